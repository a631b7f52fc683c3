"""Detection of jammed wings, as opposed to failed encoders.

A wing that is commanded to flap and does not move by its encoder is either jammed or has a failed encoder. The drive
of a jammed wing draws more current than in the previous strokes, and a single flapping wing causes a roll
oscillation; a failed encoder has neither effect. `avionics.sensing.encoders` rejects an encoder at once; the
distinction of the two faults is made here.
"""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.limits import low_pass
from wingbeat.units import Quantity

LEFT, RIGHT = 1, 2
"""flags of the wings"""


WITHOUT_ENCODER: Final = 2.0
"""-; multiple of `Gains.rocking` required without a standstill by an encoder, because gusts can last for seconds"""


class Gains(NamedTuple):
    """Thresholds of the jam detection."""

    activity_time: Annotated[float, Quantity("s", 0.01, 5.0)] = 0.15
    """s; time constant of the mean speed of a wing. Default: half a stroke"""
    least_rate: Annotated[float, Quantity("rad/s", 0.01, 20.0)] = 0.4
    """rad/s; mean speed of a commanded wing below which it counts as stationary. Default: a quarter of the mean speed
    of the smallest stroke"""
    jam_confirmation_time: Annotated[float, Quantity("s", 0.05, 10.0, formerly="still_time")] = 0.25
    """s; confirmation time of a stationary wing. Default: a stroke"""
    current_time: Annotated[float, Quantity("s", 0.01, 10.0)] = 0.5
    """s; time constant of the present current. Default: two strokes"""
    usual_time: Annotated[float, Quantity("s", 0.1, 600.0)] = 1.0
    """s; time constant of the reference current. Default: follows the throttle, not the strokes"""
    stall_ratio: Annotated[float, Quantity("-", 1.0, 20.0)] = 1.5
    """-; ratio of present to reference current above which a drive counts as stalled"""
    stall_current: Annotated[float, Quantity("A", 0.1, 100.0)] = 0.5
    """A; minimum current of a stalled drive. Default: less is electronics alone"""
    rocking: Annotated[float, Quantity("rad/s", 0.05, 20.0)] = 1.0
    """rad/s; mean magnitude of the roll rate with a single flapping wing. Default: a third of the single-wing value,
    above turns and gusts"""
    fault_confirmation_time: Annotated[float, Quantity("s", 0.05, 10.0, formerly="verdict_time")] = 1.2
    """s; duration of a rejected encoder without a jam after which the encoder is reported lost. Default: time for the
    response of current and bank"""


class State(NamedTuple):
    """State of the jam detection."""

    speed_left: float = 0.0
    """rad/s; mean left speed"""
    speed_right: float = 0.0
    """rad/s; mean right speed"""
    commanded: float = 0.0
    """s; duration of the flapping command"""
    stationary_left: float = 0.0
    """s; time for which the left wing has been stationary"""
    stationary_right: float = 0.0
    """s; time for which the right wing has been stationary"""
    invalid_time: float = 0.0
    """s; time for which an encoder has been rejected"""
    rocking: float = 0.0
    """rad/s; mean magnitude of the roll rate"""
    current: float = 0.0
    """A; low-passed current"""
    usual: float = 0.0
    """A; reference current with both wings moving"""
    lost: int = 0
    """-; flags of wings with a failed encoder"""
    jammed: int = 0
    """-; flags of jammed wings; kept until the next arming"""
    angles: tuple[float, float] = (0.0, 0.0)
    """rad; last left and right angle"""
    rocked: float = 0.0
    """s; duration of the roll oscillation with a lost encoder"""


class CheckInputs(NamedTuple):
    """Inputs of the jam detection."""

    rate_left: float
    """rad/s; from the encoder"""
    rate_right: float
    """rad/s; from the encoder"""
    current: float
    """A; both drives"""
    roll_rate: float
    """rad/s"""
    commanded: int
    """-; 1 while flapping is commanded"""
    valid: int = LEFT | RIGHT
    """-; flags of valid encoders"""
    angles: tuple[float, float] = (0.0, 0.0)
    """rad; left and right from the encoders, stored for the next rates"""


def step(gains: Gains, state: State, dt: float, inputs: CheckInputs) -> State:
    """Advance the detection by ``dt`` (s)."""
    left = low_pass(state.speed_left, abs(inputs.rate_left), gains.activity_time, dt)
    right = low_pass(state.speed_right, abs(inputs.rate_right), gains.activity_time, dt)
    rocking = low_pass(state.rocking, abs(inputs.roll_rate), gains.activity_time, dt)
    current = low_pass(state.current, inputs.current, gains.current_time, dt)
    commanded = state.commanded + dt if inputs.commanded else 0.0
    judged = commanded > 2.0 * gains.activity_time + gains.jam_confirmation_time
    stationary_left = state.stationary_left + dt if judged and left < gains.least_rate else 0.0
    stationary_right = state.stationary_right + dt if judged and right < gains.least_rate else 0.0
    both_move = judged and stationary_left == 0.0 and stationary_right == 0.0
    usual = low_pass(state.usual or current, current, gains.usual_time, dt) if both_move else state.usual
    invalid_time = state.invalid_time + dt if inputs.valid != LEFT | RIGHT else 0.0
    lost = (LEFT | RIGHT) & ~(inputs.valid | state.jammed) if invalid_time >= gains.fault_confirmation_time else 0
    state = State(
        left, right, commanded, stationary_left, stationary_right, invalid_time, rocking, current, usual, lost,
        state.jammed, inputs.angles, state.rocked,
    )  # fmt: skip
    return _judged(gains, state, dt) if judged and not both_move else state


def _judged(gains: Gains, state: State, dt: float) -> State:
    """Mark stationary wings as jammed if a drive stalls or the vehicle rocks in roll."""
    still = (LEFT if state.stationary_left >= gains.jam_confirmation_time else 0) | (
        RIGHT if state.stationary_right >= gains.jam_confirmation_time else 0
    )
    # The reference current requires both wings moving. Without it a large current may be that of the climb, unless
    # both wings are stationary: two encoders do not fail at once.
    comparable = state.usual > 0.0 or still == LEFT | RIGHT
    stalled = comparable and state.current > max(gains.stall_ratio * state.usual, gains.stall_current)
    fresh = still & ~state.lost
    if fresh and (stalled or state.rocking > gains.rocking):
        return state._replace(jammed=state.jammed | fresh)
    return _without_encoder(gains, state, dt) if state.lost and not state.jammed else state


def _without_encoder(gains: Gains, state: State, dt: float) -> State:
    """Mark a wing with a lost encoder as jammed after a sustained roll oscillation.

    The oscillation must last longer than a gust. The current is not used: without both encoders there is no reference
    current, so that a climb would count as a stall.
    """
    rocked = state.rocked + dt if state.rocking > WITHOUT_ENCODER * gains.rocking else 0.0
    return state._replace(rocked=rocked, jammed=state.lost if rocked >= gains.fault_confirmation_time else 0)
