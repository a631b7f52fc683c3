"""Encoder checks against index pulses, the other encoder and the flapping command.

A counter that misses edges keeps the error; the index, once a turn at a known position, measures it. The error is
removed at a limited rate, so that the angle does not jump. An encoder that does not count while the other wing moves
is stuck (or its wing is: the counts cannot distinguish these). An encoder that counts opposite to the other has a
wrong connection or sign. All values are in counts; signs, zeros and angles are in `avionics.sensing.wing_angle`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Final, NamedTuple

from avionics.limits import slew
from avionics.messages import EncoderSample, WingState
from wingbeat.message import Severity
from wingbeat.records import constructor
from wingbeat.units import Quantity

STUCK: Final = 2
"""counts; maximum jitter of a disc at rest on an edge"""
LONGEST_SILENCE_US: Final = 250_000
"""us; age of the last sample above which it is invalid"""
STUCK_PERIODS: Final = 1.5
"""-; periods of the commanded stroke without movement after which both encoders count as stuck"""


class Gains(NamedTuple):
    """Index positions and thresholds of the checks."""

    index_left: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; left counter at its index, after power-up at `wing_angle.Gains.zero_left`"""
    index_right: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; right counter at its index, after power-up at `wing_angle.Gains.zero_right`"""
    index_tolerance: Annotated[float, Quantity("counts", 0.5, 100.0)] = 1.5
    """counts; maximum index error without missed edges. Default: a count in each direction for the play of the disc
    """
    index_trust: Annotated[float, Quantity("counts", 0.5, 1000.0)] = 20.0
    """counts; maximum index error that is accepted at the first pulse; a larger one requires a second, consistent
    pulse. Default: 3.6 degrees; noise on the index line occurs at any position"""
    rezero_rate: Annotated[float, Quantity("counts/s", 1.0, 1e6)] = 600.0
    """counts/s; rate at which missed counts are corrected. Default: 2 rad/s, a fifth of the flap rate"""
    fastest: Annotated[float, Quantity("counts/s", 100.0, 1e7)] = 40000.0
    """counts/s; maximum count rate; a faster counter has jumped. Default: 36 degrees in 5 ms, four times the fastest
    stroke"""
    stuck_detection_travel: Annotated[float, Quantity("counts", 4.0, 10000.0, formerly="still_travel")] = 64.0
    """counts; travel of one wing within which the other must move in the same direction. Default: 0.2 rad, a quarter
    of the smallest stroke; detection within a stroke"""


class Fault(IntEnum):
    """Fault of an encoder."""

    NONE = 0
    STUCK = 1
    OPPOSED = 2


class Side(NamedTuple):
    """State of one encoder besides its count; changes at index pulses and faults."""

    pulses: int = 0
    """-; number of index pulses"""
    target: float = 0.0
    """counts; counter error to be corrected, from the index"""
    index_count: float = 0.0
    """counts; counter error at the last pulse, accepted or not"""
    missed: int = 0
    """counts; sum of the magnitudes of all index errors since boot"""
    fault: int = 0
    """-; `Fault`"""
    woken: int = 0
    """counts; travel since it was detected as stuck"""


class State(NamedTuple):
    """State of the encoder checks."""

    time_us: int = -1
    """us; time of the last sample, -1 before the first"""
    left: int = 0
    """counts; raw counter"""
    right: int = 0
    """counts; raw counter"""
    left_slip: float = 0.0
    """counts; correction subtracted from the counter"""
    right_slip: float = 0.0
    """counts; correction subtracted from the counter"""
    left_anchor: int = 0
    """counts; counter at the last movement of the left encoder"""
    right_anchor: int = 0
    """counts; counter at the last movement of the right encoder"""
    left_stuck_time: int = 0
    """counts; travel of the right wing since then"""
    right_stuck_time: int = 0
    """counts; travel of the left wing since then"""
    opposed: int = 0
    """counts; travel in opposite directions minus travel in the same direction"""
    moving_us: int = -1
    """us; time of the last movement, or of the last tick without a flapping command"""
    left_side: Side = Side()
    right_side: Side = Side()


class Counts(NamedTuple):
    """Corrected counts of the wings."""

    time_us: int
    """us; since boot"""
    left: float
    """counts"""
    right: float
    """counts"""
    valid_left: int = 1
    """-; 0 while the left encoder is rejected"""
    valid_right: int = 1
    """-; 0 while the right encoder is rejected"""
    missed: int = 0
    """counts; missed counts since boot, both counters"""


_new_state: Final = constructor(State)


def step(
    gains: Gains, state: State, sample: EncoderSample, commanded: float = 0.0, parity: float = 1.0
) -> tuple[State, Counts]:
    """Check one sample; a sample that is not later than the last one is ignored.

    Args:
        gains: index positions and thresholds.
        state: result of the last step, ``State()`` at boot.
        sample: raw counters.
        commanded: Hz; commanded flapping frequency, 0 for none.
        parity: positive if both counters have the same sign for an upstroke, negative otherwise.
    """
    time_us, left, right = sample.time_us, sample.left_counts, sample.right_counts
    left_pulses, right_pulses = sample.left_index_pulses, sample.right_index_pulses
    (last_us, left_last, right_last, left_slip, right_slip, left_anchor, right_anchor,
     left_stuck_time, right_stuck_time, opposed, moving_us, left_side, right_side) = state  # fmt: skip
    if time_us <= last_us or last_us < 0:
        state = state if last_us >= 0 else _started(sample)
        return state, _counts(state)
    dt = (time_us - last_us) * 1e-6
    moved_left, moved_right = left - left_last, right - right_last
    bound = gains.fastest * dt
    if not -bound <= moved_left <= bound:
        left_slip, left_side, moved_left = left_slip + moved_left, _jumped(left_side, moved_left), 0
    if not -bound <= moved_right <= bound:
        right_slip, right_side, moved_right = right_slip + moved_right, _jumped(right_side, moved_right), 0

    if commanded <= 0.0:
        moving_us, left_stuck_time, right_stuck_time = time_us, 0, 0
    if -STUCK <= left - left_anchor <= STUCK:
        left_stuck_time += abs(moved_right)
    else:
        left_anchor, left_stuck_time, moving_us = left, 0, time_us
    if -STUCK <= right - right_anchor <= STUCK:
        right_stuck_time += abs(moved_left)
    else:
        right_anchor, right_stuck_time, moving_us = right, 0, time_us
    if opposed or moved_left * moved_right * parity < 0.0:
        opposed = _opposed(opposed, moved_left, moved_right if parity > 0.0 else -moved_right)

    state = _new_state(
        time_us, left, right, left_slip, right_slip, left_anchor, right_anchor, left_stuck_time, right_stuck_time,
        opposed, moving_us, left_side, right_side,
    )  # fmt: skip
    passed = left_pulses != left_side.pulses or right_pulses != right_side.pulses
    if passed or left_slip != left_side.target or right_slip != right_side.target:
        state = _indexed(gains, state, sample, dt)
        left_side, right_side = state.left_side, state.right_side
    limit = gains.stuck_detection_travel
    if left_stuck_time > limit or right_stuck_time > limit or opposed > limit or left_side.fault or right_side.fault:
        state = _judge(gains, state, abs(moved_left), abs(moved_right))
    if (time_us - moving_us) * commanded > STUCK_PERIODS * 1e6:
        state = _both_dead(state)
    return state, _counts(state)


def silence(state: State, time_us: int) -> tuple[State, Counts]:
    """Mark both encoders as stuck after a timeout of the samples at ``time_us``."""
    state = _both_dead(state)
    return state, _counts(state)._replace(time_us=time_us)


def without_missed(state: State, sample: EncoderSample) -> EncoderSample:
    """Return the sample corrected for missed counts, to the nearest count."""
    left, right = sample.left_counts - round(state.left_slip), sample.right_counts - round(state.right_slip)
    return sample._replace(left_counts=left, right_counts=right)


def _started(sample: EncoderSample) -> State:
    """Return the state after the first sample; the wings are assumed to move."""
    time_us, left, right = sample.time_us, sample.left_counts, sample.right_counts
    return State(time_us, left, right, left_anchor=left, right_anchor=right, moving_us=time_us)


_new_counts: Final = constructor(Counts)


def _counts(state: State) -> Counts:
    time_us, left, right, left_slip, right_slip, _, _, _, _, _, _, left_side, right_side = state
    valid_left, valid_right = 0 if left_side.fault else 1, 0 if right_side.fault else 1
    missed = left_side.missed + right_side.missed
    return _new_counts(time_us, left - left_slip, right - right_slip, valid_left, valid_right, missed)


def _jumped(side: Side, moved: int) -> Side:
    """Compensate a counter jump; the wing is assumed at rest until the next index."""
    return side._replace(
        target=side.target + moved, index_count=side.index_count + moved, missed=side.missed + abs(moved)
    )


def _opposed(opposed: int, moved_left: int, moved_right: int) -> int:
    """Return the accumulated opposite travel.

    The common travel of both wings is added if opposite and subtracted otherwise.
    """
    common = min(abs(moved_left), abs(moved_right))
    return opposed + common if moved_left * moved_right < 0 else max(0, opposed - common)


def _indexed(gains: Gains, state: State, sample: EncoderSample, dt: float) -> State:
    """Update the counter errors from index pulses and the corrections by ``dt`` (s)."""
    left_latched, right_latched = sample.left_index_counts, sample.right_index_counts
    left_pulses, right_pulses = sample.left_index_pulses, sample.right_index_pulses
    left_side, left_slip, right_side, right_slip = (
        state.left_side,
        state.left_slip,
        state.right_side,
        state.right_slip,
    )
    if left_pulses != left_side.pulses:
        index_count = left_latched - gains.index_left
        left_side, left_slip = _index_passed(gains, left_side, left_slip, left_pulses, index_count, state.opposed)
    if right_pulses != right_side.pulses:
        index_count = right_latched - gains.index_right
        right_side, right_slip = _index_passed(
            gains, right_side, right_slip, right_pulses, index_count, state.opposed
        )
    return state._replace(
        left_slip=slew(left_slip, left_side.target, gains.rezero_rate, dt),
        right_slip=slew(right_slip, right_side.target, gains.rezero_rate, dt),
        left_side=left_side,
        right_side=right_side,
    )


def _index_passed(
    gains: Gains, side: Side, slip: float, pulses: int, index_count: float, opposed: int
) -> tuple[Side, float]:
    """Process an index pulse: set the counter error, and the correction after a fault."""
    side, before = side._replace(pulses=pulses, index_count=index_count), side
    if side.fault == Fault.STUCK:
        return (side._replace(target=index_count, fault=0), index_count) if side.woken else (side, slip)
    error = abs(index_count - side.target)
    if error <= gains.index_tolerance or opposed > gains.index_trust:
        return side, slip
    if error > gains.index_trust and abs(index_count - before.index_count) > gains.index_trust:
        return side, slip
    return side._replace(target=index_count, missed=side.missed + round(error)), slip


def _judge(gains: Gains, state: State, travel_left: int, travel_right: int) -> State:
    """Detect new and cleared encoder faults."""
    limit = gains.stuck_detection_travel
    left = _woken(limit, state.left_side, travel_left if state.left == state.left_anchor else 0)
    right = _woken(limit, state.right_side, travel_right if state.right == state.right_anchor else 0)
    if left.fault != Fault.STUCK and right.fault != Fault.STUCK:
        if state.left_stuck_time > limit:
            left = _dead(left)
        elif state.right_stuck_time > limit:
            right = _dead(right)
        elif state.opposed == 0 or state.opposed > limit:
            left, right = _distinguish(gains, state.opposed > 0, left, right)
    return state._replace(left_side=left, right_side=right)


def _woken(limit: float, side: Side, travel: int) -> Side:
    """Clear a stuck fault after the travel limit, with or without an index."""
    if side.fault != Fault.STUCK or not travel:
        return side
    woken = side.woken + travel
    return side._replace(woken=woken, fault=0 if woken > limit else side.fault)


def _dead(side: Side) -> Side:
    return side if side.fault == Fault.STUCK else side._replace(fault=int(Fault.STUCK), woken=0)


def _both_dead(state: State) -> State:
    return state._replace(left_side=_dead(state.left_side), right_side=_dead(state.right_side))


def _distinguish(gains: Gains, opposed: bool, left: Side, right: Side) -> tuple[Side, Side]:
    """Determine which of two opposing encoders is wrong by its index error.

    Both are marked if the indices do not distinguish them.
    """
    if not opposed:
        return left._replace(fault=0), right._replace(fault=0)
    off_left = abs(left.index_count - left.target) > gains.index_trust
    off_right = abs(right.index_count - right.target) > gains.index_trust
    wrong = int(Fault.OPPOSED)
    return (
        left._replace(fault=wrong if off_left or not off_right else 0),
        right._replace(fault=wrong if off_right or not off_left else 0),
    )


def health(wing: WingState) -> tuple[int, int, int]:
    """Return the validity of both encoders and the number of missed counts."""
    return wing.valid_left, wing.valid_right, wing.missed_counts


def changes(before: WingState, now: WingState) -> list[tuple[Severity, str]]:
    """Return the events for changes of the encoder states."""
    said = []
    for side, was, is_now in (
        ("left", before.valid_left, now.valid_left),
        ("right", before.valid_right, now.valid_right),
    ):
        if was and not is_now:
            said.append((Severity.ERROR, f"{side} encoder rejected: stuck or reversed"))
        elif is_now and not was:
            said.append((Severity.NOTICE, f"{side} encoder resumed"))
    if now.missed_counts > before.missed_counts:
        text = f"encoder re-zeroed at its index: {now.missed_counts - before.missed_counts} counts missed"
        said.append((Severity.WARNING, f"{text}, {now.missed_counts} since boot"))
    return said
