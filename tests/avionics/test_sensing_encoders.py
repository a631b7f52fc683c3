"""Encoders against their indices, each other, and the commanded stroke: missed counts, dead and reversed encoders."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.messages import EncoderSample, WingState
from avionics.sensing import encoders, wing_angle
from avionics.sensing.encoders import Fault
from wingbeat.message import Severity

PERIOD_US = 5000
FREQUENCY, AMPLITUDE = 4.0, 0.4
INDEX_ANGLE, INDEX = 0.15, 47
GAINS = encoders.Gains(index_left=INDEX, index_right=INDEX)
WING_GAINS = wing_angle.Gains()
COUNTS_PER_RAD = 2000.0 / math.tau

Alter = Callable[[int, EncoderSample], EncoderSample]


class Counter:
    """A counter with an index, written from the data sheet's description, not from the simulated one."""

    def __init__(self) -> None:
        self.lost = 0
        self.place = 0
        self.latched = self.pulses = 0

    def read(self, angle: float) -> tuple[int, int, int]:
        place = math.floor(angle * COUNTS_PER_RAD)
        way = 1 if place > self.place else -1
        for passed in range(self.place + way, place + way, way):
            if passed == INDEX:
                self.latched, self.pulses = passed - self.lost, self.pulses + 1
        self.place = place
        return place - self.lost, self.latched, self.pulses


class Row(NamedTuple):
    time: float
    true: float
    phase: float
    state: encoders.State
    wing: WingState


def wing(t: float) -> float:
    """From rest, a sine about 0.1 rad."""
    return 0.1 + AMPLITUDE * math.sin(math.tau * FREQUENCY * t)


class Rig:
    """Two wings that move together, their encoders, and the flight code behind them."""

    def __init__(self, gains: encoders.Gains = GAINS, commanded: float = FREQUENCY, parity: float = 1.0) -> None:
        self.left, self.right = Counter(), Counter()
        self.gains, self.commanded, self.parity = gains, commanded, parity
        self.tick = 0
        self.encoders, self.wing = encoders.State(), wing_angle.State()
        self.rows: list[Row] = []

    def run(self, seconds: float, alter: Alter = lambda tick, sample: sample) -> Rig:
        for _ in range(round(seconds * 1e6 / PERIOD_US)):
            t = self.tick * PERIOD_US * 1e-6
            left, right = self.left.read(wing(t)), self.right.read(wing(t))
            sample = EncoderSample(self.tick * PERIOD_US, left[0], right[0], left[1], right[1], left[2], right[2])
            sample = alter(self.tick, sample)
            asked = wing_angle.Commanded(self.commanded, math.tau * (FREQUENCY * t % 1.0))
            self.encoders, counts = encoders.step(self.gains, self.encoders, sample, self.commanded, self.parity)
            self.wing, message = wing_angle.step(WING_GAINS, self.wing, counts, asked)
            self.rows.append(Row(t, wing(t), asked.phase, self.encoders, message))
            self.tick += 1
        return self

    def check_phase(self, since: float, until: float = math.inf) -> None:
        checked = [row for row in self.rows if since <= row.time < until]
        assert checked
        for row in checked:
            error = (row.wing.phase - row.phase + math.pi) % math.tau - math.pi
            assert abs(math.degrees(error)) < 2.0
            assert row.wing.frequency == pytest.approx(FREQUENCY, rel=0.01)


def frozen_left(tick: int, sample: EncoderSample) -> EncoderSample:
    return sample._replace(left_counts=-30, left_index_counts=INDEX, left_index_pulses=5)


def frozen(tick: int, sample: EncoderSample) -> EncoderSample:
    return EncoderSample(sample.time_us, -30, 12, INDEX, INDEX, 5, 5)


def reversed_left(tick: int, sample: EncoderSample) -> EncoderSample:
    """Channels A and B swapped: it counts down, and so does what the index latches."""
    return sample._replace(left_counts=-sample.left_counts, left_index_counts=-sample.left_index_counts)


