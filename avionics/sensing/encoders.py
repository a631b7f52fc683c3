"""The encoders' counters against their index pulses, against each other, and against what is asked of the wings.

A counter that misses edges stays wrong for ever; the index, once a turn at a known place, tells by how much. What it
tells is taken back slowly, so that no angle jumps. An encoder that stands still while the other wing moves is dead
(or its wing is: the counts cannot tell), and one that counts against the other is wired or told the wrong way round.
All in counts: signs, zeros and angles are `avionics.sensing.wing_angle`'s.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple

from avionics.limits import slew
from avionics.messages import EncoderSample, WingState
from wingbeat.message import Severity
from wingbeat.records import constructor
from wingbeat.units import Quantity

STUCK = 2
"""counts; a disc that rests on an edge trembles by less"""
LONGEST_SILENCE_US = 250_000
"""us; without a sample after which the last says nothing of the wings"""
PATIENCE = 1.5
"""-; periods of the commanded stroke without a movement after which both encoders are dead"""


class Gains(NamedTuple):
    """Where the indices are, and what is believed."""

    index_left: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; of the left counter at its index, as powered up for `wing_angle.Gains.zero_left`"""
    index_right: Annotated[float, Quantity("counts", -1e6, 1e6)] = 0.0
    """counts; of the right counter at its index, as powered up for `wing_angle.Gains.zero_right`"""
    index_tolerance: Annotated[float, Quantity("counts", 0.5, 100.0)] = 1.5
    """counts; by which an index may be off without an edge missed. Default: a count either way for the play of the
    disc"""
    index_trust: Annotated[float, Quantity("counts", 0.5, 1000.0)] = 20.0
    """counts; an index that is further off must be off again by as much before it is believed. Default: 3.6 degrees;
    a spike on the index line lies anywhere in the stroke"""
    rezero_rate: Annotated[float, Quantity("counts/s", 1.0, 1e6)] = 600.0
    """counts/s; with which missed counts are taken back. Default: 2 rad/s, a fifth of the flap rate"""
    fastest: Annotated[float, Quantity("counts/s", 100.0, 1e7)] = 40000.0
    """counts/s; a counter that moves faster has jumped. Default: 36 degrees in 5 ms, four times the fastest
    stroke"""
    stuck_detection_travel: Annotated[float, Quantity("counts", 4.0, 10000.0, formerly="still_travel")] = 64.0
    """counts; travel of one wing within which the other must move, and in the same direction. Default: 0.2 rad, a
    quarter of the smallest stroke flown; less than a stroke later the fault is known"""


class Fault(IntEnum):
    """What is wrong with an encoder."""

    NONE = 0
    STUCK = 1
    OPPOSED = 2


class Side(NamedTuple):
    """What is known of one encoder beyond its count; changes with its index and its faults only."""

    pulses: int = 0
    """-; index pulses seen"""
    target: float = 0.0
    """counts; by which the counter is too high, as the index tells"""
    index_count: float = 0.0
    """counts; the same, as the last pulse told it, believed or not"""
    missed: int = 0
    """counts; by which the index has moved since boot, all moves added"""
    fault: int = 0
    """-; `Fault`"""
    woken: int = 0
    """counts; travelled since it was found dead"""


class State(NamedTuple):
    """What the check remembers."""

    time_us: int = -1
    """us; of the last sample, -1 before the first"""
    left: int = 0
    """counts; as read"""
    right: int = 0
    """counts; as read"""
    left_slip: float = 0.0
    """counts; taken off the counter"""
    right_slip: float = 0.0
    """counts; taken off the counter"""
    left_anchor: int = 0
    """counts; where the left encoder last moved"""
    right_anchor: int = 0
    """counts; where the right encoder last moved"""
    left_stuck_time: int = 0
    """counts; travel of the right wing since then"""
    right_stuck_time: int = 0
    """counts; travel of the left wing since then"""
    opposed: int = 0
    """counts; travel of the wings against each other, less that with each other"""
    moving_us: int = -1
    """us; when either moved, or when flapping was not commanded"""
    left_side: Side = Side()
    right_side: Side = Side()


