"""Modes, arming, stages of the flight, failsafes.

The mode is what the operator asked for or a failsafe took; the stage is where the flight is, from the hand
to the ground. Every refusal has a reason, said as a `Notice`.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Annotated, NamedTuple

from avionics.messages import Breach, Failsafe, Mode, Severity, Stage
from avionics.quantities import Quantity

STANDARD_GRAVITY = 9.80665
"""m/s^2"""

AIRBORNE = (Stage.CLIMB_OUT, Stage.EN_ROUTE, Stage.APPROACH, Stage.FLARE)
LANDING = (Stage.APPROACH, Stage.FLARE)
GUIDED = (Mode.AUTO, Mode.RETURN, Mode.LAND, Mode.LOITER)
"""modes in which the navigation steers"""
PILOTED = (Mode.MANUAL, Mode.STABILIZED)
"""modes in which the throttle is the pilot's"""
BY_STICK = (*PILOTED, Mode.ALTITUDE_HOLD)
"""modes that are flown by sticks"""


PITOT_BLOCKED = int(Failsafe.PITOT_BLOCKED)
RECEIVER_LOST = int(Failsafe.RECEIVER_LOST)
WAIT_LAUNCH, EN_ROUTE = Stage.WAIT_LAUNCH, Stage.EN_ROUTE
"""looked up once: a member of an enum costs as much as a call"""


class Notice(NamedTuple):
    """Something to tell people; the caller adds the time."""

    severity: Severity
    """-; MAVLink severity"""
    text: str
    """-; one line"""


class Gains(NamedTuple):
    """Thresholds of launch, touchdown, arming and failsafes."""

    launch_force: Annotated[float, Quantity("m/s^2", 1.0, 150.0)]
    """m/s^2; forward specific force that tells a throw"""
    launch_time: Annotated[float, Quantity("s", 0.0, 2.0)]
    """s; for which it must last"""
    launch_push: Annotated[float, Quantity("m/s", 0.1, 30.0)]
    """m/s; speed along the body that it gives"""
    launch_airspeed: Annotated[float, Quantity("m/s", 0.5, 30.0)]
    """m/s; airspeed that goes with it"""
    launch_reach: Annotated[float, Quantity("m", 0.1, 10.0)]
    """m; way at that speed that no arm has; a fifth as far again it is a throw also without an airspeed"""
    launch_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)]
    """rad; greatest pitch or roll at which a push is a throw"""
    wait_throttle: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; flapping while armed on the hand, 0 for still wings"""
    touchdown_airspeed: Annotated[float, Quantity("m/s", 0.1, 20.0)]
    """m/s; less airspeed (on an approach: or ground speed) than this"""
    touchdown_climb: Annotated[float, Quantity("m/s", 0.05, 5.0)]
    """m/s; and less climb or sink than this"""
    touchdown_time: Annotated[float, Quantity("s", 0.1, 20.0)]
    """s; for this long means landed, on an approach"""
    crash_time: Annotated[float, Quantity("s", 0.5, 60.0)]
    """s; the same outside an approach"""
    arm_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)]
    """rad; greatest pitch or roll to arm at"""
    arm_battery: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; least share of the battery to arm with"""
    battery_return: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; share of the battery at which to return"""
    battery_land: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; share of the battery at which to land at once"""
    link_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)]
    """s; without the ground link before returning"""
    gps_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)]
    """s; without a fix before the position is no longer steered by"""
    gps_land_delay: Annotated[float, Quantity("s", 0.0, 3600.0)]
    """s; without a position, in a guided mode, before landing along the present heading"""
    fence_radius: Annotated[float, Quantity("m", 10.0, 100000.0)]
    """m; from home, beyond which to return"""
    fence_altitude: Annotated[float, Quantity("m", 5.0, 5000.0)]
    """m; above which to return"""
    fence_floor: Annotated[float, Quantity("m", 0.0, 1000.0)]
    """m; below which to return once it was passed on the way up, until an approach; 0 for none"""
    fence_margin: Annotated[float, Quantity("m", 0.0, 500.0)]
    """m; from the fence at which it is warned of"""
    glide_pitch: Annotated[float, Quantity("rad", -1.0, 1.0)]
    """rad; pitch of a glide after the flapping was stopped"""
    arm_turn: Annotated[float, Quantity("rad/s", 0.01, 20.0)]
    """rad/s; greatest rate of turn to arm at"""