def test_good_encoders_pass_as_they_are() -> None:
    rig = Rig().run(3.0)
    assert all(row.wing[-3:] == (1, 1, 0) for row in rig.rows)
    assert all(abs(row.wing.angle_left - row.true) <= 1.0 / COUNTS_PER_RAD for row in rig.rows)
    rig.check_phase(since=0.6)


@pytest.mark.parametrize("lost", [3, 12, -15, 40, -90])
def test_missed_counts_are_found_and_taken_back_without_a_jump(lost: int) -> None:
    """GIVEN counts lost at 2.03 s THEN the index tells how many, and the angle comes back slowly and stays right."""
    rig = Rig().run(2.03)
    rig.left.lost = lost
    rig.run(2.0)
    assert rig.rows[-1].wing.missed_counts == pytest.approx(abs(lost), abs=1)
    assert rig.rows[-1].wing[-3:-1] == (1, 1)
    errors = [row.wing.angle_left - row.true for row in rig.rows]
    steps = [b - a for a, b in pairwise(errors[407:])]
    assert max(map(abs, steps)) <= GAINS.rezero_rate * 0.005 / COUNTS_PER_RAD + 1.0 / COUNTS_PER_RAD
    back = 2.03 + 0.25 + abs(lost) / GAINS.rezero_rate + 0.01
    assert all(abs(row.wing.angle_left - row.true) < 2.0 / COUNTS_PER_RAD for row in rig.rows if row.time > back)
    rig.check_phase(since=2.03 + (1.0 if abs(lost) <= 15 else 5.0) / FREQUENCY)


@given(losses=st.lists(st.tuples(st.integers(-60, 60), st.integers(-60, 60)), min_size=1, max_size=4))
@settings(max_examples=15, deadline=None)
def test_phase_is_good_five_strokes_after_any_losses(losses: list[tuple[int, int]]) -> None:
    """The index tells within half a stroke (a great loss: one), then the angle comes back, then strokes count."""
    rig = Rig().run(1.01)
    for left, right in losses:
        rig.left.lost += left
        rig.right.lost += right
        start = rig.tick * PERIOD_US * 1e-6
        rig.run(1.49)
        rig.check_phase(since=start + 5.0 / FREQUENCY, until=start + 1.49)


def test_a_spike_on_the_index_line_is_not_believed() -> None:
    """GIVEN one index pulse at a wrong place THEN no count is taken for missed."""

    def spiked(tick: int, sample: EncoderSample) -> EncoderSample:
        early = tick < 310
        return sample._replace(
            left_index_counts=sample.left_index_counts if early or tick > 312 else sample.left_counts,
            left_index_pulses=sample.left_index_pulses + (0 if early else 1),
        )

    rig = Rig().run(3.0, spiked)
    assert rig.rows[-1].wing.missed_counts == 0
    rig.check_phase(since=0.6)


def test_power_up_outside_the_jig_is_put_right_by_the_index() -> None:
    rig = Rig()
    rig.left.lost = rig.right.lost = 55
    rig.run(2.0)
    assert rig.rows[-1].wing.angle_left == pytest.approx(rig.rows[-1].true, abs=1.0 / COUNTS_PER_RAD)


def test_an_encoder_without_index_is_left_alone() -> None:
    def no_index(tick: int, sample: EncoderSample) -> EncoderSample:
        return EncoderSample(*sample[:3])

    rig = Rig().run(1.0, no_index)
    rig.left.lost = 20
    rig.run(1.0, no_index)
    assert rig.rows[-1].wing[-3:] == (1, 1, 0)
    assert rig.rows[-1].wing.angle_left == pytest.approx(rig.rows[-1].true - 20 / COUNTS_PER_RAD, abs=0.004)


