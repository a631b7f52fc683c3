"""Navigation: altitude and course setpoints from mission items and mode.

Each kind of item has one function that returns its target and whether the item is complete. To add a kind, declare it
in `mission.ItemKind`, write its function and enter it in ``ITEMS``. Lines and circles are in `path`, the other parts
in `items`, `circle`, `homing` and `approach`; `survey` computes the legs of a survey when its file is read.
"""

from __future__ import annotations

from typing import Final

from avionics.guidance import approach, circle, homing, items, offboard
from avionics.guidance.mission import INSTANT, Excitation, ItemKind, Mission, MissionItem, landing_sequence
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

__all__: Final = [
    "Gains",
    "Situation",
    "State",
    "Target",
    "begin_item",
    "change_airspeed",
    "change_altitude",
    "choose_item",
    "excite",
    "loiter_at",
    "step",
]

ITEMS: Final[dict[ItemKind, items.ItemFunction]] = {
    ItemKind.TAKEOFF: items.take_off,
    ItemKind.HOLD: items.hold_heading,
    ItemKind.WAYPOINT: items.waypoint,
    ItemKind.EXCITE: items.excite,
    ItemKind.LOITER: circle.item,
    ItemKind.CIRCLE: circle.item,
    ItemKind.RETURN: homing.return_home,
    ItemKind.LAND: approach.land,
}
CHOOSING = (ItemKind.RETURN, ItemKind.LAND)
"""items with altitudes selected by the vehicle"""
AT_ONCE: Final = 2
"""value of `Gains.return_type`: a RETURN flies the landing sequence instead of the return to home"""
RETURN_ITEM: Final = MissionItem(ItemKind.RETURN)


def step(gains: Gains, state: State, dt: float, mission: Mission, situation: Situation) -> tuple[State, Target]:
    """Advance the navigation by ``dt`` (s).

    A change of mode starts at the present position, course and altitude. Altitudes of mission items and sticks may
    exceed the ceiling of the fence; altitudes selected by the navigation are limited to it.
    """
    state = _with_wind(state, dt, situation)
    if situation.mode != state.mode:
        state = _enter_mode(gains, state, situation)
    if situation.mode == Mode.AUTO:
        return _automatic(gains, state, dt, mission, situation)
    if situation.mode == Mode.RETURN:
        return _return(gains, state, dt, mission, situation)
    if situation.mode == Mode.LAND:
        state, target = approach.down_the_line(gains, state, state.heading, situation)
        return state, below_ceiling(target, situation)
    if situation.mode == Mode.LOITER:
        return _loiter(gains, state, dt, situation)
    if situation.mode == Mode.OFFBOARD and situation.setpoint is not None:
        return offboard.fly(gains, state, dt, situation.setpoint, situation)
    return _piloted(gains, state, dt, situation)


def _with_wind(state: State, dt: float, now: Situation) -> State:
    """Return ``state`` with the low-passed wind estimate."""
    north = low_pass(state.wind_north, now.wind_north, WIND_TIME, dt)
    return state._replace(wind_north=north, wind_east=low_pass(state.wind_east, now.wind_east, WIND_TIME, dt))


def begin_item(gains: Gains, state: State, item: int, situation: Situation) -> State:
    """Begin ``item`` at the present position, course and altitude."""
    start = (state.from_north, state.from_east) if state.via else (situation.north, situation.east)
    started = state._replace(
        item=item,
        started=1,
        elapsed=0.0,
        waiting=0.0,
        from_north=start[0],
        from_east=start[1],
        via=0,
        heading=situation.heading,
        altitude=situation.altitude,
        radius=0.0,
        final=0,
        flare=0,
        arrived=0,
        landing=0,
        excitations=situation.excitations,
    )
    return homing.begin(gains, started, situation)


def choose_item(state: State, item: int) -> State:
    """Select ``item`` as the next one; jump counts are reset.

    The item begins at the position of the vehicle at that time.
    """
    return state._replace(item=item, started=0, via=0, jumps=(), landing_sequence=0)


def excite(state: State, excitation: Excitation | None, situation: Situation) -> State:
    """Start an identification input at the present heading and altitude."""
    return state._replace(
        extra=excitation,
        heading=situation.heading,
        altitude=situation.altitude,
        excitations=situation.excitations,
        elapsed=0.0,
    )