class State(NamedTuple):
    """What the modes remember."""

    mode: int = Mode.MANUAL
    """-; see `Mode`"""
    stage: int = Stage.ON_GROUND
    """-; see `Stage`"""
    armed: int = 0
    """-; 1 when the wings may move"""
    push: float = 0.0
    """m/s; speed along the body gained on the hand or in a throw"""
    push_way: float = 0.0
    """m; way at that speed since a throw may have begun"""
    force_time: float = 0.0
    """s; for which the force has been a throw's"""
    thrown: int = 0
    """-; 1 once the force lasted, in this push"""
    above_floor: int = 0
    """-; 1 once the flight was above the fence's floor"""
    killed: int = 0
    """-; 1 from a kill to the next arming"""
    pilot_time: float = 0.0
    """s; since the pilot's sticks were lost in a mode that is flown by them"""
    still_time: float = 0.0
    """s; for which the touchdown condition has held"""
    still_altitude: float = 0.0
    """m; where that began"""
    link_lost: int = 0
    """-; 1 while the ground link is lost"""
    link_time: float = 0.0
    """s; since the ground link was lost"""
    failsafe: int = 0
    """-; flags of `Failsafe` that are present"""
    answered: int = 0
    """-; flags of `Failsafe` that have changed the mode since arming"""
    critical: int = 0
    """-; 1 once a failure made it land"""
    cut: int = 0
    """-; 1 once a failure stopped the flapping, until the next arming"""
    rescued: int = 0
    """-; 1 in a mode that a failsafe took, until somebody chooses one"""
    stranded_time: float = 0.0
    """s; for which a return was wanted that no position allows"""
    pending: tuple[float, ...] = ()
    """s; for which each row of `FAILURES` has been about to come or go; empty while none is"""


ANY_MODE = -1
"""-; of `Conditions.navigated`: the wanted stage is the present mode's"""


class Conditions(NamedTuple):
    """What the modes look at."""

    forward_force: float
    """m/s^2; specific force along FRD x"""
    airspeed: float
    """m/s; true"""
    altitude: float
    """m; positive up"""
    climb_rate: float
    """m/s; positive up"""
    roll: float
    """rad"""
    pitch: float
    """rad"""
    ground_speed: float
    """m/s"""
    home_distance: float
    """m; horizontal"""
    fix_age: float
    """s; since the last usable GPS fix, infinite before the first"""
    battery: float
    """-; share that remains"""
    settled: int
    """-; 1 once the attitude is known"""
    imu_fault: int
    """-; 1 while the IMU's samples are refused"""
    items: int
    """-; length of the mission"""
    throttle_stick: float
    """-; 0 to 1"""
    wanted_stage: int
    """-; stage the navigation is in"""
    fence_clearance: float = math.inf
    """m; inside of the plan's fence, negative outside, infinite without one"""
    fence_floor: float = 0.0
    """m; of the plan's fence, 0 for none"""
    fence_ceiling: float = 0.0
    """m; of the plan's fence, 0 for none"""
    pilot_lost: int = 0
    """-; 1 while there are no sticks that are not stale"""
    kill_switch: int = 0
    """-; 1 while a kill switch is on"""
    above_flare: int = 0
    """-; 1 above the altitude at which a landing flares"""
    sensed: int = 0
    """-; flags of `Failsafe` that the sensing tells"""
    turn_rate: float = 0.0
    """rad/s; greatest of the three"""
    unready: tuple[str, ...] = ()
    """-; what else speaks against arming, looked up for that alone"""
    return_floor: float = 0.0
    """m; below which nothing is circled and no way home begun"""
    by_receiver: int = 0
    """-; 1 while the sticks flown are the receiver's"""
    final: int = 0
    """-; 1 while the navigation is on the straight line down"""
    navigated: int = ANY_MODE
    """-; mode that ``wanted_stage`` belongs to"""


Outcome = tuple[State, tuple[Notice, ...]]


