"""Modes, arming, stages of the flight, failsafes.

The mode is what the operator asked for or a failsafe took; the stage is where the flight is, from the hand
to the ground. Every refusal has a reason, said as a `Notice`.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.messages import Failsafe, Mode, Severity, Stage
from avionics.quantities import Quantity

AIRBORNE = (Stage.CLIMB_OUT, Stage.EN_ROUTE, Stage.APPROACH, Stage.FLARE)
LANDING = (Stage.APPROACH, Stage.FLARE)
GUIDED = (Mode.AUTO, Mode.RETURN, Mode.LAND)
"""modes in which the navigation steers"""
PILOTED = (Mode.MANUAL, Mode.STABILIZED)
"""modes in which the throttle is the pilot's"""


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
    launch_airspeed: Annotated[float, Quantity("m/s", 0.5, 30.0)]
    """m/s; airspeed that tells a throw"""
    launch_time: Annotated[float, Quantity("s", 0.0, 2.0)]
    """s; for which either must last"""
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


class State(NamedTuple):
    """What the modes remember."""

    mode: int = Mode.MANUAL
    """-; see `Mode`"""
    stage: int = Stage.ON_GROUND
    """-; see `Stage`"""
    armed: int = 0
    """-; 1 when the wings may move"""
    launch_time: float = 0.0
    """s; for which the launch condition has held"""
    still_time: float = 0.0
    """s; for which the touchdown condition has held"""
    link_lost: int = 0
    """-; 1 while the ground link is lost"""
    link_time: float = 0.0
    """s; since the ground link was lost"""
    failsafe: int = 0
    """-; flags of `Failsafe` that are present"""
    answered: int = 0
    """-; flags of `Failsafe` that have changed the mode since arming"""
    critical: int = 0
    """-; 1 once the battery or the lost position made it land"""


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


Outcome = tuple[State, tuple[Notice, ...]]


def arming_refusals(gains: Gains, state: State, seen: Conditions) -> tuple[str, ...]:
    """Why the vehicle must not be armed now; empty when it may."""
    automatic = state.mode in GUIDED
    checks = (
        (not seen.settled, "attitude is not known yet"),
        (seen.imu_fault, "the IMU's samples are refused"),
        (max(abs(seen.roll), abs(seen.pitch)) > gains.arm_tilt, "tilted too far"),
        (seen.battery < gains.arm_battery, f"battery at {100.0 * seen.battery:.0f} %"),
        (state.mode in (Mode.RETURN, Mode.LAND), "mode is RETURN or LAND"),
        (automatic and seen.items == 0, "no mission"),
        (automatic and seen.fix_age > gains.gps_loss_delay, "no GPS position"),
        (state.mode in PILOTED and seen.throttle_stick > 0.05, "throttle stick is not at zero"),
    )
    return tuple(text for failed, text in checks if failed)


def arm(gains: Gains, state: State, seen: Conditions) -> Outcome:
    """Arm, or say why not."""
    if state.armed:
        return state, (Notice(Severity.INFO, "already armed"),)
    reasons = arming_refusals(gains, state, seen)
    if reasons:
        return state, (Notice(Severity.WARNING, f"arming refused: {'; '.join(reasons)}"),)
    armed = state._replace(
        armed=1, stage=int(Stage.WAIT_LAUNCH), launch_time=0.0, still_time=0.0, answered=0, critical=0
    )
    return armed, (Notice(Severity.NOTICE, "armed"),)


def disarm(state: State, forced: bool) -> Outcome:
    """Disarm on the ground; in the air only when ``forced``."""
    if not state.armed:
        return state, (Notice(Severity.INFO, "already disarmed"),)
    if state.stage in AIRBORNE and not forced:
        return state, (Notice(Severity.WARNING, "disarming refused: in flight"),)
    stage = Stage.LANDED if state.stage in AIRBORNE else Stage.ON_GROUND
    return state._replace(armed=0, stage=int(stage)), (Notice(Severity.NOTICE, "disarmed"),)


def mode_refusal(gains: Gains, state: State, mode: Mode, seen: Conditions) -> str:
    """Why ``mode`` cannot be flown now; empty when it can."""
    if mode == Mode.AUTO and seen.items == 0:
        return "no mission"
    if mode == Mode.RETURN and seen.fix_age > gains.gps_loss_delay:
        return "no GPS position"
    if mode in (Mode.RETURN, Mode.LAND) and state.armed and state.stage not in AIRBORNE:
        return "not in flight"
    return ""


def set_mode(gains: Gains, state: State, mode: Mode, seen: Conditions) -> Outcome:
    """Change the mode, or say why not."""
    reason = mode_refusal(gains, state, mode, seen)
    if reason:
        return state, (Notice(Severity.WARNING, f"mode {mode.name} refused: {reason}"),)
    return _enter(state, mode, Severity.INFO, f"mode {mode.name}")


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
    if state.stage == Stage.WAIT_LAUNCH:
        return _watch_launch(gains, state, dt, seen)
    if state.stage in AIRBORNE:
        return _watch_touchdown(gains, state, dt, seen)
    return state, ()


