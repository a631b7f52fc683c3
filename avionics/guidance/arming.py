"""Arming, disarming and kill: conditions under which the wings may move."""

from __future__ import annotations

from avionics.guidance.failsafes import ANSWERED, FAILURES
from avionics.guidance.modes import AIRBORNE, GUIDED, PILOTED, Conditions, Gains, Notice, Outcome, State
from avionics.guidance.stages import without_push
from avionics.messages import Mode, Stage
from wingbeat.message import Severity

NOT_ARMED = (Mode.RETURN, Mode.LAND, Mode.LOITER, Mode.OFFBOARD)
"""modes in which arming is denied"""


def refusals(gains: Gains, state: State, conditions: Conditions) -> tuple[str, ...]:
    """Return the reasons why arming is denied now; empty if arming is permitted."""
    automatic = state.mode in GUIDED
    checks = (
        (not conditions.settled, "attitude not aligned: hold still"),
        (conditions.imu_fault, "IMU samples rejected"),
        (conditions.turn_rate > gains.arm_turn, "vehicle is turning: hold it still"),
        (max(abs(conditions.roll), abs(conditions.pitch)) > gains.arm_tilt, "tilt too large: hold it level"),
        (
            conditions.battery < gains.arm_battery,
            f"battery {100.0 * conditions.battery:.0f} %, minimum {100.0 * gains.arm_battery:.0f} %",
        ),
        (conditions.kill_switch, "kill switch on"),
        (state.mode in NOT_ARMED, f"mode {Mode(state.mode).name}: select another mode"),
        (automatic and conditions.items == 0, "no mission: upload one"),
        (automatic and conditions.fix_age > gains.gps_loss_delay, "no GPS position"),
        (state.mode in PILOTED and conditions.throttle_stick > 0.05, "throttle stick not at zero"),
    )
    hindering = conditions.sensed | state.failsafe & ANSWERED
    sensed = tuple(failure.text for failure in FAILURES if failure.flag & hindering)
    return tuple(text for failed, text in checks if failed) + sensed + conditions.unready


def arm(gains: Gains, state: State, conditions: Conditions) -> Outcome:
    """Arm the vehicle, or return the denial reasons as a notice."""
    if state.armed:
        return state, (Notice(Severity.INFO, "already armed"),)
    reasons = refusals(gains, state, conditions)
    if reasons:
        return state, (Notice(Severity.WARNING, f"arming denied: {'; '.join(reasons)}"),)
    armed = state._replace(
        armed=1,
        stage=int(Stage.WAIT_LAUNCH),
        stationary_time=0.0,
        answered=0,
        critical=0,
        cut=0,
        rescued=0,
        stranded_time=0.0,
        above_floor=0,
        killed=0,
    )
    armed = without_push(armed)
    return armed, (Notice(Severity.NOTICE, "armed"),)


def disarm(state: State, forced: bool) -> Outcome:
    """Disarm on the ground; in flight only if ``forced``."""
    if not state.armed:
        return state, (Notice(Severity.INFO, "already disarmed"),)
    if state.stage not in AIRBORNE:
        return state._replace(armed=0, stage=int(Stage.ON_GROUND)), (Notice(Severity.NOTICE, "disarmed"),)
    if not forced:
        return state, (Notice(Severity.WARNING, "disarm denied: in flight"),)
    return kill(state, "forced disarm")


def kill(state: State, reason: str) -> Outcome:
    """Stop the wings at once and center the tail, in any flight stage.

    Only the next arming ends this state.
    """
    if not state.armed:
        return state, ()
    stage = Stage.LANDED if state.stage in AIRBORNE else Stage.ON_GROUND
    text = f"KILLED, {reason}: wings stopped, tail neutral; arm again to fly"
    return state._replace(armed=0, killed=1, stage=int(stage)), (Notice(Severity.EMERGENCY, text),)
