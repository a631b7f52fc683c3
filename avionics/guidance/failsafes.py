"""Failsafes: detection of failures, their notices and actions.

The action of a failure is executed once; the operator may then select another mode.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple

from avionics.guidance import fence
from avionics.guidance.modes import (
    AIRBORNE,
    BY_STICK,
    GUIDED,
    PILOTED,
    Conditions,
    Gains,
    Notice,
    Outcome,
    State,
    enter,
)
from avionics.messages import Failsafe, Mode, Stage
from wingbeat.message import Severity

RECEIVER_LOST: Final = int(Failsafe.RECEIVER_LOST)
"""Cached member: access to an enum member costs as much as a call."""


class Action(IntEnum):
    """Action for a failure in flight; a higher value has priority."""

    CARRY_ON = 0
    RETURN = 1
    LAND = 2
    CUT = 3


DOING: Final = {Action.RETURN: "returning", Action.LAND: "landing", Action.CUT: "flapping stopped"}


class Failure(NamedTuple):
    """Row of the failsafe table: notice and action of a failure."""

    flag: Failsafe
    text: str
    """text after ``failsafe:``"""
    action: Action
    severity: Severity = Severity.WARNING
    """severity of the notice at the onset; notices of the action are CRITICAL, those of the end INFO"""
    clear: float = 0.0
    """s; time for which the failure must be absent before it is cleared"""


FAILURES = (
    Failure(Failsafe.WING_JAMMED, "wing jammed", Action.CUT, Severity.CRITICAL, 2.0),
    Failure(Failsafe.IMU_FAULT, "IMU samples rejected", Action.CUT, Severity.CRITICAL, 0.5),
    Failure(Failsafe.TAIL_JAMMED, "tail servo not responding", Action.LAND, Severity.CRITICAL, 2.0),
    Failure(Failsafe.ACCEL_SATURATED, "accelerometer saturated", Action.LAND, Severity.ERROR, 2.0),
    Failure(Failsafe.BATTERY_CRITICAL, "battery critical", Action.LAND, Severity.CRITICAL, 2.0),
    Failure(Failsafe.BARO_LOST, "barometer lost", Action.LAND, Severity.ERROR, 3.0),
    Failure(Failsafe.POSITION_LOST, "no position", Action.LAND, Severity.ERROR),
    Failure(Failsafe.LINK_LOST, "ground link lost", Action.RETURN),
    Failure(Failsafe.BATTERY_LOW, "battery low", Action.RETURN),
    Failure(Failsafe.FENCE, "outside the fence", Action.RETURN, clear=2.0),
    Failure(Failsafe.PILOT_LOST, "manual control lost", Action.CARRY_ON),
    Failure(Failsafe.RECEIVER_LOST, "receiver lost", Action.CARRY_ON, clear=1.0),
    Failure(Failsafe.FENCE_NEAR, "near the fence", Action.CARRY_ON, clear=2.0),
    Failure(Failsafe.GPS_LOST, "GPS position lost", Action.CARRY_ON),
    Failure(Failsafe.PITOT_BLOCKED, "airspeed invalid", Action.CARRY_ON),
    Failure(Failsafe.MAG_DISTURBED, "magnetic field disturbed", Action.CARRY_ON, clear=2.0),
    Failure(Failsafe.ENCODER_LEFT, "left wing encoder lost", Action.CARRY_ON),
    Failure(Failsafe.ENCODER_RIGHT, "right wing encoder lost", Action.CARRY_ON),
    Failure(Failsafe.BARO_REFUSED, "barometer rejected", Action.CARRY_ON, clear=3.0),
)
"""failures in order of priority"""

ANSWERED: Final = sum(int(failure.flag) for failure in FAILURES if failure.action)
"""flags of the failures that have an action"""
NO_RETURN: Final = Failsafe.GPS_LOST | Failsafe.POSITION_LOST
BATTERY_RECOVERY: Final = 0.05
"""-; hysteresis of the battery thresholds against fluctuations of the voltage under load"""


def set_link(state: State, lost: bool) -> Outcome:
    """Set the state of the ground link, as reported by the ground task."""
    if lost == bool(state.link_lost):
        return state, ()
    notice = Notice(Severity.WARNING, "ground link lost") if lost else Notice(Severity.INFO, "ground link resumed")
    # On the ground the flag clears without a resumed link.
    notices = (notice,) if lost or state.armed else ()
    return state._replace(link_lost=int(lost), link_time=0.0), notices


def present(gains: Gains, state: State, conditions: Conditions) -> int:
    """Return the flags of the present failures."""
    room = fence.least_clearance(gains, state, conditions)
    return (
        conditions.sensed
        | (Failsafe.LINK_LOST if state.link_lost and state.link_time >= gains.link_loss_delay else 0)
        | (_position_missed(gains, state, conditions) if conditions.fix_age > gains.gps_loss_delay else 0)
        | (_battery(gains, state, conditions) if conditions.battery < gains.battery_return + BATTERY_RECOVERY else 0)
        | (Failsafe.IMU_FAULT if conditions.imu_fault else 0)
        | (Failsafe.FENCE if room < 0.0 else Failsafe.FENCE_NEAR if room < gains.fence_margin else 0)
        | (Failsafe.PILOT_LOST if state.pilot_time > 0.0 else 0)
    )


def _battery(gains: Gains, state: State, conditions: Conditions) -> int:
    """Return the battery flags; each clears at `BATTERY_RECOVERY` above its threshold."""
    low = gains.battery_return + (BATTERY_RECOVERY if state.failsafe & Failsafe.BATTERY_LOW else 0.0)
    critical = gains.battery_land + (BATTERY_RECOVERY if state.failsafe & Failsafe.BATTERY_CRITICAL else 0.0)
    return (Failsafe.BATTERY_LOW if conditions.battery < low else 0) | (
        Failsafe.BATTERY_CRITICAL if conditions.battery < critical else 0
    )


def _position_missed(gains: Gains, state: State, conditions: Conditions) -> int:
    """Return the flags of a lost position.

    Before the first fix the flags are set only in a guided flight.
    """
    guided = state.armed == 1 and state.mode in GUIDED
    if math.isinf(conditions.fix_age) and not guided:
        return 0
    gone = guided and conditions.fix_age > gains.gps_loss_delay + gains.gps_land_delay
    return Failsafe.GPS_LOST | (Failsafe.POSITION_LOST if gone else 0)


def step(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """Update the failures, report their changes and execute actions; ``dt`` in s."""
    if state.link_lost:
        state = state._replace(link_time=state.link_time + dt)
    state = fence.watch_floor(gains, _watch_pilot(state, dt, conditions), conditions)
    now = int(present(gains, state, conditions))
    if not (now or state.failsafe):
        return state, ()
    flags, pending = _settled(state, dt, now)
    notices = _announce(state.failsafe, flags)
    state = state._replace(failsafe=flags, answered=state.answered & flags, pending=pending)
    if not flags or not state.armed or state.stage not in AIRBORNE:
        return state, notices
    state, done = _answer(gains, state, flags, conditions)
    state, circled = _leave_the_pilots_modes(gains, state, conditions)
    state, stranded = _watch_stranded(gains, state, dt, conditions)
    return state, notices + done + circled + stranded


def pilot_missed(state: State, conditions: Conditions) -> bool:
    """Return whether the stick inputs that the flight requires are missing.

    Inputs required at their loss count as required until they resume.
    """
    if not conditions.pilot_lost or state.armed == 0 or state.stage not in AIRBORNE:
        return False
    by_receiver = state.mode == Mode.ALTITUDE_HOLD and conditions.sensed & RECEIVER_LOST != 0
    return state.mode in PILOTED or by_receiver or state.pilot_time > 0.0


def _watch_pilot(state: State, dt: float, conditions: Conditions) -> State:
    if pilot_missed(state, conditions):
        return state._replace(pilot_time=state.pilot_time + dt)
    return state if state.pilot_time == 0.0 else state._replace(pilot_time=0.0)


def _leave_the_pilots_modes(gains: Gains, state: State, conditions: Conditions) -> Outcome:
    """Respond to the loss of stick inputs.

    The vehicle circles, and returns after the delay of a lost link. Without a position it holds altitude with wings
    level. If a landing was required since arming, it lands. Modes flown by throttle stick are left even if the
    operator selected them.
    """
    if state.pilot_time == 0.0:
        return state, ()
    placed = conditions.fix_age <= gains.gps_loss_delay
    if state.mode in PILOTED:
        return _rescue(state, Mode.LOITER if placed else Mode.ALTITUDE_HOLD)
    if (
        state.mode == Mode.ALTITUDE_HOLD
        and conditions.sensed & RECEIVER_LOST & ~state.answered
        and (placed or _doomed(state))
    ):
        return _rescue(state._replace(answered=state.answered | RECEIVER_LOST), Mode.LOITER)
    late = state.pilot_time >= gains.link_loss_delay and not state.answered & Failsafe.PILOT_LOST
    if state.mode == Mode.LOITER and placed and late:
        return _rescue(state._replace(answered=state.answered | Failsafe.PILOT_LOST), Mode.RETURN)
    return state, ()


def _doomed(state: State) -> bool:
    """Return whether a failure has required a landing since arming.

    Other automatic modes are then excluded.
    """
    return state.critical == 1 or state.cut == 1


def _rescue(state: State, mode: Mode) -> Outcome:
    """Enter ``mode``, or LAND if a landing is required, without stick inputs."""
    mode = Mode.LAND if _doomed(state) else mode
    doing = {Mode.RETURN: "returning", Mode.LAND: "landing"}.get(mode, mode.name)
    return enter(state._replace(rescued=1), mode, Severity.CRITICAL, f"failsafe: {doing}, manual control lost")


def _watch_stranded(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """Replace a return without a position by a landing.

    A pilot who flies by stick prevents the landing.
    """
    if not _stranded(gains, state, conditions):
        return (state if state.stranded_time == 0.0 else state._replace(stranded_time=0.0)), ()
    state = state._replace(stranded_time=state.stranded_time + dt)
    if state.stranded_time < gains.gps_land_delay:
        return state, ()
    wanted = sum(failure.flag for failure in FAILURES if failure.action == Action.RETURN)
    answered = state.answered | state.failsafe & (wanted | Failsafe.PILOT_LOST)
    state = state._replace(critical=1, rescued=1, stranded_time=0.0, answered=int(answered))
    return enter(state, Mode.LAND, Severity.CRITICAL, "failsafe: landing, no position for the return")


def _stranded(gains: Gains, state: State, conditions: Conditions) -> bool:
    """Return whether a return is pending without a position and without sticks."""
    if conditions.fix_age <= gains.gps_loss_delay or not conditions.pilot_lost or state.mode == Mode.LAND:
        return False
    fresh = state.failsafe & ~state.answered
    return fresh & Failsafe.PILOT_LOST != 0 or any(f.action == Action.RETURN and f.flag & fresh for f in FAILURES)


def _settled(state: State, dt: float, now: int) -> tuple[int, tuple[float, ...]]:
    """Return the failure flags and the times of absence of those about to clear.

    A failure is set at once and cleared after an absence of its time ``clear``.
    """
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
    """Return one notice for each failure that was set or cleared."""
    if before == after:
        return ()
    came = tuple(Notice(f.severity, f"failsafe: {f.text}") for f in FAILURES if f.flag & after & ~before)
    return came + tuple(
        Notice(Severity.INFO, f"failsafe cleared: {f.text}") for f in FAILURES if f.flag & before & ~after
    )


def _answer(gains: Gains, state: State, flags: int, conditions: Conditions) -> Outcome:
    """Execute the action of the most severe new failure once.

    The operator may then select another mode.
    """
    if not flags & ~state.answered & ANSWERED:
        return state, ()
    fresh = [f for f in FAILURES if f.flag & flags & ~state.answered and f.action]
    if _by_receiver(state, conditions):
        fresh = [f for f in fresh if f.flag != Failsafe.LINK_LOST]
    if _returns_later(gains, state, flags, conditions):
        fresh = [f for f in fresh if f.action != Action.RETURN]
    if not fresh:
        return state, ()
    gravest = max(fresh, key=lambda failure: failure.action)
    state = state._replace(answered=state.answered | sum(f.flag for f in fresh))
    if gravest.action == Action.RETURN:
        return _answer_by_return(state, gravest, conditions)
    text = f"failsafe: {DOING[gravest.action]}, {gravest.text}"
    if gravest.action == Action.LAND:
        return enter(state._replace(critical=1, rescued=1), Mode.LAND, Severity.CRITICAL, text)
    entered, _ = enter(state._replace(cut=1, critical=1, rescued=1), Mode.LAND, Severity.CRITICAL, text)
    return entered, (Notice(Severity.CRITICAL, text),)


def _by_receiver(state: State, conditions: Conditions) -> bool:
    """Return whether a pilot flies by receiver, without need of the ground link."""
    return conditions.by_receiver == 1 and state.mode in BY_STICK


def _returns_later(gains: Gains, state: State, flags: int, conditions: Conditions) -> bool:
    """Return whether a return is delayed.

    A return requires a position and, after the launch, a minimum altitude. If a failure has required a landing, no
    position is needed.
    """
    low = state.stage == Stage.CLIMB_OUT and conditions.altitude < conditions.return_floor
    blind = flags & NO_RETURN != 0 or conditions.fix_age > gains.gps_loss_delay
    return low or (blind and not _doomed(state))


def _answer_by_return(state: State, failure: Failure, conditions: Conditions) -> Outcome:
    """Enter RETURN, or LAND if a landing is required.

    The mode does not change on the glide path or in the flare, because the landing is the shorter path.
    """
    on_the_line = state.stage == Stage.FLARE or (state.stage == Stage.APPROACH and conditions.final == 1)
    action = Action.LAND if _doomed(state) else Action.RETURN
    if on_the_line or state.mode == Mode.LAND or state.mode == Mode[action.name]:
        return state, ()
    text = f"failsafe: {DOING[action]}, {failure.text}"
    return enter(state._replace(rescued=1), Mode[action.name], Severity.CRITICAL, text)