def test_a_counter_that_jumps_does_not_move_the_wing() -> None:
    """GIVEN a counter reset to 5000 counts elsewhere THEN the angle goes on, within what the wing moved meanwhile."""
    rig = Rig().run(2.0)
    rig.right.lost = 5000
    rig.run(2.0)
    errors = [row.wing.angle_right - row.true for row in rig.rows]
    assert max(map(abs, errors)) < 0.06
    assert abs(errors[-1]) < 2.0 / COUNTS_PER_RAD


def test_a_dead_encoder_is_found_within_half_a_stroke_and_mirrored() -> None:
    rig = Rig().run(2.0).run(2.0, frozen_left)
    invalid = [row.time for row in rig.rows if not row.wing.valid_left]
    assert 2.0 < invalid[0] < 2.0 + 0.5 / FREQUENCY
    after = [row for row in rig.rows if row.time > invalid[0]]
    assert all(row.wing[-3:-1] == (0, 1) for row in after)
    assert all(row.wing.angle_left == row.wing.angle_right for row in after)
    assert all(row.wing.amplitude_left == pytest.approx(AMPLITUDE, rel=0.02) for row in after if row.time > 2.5)
    rig.check_phase(since=2.0 + 4.0 / FREQUENCY)


@pytest.mark.parametrize("dead_at", [2.0 + 0.0125 * i for i in range(20)])
def test_phase_and_frequency_outlive_an_encoder_that_dies_at_any_phase(dead_at: float) -> None:
    def stuck(tick: int, sample: EncoderSample) -> EncoderSample:
        return sample._replace(right_counts=held, right_index_pulses=99)

    rig = Rig().run(dead_at)
    held = rig.encoders.right
    rig.run(1.5, stuck)
    assert rig.rows[-1].wing[-3:-1] == (1, 0)
    rig.check_phase(since=dead_at + 3.0 / FREQUENCY)
    assert all(row.wing.flapping for row in rig.rows if row.time > 1.0)


def test_an_encoder_that_comes_back_is_believed_from_its_index_on() -> None:
    rig = Rig().run(1.0).run(1.0, frozen_left)
    rig.left.lost = 33
    rig.run(1.0)
    assert rig.rows[-1].wing[-3:-1] == (1, 1)
    assert rig.rows[-1].wing.angle_left == pytest.approx(rig.rows[-1].true, abs=2.0 / COUNTS_PER_RAD)
    rig.check_phase(since=2.6)


def test_both_dead_the_command_stands_in() -> None:
    """GIVEN both counters still while 4 Hz are asked THEN frequency and phase are the commanded ones."""
    rig = Rig().run(2.0).run(2.0, frozen)
    late = [row for row in rig.rows if row.time > 2.0 + 1.6 / FREQUENCY]
    for row in late:
        assert row.wing[-3:-1] == (0, 0)
        assert (row.wing.frequency, row.wing.phase, row.wing.flapping) == (FREQUENCY, row.phase, 1)
    rig.run(1.5)
    assert rig.rows[-1].wing[-3:-1] == (1, 1)
    rig.check_phase(since=4.8)


def test_without_samples_both_are_dead() -> None:
    rig = Rig().run(2.0)
    _, counts = encoders.silence(rig.encoders, 2_400_000)
    assert (counts.time_us, counts.valid_left, counts.valid_right) == (2_400_000, 0, 0)
    _, message = wing_angle.step(WING_GAINS, rig.wing, counts, wing_angle.Commanded(3.5, 1.0))
    assert (message.time_us, message.frequency, message.phase, message.flapping) == (2_400_000, 3.5, 1.0, 1)
    _, message = wing_angle.step(WING_GAINS, rig.wing, counts, wing_angle.Commanded())
    assert (message.frequency, message.flapping) == (0.0, 0)


def test_a_calibration_at_rest_is_given_the_counts_without_what_was_missed() -> None:
    rig = Rig().run(1.0)
    rig.left.lost = 20
    rig.run(1.0)
    sample = EncoderSample(rig.encoders.time_us, rig.encoders.left, rig.encoders.right)
    put_back = encoders.without_missed(rig.encoders, sample)
    assert (put_back.left_counts, put_back.right_counts) == (sample.left_counts + 20, sample.right_counts)


