"""What the navigation is tuned with, remembers, looks at and asks for; shared by the files of its parts."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.guidance.mission import Excitation, Rally
from avionics.guidance.path import Place
from avionics.guidance.setpoint import Setpoint
from avionics.limits import clip
from avionics.messages import Mode, Stage
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.units import Quantity

TURN_BANK = 0.4
"""rad; with which a corner is flown: short of every vehicle's greatest bank, to have some left for the wind"""
SHARPEST = 0.5 * math.pi
"""rad; a sharper corner is begun no earlier than this one"""
WIND_TIME = 20.0
"""s; time constant of the mean wind: about one turn of a circle, over which errors of airspeed and heading cancel"""
FASTEST_DRIFT = 2.0
"""-; greatest ground speed, in units of the airspeed, that a following wind is believed to give"""


class Gains(NamedTuple):
    """What the navigation is tuned with."""

    lookahead: Annotated[float, Quantity("m", 1.0, 500.0)]
    """m; distance ahead on the path at which the course aims, in still air"""
    acceptance: Annotated[float, Quantity("m", 0.5, 200.0)]
    """m; radius at which a waypoint counts as reached"""
    capture_altitude: Annotated[float, Quantity("m", 0.1, 50.0)]
    """m; altitude error at which a take-off or a climb on a circle is over and the time of a hold begins"""
    capture_heading: Annotated[float, Quantity("rad", 0.02, 3.2)]
    """rad; heading error at which the time of a hold begins"""
    capture_limit: Annotated[float, Quantity("s", 0.0, 600.0)]
    """s; after which the time of a hold begins anyway"""
    return_altitude: Annotated[float, Quantity("m", 2.0, 1000.0)]
    """m; safe altitude of the way home"""
    return_floor: Annotated[float, Quantity("m", 0.0, 1000.0)]
    """m; a return, or a circle that a failsafe asks for, from below it first climbs straight ahead, wings level"""
    loiter_radius: Annotated[float, Quantity("m", 3.0, 500.0)]
    """m; of the circle flown at home, and of every circle that names no radius"""
    loiter_time: Annotated[float, Quantity("s", 0.0, 36000.0)]
    """s; circled at home before landing"""
    approach_length: Annotated[float, Quantity("m", 5.0, 2000.0)]
    """m; of the straight line down to the landing place, in still air"""
    approach_altitude: Annotated[float, Quantity("m", 2.0, 300.0)]
    """m; at which that line begins"""
    approach_margin: Annotated[float, Quantity("m", 0.1, 100.0)]
    """m; above the head of the line from which it may be begun; from higher a circle is flown there first"""
    flare_altitude: Annotated[float, Quantity("m", 0.0, 30.0)]
    """m; below which the sink dies out towards the ground"""
    flare_sink: Annotated[float, Quantity("m/s", 0.05, 5.0)]
    """m/s; greatest sink at the landing place's altitude and below it"""
    flare_time: Annotated[float, Quantity("s", 0.1, 30.0)]
    """s; altitude per greatest sink beyond that: the time constant of the round-out"""
    flare_throttle: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; in the flare while the sink is as asked: less than level flight needs, so that it slows down"""
    flare_pitch: Annotated[float, Quantity("rad", -0.5, 1.2)]
    """rad; least pitch setpoint in the flare"""
    stick_climb: Annotated[float, Quantity("m/s", 0.0, 10.0)]
    """m/s; change of the held altitude at full pitch stick (altitude hold)"""
    stick_dead_band: Annotated[float, Quantity("-", 0.0, 0.5)]
    """-; stick that counts as centred"""
    approach_airspeed: Annotated[float, Quantity("m/s", 1.0, 50.0)] = 8.0
    """m/s; true airspeed on the line down to the landing place"""
    flare_reach: Annotated[float, Quantity("m", 0.0, 1000.0)] = 0.0
    """m; from the end of that line, where it meets the ground, to the touchdown in still air"""
    offboard_timeout: Annotated[float, Quantity("s", 0.1, 60.0)] = 1.0
    """s; greatest age of a setpoint of OFFBOARD, after which the mode changes to LOITER (PX4: COM_OF_LOSS_T).
    Default: as COM_OF_LOSS_T of PX4"""
    return_type: Annotated[int, Quantity("-", 0, 2)] = 0
    """-; landing of a RETURN if the mission has a DO_LAND_START: 0 at home or the rally point, 1 by the mission's
    landing sequence after the circle there, 2 by the landing sequence at once.
    Default: home is known to be clear of obstacles"""


class State(NamedTuple):
    """What the navigation remembers."""

    mode: int = Mode.MANUAL
    """-; mode of the last step"""
    item: int = 0
    """-; mission item being flown"""
    started: int = 0
    """-; 1 once the item's start has been taken"""
    elapsed: float = 0.0
    """s; in the item, from its capture if it has one"""
    waiting: float = 0.0
    """s; for the capture of a hold"""
    from_north: float = 0.0
    """m; where the leg begins"""
    from_east: float = 0.0
    """m; where the leg begins"""
    via: int = 0
    """-; 1 when the next leg begins at the waypoint just passed, (``from_north``, ``from_east``), not where it is"""
    corner: float = 0.0
    """rad; turn at the end of the leg into the next one, 0 where none follows"""
    onward: float = 0.0
    """rad; course of the next leg"""
    heading: float = 0.0
    """rad; heading held"""
    altitude: float = 0.0
    """m; altitude held"""
    centre_north: float = 0.0
    """m; of the circle flown"""
    centre_east: float = 0.0
    """m; of the circle flown"""
    radius: float = 0.0
    """m; of the circle flown, positive clockwise"""
    bearing: float = 0.0
    """rad; from the circle's centre to the aircraft at the last step"""
    swept: float = 0.0
    """rad; flown around the centre since the circle was joined, positive in its direction"""
    goal_north: float = 0.0
    """m; where a return goes to: home or a rally point"""
    goal_east: float = 0.0
    """m; where a return goes to"""
    goal_altitude: float = 0.0
    """m; at which it is circled there"""
    final: int = 0
    """-; 1 on the straight line down"""
    flare: int = 0
    """-; 1 once the flare has begun; it is not left again"""
    touch_north: float = 0.0
    """m; end of the line down, `flare_distance` before the landing place"""
    touch_east: float = 0.0
    """m; end of the line down"""
    slope_length: float = 0.0
    """m; of the line down, once it is being flown"""
    arrived: int = 0
    """-; 1 once the circle of the item was joined, the return is over its goal, or the head of the approach met"""
    excitations: int = 0
    """-; excitations that were finished when the item began"""
    extra: Excitation | None = None
    """-; an identification input asked for over the link"""
    jumps: tuple[tuple[int, int], ...] = ()
    """-; number of a jump item, and how often it has jumped"""
    landing: int = 0
    """-; 1 while a return lands at its goal, on the course ``heading``"""
    wind_north: float = 0.0
    """m/s; mean wind over `WIND_TIME`"""
    wind_east: float = 0.0
    """m/s; mean wind over `WIND_TIME`"""
    landing_sequence: int = 0
    """-; 1 while a RETURN flies the landing sequence of the mission"""
    airspeed: float = 0.0
    """m/s; setpoint until the mode changes, 0 for the vehicle's own"""