def _watch_launch(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    thrown = seen.forward_force > gains.launch_force or seen.airspeed > gains.launch_airspeed
    lasted = state.launch_time + dt if thrown else 0.0
    if not thrown or lasted < gains.launch_time:
        return state._replace(launch_time=lasted), ()
    stage = Stage.CLIMB_OUT if state.mode == Mode.AUTO else Stage.EN_ROUTE
    return state._replace(stage=int(stage), launch_time=0.0), (Notice(Severity.NOTICE, "launched"),)


def _watch_touchdown(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    landing = state.stage in LANDING
    slow = seen.airspeed < gains.touchdown_airspeed
    if landing and seen.fix_age <= gains.gps_loss_delay:
        slow = slow or seen.ground_speed < gains.touchdown_airspeed
    still = slow and abs(seen.climb_rate) < gains.touchdown_climb
    lasted = state.still_time + dt if still else 0.0
    if lasted < (gains.touchdown_time if landing else gains.crash_time):
        return _follow_navigation(state._replace(still_time=lasted), seen)
    landed = state._replace(stage=int(Stage.LANDED), armed=0, still_time=0.0)
    text = "touchdown, disarmed" if landing else "on the ground outside an approach, disarmed"
    return landed, (Notice(Severity.NOTICE if landing else Severity.CRITICAL, text),)


def _follow_navigation(state: State, seen: Conditions) -> Outcome:
    """In a guided mode the airborne stage is the navigation's, else it is EN_ROUTE."""
    wanted = Stage(seen.wanted_stage) if state.mode in GUIDED else Stage.EN_ROUTE
    if wanted == state.stage or wanted not in AIRBORNE:
        return state, ()
    return state._replace(stage=int(wanted)), (Notice(Severity.INFO, f"stage {wanted.name}"),)


def present(gains: Gains, state: State, seen: Conditions) -> int:
    """Flags of the failures that are present now."""
    outside = seen.home_distance > gains.fence_radius or seen.altitude > gains.fence_altitude
    return (
        (Failsafe.LINK_LOST if state.link_lost and state.link_time >= gains.link_loss_delay else 0)
        | (Failsafe.GPS_LOST if _position_missed(gains, state, seen) else 0)
        | (Failsafe.BATTERY_LOW if seen.battery < gains.battery_return else 0)
        | (Failsafe.IMU_FAULT if seen.imu_fault else 0)
        | (Failsafe.FENCE if outside else 0)
    )


def _position_missed(gains: Gains, state: State, seen: Conditions) -> bool:
    """A position that was there is gone; without a first fix only a guided flight misses it."""
    never = math.isinf(seen.fix_age)
    return seen.fix_age > gains.gps_loss_delay and (not never or (state.armed == 1 and state.mode in GUIDED))


REASONS = {
    Failsafe.LINK_LOST: "ground link lost",
    Failsafe.GPS_LOST: "GPS position lost",
    Failsafe.BATTERY_LOW: "battery low",
    Failsafe.IMU_FAULT: "IMU samples refused",
    Failsafe.FENCE: "outside the fence",
}
RETURNING = (Failsafe.LINK_LOST, Failsafe.BATTERY_LOW, Failsafe.FENCE)


def _failsafes(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    if state.link_lost:
        state = state._replace(link_time=state.link_time + dt)
    flags = present(gains, state, seen)
    notices = _announce(state.failsafe, flags)
    state = state._replace(failsafe=int(flags), answered=state.answered & int(flags))
    if not state.armed or state.stage not in AIRBORNE:
        return state, notices
    state, landed = _land_when_critical(gains, state, seen)
    state, returned = _return_when_failed(state, flags)
    return state, notices + landed + returned


def _announce(before: int, after: int) -> tuple[Notice, ...]:
    """One notice for each failure that came or went."""
    if before == after:
        return ()
    came = tuple(Notice(Severity.WARNING, f"failsafe: {REASONS[f]}") for f in REASONS if f & after & ~before)
    return came + tuple(Notice(Severity.INFO, f"failsafe over: {REASONS[f]}") for f in REASONS if f & before & ~after)


def _land_when_critical(gains: Gains, state: State, seen: Conditions) -> Outcome:
    lost = seen.fix_age > gains.gps_loss_delay + gains.gps_land_delay and state.mode in GUIDED
    if state.critical or state.mode == Mode.LAND or not (lost or seen.battery < gains.battery_land):
        return state, ()
    text = "failsafe: landing, " + ("no position" if lost else "battery nearly empty")
    return _enter(state._replace(critical=1), Mode.LAND, Severity.CRITICAL, text)


def _return_when_failed(state: State, flags: int) -> Outcome:
    """Return once for each failure; the operator may then choose another mode."""
    fresh = [f for f in RETURNING if f & flags & ~state.answered]
    if not fresh or flags & Failsafe.GPS_LOST:
        return state, ()
    answered = state._replace(answered=state.answered | sum(fresh))
    if state.mode in (Mode.RETURN, Mode.LAND) or state.stage in LANDING:
        return answered, ()
    return _enter(answered, Mode.RETURN, Severity.CRITICAL, f"failsafe: returning, {REASONS[fresh[0]]}")
