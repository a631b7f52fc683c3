"""Whether both wings move as they are told: a jammed wing, or only its encoder is dead.

A wing that is told to flap and does not move by its encoder is one or the other. A drive that pulls on a jammed wing
draws more than the strokes before, and one wing that beats alone rocks the vehicle; a dead encoder changes neither.
`avionics.sensing.encoders` stops believing an encoder at once; the verdict which of the two it is waits here.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import low_pass
from wingbeat.units import Quantity

LEFT, RIGHT = 1, 2
"""flags of the wings"""


WITHOUT_ENCODER = 2.0
"""-; in units of `Gains.rocking`, what it takes where no encoder tells of a standstill: gusts make one for seconds"""


class Gains(NamedTuple):
    """When a wing stands still, and when its drive is stalled."""

    activity_time: Annotated[float, Quantity("s", 0.01, 5.0)] = 0.15
    """s; time constant of a wing's mean speed. Default: half a stroke"""
    least_rate: Annotated[float, Quantity("rad/s", 0.01, 20.0)] = 0.4
    """rad/s; mean speed of a wing that is told to flap, below which it stands still. Default: a quarter of the mean
    speed of the smallest stroke"""
    jam_confirmation_time: Annotated[float, Quantity("s", 0.05, 10.0, formerly="still_time")] = 0.25
    """s; for which it must stand still. Default: a stroke"""
    current_time: Annotated[float, Quantity("s", 0.01, 10.0)] = 0.5
    """s; time constant of the present current. Default: two strokes"""
    usual_time: Annotated[float, Quantity("s", 0.1, 600.0)] = 1.0
    """s; time constant of the usual current. Default: follows the throttle, not the strokes"""
    stall_ratio: Annotated[float, Quantity("-", 1.0, 20.0)] = 1.5
    """-; present over usual current from which a drive is stalled"""
    stall_current: Annotated[float, Quantity("A", 0.1, 100.0)] = 0.5
    """A; less current than this is never that of a stalled drive. Default: less is electronics alone"""
    rocking: Annotated[float, Quantity("rad/s", 0.05, 20.0)] = 1.0
    """rad/s; mean size of the roll rate that one beating wing alone makes. Default: a third of what one wing alone
    makes, beyond turns and gusts"""
    fault_confirmation_time: Annotated[float, Quantity("s", 0.05, 10.0, formerly="verdict_time")] = 1.2
    """s; for which an encoder is not believed, and its wing not jammed, after which it is told lost. Default: time
    for the current and the bank to tell"""


class State(NamedTuple):
    """What the check remembers."""

    speed_left: float = 0.0
    """rad/s; mean speed"""
    speed_right: float = 0.0
    """rad/s; mean speed"""
    commanded: float = 0.0
    """s; for which the wings have been told to flap"""
    stationary_left: float = 0.0
    """s; for which the left wing has stood still"""
    stationary_right: float = 0.0
    """s; for which the right wing has stood still"""
    invalid_time: float = 0.0
    """s; for which an encoder has not been believed"""
    rocking: float = 0.0
    """rad/s; mean size of the roll rate"""
    current: float = 0.0
    """A; present"""
    usual: float = 0.0
    """A; with both wings moving"""
    lost: int = 0
    """-; flags of wings whose encoder is dead"""
    jammed: int = 0
    """-; flags of wings that are jammed; kept until the next arming"""
    angles: tuple[float, float] = (0.0, 0.0)
    """rad; last left and right"""
    rocked: float = 0.0
    """s; for which the vehicle has been rocked while an encoder was lost"""


class CheckInputs(NamedTuple):
    """What the check looks at."""

    rate_left: float
    """rad/s; by the encoder"""
    rate_right: float
    """rad/s; by the encoder"""
    current: float
    """A; of both drives"""
    roll_rate: float
    """rad/s"""
    commanded: int
    """-; 1 while the wings are told to flap"""
    valid: int = LEFT | RIGHT
    """-; flags of the encoders that are believed"""
    angles: tuple[float, float] = (0.0, 0.0)
    """rad; left and right by the encoder, kept for the next rates"""


def step(gains: Gains, state: State, dt: float, inputs: CheckInputs) -> State:
    """One look; ``dt`` in s."""
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
    """The state with the wings that stand still while their drives pull, or while the other rocks the vehicle."""
    still = (LEFT if state.stationary_left >= gains.jam_confirmation_time else 0) | (
        RIGHT if state.stationary_right >= gains.jam_confirmation_time else 0
    )
    # The usual current is learned with both wings moving. Without it a strong current may be that of the climb,
    # unless both wings stand still: two encoders do not fail at once.
    comparable = state.usual > 0.0 or still == LEFT | RIGHT
    stalled = comparable and state.current > max(gains.stall_ratio * state.usual, gains.stall_current)
    fresh = still & ~state.lost
    if fresh and (stalled or state.rocking > gains.rocking):
        return state._replace(jammed=state.jammed | fresh)
    return _without_encoder(gains, state, dt) if state.lost and not state.jammed else state


def _without_encoder(gains: Gains, state: State, dt: float) -> State:
    """A wing of a lost encoder: jammed when the other rocks the vehicle for longer than a gust.

    The current alone would mistake a climb for a stall: what is usual is not learned without both encoders.
    """
    rocked = state.rocked + dt if state.rocking > WITHOUT_ENCODER * gains.rocking else 0.0
    return state._replace(rocked=rocked, jammed=state.lost if rocked >= gains.fault_confirmation_time else 0)