class Situation(NamedTuple):
    """What the navigation looks at."""

    mode: int
    """-; flight mode"""
    stage: int
    """-; stage of the flight"""
    north: float
    """m; from home"""
    east: float
    """m; from home"""
    valid: int
    """-; 1 while the position can be steered by"""
    heading: float
    """rad; course over ground or yaw, whichever is steered"""
    altitude: float
    """m; positive up"""
    stick_pitch: float
    """-; -1 to 1"""
    excitations: int
    """-; excitations finished since boot"""
    airspeed: float = 0.0
    """m/s; true, 0 while unknown"""
    ground_speed: float = 0.0
    """m/s; 0 while unknown"""
    wind_north: float = 0.0
    """m/s; velocity of the air over ground, 0 while unknown"""
    wind_east: float = 0.0
    """m/s; velocity of the air over ground, 0 while unknown"""
    rally: Rally = ()
    """-; places to return to instead of home"""
    ceiling: float = math.inf
    """m; greatest altitude to ask for where the navigation chooses it: the fence's, less its margin"""
    rescued: int = 0
    """-; 1 while the mode is one that a failsafe took"""
    setpoint: Setpoint | None = None
    """-; of OFFBOARD, from `offboard.resolve`"""
    terrain: float = 0.0
    """m; altitude of the ground below the vehicle"""
    mission_allowed: int = 1
    """-; 0 while an item of the mission is outside the plan's fence"""