def loiter_at(gains: Gains, state: State, requested: MissionItem, situation: Situation) -> State:
    """Circle at the position, altitude and radius of ``requested`` in the mode LOITER."""
    started = begin_item(gains, state._replace(via=0), state.item, situation)
    started = started._replace(mode=int(Mode.LOITER), extra=None, altitude=requested.altitude)
    return circle.centre_at(
        started, requested.north, requested.east, requested.radius or gains.loiter_radius, situation
    )


def change_altitude(gains: Gains, state: State, altitude: float, situation: Situation) -> State:
    """Set the altitude to ``altitude`` (m above home) on the present circle or course."""
    if situation.mode != state.mode:
        state = _enter_mode(gains, state, situation)
    return state._replace(altitude=altitude)


def change_airspeed(gains: Gains, state: State, airspeed: float, situation: Situation) -> State:
    """Fly at ``airspeed`` (m/s; 0 for the default) until the mode changes."""
    if situation.mode != state.mode:
        state = _enter_mode(gains, state, situation)
    return state._replace(airspeed=airspeed)


def _enter_mode(gains: Gains, state: State, situation: Situation) -> State:
    state = begin_item(gains, state._replace(via=0), state.item, situation)
    state = state._replace(mode=situation.mode, extra=None, airspeed=0.0, landing_sequence=0)
    if situation.mode == Mode.LAND:
        return approach.land_ahead(gains, state, situation)
    if situation.mode == Mode.LOITER and not (
        situation.rescued and situation.altitude < least_altitude(gains, situation.ceiling)
    ):
        return circle.tangent_circle_center(state, gains.loiter_radius, situation)
    return state


def _loiter(gains: Gains, state: State, dt: float, situation: Situation) -> tuple[State, Target]:
    """Circle; climb straight ahead first if a failsafe began at a low altitude.

    The radius is 0 until the circle is defined.
    """
    if state.radius != 0.0:
        state, target = circle.around(gains, state, dt, state.altitude, situation)
        return state, below_ceiling(target, situation) if situation.rescued else target
    floor = least_altitude(gains, situation.ceiling)
    state = state._replace(altitude=floor + gains.capture_altitude)
    if situation.altitude < floor:
        return state, climb_ahead(gains, state, state.altitude, situation)
    return circle.around(
        gains, circle.tangent_circle_center(state, gains.loiter_radius, situation), dt, state.altitude, situation
    )


def _automatic(gains: Gains, state: State, dt: float, mission: Mission, situation: Situation) -> tuple[State, Target]:
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, situation)
    state = _jump(state, mission)
    if state.item >= len(mission):
        return _return_to_launch(gains, state._replace(airspeed=0.0), dt, situation)
    if not state.started or situation.stage == Stage.WAIT_LAUNCH:
        state = _begin_keeping_setpoints(gains, state, mission, situation)
    item = mission[state.item]
    if item.here:
        item = item._replace(north=state.from_north, east=state.from_east)
        if item.kind == ItemKind.LAND and item.heading == 0.0:
            item = item._replace(heading=state.heading)
    state, target, done = ITEMS[item.kind](gains, state, dt, item, situation)
    if item.kind in CHOOSING:
        target = below_ceiling(target, situation)
    if done and situation.stage != Stage.WAIT_LAUNCH:
        state = _finish(state, item, target)
        if item.kind == ItemKind.RETURN and state.item >= len(mission):
            state = homing.begin_landing(state, situation)
    return state, target


def _finish(state: State, item: MissionItem, target: Target) -> State:
    """Proceed to the next item; the leg after a waypoint begins at the waypoint."""
    state = state._replace(heading=target.heading, altitude=target.altitude, started=0, item=state.item + 1, via=0)
    if item.kind != ItemKind.WAYPOINT or item.duration > 0.0:
        return state
    return state._replace(via=1, from_north=item.north, from_east=item.east)