def test_wings_at_rest_or_moved_by_hand_are_no_fault() -> None:
    """GIVEN one wing moved while nothing is commanded THEN both encoders stay believed."""
    rig = Rig(commanded=0.0).run(3.0, frozen_left)
    assert all(row.wing[-3:-1] == (1, 1) for row in rig.rows)


def test_a_reversed_encoder_is_the_one_whose_index_is_elsewhere() -> None:
    rig = Rig().run(2.0, reversed_left)
    assert rig.encoders.left_side.fault == Fault.OPPOSED
    assert rig.rows[-1].wing[-3:-1] == (0, 1)
    rig.check_phase(since=1.0)


def test_which_is_reversed_is_not_known_without_an_index() -> None:
    def reversed_without_index(tick: int, sample: EncoderSample) -> EncoderSample:
        return EncoderSample(*reversed_left(tick, sample)[:3])

    rig = Rig().run(2.0, reversed_without_index)
    assert rig.rows[-1].wing[-3:-1] == (0, 0)
    assert rig.rows[-1].wing.frequency == FREQUENCY


def test_an_encoder_mounted_the_other_way_round_is_none_reversed() -> None:
    gains = GAINS._replace(index_left=-INDEX)
    rig = Rig(gains, parity=-1.0).run(2.0, reversed_left)
    assert all(row.state.left_side.fault == row.state.right_side.fault == 0 for row in rig.rows)


def test_a_wrong_sign_put_right_in_flight_is_forgiven() -> None:
    rig = Rig().run(2.0, reversed_left)
    rig.parity, rig.gains = -1.0, GAINS._replace(index_left=-INDEX)
    rig.run(2.0, reversed_left)
    assert (rig.encoders.left_side.fault, rig.encoders.right_side.fault) == (0, 0)


def test_time_that_does_not_advance_changes_nothing() -> None:
    rig = Rig().run(1.0)
    again = EncoderSample(rig.encoders.time_us, 500, 500, 9, 9, 99, 99)
    assert encoders.step(GAINS, rig.encoders, again, 4.0)[0] == rig.encoders
    assert encoders.step(GAINS, rig.encoders, again._replace(time_us=0), 4.0)[0] == rig.encoders


def test_what_changed_is_said_once() -> None:
    rig = Rig().run(1.0).run(1.0, frozen_left).run(1.0)
    rig.right.lost = 10
    rig.run(1.0)
    said = [said for before, now in pairwise(rig.rows) for said in encoders.changes(before.wing, now.wing)]
    assert [severity for severity, _ in said] == [Severity.ERROR, Severity.NOTICE, Severity.WARNING]
    assert said[0][1].startswith("left encoder rejected")
    assert "10 counts missed" in said[2][1]


counts = st.integers(-(2**31), 2**31 - 1)


@given(
    st.lists(
        st.tuples(st.integers(-3, 400000), counts, st.integers(-5000, 5000), counts, counts, st.integers(0, 9)),
        max_size=60,
    ),
    st.floats(0.0, 20.0),
)
def test_any_samples_give_finite_counts(steps: list[tuple[int, ...]], commanded: float) -> None:
    state, wings, time_us = encoders.State(), wing_angle.State(), 0
    for dt, left, right, left_index, right_index, pulses in steps:
        time_us = max(0, time_us + dt)
        sample = EncoderSample(time_us, left, right, left_index, right_index, pulses, pulses // 2)
        state, found = encoders.step(GAINS, state, sample, commanded)
        wings, message = wing_angle.step(WING_GAINS, wings, found, wing_angle.Commanded(commanded, 1.0))
        assert all(math.isfinite(value) for value in (*found, *message))
        assert 0.0 <= message.phase <= math.tau
