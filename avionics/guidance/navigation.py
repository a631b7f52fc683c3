"""Navigation: from the mission's items and the mode to an altitude and a course to fly.

One function per kind of item; each returns the target it asks for and whether the item is done. To add a
kind: declare it in `mission.ItemKind`, write its function, enter it in ``ITEMS``. Lines and circles are in `path`,
the other parts in `items`, `circle`, `homing`, `approach`; a survey is laid out by `survey` when its file is read.
"""

from __future__ import annotations

from avionics.guidance import approach, circle, homing, items, offboard
from avionics.guidance.mission import Excitation, ItemKind, Mission, MissionItem
from avionics.guidance.path import leg
from avionics.guidance.route import (
    WIND_TIME,
    Gains,
    Situation,
    State,
    Target,
    below_ceiling,
    climb_ahead,
    least_altitude,
)
from avionics.limits import low_pass, wrap
from avionics.messages import Mode, Stage

__all__ = [
    "Gains",
    "Situation",
    "State",
    "Target",
    "begin_item",
    "change_altitude",
    "choose_item",
    "excite",
    "loiter_at",
    "step",
]

ITEMS: dict[ItemKind, items.ItemFunction] = {
    ItemKind.TAKEOFF: items.take_off,
    ItemKind.HOLD: items.hold,
    ItemKind.WAYPOINT: items.waypoint,
    ItemKind.EXCITE: items.excite,
    ItemKind.LOITER: circle.item,
    ItemKind.CIRCLE: circle.item,
    ItemKind.RETURN: homing.return_home,
    ItemKind.LAND: approach.land,
}
CHOOSING = (ItemKind.RETURN, ItemKind.LAND)
"""items whose altitudes are the vehicle's choice"""
GO_HOME = MissionItem(ItemKind.RETURN)


def step(gains: Gains, state: State, dt: float, mission: Mission, seen: Situation) -> tuple[State, Target]:
    """One step; ``dt`` in s. A change of mode takes the present place, course and altitude as its start.

    What a mission's items or a stick ask for may be above the fence, what is chosen here may not.
    """
    state = _with_wind(state, dt, seen)
    if seen.mode != state.mode:
        state = _enter_mode(gains, state, seen)
    if seen.mode == Mode.AUTO:
        return _automatic(gains, state, dt, mission, seen)
    if seen.mode == Mode.RETURN:
        return _going_home(gains, state, dt, seen)
    if seen.mode == Mode.LAND:
        state, target = approach.down_the_line(gains, state, state.heading, seen)
        return state, below_ceiling(target, seen)
    if seen.mode == Mode.LOITER:
        return _loiter(gains, state, dt, seen)
    if seen.mode == Mode.OFFBOARD and seen.setpoint is not None:
        return offboard.fly(gains, state, dt, seen.setpoint, seen)
    return _piloted(gains, state, dt, seen)


def _with_wind(state: State, dt: float, now: Situation) -> State:
    """``state`` with the mean of the estimated wind, which follows every gust."""
    north = low_pass(state.wind_north, now.wind_north, WIND_TIME, dt)
    return state._replace(wind_north=north, wind_east=low_pass(state.wind_east, now.wind_east, WIND_TIME, dt))


def begin_item(gains: Gains, state: State, item: int, seen: Situation) -> State:
    """Make ``item`` the present one, starting here, on the course flown, at the altitude flown."""
    start = (state.from_north, state.from_east) if state.via else (seen.north, seen.east)
    begun = state._replace(
        item=item,
        begun=1,
        elapsed=0.0,
        waiting=0.0,
        from_north=start[0],
        from_east=start[1],
        via=0,
        heading=seen.heading,
        altitude=seen.altitude,
        radius=0.0,
        final=0,
        flare=0,
        arrived=0,
        landing=0,
        excitations=seen.excitations,
    )
    return homing.begin(gains, begun, seen)


def choose_item(state: State, item: int) -> State:
    """Make ``item`` the next one to be begun, from wherever it is then; jumps are counted anew."""
    return state._replace(item=item, begun=0, via=0, jumps=())


def excite(state: State, excitation: Excitation | None, seen: Situation) -> State:
    """Fly an identification input now, on the present heading and at the present altitude."""
    return state._replace(
        extra=excitation, heading=seen.heading, altitude=seen.altitude, excitations=seen.excitations, elapsed=0.0
    )


def loiter_at(gains: Gains, state: State, wanted: MissionItem, seen: Situation) -> State:
    """Circle at the place, altitude and radius of ``wanted`` from now on, in the mode LOITER."""
    begun = begin_item(gains, state._replace(via=0), state.item, seen)
    begun = begun._replace(mode=int(Mode.LOITER), extra=None, altitude=wanted.altitude)
    return circle.centre_at(begun, wanted.north, wanted.east, wanted.radius or gains.loiter_radius, seen)


def change_altitude(gains: Gains, state: State, altitude: float, situation: Situation) -> State:
    """Hold ``altitude`` (m above home) from now on, on the present circle or course."""
    if situation.mode != state.mode:
        state = _enter_mode(gains, state, situation)
    return state._replace(altitude=altitude)