class Counts(NamedTuple):
    """Counts of the wings without what was missed."""

    time_us: int
    """us; since boot"""
    left: float
    """counts"""
    right: float
    """counts"""
    valid_left: int = 1
    """-; 0 while the left encoder is not believed"""
    valid_right: int = 1
    """-; 0 while the right encoder is not believed"""
    missed: int = 0
    """counts; missed since boot, both counters"""


_new_state = constructor(State)


def step(
    gains: Gains, state: State, sample: EncoderSample, commanded: float = 0.0, parity: float = 1.0
) -> tuple[State, Counts]:
    """One sample on; one that is not later than the last changes nothing.

    Args:
        gains: places of the indices and what is believed.
        state: what the last step returned, ``State()`` at boot.
        sample: as the counters were read.
        commanded: Hz; flapping that is asked of the wings, 0 for none.
        parity: above 0 where both counters rise with the wings up or both fall, below 0 where one does.
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
    if (time_us - moving_us) * commanded > PATIENCE * 1e6:
        state = _both_dead(state)
    return state, _counts(state)


def silence(state: State, time_us: int) -> tuple[State, Counts]:
    """No sample for so long that neither encoder is believed; ``time_us`` is now."""
    state = _both_dead(state)
    return state, _counts(state)._replace(time_us=time_us)


def without_missed(state: State, sample: EncoderSample) -> EncoderSample:
    """The sample with the counts that were missed put back, to the nearest count."""
    left, right = sample.left_counts - round(state.left_slip), sample.right_counts - round(state.right_slip)
    return sample._replace(left_counts=left, right_counts=right)


def _started(sample: EncoderSample) -> State:
    """At the first sample: the wings are taken to move."""
    time_us, left, right = sample.time_us, sample.left_counts, sample.right_counts
    return State(time_us, left, right, left_anchor=left, right_anchor=right, moving_us=time_us)


_new_counts = constructor(Counts)


def _counts(state: State) -> Counts:
    time_us, left, right, left_slip, right_slip, _, _, _, _, _, _, left_side, right_side = state
    valid_left, valid_right = 0 if left_side.fault else 1, 0 if right_side.fault else 1
    missed = left_side.missed + right_side.missed
    return _new_counts(time_us, left - left_slip, right - right_slip, valid_left, valid_right, missed)


def _jumped(side: Side, moved: int) -> Side:
    """The counter jumped: the wing is taken to have stood still, until the index tells better."""
    return side._replace(
        target=side.target + moved, index_count=side.index_count + moved, missed=side.missed + abs(moved)
    )


def _opposed(opposed: int, moved_left: int, moved_right: int) -> int:
    """Travel of the wings against each other: what is common to both, added when against and taken off when with."""
    common = min(abs(moved_left), abs(moved_right))
    return opposed + common if moved_left * moved_right < 0 else max(0, opposed - common)


def _indexed(gains: Gains, state: State, sample: EncoderSample, dt: float) -> State:
    """The state after ``dt`` s with what the indices of ``sample`` tell, the slips on their way to it."""
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
    """What an index pulse changes: the slip to be reached, and at once the slip of an encoder that comes back."""
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
    """Find the encoders at fault, and those that are no longer."""
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
    """A dead encoder after some travel: it counts again once it has moved as far as it missed, index or not."""
    if side.fault != Fault.STUCK or not travel:
        return side
    woken = side.woken + travel
    return side._replace(woken=woken, fault=0 if woken > limit else side.fault)


def _dead(side: Side) -> Side:
    return side if side.fault == Fault.STUCK else side._replace(fault=int(Fault.STUCK), woken=0)


def _both_dead(state: State) -> State:
    return state._replace(left_side=_dead(state.left_side), right_side=_dead(state.right_side))


def _distinguish(gains: Gains, opposed: bool, left: Side, right: Side) -> tuple[Side, Side]:
    """Which of two encoders that count against each other is wrong: the one whose index is not at its place.

    Both, when the indices cannot tell.
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
    """Return which encoders are valid and how many counts were missed."""
    return wing.valid_left, wing.valid_right, wing.missed_counts


def changes(before: WingState, now: WingState) -> list[tuple[Severity, str]]:
    """What is to be said of the encoders, from the last wing state to this one."""
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
