"""Flight modes, and the records that arming, stages and failsafes share with them.

The mode is selected by the operator or a failsafe. The stage is the phase of the flight from launch to landing. Each
denied request has a reason, published as a `Notice`.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

from avionics.messages import Failsafe, Mode, Stage
from wingbeat.message import Severity
from wingbeat.units import Quantity

AIRBORNE = (Stage.CLIMB_OUT, Stage.EN_ROUTE, Stage.APPROACH, Stage.FLARE)
LANDING = (Stage.APPROACH, Stage.FLARE)
GUIDED = (Mode.AUTO, Mode.RETURN, Mode.LAND, Mode.LOITER, Mode.OFFBOARD)
"""modes with navigation active"""
PILOTED = (Mode.MANUAL, Mode.STABILIZED)
"""modes with manual throttle"""
BY_STICK = (*PILOTED, Mode.ALTITUDE_HOLD)
"""modes that require stick inputs"""


class Notice(NamedTuple):
    """Text message for the operator; the caller adds the time."""

    severity: Severity
    """-; MAVLink severity"""
    text: str
    """-; one line"""


class Gains(NamedTuple):
    """Thresholds of launch, touchdown, arming and failsafes."""

    launch_force: Annotated[float, Quantity("m/s^2", 1.0, 150.0)] = 12.0
    """m/s^2; forward specific force that indicates a throw. Default: above the gravity component at any pitch, below
    a throw"""
    launch_time: Annotated[float, Quantity("s", 0.0, 2.0)] = 0.1
    """s; minimum duration of the launch force. Default: a third of a throw, longer than the impact of a step"""
    launch_push: Annotated[float, Quantity("m/s", 0.1, 30.0)] = 2.2
    """m/s; minimum forward speed gained in the throw. Default: under half of a firm throw; more than running adds"""
    launch_airspeed: Annotated[float, Quantity("m/s", 0.5, 30.0)] = 2.5
    """m/s; minimum airspeed of a launch. Default: more than half of the weakest throw, as the filtered pitot follows
    it"""
    launch_reach: Annotated[float, Quantity("m", 0.1, 10.0)] = 1.25
    """m; distance at that speed beyond the reach of an arm; at 1.2 times this distance no airspeed is required.
    Default: an arm from behind the shoulder to its full length, and the turn of the body"""
    launch_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)] = 1.0
    """rad; maximum pitch or roll at launch. Default: accepts a poor throw, rejects a vehicle that hangs from the hand
    """
    wait_throttle: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.0
    """-; throttle while armed before launch, 0 for stopped wings. Default: stopped wings are safe to handle"""
    touchdown_airspeed: Annotated[float, Quantity("m/s", 0.1, 20.0)] = 2.0
    """m/s; maximum airspeed (on an approach: or ground speed) at touchdown. Default: a quarter of the cruise"""
    touchdown_climb: Annotated[float, Quantity("m/s", 0.05, 5.0)] = 0.3
    """m/s; maximum climb or sink rate at touchdown. Default: less than the sink of the flare, three times the noise
    at rest"""
    touchdown_time: Annotated[float, Quantity("s", 0.1, 20.0)] = 2.2
    """s; duration of the touchdown condition on an approach. Default: a floating vehicle sinks by half a meter in
    this time"""
    crash_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 3.0
    """s; duration of the touchdown condition outside an approach. Default: no flight at this speed lasts as long"""
    arm_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)] = 0.9
    """rad; maximum pitch or roll at arming. Default: includes the attitude before a throw, excludes a hanging vehicle
    """
    arm_battery: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.3
    """-; minimum remaining battery fraction at arming. Default: enough for a circuit and the return"""
    battery_return: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.2
    """-; remaining battery fraction for a return. Default: two minutes of flight"""
    battery_land: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.08
    """-; remaining battery fraction for an immediate landing. Default: one minute of flight"""
    link_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 5.0
    """s; duration of a lost ground link before a return. Default: longer than a turn with the antenna shadowed"""
    gps_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 2.0
    """s; duration without a fix before the position is no longer used. Default: ten fixes at 5 Hz"""
    gps_land_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 30.0
    """s; duration without a position in a guided mode before a landing along the present heading. Default: half a
    kilometer of flight without a position"""
    fence_radius: Annotated[float, Quantity("m", 10.0, 100000.0)] = 600.0
    """m; maximum distance from home before a return. Default: visible from the ground"""
    fence_altitude: Annotated[float, Quantity("m", 5.0, 5000.0)] = 120.0
    """m; maximum altitude before a return. Default: the usual ceiling for models"""
    fence_floor: Annotated[float, Quantity("m", 0.0, 1000.0)] = 0.0
    """m; minimum altitude before a return, active from the climb above it until an approach; 0 for none. Default:
    none; a plan may set one"""
    fence_margin: Annotated[float, Quantity("m", 0.0, 500.0)] = 15.0
    """m; clearance to the fence below which a warning is issued. Default: two seconds of flight"""
    glide_pitch: Annotated[float, Quantity("rad", -1.0, 1.0)] = -0.05
    """rad; pitch in a glide with stopped wings. Default: tuned on the simulated vehicle"""
    arm_turn: Annotated[float, Quantity("rad/s", 0.01, 20.0)] = 0.7
    """rad/s; maximum angular rate at arming. Default: above the motion of a steady hand"""


class State(NamedTuple):
    """State of the modes."""

    mode: int = Mode.MANUAL
    """-; see `Mode`"""
    stage: int = Stage.ON_GROUND
    """-; see `Stage`"""
    armed: int = 0
    """-; 1 if the wings may move"""
    push: float = 0.0
    """m/s; forward speed gained in the hand or in a throw"""
    push_way: float = 0.0
    """m; distance covered at that speed since the possible start of a throw"""
    force_time: float = 0.0
    """s; time for which the force has exceeded the launch force"""
    launch_state: int = 0
    """-; 1 once the force lasted in this push; 2 once the launch speed was reached"""
    above_floor: int = 0
    """-; 1 once the flight was above the floor of the fence"""
    killed: int = 0
    """-; 1 from a kill to the next arming"""
    pilot_time: float = 0.0
    """s; time since the loss of stick inputs in a mode that requires them"""
    stationary_time: float = 0.0
    """s; time for which the touchdown condition has been met"""
    stationary_altitude: float = 0.0
    """m; altitude at the start of the touchdown condition"""
    link_lost: int = 0
    """-; 1 while the ground link is lost"""
    link_time: float = 0.0
    """s; time since the loss of the ground link"""
    failsafe: int = 0
    """-; active flags of `Failsafe`"""
    answered: int = 0
    """-; flags of `Failsafe` that have changed the mode since arming"""
    critical: int = 0
    """-; 1 once a failure has required a landing"""
    cut: int = 0
    """-; 1 once a failure has stopped the flapping, until the next arming"""
    rescued: int = 0
    """-; 1 in a mode entered by a failsafe, until the operator selects a mode"""
    stranded_time: float = 0.0
    """s; time for which a return was required without a position"""
    pending: tuple[float, ...] = ()
    """s; time of pending changes for each row of `failsafes.FAILURES`; empty if none is pending"""


ANY_MODE: Final = -1
"""-; value of `Conditions.navigated`: the requested stage belongs to the present mode"""


class Conditions(NamedTuple):
    """Inputs of the modes and failsafes."""

    forward_force: float
    """m/s^2; specific force along FRD x"""
    airspeed: float
    """m/s; true airspeed"""
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
    """m; horizontal distance"""
    fix_age: float
    """s; time since the last usable GPS fix, infinite before the first"""
    battery: float
    """-; remaining fraction"""
    settled: int
    """-; 1 once the attitude estimate is aligned"""
    imu_fault: int
    """-; 1 while IMU samples are rejected"""
    items: int
    """-; number of mission items"""
    throttle_stick: float
    """-; from 0 to 1"""
    requested_stage: int
    """-; stage of the navigation"""
    fence_clearance: float = math.inf
    """m; clearance inside the fence of the plan, negative outside, infinite without one"""
    fence_floor: float = 0.0
    """m; floor of the fence of the plan, 0 for none"""
    fence_ceiling: float = 0.0
    """m; ceiling of the fence of the plan, 0 for none"""
    pilot_lost: int = 0
    """-; 1 while no recent stick inputs are available"""
    kill_switch: int = 0
    """-; 1 while a kill switch is on"""
    above_flare: int = 0
    """-; 1 above the flare altitude of a landing"""
    sensed: int = 0
    """-; flags of `Failsafe` set by the sensing task"""
    turn_rate: float = 0.0
    """rad/s; largest magnitude of the three axes"""
    unready: tuple[str, ...] = ()
    """-; further reasons against arming, evaluated for arming only"""
    return_floor: float = 0.0
    """m; altitude below which neither a circle nor a return begins"""
    by_receiver: int = 0
    """-; 1 while the active stick inputs come from the receiver"""
    final: int = 0
    """-; 1 on the glide path"""
    navigated: int = ANY_MODE
    """-; mode that ``requested_stage`` belongs to"""
    setpoint_valid: int = 0
    """-; 1 while an OFFBOARD setpoint is available that has not expired"""


Outcome = tuple[State, tuple[Notice, ...]]


def mode_refusal(gains: Gains, state: State, mode: Mode, conditions: Conditions) -> str:
    """Return why ``mode`` is denied now; empty if it is available."""
    if mode == Mode.AUTO and conditions.items == 0:
        return "no mission"
    if mode == Mode.RETURN and conditions.fix_age > gains.gps_loss_delay:
        return "no GPS position"
    if mode in (Mode.RETURN, Mode.LAND, Mode.LOITER) and state.armed and state.stage not in AIRBORNE:
        return "not in flight"
    if mode == Mode.OFFBOARD and state.stage not in AIRBORNE:
        return "not in flight"
    if mode == Mode.OFFBOARD and not conditions.setpoint_valid:
        return "no recent setpoint"
    return ""


def set_mode(gains: Gains, state: State, mode: Mode, conditions: Conditions) -> Outcome:
    """Change the mode, or return the denial reason as a notice."""
    reason = mode_refusal(gains, state, mode, conditions)
    if reason:
        return state, (Notice(Severity.WARNING, f"mode {mode.name} denied: {reason}"),)
    if state.pilot_time > 0.0:
        state = state._replace(answered=state.answered | Failsafe.PILOT_LOST)
    return enter(state._replace(rescued=0), mode, Severity.INFO, f"mode {mode.name}")


def enter(state: State, mode: Mode, severity: Severity, text: str) -> Outcome:
    """Change the mode and publish ``text``; no change if it is active already.

    In flight the new mode begins in the stage EN_ROUTE.
    """
    if state.mode == mode:
        return state, ()
    stage = Stage.EN_ROUTE if state.stage in AIRBORNE else state.stage
    return state._replace(mode=int(mode), stage=int(stage), stationary_time=0.0), (Notice(severity, text),)