def _jump(state: State, mission: Mission) -> State:
    """Execute jump and speed items up to the next item to fly.

    A mission that contains only jumps is complete.
    """
    for _ in mission:
        item = state.item
        airspeed = state.airspeed
        while item < len(mission) and mission[item].kind in INSTANT:
            if mission[item].kind == ItemKind.SPEED:
                airspeed = mission[item].airspeed
            item += 1
        if item != state.item:
            state = state._replace(item=item, started=0, airspeed=airspeed)
        if state.item >= len(mission) or mission[state.item].kind != ItemKind.JUMP:
            return state
        jump, counts = mission[state.item], dict(state.jumps)
        done = counts.get(state.item, 0)
        if 0 <= jump.repeats <= done:
            state = state._replace(item=state.item + 1)
            continue
        counts[state.item] = done + 1
        state = state._replace(item=jump.jump_to, started=0, jumps=tuple(counts.items()))
    return state._replace(item=len(mission))


def _begin_keeping_setpoints(gains: Gains, state: State, mission: Mission, situation: Situation) -> State:
    """Begin an item; an excitation keeps the setpoints of the item before it.

    This prevents frozen errors in the trim of the excitation.
    """
    started = _with_corner(begin_item(gains, state, state.item, situation), mission)
    after_another = state.item > 0 and mission[state.item].kind == ItemKind.EXCITE and state.altitude > 0.0
    return started._replace(heading=state.heading, altitude=state.altitude) if after_another else started


def _with_corner(state: State, mission: Mission) -> State:
    """Store the turn into the leg after this one, if there is one."""
    item = mission[state.item]
    following = next((each for each in mission[state.item + 1 :] if each.kind not in INSTANT), None)
    legs = following is not None and item.kind == following.kind == ItemKind.WAYPOINT
    if following is None or not legs or item.here or following.here:
        return state._replace(corner=0.0)
    place = (item.north, item.east)
    onward = leg(place, (following.north, following.east), place).course
    course = leg((state.from_north, state.from_east), place, place).course
    return state._replace(corner=wrap(onward - course), onward=onward)


def _extra_excitation(gains: Gains, state: State, dt: float, situation: Situation) -> tuple[State, Target]:
    item = MissionItem(ItemKind.EXCITE, excitation=state.extra)
    state, target, done = items.excite(gains, state, dt, item, situation)
    if done:
        state = begin_item(gains, state, state.item, situation)._replace(extra=None)
    return state, target


def _return(gains: Gains, state: State, dt: float, mission: Mission, situation: Situation) -> tuple[State, Target]:
    """Fly a RETURN to home or by the landing sequence (`Gains.return_type`)."""
    if state.landing_sequence:
        return _automatic(gains, state, dt, mission, situation)
    was_landing = state.landing
    state, target = _return_to_launch(gains, state, dt, situation)
    allowed = gains.return_type and situation.valid and situation.mission_allowed and not was_landing
    start = landing_sequence(mission) if allowed else None
    at_once = gains.return_type == AT_ONCE and situation.altitude >= least_altitude(gains, situation.ceiling)
    if start is not None and (at_once or state.landing):
        state = choose_item(state, start)._replace(landing=0, landing_sequence=1)
    return state, target


def _return_to_launch(gains: Gains, state: State, dt: float, situation: Situation) -> tuple[State, Target]:
    """Fly home, circle there and land."""
    if not (state.started or state.final):
        state = begin_item(gains, state._replace(via=0), state.item, situation)
    if state.landing:
        state, target = homing.land(gains, state, dt, situation)
        return state, below_ceiling(target, situation)
    state, target, done = homing.return_home(gains, state, dt, RETURN_ITEM, situation)
    if done:
        state = homing.begin_landing(state, situation)
    return state, below_ceiling(target, situation)


def _piloted(gains: Gains, state: State, dt: float, situation: Situation) -> tuple[State, Target]:
    """Fly ALTITUDE_HOLD: the pitch stick changes the altitude setpoint.

    Other modes use their sticks directly.
    """
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, situation)
    stick = situation.stick_pitch if abs(situation.stick_pitch) > gains.stick_dead_band else 0.0
    state = state._replace(altitude=state.altitude + gains.stick_climb * stick * dt)
    return state, Target(Stage.EN_ROUTE, state.altitude, state.heading)
