"""Parameters, state, inputs and outputs of the navigation."""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

from avionics.guidance.mission import Excitation, Rally
from avionics.guidance.path import Place
from avionics.guidance.setpoint import Setpoint
from avionics.limits import clip
from avionics.messages import Mode, Stage
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.units import Quantity

TURN_BANK: Final = 0.4
"""rad; bank of a turn at a corner: below the maximum bank of every vehicle, with reserve for wind"""
SHARPEST: Final = 0.5 * math.pi
"""rad; limit of the corner angle in the computation of the turning distance"""
WIND_TIME: Final = 20.0
"""s; time constant of the mean wind: about one turn of a circle, over which errors of airspeed and heading cancel"""
FASTEST_DRIFT: Final = 2.0
"""-; limit of the ratio of ground speed to airspeed in a tailwind"""


class Gains(NamedTuple):
    """Parameters of the navigation."""

    lookahead: Annotated[float, Quantity("m", 1.0, 500.0)]
    """m; distance ahead on the path at which the course aims, in still air"""
    acceptance: Annotated[float, Quantity("m", 0.5, 200.0)]
    """m; radius at which a waypoint counts as reached"""
    capture_altitude: Annotated[float, Quantity("m", 0.1, 50.0)]
    """m; altitude error at which a takeoff or a climb on a circle is complete and the time of a hold begins"""
    capture_heading: Annotated[float, Quantity("rad", 0.02, 3.2)]
    """rad; heading error at which the time of a hold begins"""
    capture_limit: Annotated[float, Quantity("s", 0.0, 600.0)]
    """s; maximum delay of the start of a hold"""
    return_altitude: Annotated[float, Quantity("m", 2.0, 1000.0)]
    """m; altitude of the return"""
    return_floor: Annotated[float, Quantity("m", 0.0, 1000.0)]
    """m; altitude below which a return, or a circle of a failsafe, starts with a straight climb, wings level"""
    loiter_radius: Annotated[float, Quantity("m", 3.0, 500.0)]
    """m; radius of the circle at home and of circles without a specified radius"""
    loiter_time: Annotated[float, Quantity("s", 0.0, 36000.0)]
    """s; time on the circle at home before landing"""
    approach_length: Annotated[float, Quantity("m", 5.0, 2000.0)]
    """m; length of the straight glide path to the landing point, in still air"""
    approach_altitude: Annotated[float, Quantity("m", 2.0, 300.0)]
    """m; altitude at the start of the glide path"""
    approach_margin: Annotated[float, Quantity("m", 0.1, 100.0)]
    """m; maximum altitude above the start of the glide path; at higher altitudes a circle is flown first"""
    flare_altitude: Annotated[float, Quantity("m", 0.0, 30.0)]
    """m; altitude below which the sink rate is reduced for the flare"""
    flare_sink: Annotated[float, Quantity("m/s", 0.05, 5.0)]
    """m/s; maximum sink at and below the altitude of the landing point"""
    flare_time: Annotated[float, Quantity("s", 0.1, 30.0)]
    """s; altitude per increase of the maximum sink: the time constant of the flare"""
    flare_throttle: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; throttle trim during the flare; below level flight, so that the vehicle decelerates"""
    flare_pitch: Annotated[float, Quantity("rad", -0.5, 1.2)]
    """rad; minimum pitch setpoint in the flare"""
    stick_climb: Annotated[float, Quantity("m/s", 0.0, 10.0)]
    """m/s; rate of the altitude setpoint at full pitch stick (altitude hold)"""
    stick_dead_band: Annotated[float, Quantity("-", 0.0, 0.5)]
    """-; dead band of the sticks"""
    approach_airspeed: Annotated[float, Quantity("m/s", 1.0, 50.0)] = 8.0
    """m/s; true airspeed on the glide path"""
    flare_reach: Annotated[float, Quantity("m", 0.0, 1000.0)] = 0.0
    """m; distance from the end of the glide path, at ground level, to the touchdown in still air"""
    launch_height: Annotated[float, Quantity("m", 0.0, 20.0)] = 0.0
    """m; height above the ground at which the vehicle is armed, the origin of the altitude: the flare goes by the
    ground. Default: a launch from the ground"""
    offboard_timeout: Annotated[float, Quantity("s", 0.1, 60.0)] = 1.0
    """s; maximum age of an OFFBOARD setpoint, after which the mode changes to LOITER (PX4: COM_OF_LOSS_T). Default:
    as COM_OF_LOSS_T of PX4"""
    return_type: Annotated[int, Quantity("-", 0, 2)] = 0
    """-; landing of a RETURN if the mission has a DO_LAND_START: 0 at home or the rally point, 1 by the landing
    sequence after the circle there, 2 by the landing sequence at once. Default: home is known to be clear of
    obstacles"""


class State(NamedTuple):
    """State of the navigation."""

    mode: int = Mode.MANUAL
    """-; mode of the previous step"""
    item: int = 0
    """-; index of the active mission item"""
    started: int = 0
    """-; 1 once the start of the item is stored"""
    elapsed: float = 0.0
    """s; time in the item, from its capture if it has one"""
    waiting: float = 0.0
    """s; time before the capture of a hold"""
    from_north: float = 0.0
    """m; start of the leg"""
    from_east: float = 0.0
    """m; start of the leg"""
    via: int = 0
    """-; 1 if the next leg begins at the waypoint (``from_north``, ``from_east``) instead of the present position"""
    corner: float = 0.0
    """rad; turn at the end of the leg into the next one, 0 without a next leg"""
    onward: float = 0.0
    """rad; course of the next leg"""
    heading: float = 0.0
    """rad; heading setpoint"""
    altitude: float = 0.0
    """m; altitude setpoint"""
    centre_north: float = 0.0
    """m; center of the circle"""
    centre_east: float = 0.0
    """m; center of the circle"""
    radius: float = 0.0
    """m; radius of the circle, positive clockwise"""
    bearing: float = 0.0
    """rad; bearing from the center of the circle to the vehicle at the previous step"""
    swept: float = 0.0
    """rad; angle flown around the center since the intercept, positive in the direction of the circle"""
    goal_north: float = 0.0
    """m; goal of a return: home or a rally point"""
    goal_east: float = 0.0
    """m; goal of a return"""
    goal_altitude: float = 0.0
    """m; altitude of the circle at the goal"""
    final: int = 0
    """-; 1 on the glide path"""
    flare: int = 0
    """-; 1 once the flare has begun, until the end of the item"""
    touch_north: float = 0.0
    """m; end of the glide path, one flare distance before the landing point"""
    touch_east: float = 0.0
    """m; end of the glide path"""
    slope_length: float = 0.0
    """m; length of the active glide path"""
    arrived: int = 0
    """-; 1 once the circle, the goal of the return or the start of the approach is reached"""
    excitations: int = 0
    """-; number of excitations finished at the start of the item"""
    extra: Excitation | None = None
    """-; identification input requested over the link"""
    jumps: tuple[tuple[int, int], ...] = ()
    """-; index of a jump item and number of its jumps"""
    landing: int = 0
    """-; 1 while a return lands at its goal, on the course ``heading``"""
    wind_north: float = 0.0
    """m/s; mean wind over `WIND_TIME`"""
    wind_east: float = 0.0
    """m/s; mean wind over `WIND_TIME`"""
    landing_sequence: int = 0
    """-; 1 while a RETURN flies the landing sequence of the mission"""
    airspeed: float = 0.0
    """m/s; setpoint until the mode changes, 0 for the default of the vehicle"""


class Situation(NamedTuple):
    """Inputs of the navigation."""

    mode: int
    """-; flight mode"""
    stage: int
    """-; stage of the flight"""
    north: float
    """m; from home"""
    east: float
    """m; from home"""
    valid: int
    """-; 1 while the position is valid for navigation"""
    heading: float
    """rad; controlled angle: course over ground or yaw"""
    altitude: float
    """m; positive up"""
    stick_pitch: float
    """-; from -1 to 1"""
    excitations: int
    """-; number of excitations finished since boot"""
    airspeed: float = 0.0
    """m/s; true airspeed, 0 if unknown"""
    ground_speed: float = 0.0
    """m/s; 0 if unknown"""
    wind_north: float = 0.0
    """m/s; wind velocity over ground, 0 if unknown"""
    wind_east: float = 0.0
    """m/s; wind velocity over ground, 0 if unknown"""
    rally: Rally = ()
    """-; rally points, alternatives to home"""
    ceiling: float = math.inf
    """m; maximum altitude selected by the navigation: ceiling of the fence minus its margin"""
    rescued: int = 0
    """-; 1 while the mode was entered by a failsafe"""
    setpoint: Setpoint | None = None
    """-; setpoint of OFFBOARD, from `offboard.resolve`"""
    terrain: float = 0.0
    """m; altitude of the ground below the vehicle"""
    mission_allowed: int = 1
    """-; 0 while an item of the mission is outside the plan's fence"""