def _enter_mode(gains: Gains, state: State, seen: Situation) -> State:
    state = begin_item(gains, state._replace(via=0), state.item, seen)._replace(mode=seen.mode, extra=None)
    if seen.mode == Mode.LAND:
        return approach.land_ahead(gains, state, seen)
    if seen.mode == Mode.LOITER and not (seen.rescued and seen.altitude < least_altitude(gains, seen.ceiling)):
        return circle.centre_beside(state, gains.loiter_radius, seen)
    return state


def _loiter(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    """Circle; where a failsafe found it low (no circle was laid, radius 0) climb straight ahead first."""
    if state.radius != 0.0:
        state, target = circle.around(gains, state, dt, state.altitude, seen)
        return state, below_ceiling(target, seen) if seen.rescued else target
    floor = least_altitude(gains, seen.ceiling)
    state = state._replace(altitude=floor + gains.capture_altitude)
    if seen.altitude < floor:
        return state, climb_ahead(gains, state, state.altitude, seen)
    return circle.around(gains, circle.centre_beside(state, gains.loiter_radius, seen), dt, state.altitude, seen)


def _automatic(gains: Gains, state: State, dt: float, mission: Mission, seen: Situation) -> tuple[State, Target]:
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, seen)
    state = _jump(state, mission)
    if state.item >= len(mission):
        return _going_home(gains, state, dt, seen)
    if not state.begun or seen.stage == Stage.WAIT_LAUNCH:
        state = _begin_keeping_setpoints(gains, state, mission, seen)
    item = mission[state.item]
    if item.here:
        item = item._replace(north=state.from_north, east=state.from_east)
        if item.kind == ItemKind.LAND and item.heading == 0.0:
            item = item._replace(heading=state.heading)
    state, target, done = ITEMS[item.kind](gains, state, dt, item, seen)
    if item.kind in CHOOSING:
        target = below_ceiling(target, seen)
    if done and seen.stage != Stage.WAIT_LAUNCH:
        state = _finish(state, item, target)
        if item.kind == ItemKind.RETURN and state.item >= len(mission):
            state = homing.begin_landing(state, seen)
    return state, target


def _finish(state: State, item: MissionItem, target: Target) -> State:
    """Go on with the next item; the leg after a waypoint begins at the waypoint, not at the cut corner."""
    state = state._replace(heading=target.heading, altitude=target.altitude, begun=0, item=state.item + 1, via=0)
    if item.kind != ItemKind.WAYPOINT or item.duration > 0.0:
        return state
    return state._replace(via=1, from_north=item.north, from_east=item.east)


def _jump(state: State, mission: Mission) -> State:
    """Follow jump items until there is one to fly; a mission of nothing but jumps is at its end."""
    for _ in mission:
        item = state.item
        while item < len(mission) and mission[item].kind == ItemKind.SKIP:
            item += 1
        if item != state.item:
            state = state._replace(item=item, begun=0)
        if state.item >= len(mission) or mission[state.item].kind != ItemKind.JUMP:
            return state
        jump, counts = mission[state.item], dict(state.jumps)
        done = counts.get(state.item, 0)
        if 0 <= jump.repeats <= done:
            state = state._replace(item=state.item + 1)
            continue
        counts[state.item] = done + 1
        state = state._replace(item=jump.jump_to, begun=0, jumps=tuple(counts.items()))
    return state._replace(item=len(mission))


def _begin_keeping_setpoints(gains: Gains, state: State, mission: Mission, seen: Situation) -> State:
    """An excitation holds the setpoints of the item before it, so that no error is frozen into its trim."""
    begun = _with_corner(begin_item(gains, state, state.item, seen), mission)
    after_another = state.item > 0 and mission[state.item].kind == ItemKind.EXCITE and state.altitude > 0.0
    return begun._replace(heading=state.heading, altitude=state.altitude) if after_another else begun


def _with_corner(state: State, mission: Mission) -> State:
    """Look ahead to the leg after this one, if there is one."""
    item = mission[state.item]
    following = next((each for each in mission[state.item + 1 :] if each.kind != ItemKind.SKIP), None)
    legs = following is not None and item.kind == following.kind == ItemKind.WAYPOINT
    if following is None or not legs or item.here or following.here:
        return state._replace(corner=0.0)
    place = (item.north, item.east)
    onward = leg(place, (following.north, following.east), place).course
    course = leg((state.from_north, state.from_east), place, place).course
    return state._replace(corner=wrap(onward - course), onward=onward)


def _extra_excitation(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    item = MissionItem(ItemKind.EXCITE, excitation=state.extra)
    state, target, done = items.excite(gains, state, dt, item, seen)
    if done:
        state = begin_item(gains, state, state.item, seen)._replace(extra=None)
    return state, target


def _going_home(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    """Home, a loiter, then the landing there."""
    if not (state.begun or state.final):
        state = begin_item(gains, state._replace(via=0), state.item, seen)
    if state.landing:
        state, target = homing.land(gains, state, dt, seen)
        return state, below_ceiling(target, seen)
    state, target, done = homing.return_home(gains, state, dt, GO_HOME, seen)
    if done:
        state = homing.begin_landing(state, seen)
    return state, below_ceiling(target, seen)


def _piloted(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    """Altitude hold: the pitch stick moves the altitude that is held; other modes use their sticks directly."""
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, seen)
    stick = seen.stick_pitch if abs(seen.stick_pitch) > gains.stick_dead_band else 0.0
    state = state._replace(altitude=state.altitude + gains.stick_climb * stick * dt)
    return state, Target(Stage.EN_ROUTE, state.altitude, state.heading)