def arming_refusals(gains: Gains, state: State, seen: Conditions) -> tuple[str, ...]:
    """Why the vehicle must not be armed now; empty when it may."""
    automatic = state.mode in GUIDED
    checks = (
        (not seen.settled, "attitude is not known yet"),
        (seen.imu_fault, "the IMU's samples are refused"),
        (seen.turn_rate > gains.arm_turn, "the vehicle is being turned"),
        (max(abs(seen.roll), abs(seen.pitch)) > gains.arm_tilt, "tilted too far"),
        (seen.battery < gains.arm_battery, f"battery at {100.0 * seen.battery:.0f} %"),
        (seen.kill_switch, "the kill switch is on"),
        (state.mode in (Mode.RETURN, Mode.LAND, Mode.LOITER), "mode is RETURN or LAND or LOITER"),
        (automatic and seen.items == 0, "no mission"),
        (automatic and seen.fix_age > gains.gps_loss_delay, "no GPS position"),
        (state.mode in PILOTED and seen.throttle_stick > 0.05, "throttle stick is not at zero"),
    )
    hindering = seen.sensed | state.failsafe & ANSWERED
    sensed = tuple(failure.text for failure in FAILURES if failure.flag & hindering)
    return tuple(text for failed, text in checks if failed) + sensed + seen.unready


def arm(gains: Gains, state: State, seen: Conditions) -> Outcome:
    """Arm, or say why not."""
    if state.armed:
        return state, (Notice(Severity.INFO, "already armed"),)
    reasons = arming_refusals(gains, state, seen)
    if reasons:
        return state, (Notice(Severity.WARNING, f"arming refused: {'; '.join(reasons)}"),)
    armed = state._replace(
        armed=1,
        stage=int(Stage.WAIT_LAUNCH),
        still_time=0.0,
        answered=0,
        critical=0,
        cut=0,
        rescued=0,
        stranded_time=0.0,
        above_floor=0,
        killed=0,
    )
    armed = _without_push(armed)
    return armed, (Notice(Severity.NOTICE, "armed"),)


def disarm(state: State, forced: bool) -> Outcome:
    """Disarm on the ground; in the air only when ``forced``."""
    if not state.armed:
        return state, (Notice(Severity.INFO, "already disarmed"),)
    if state.stage not in AIRBORNE:
        return state._replace(armed=0, stage=int(Stage.ON_GROUND)), (Notice(Severity.NOTICE, "disarmed"),)
    if not forced:
        return state, (Notice(Severity.WARNING, "disarming refused: in flight"),)
    return kill(state, "disarmed by force")


def kill(state: State, reason: str) -> Outcome:
    """Stop the wings at once and put the tail at neutral, wherever it is; only arming anew ends it."""
    if not state.armed:
        return state, ()
    stage = Stage.LANDED if state.stage in AIRBORNE else Stage.ON_GROUND
    text = f"KILLED, {reason}: wings stopped, tail neutral; arm again to fly"
    return state._replace(armed=0, killed=1, stage=int(stage)), (Notice(Severity.EMERGENCY, text),)


def mode_refusal(gains: Gains, state: State, mode: Mode, seen: Conditions) -> str:
    """Why ``mode`` cannot be flown now; empty when it can."""
    if mode == Mode.AUTO and seen.items == 0:
        return "no mission"
    if mode == Mode.RETURN and seen.fix_age > gains.gps_loss_delay:
        return "no GPS position"
    if mode in (Mode.RETURN, Mode.LAND, Mode.LOITER) and state.armed and state.stage not in AIRBORNE:
        return "not in flight"
    return ""


def set_mode(gains: Gains, state: State, mode: Mode, seen: Conditions) -> Outcome:
    """Change the mode, or say why not."""
    reason = mode_refusal(gains, state, mode, seen)
    if reason:
        return state, (Notice(Severity.WARNING, f"mode {mode.name} refused: {reason}"),)
    if state.pilot_time > 0.0:
        state = state._replace(answered=state.answered | Failsafe.PILOT_LOST)
    return _enter(state._replace(rescued=0), mode, Severity.INFO, f"mode {mode.name}")