class Target(NamedTuple):
    """Output of the navigation: setpoints of the inner loops."""

    stage: Stage
    """-; flight stage"""
    altitude: float
    """m; positive up"""
    heading: float
    """rad; course setpoint"""
    distance: float = 0.0
    """m; distance to the position of the item"""
    cross_track: float = 0.0
    """m; distance from the leg, positive to its right; distance from a circle, positive outside"""
    curvature: float = 0.0
    """1/m; curvature of the path, positive to the right, for the feed-forward bank"""
    excitation: Excitation | None = None
    """-; active identification input"""


def here(situation: Situation) -> Place:
    """Return north and east (m) of the vehicle."""
    return situation.north, situation.east


def least_altitude(gains: Gains, ceiling: float) -> float:
    """Return the altitude (m) below which neither a circle nor a return begins.

    A low ``ceiling`` (m) lowers it.
    """
    return min(gains.return_floor, ceiling - gains.capture_altitude)


def climb_ahead(gains: Gains, state: State, altitude: float, situation: Situation) -> Target:
    """Climb to ``altitude`` (m) on the present heading setpoint.

    The wings stay level, because a bank close to the ground would cause a wing strike.
    """
    return Target(Stage.EN_ROUTE, min(altitude, situation.ceiling), state.heading)


def below_ceiling(target: Target, situation: Situation) -> Target:
    """Return ``target`` with its altitude limited to the ceiling."""
    return target if target.altitude <= situation.ceiling else target._replace(altitude=situation.ceiling)