class Target(NamedTuple):
    """What the navigation asks of the loops below."""

    stage: Stage
    """-; the stage this belongs to"""
    altitude: float
    """m; positive up"""
    heading: float
    """rad; course to fly"""
    distance: float = 0.0
    """m; to the item's place"""
    cross_track: float = 0.0
    """m; off the leg, positive to the right of it; off a circle, positive outside"""
    curvature: float = 0.0
    """1/m; of the path flown, positive to the right: the bank of a circle is known without an error"""
    excitation: Excitation | None = None
    """-; identification input to fly now"""


def here(situation: Situation) -> Place:
    """North and east of the aircraft."""
    return situation.north, situation.east


def least_altitude(gains: Gains, ceiling: float) -> float:
    """Altitude (m) below which nothing is circled and no way home begun; a low ``ceiling`` (m) lowers it."""
    return min(gains.return_floor, ceiling - gains.capture_altitude)


def climb_ahead(gains: Gains, state: State, altitude: float, situation: Situation) -> Target:
    """Up to ``altitude`` (m) straight on along the heading held: at a metre above ground a bank is a wing in it."""
    return Target(Stage.EN_ROUTE, min(altitude, situation.ceiling), state.heading)


def below_ceiling(target: Target, situation: Situation) -> Target:
    """``target``, no higher than where the fence lets it be."""
    return target if target.altitude <= situation.ceiling else target._replace(altitude=situation.ceiling)


def lookahead(gains: Gains, situation: Situation) -> float:
    """How far ahead (m) a path is aimed at: longer with the ground speed V of a following wind.

    The heading loop turns the course at a rate k that it keeps in any wind (`heading.step`); the cross-track error is
    then a second-order mode of frequency sqrt(k V / L) and damping sqrt(k L / V) / 2, both kept when L grows as V.
    """
    if situation.airspeed <= 1.0:
        return gains.lookahead
    return gains.lookahead * clip(situation.ground_speed / situation.airspeed, 1.0, FASTEST_DRIFT)


def turning_distance(gains: Gains, state: State, situation: Situation) -> float:
    """Way (m) before the end of a leg at which the turn into the next one begins: R tan(turn / 2).

    The radius is that of the greater ground speed, before or after the turn: into a following wind it is wide.
    It is bounded by the radius of the vehicle's circles, for gusts that the airspeed tells.
    """
    if state.corner == 0.0:
        return 0.0
    after = situation.airspeed + tailwind(situation, state.onward)
    radius = max(situation.ground_speed, after) ** 2 / (STANDARD_GRAVITY * math.tan(TURN_BANK))
    return min(radius * math.tan(0.5 * min(abs(state.corner), SHARPEST)), gains.loiter_radius)


def tailwind(situation: Situation, course: float) -> float:
    """Wind (m/s) along ``course`` (rad), positive from behind."""
    return situation.wind_north * math.cos(course) + situation.wind_east * math.sin(course)