def _enter(state: State, mode: Mode, severity: Severity, text: str) -> Outcome:
    if state.mode == mode:
        return state, ()
    stage = Stage.EN_ROUTE if state.stage in AIRBORNE else state.stage
    return state._replace(mode=int(mode), stage=int(stage), still_time=0.0), (Notice(severity, text),)


def set_link(state: State, lost: bool) -> Outcome:
    """The ground side says that its link was lost or is back."""
    if lost == bool(state.link_lost):
        return state, ()
    notice = Notice(Severity.WARNING, "ground link lost") if lost else Notice(Severity.INFO, "ground link is back")
    return state._replace(link_lost=int(lost), link_time=0.0), (notice,)


def step(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    """One step of stages and failsafes; ``dt`` in s."""
    state, failed = _failsafes(gains, state, dt, seen)
    state, moved = _stages(gains, state, dt, seen)
    return state, failed + moved


def _stages(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    if state.stage == WAIT_LAUNCH:
        return _watch_launch(gains, state, dt, seen)
    if state.stage in AIRBORNE:
        return _watch_touchdown(gains, state, dt, seen)
    return state, ()


PUSH_MEMORY = 1.0
"""s; in which the speed gained is forgotten, and with it the accelerometer's offset: a hand comes to rest again"""
SLOW = 0.5
"""-; share of `Gains.launch_push` below which a push without force is over; a wrong attitude may feign it"""
BLIND_REACH = 1.2
"""-; in units of `Gains.launch_reach`: a way that tells a throw also without an airspeed"""


FAST = 2
"""-; of `State.thrown`: it was as fast as a throw, whatever drag takes off a weak one on the way out of reach"""


def _watch_launch(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    """A throw pushes for a while and its speed is kept; a hand takes back what it gave within its reach."""
    state = _pushed(gains, state, dt, seen)
    upright = max(abs(seen.roll), abs(seen.pitch)) <= gains.launch_tilt
    far = state.push_way >= gains.launch_reach
    flown = seen.airspeed >= gains.launch_airspeed or state.push_way >= BLIND_REACH * gains.launch_reach
    if not (state.thrown == FAST and upright and far and flown):
        return state, ()
    stage = Stage.CLIMB_OUT if state.mode == Mode.AUTO else Stage.EN_ROUTE
    return _without_push(state)._replace(stage=int(stage)), (Notice(Severity.NOTICE, "launched"),)


def _pushed(gains: Gains, state: State, dt: float, seen: Conditions) -> State:
    """Speed along the body from the force, gravity's share taken off; its way counts from where a throw may begin."""
    accel = seen.forward_force - STANDARD_GRAVITY * math.sin(seen.pitch)
    push = (state.push + accel * dt) * (1.0 - dt / PUSH_MEMORY)
    force_time = state.force_time + dt if seen.forward_force > gains.launch_force else 0.0
    if force_time == 0.0 and push < SLOW * gains.launch_push:
        return state._replace(push=push, push_way=0.0, force_time=0.0, thrown=0)
    thrown = max(state.thrown, int(force_time >= gains.launch_time))
    if thrown and push >= gains.launch_push:
        thrown = FAST
    way = max(state.push_way + push * dt, 0.0) if force_time > 0.0 or state.push_way > 0.0 else 0.0
    return state._replace(push=push, push_way=way, force_time=force_time, thrown=thrown)


def _without_push(state: State) -> State:
    return state._replace(push=0.0, push_way=0.0, force_time=0.0, thrown=0)


STILL_TRAVEL = 0.4
"""m; up or down within the time of standing still: twice what the altitude's noise makes of it"""


NEAR_GROUND = 0.5
"""-; of the return's floor, below which a standstill may be one on the ground: a dead pitot tells one too"""


def _watch_touchdown(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    landing = state.stage in LANDING
    slow = seen.airspeed < gains.touchdown_airspeed
    placed = seen.fix_age <= gains.gps_loss_delay
    if (landing or seen.sensed & PITOT_BLOCKED) and placed:
        slow = slow or seen.ground_speed < gains.touchdown_airspeed
    near_ground = seen.altitude <= NEAR_GROUND * seen.return_floor or (
        placed and seen.ground_speed < gains.touchdown_airspeed
    )
    slow = slow and (landing or near_ground)
    # Against the wind a float above the ground is slow over it too.
    still = slow and abs(seen.climb_rate) < gains.touchdown_climb and not (landing and seen.above_flare)
    # A float sinks slowly, but it sinks.
    still = still and (state.still_time == 0.0 or abs(seen.altitude - state.still_altitude) < STILL_TRAVEL)
    since = seen.altitude if state.still_time == 0.0 else state.still_altitude
    lasted = state.still_time + dt if still else 0.0
    if lasted != state.still_time:
        state = state._replace(still_time=lasted, still_altitude=since)
    if lasted < (gains.touchdown_time if landing else gains.crash_time):
        return _follow_navigation(state, seen)
    landed = state._replace(stage=int(Stage.LANDED), armed=0, still_time=0.0)
    return landed, (_on_the_ground(landing, state.mode),)


def _on_the_ground(landing: bool, mode: int) -> Notice:
    if landing:
        return Notice(Severity.NOTICE, "touchdown, disarmed")
    if mode in PILOTED:
        return Notice(Severity.NOTICE, "on the ground, disarmed")
    return Notice(Severity.CRITICAL, "on the ground outside an approach, disarmed")


def _follow_navigation(state: State, seen: Conditions) -> Outcome:
    """In a guided mode the airborne stage is the navigation's, else it is EN_ROUTE."""
    if state.mode in GUIDED and seen.navigated not in (ANY_MODE, state.mode):
        return state, ()
    wanted = seen.wanted_stage if state.mode in GUIDED else EN_ROUTE
    if wanted == state.stage or wanted not in AIRBORNE:
        return state, ()
    return state._replace(stage=int(wanted)), (Notice(Severity.INFO, f"stage {Stage(wanted).name}"),)


class Action(IntEnum):
    """What is done about a failure in the air; a later one outranks an earlier one."""

    CARRY_ON = 0
    RETURN = 1
    LAND = 2
    CUT = 3


DOING = {Action.RETURN: "returning", Action.LAND: "landing", Action.CUT: "flapping stopped"}


class Failure(NamedTuple):
    """One row of the table: what is told about a failure, and what is done."""

    flag: Failsafe
    text: str
    """said after ``failsafe:``"""
    action: Action
    severity: Severity = Severity.WARNING
    """of the words when it comes; those of the action are CRITICAL, those of the end INFO"""
    clear: float = 0.0
    """s; for which it must be absent until it is over"""


FAILURES = (
    Failure(Failsafe.WING_JAMMED, "wing jammed", Action.CUT, Severity.CRITICAL, 2.0),
    Failure(Failsafe.IMU_FAULT, "IMU samples refused", Action.CUT, Severity.CRITICAL, 0.5),
    Failure(Failsafe.TAIL_JAMMED, "tail does not answer", Action.LAND, Severity.CRITICAL, 2.0),
    Failure(Failsafe.ACCEL_SATURATED, "accelerometer saturated", Action.LAND, Severity.ERROR, 2.0),
    Failure(Failsafe.BATTERY_CRITICAL, "battery nearly empty", Action.LAND, Severity.CRITICAL, 2.0),
    Failure(Failsafe.BARO_LOST, "barometer lost", Action.LAND, Severity.ERROR, 3.0),
    Failure(Failsafe.POSITION_GONE, "no position", Action.LAND, Severity.ERROR),
    Failure(Failsafe.LINK_LOST, "ground link lost", Action.RETURN),
    Failure(Failsafe.BATTERY_LOW, "battery low", Action.RETURN),
    Failure(Failsafe.FENCE, "outside the fence", Action.RETURN, clear=2.0),
    Failure(Failsafe.PILOT_LOST, "pilot's sticks lost", Action.CARRY_ON),
    Failure(Failsafe.RECEIVER_LOST, "receiver lost", Action.CARRY_ON, clear=1.0),
    Failure(Failsafe.FENCE_NEAR, "close to the fence", Action.CARRY_ON, clear=2.0),
    Failure(Failsafe.GPS_LOST, "GPS position lost", Action.CARRY_ON),
    Failure(Failsafe.PITOT_BLOCKED, "airspeed not believed", Action.CARRY_ON),
    Failure(Failsafe.MAG_DISTURBED, "magnetic field disturbed", Action.CARRY_ON, clear=2.0),
    Failure(Failsafe.ENCODER_LEFT, "left wing encoder lost", Action.CARRY_ON),
    Failure(Failsafe.ENCODER_RIGHT, "right wing encoder lost", Action.CARRY_ON),
    Failure(Failsafe.BARO_REFUSED, "barometer refused", Action.CARRY_ON, clear=3.0),
)
"""in the order in which they are answered"""

ANSWERED = sum(int(failure.flag) for failure in FAILURES if failure.action)
"""flags of the failures about which something is done"""
NO_RETURN = Failsafe.GPS_LOST | Failsafe.POSITION_GONE
BATTERY_RECOVERY = 0.05
"""-; of the battery, by which it must be above a threshold before that is over: a voltage under load flickers"""


def present(gains: Gains, state: State, seen: Conditions) -> int:
    """Flags of the failures that are present now."""
    room = fence_room(gains, state, seen)
    return (
        seen.sensed
        | (Failsafe.LINK_LOST if state.link_lost and state.link_time >= gains.link_loss_delay else 0)
        | (_position_missed(gains, state, seen) if seen.fix_age > gains.gps_loss_delay else 0)
        | (_battery(gains, state, seen) if seen.battery < gains.battery_return + BATTERY_RECOVERY else 0)
        | (Failsafe.IMU_FAULT if seen.imu_fault else 0)
        | (Failsafe.FENCE if room < 0.0 else Failsafe.FENCE_NEAR if room < gains.fence_margin else 0)
        | (Failsafe.PILOT_LOST if state.pilot_time > 0.0 else 0)
    )


def fence_room(gains: Gains, state: State, seen: Conditions) -> float:
    """Way (m) to the next limit of the vehicle's and the plan's fence, negative outside, infinite on the ground."""
    return min(_fence_rooms(gains, state, seen)) if state.stage in AIRBORNE else math.inf


def breach(gains: Gains, state: State, seen: Conditions) -> Breach:
    """What of the fence is passed furthest."""
    rooms = dict(zip((Breach.FLOOR, Breach.CEILING, Breach.BORDER), _fence_rooms(gains, state, seen), strict=True))
    return min(rooms, key=rooms.__getitem__) if fence_room(gains, state, seen) < 0.0 else Breach.NONE


def _fence_rooms(gains: Gains, state: State, seen: Conditions) -> tuple[float, float, float]:
    """m; above the floor, below the ceiling, inside of the border."""
    ceiling = min(gains.fence_altitude, seen.fence_ceiling or math.inf) - seen.altitude
    border = min(gains.fence_radius - seen.home_distance, seen.fence_clearance)
    if not state.above_floor or state.stage in LANDING:
        return math.inf, ceiling, border
    return seen.altitude - max(gains.fence_floor, seen.fence_floor), ceiling, border


def _battery(gains: Gains, state: State, seen: Conditions) -> int:
    """What came at a threshold stays until the battery is `BATTERY_RECOVERY` above it."""
    low = gains.battery_return + (BATTERY_RECOVERY if state.failsafe & Failsafe.BATTERY_LOW else 0.0)
    critical = gains.battery_land + (BATTERY_RECOVERY if state.failsafe & Failsafe.BATTERY_CRITICAL else 0.0)
    return (Failsafe.BATTERY_LOW if seen.battery < low else 0) | (
        Failsafe.BATTERY_CRITICAL if seen.battery < critical else 0
    )


def _position_missed(gains: Gains, state: State, seen: Conditions) -> int:
    """A position that was there is gone; without a first fix only a guided flight misses it."""
    guided = state.armed == 1 and state.mode in GUIDED
    if math.isinf(seen.fix_age) and not guided:
        return 0
    gone = guided and seen.fix_age > gains.gps_loss_delay + gains.gps_land_delay
    return Failsafe.GPS_LOST | (Failsafe.POSITION_GONE if gone else 0)


def _failsafes(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    if state.link_lost:
        state = state._replace(link_time=state.link_time + dt)
    state = _watch_floor(gains, _watch_pilot(state, dt, seen), seen)
    now = int(present(gains, state, seen))
    if not (now or state.failsafe):
        return state, ()
    flags, pending = _settled(state, dt, now)
    notices = _announce(state.failsafe, flags)
    state = state._replace(failsafe=flags, answered=state.answered & flags, pending=pending)
    if not flags or not state.armed or state.stage not in AIRBORNE:
        return state, notices
    state, done = _answer(gains, state, flags, seen)
    state, circled = _leave_the_pilots_modes(gains, state, seen)
    state, stranded = _watch_stranded(gains, state, dt, seen)
    return state, notices + done + circled + stranded


def _watch_floor(gains: Gains, state: State, seen: Conditions) -> State:
    """The fence's floor begins to hold when it was passed by the margin, and ends with the flight."""
    floor = max(gains.fence_floor, seen.fence_floor)
    up = state.stage in AIRBORNE and floor > 0.0
    passed = int(up and (state.above_floor == 1 or seen.altitude > floor + gains.fence_margin))
    return state if passed == state.above_floor else state._replace(above_floor=passed)


def pilot_missed(state: State, seen: Conditions) -> bool:
    """Whether sticks are missing that the flight needs, or needed until they were lost."""
    if not seen.pilot_lost or state.armed == 0 or state.stage not in AIRBORNE:
        return False
    by_receiver = state.mode == Mode.ALTITUDE_HOLD and seen.sensed & RECEIVER_LOST != 0
    return state.mode in PILOTED or by_receiver or state.pilot_time > 0.0


def _watch_pilot(state: State, dt: float, seen: Conditions) -> State:
    if pilot_missed(state, seen):
        return state._replace(pilot_time=state.pilot_time + dt)
    return state if state.pilot_time == 0.0 else state._replace(pilot_time=0.0)


def _leave_the_pilots_modes(gains: Gains, state: State, seen: Conditions) -> Outcome:
    """Without sticks: circle, after the delay of a lost link return; without a position hold the altitude, level.

    Whoever was to land lands. The modes flown by throttle stick are left whatever was chosen before.
    """
    if state.pilot_time == 0.0:
        return state, ()
    placed = seen.fix_age <= gains.gps_loss_delay
    if state.mode in PILOTED:
        return _rescue(state, Mode.LOITER if placed else Mode.ALTITUDE_HOLD)
    if (
        state.mode == Mode.ALTITUDE_HOLD
        and seen.sensed & RECEIVER_LOST & ~state.answered
        and (placed or _doomed(state))
    ):
        return _rescue(state._replace(answered=state.answered | RECEIVER_LOST), Mode.LOITER)
    late = state.pilot_time >= gains.link_loss_delay and not state.answered & Failsafe.PILOT_LOST
    if state.mode == Mode.LOITER and placed and late:
        return _rescue(state._replace(answered=state.answered | Failsafe.PILOT_LOST), Mode.RETURN)
    return state, ()


def _doomed(state: State) -> bool:
    """Whether a failure asked for a landing since arming: nothing automatic does anything else any more."""
    return state.critical == 1 or state.cut == 1


def _rescue(state: State, mode: Mode) -> Outcome:
    """Enter ``mode``, or LAND, without sticks."""
    mode = Mode.LAND if _doomed(state) else mode
    doing = {Mode.RETURN: "returning", Mode.LAND: "landing"}.get(mode, mode.name)
    return _enter(state._replace(rescued=1), mode, Severity.CRITICAL, f"failsafe: {doing}, pilot's sticks lost")


def _watch_stranded(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    """A return that no position allows becomes a landing, unless somebody flies by stick."""
    if not _stranded(gains, state, seen):
        return (state if state.stranded_time == 0.0 else state._replace(stranded_time=0.0)), ()
    state = state._replace(stranded_time=state.stranded_time + dt)
    if state.stranded_time < gains.gps_land_delay:
        return state, ()
    wanted = sum(failure.flag for failure in FAILURES if failure.action == Action.RETURN)
    answered = state.answered | state.failsafe & (wanted | Failsafe.PILOT_LOST)
    state = state._replace(critical=1, rescued=1, stranded_time=0.0, answered=int(answered))
    return _enter(state, Mode.LAND, Severity.CRITICAL, "failsafe: landing, no position to return by")


def _stranded(gains: Gains, state: State, seen: Conditions) -> bool:
    """Whether there is a reason to return that waits for a position, and nobody's stick."""
    if seen.fix_age <= gains.gps_loss_delay or not seen.pilot_lost or state.mode == Mode.LAND:
        return False
    fresh = state.failsafe & ~state.answered
    return fresh & Failsafe.PILOT_LOST != 0 or any(f.action == Action.RETURN and f.flag & fresh for f in FAILURES)


def _settled(state: State, dt: float, now: int) -> tuple[int, tuple[float, ...]]:
    """Flags with what has come at once and what has been absent for long enough; the times of the rest."""
    if now == state.failsafe:
        return now, ()
    before = state.pending or (0.0,) * len(FAILURES)
    ending = state.failsafe & ~now
    pending = tuple(
        time + dt if failure.flag & ending else 0.0 for failure, time in zip(FAILURES, before, strict=True)
    )
    over = sum(
        failure.flag
        for failure, time in zip(FAILURES, pending, strict=True)
        if failure.flag & ending and time >= failure.clear
    )
    after = (now | state.failsafe) & ~over
    return after, () if after == now else pending


def _announce(before: int, after: int) -> tuple[Notice, ...]:
    """One notice for each failure that came or went."""
    if before == after:
        return ()
    came = tuple(Notice(f.severity, f"failsafe: {f.text}") for f in FAILURES if f.flag & after & ~before)
    return came + tuple(
        Notice(Severity.INFO, f"failsafe over: {f.text}") for f in FAILURES if f.flag & before & ~after
    )


def _answer(gains: Gains, state: State, flags: int, seen: Conditions) -> Outcome:
    """Do what the gravest failure that has not been answered asks for, once; the operator may then choose again."""
    if not flags & ~state.answered & ANSWERED:
        return state, ()
    fresh = [f for f in FAILURES if f.flag & flags & ~state.answered and f.action]
    if _by_receiver(state, seen):
        fresh = [f for f in fresh if f.flag != Failsafe.LINK_LOST]
    if _returns_later(gains, state, flags, seen):
        fresh = [f for f in fresh if f.action != Action.RETURN]
    if not fresh:
        return state, ()
    gravest = max(fresh, key=lambda failure: failure.action)
    state = state._replace(answered=state.answered | sum(f.flag for f in fresh))
    if gravest.action == Action.RETURN:
        return _answer_by_return(state, gravest, seen)
    text = f"failsafe: {DOING[gravest.action]}, {gravest.text}"
    if gravest.action == Action.LAND:
        return _enter(state._replace(critical=1, rescued=1), Mode.LAND, Severity.CRITICAL, text)
    entered, _ = _enter(state._replace(cut=1, critical=1, rescued=1), Mode.LAND, Severity.CRITICAL, text)
    return entered, (Notice(Severity.CRITICAL, text),)


def _by_receiver(state: State, seen: Conditions) -> bool:
    """A pilot who is heard by the receiver flies on without the ground's link."""
    return seen.by_receiver == 1 and state.mode in BY_STICK


def _returns_later(gains: Gains, state: State, flags: int, seen: Conditions) -> bool:
    """A return waits for a position and, after the throw, for room below; who is doomed to land needs no position."""
    low = state.stage == Stage.CLIMB_OUT and seen.altitude < seen.return_floor
    blind = flags & NO_RETURN != 0 or seen.fix_age > gains.gps_loss_delay
    return low or (blind and not _doomed(state))


def _answer_by_return(state: State, failure: Failure, seen: Conditions) -> Outcome:
    """RETURN, or LAND where that was asked before; neither on the line down, which is the shorter way."""
    on_the_line = state.stage == Stage.FLARE or (state.stage == Stage.APPROACH and seen.final == 1)
    action = Action.LAND if _doomed(state) else Action.RETURN
    if on_the_line or state.mode == Mode.LAND or state.mode == Mode[action.name]:
        return state, ()
    text = f"failsafe: {DOING[action]}, {failure.text}"
    return _enter(state._replace(rescued=1), Mode[action.name], Severity.CRITICAL, text)
