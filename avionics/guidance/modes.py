"""Modes, and the records that arming, stages and failsafes share with them.

The mode is what the operator asked for or a failsafe took; the stage is where the flight is, from the hand
to the ground. Every refusal has a reason, said as a `Notice`.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.messages import Failsafe, Mode, Stage
from wingbeat.message import Severity
from wingbeat.units import Quantity

AIRBORNE = (Stage.CLIMB_OUT, Stage.EN_ROUTE, Stage.APPROACH, Stage.FLARE)
LANDING = (Stage.APPROACH, Stage.FLARE)
GUIDED = (Mode.AUTO, Mode.RETURN, Mode.LAND, Mode.LOITER, Mode.OFFBOARD)
"""modes in which the navigation steers"""
PILOTED = (Mode.MANUAL, Mode.STABILIZED)
"""modes in which the throttle is the pilot's"""
BY_STICK = (*PILOTED, Mode.ALTITUDE_HOLD)
"""modes that are flown by sticks"""


class Notice(NamedTuple):
    """Something to tell people; the caller adds the time."""

    severity: Severity
    """-; MAVLink severity"""
    text: str
    """-; one line"""


class Gains(NamedTuple):
    """Thresholds of launch, touchdown, arming and failsafes."""

    launch_force: Annotated[float, Quantity("m/s^2", 1.0, 150.0)] = 12.0
    """m/s^2; forward specific force that tells a throw. Default: above gravity's share at any pitch, below a
    throw"""
    launch_time: Annotated[float, Quantity("s", 0.0, 2.0)] = 0.1
    """s; for which it must last. Default: a third of a throw, longer than a step jolts"""
    launch_push: Annotated[float, Quantity("m/s", 0.1, 30.0)] = 2.2
    """m/s; speed along the body that it gives. Default: under half of a firm throw; running does not give it"""
    launch_airspeed: Annotated[float, Quantity("m/s", 0.5, 30.0)] = 2.5
    """m/s; airspeed that goes with it. Default: more than half of the weakest throw, as the filtered pitot follows
    it"""
    launch_reach: Annotated[float, Quantity("m", 0.1, 10.0)] = 1.25
    """m; way at that speed that no arm has; a fifth as far again it is a throw also without an airspeed. Default: an
    arm from behind the shoulder to its full length, and the body's turn"""
    launch_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)] = 1.0
    """rad; greatest pitch or roll at which a push is a throw. Default: a bad throw, not a bird hanging from the
    hand"""
    wait_throttle: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.0
    """-; flapping while armed on the hand, 0 for still wings. Default: still wings are safe on the hand"""
    touchdown_airspeed: Annotated[float, Quantity("m/s", 0.1, 20.0)] = 2.0
    """m/s; less airspeed (on an approach: or ground speed) than this. Default: a quarter of the cruise"""
    touchdown_climb: Annotated[float, Quantity("m/s", 0.05, 5.0)] = 0.3
    """m/s; and less climb or sink than this. Default: less than the sink of the flare, three times what lying still
    reads"""
    touchdown_time: Annotated[float, Quantity("s", 0.1, 20.0)] = 2.2
    """s; for this long means landed, on an approach. Default: a float sinks by half a metre meanwhile"""
    crash_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 3.0
    """s; the same outside an approach. Default: no flight at this speed lasts so long"""
    arm_tilt: Annotated[float, Quantity("rad", 0.1, 3.2)] = 0.9
    """rad; greatest pitch or roll to arm at. Default: held ready to throw, not hanging"""
    arm_battery: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.3
    """-; least share of the battery to arm with. Default: enough for a circuit and the way home"""
    battery_return: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.2
    """-; share of the battery at which to return. Default: two minutes of flight"""
    battery_land: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.08
    """-; share of the battery at which to land at once. Default: one minute of flight"""
    link_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 5.0
    """s; without the ground link before returning. Default: longer than a turn with the antenna shadowed"""
    gps_loss_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 2.0
    """s; without a fix before the position is no longer steered by. Default: ten fixes at 5 Hz"""
    gps_land_delay: Annotated[float, Quantity("s", 0.0, 3600.0)] = 30.0
    """s; without a position, in a guided mode, before landing along the present heading. Default: half a kilometre
    of flight in the blind"""
    fence_radius: Annotated[float, Quantity("m", 10.0, 100000.0)] = 600.0
    """m; from home, beyond which to return. Default: still seen from the ground"""
    fence_altitude: Annotated[float, Quantity("m", 5.0, 5000.0)] = 120.0
    """m; above which to return. Default: the usual ceiling for models"""
    fence_floor: Annotated[float, Quantity("m", 0.0, 1000.0)] = 0.0
    """m; below which to return once it was passed on the way up, until an approach; 0 for none. Default: none; a
    plan may set one"""
    fence_margin: Annotated[float, Quantity("m", 0.0, 500.0)] = 15.0
    """m; from the fence at which it is warned of. Default: two seconds of flight"""
    glide_pitch: Annotated[float, Quantity("rad", -1.0, 1.0)] = -0.05
    """rad; pitch of a glide after the flapping was stopped. Default: tuned on the simulated vehicle"""
    arm_turn: Annotated[float, Quantity("rad/s", 0.01, 20.0)] = 0.7
    """rad/s; greatest rate of turn to arm at. Default: a hand is steadier"""


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
    launch_state: int = 0
    """-; 1 once the force lasted, in this push"""
    above_floor: int = 0
    """-; 1 once the flight was above the fence's floor"""
    killed: int = 0
    """-; 1 from a kill to the next arming"""
    pilot_time: float = 0.0
    """s; since the pilot's sticks were lost in a mode that is flown by them"""
    stationary_time: float = 0.0
    """s; for which the touchdown condition has held"""
    stationary_altitude: float = 0.0
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
    """s; for which each row of `failsafes.FAILURES` has been about to come or go; empty while none is"""


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
    """-; 1 while IMU samples are rejected"""
    items: int
    """-; length of the mission"""
    throttle_stick: float
    """-; 0 to 1"""
    requested_stage: int
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
    """-; mode that ``requested_stage`` belongs to"""
    setpoint_valid: int = 0
    """-; 1 while there is a setpoint for OFFBOARD that has not expired"""


Outcome = tuple[State, tuple[Notice, ...]]


def mode_refusal(gains: Gains, state: State, mode: Mode, conditions: Conditions) -> str:
    """Why ``mode`` cannot be flown now; empty when it can."""
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
    """Change the mode, or say why not."""
    reason = mode_refusal(gains, state, mode, conditions)
    if reason:
        return state, (Notice(Severity.WARNING, f"mode {mode.name} denied: {reason}"),)
    if state.pilot_time > 0.0:
        state = state._replace(answered=state.answered | Failsafe.PILOT_LOST)
    return enter(state._replace(rescued=0), mode, Severity.INFO, f"mode {mode.name}")


def enter(state: State, mode: Mode, severity: Severity, text: str) -> Outcome:
    """Change the mode and say ``text``; in the air its flight begins en route. Nothing where it is flown already."""
    if state.mode == mode:
        return state, ()
    stage = Stage.EN_ROUTE if state.stage in AIRBORNE else state.stage
    return state._replace(mode=int(mode), stage=int(stage), stationary_time=0.0), (Notice(severity, text),)