def lookahead(gains: Gains, situation: Situation) -> float:
    """Return the lookahead distance (m), longer in a tailwind.

    The heading loop turns the course at a rate k that is independent of the wind (`heading.step`). The cross-track
    error is then a second-order mode with frequency sqrt(k V / L) and damping sqrt(k L / V) / 2 at the ground speed
    V. Both are constant if L is proportional to V.
    """
    if situation.airspeed <= 1.0:
        return gains.lookahead
    return gains.lookahead * clip(situation.ground_speed / situation.airspeed, 1.0, FASTEST_DRIFT)


def turning_distance(gains: Gains, state: State, situation: Situation) -> float:
    """Return the distance (m) before the end of a leg at which the turn begins.

    The distance is R tan(turn / 2). The radius R follows from the larger ground speed, before or after the turn. It
    is limited to the loiter radius, because gusts disturb the measured airspeed.
    """
    if state.corner == 0.0:
        return 0.0
    after = situation.airspeed + tailwind(situation, state.onward)
    radius = max(situation.ground_speed, after) ** 2 / (STANDARD_GRAVITY * math.tan(TURN_BANK))
    return min(radius * math.tan(0.5 * min(abs(state.corner), SHARPEST)), gains.loiter_radius)


def tailwind(situation: Situation, course: float) -> float:
    """Return the wind (m/s) along ``course`` (rad), positive from behind."""
    return situation.wind_north * math.cos(course) + situation.wind_east * math.sin(course)
