"""Wing motion from encoder counts: phase, frequency, amplitude, and what is no stroke."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from avionics.messages import WingState
from avionics.sensing import wing_angle
from avionics.sensing.encoders import Counts

GAINS = wing_angle.Gains()
PERIOD_US = 5000


def counts(angle: float) -> int:
    """Last edge passed of a 2000-count encoder."""
    return math.floor(angle * 2000.0 / math.tau)


def measured(
    left: Callable[[float], float],
    right: Callable[[float], float] | None = None,
    seconds: float = 4.0,
    gains: wing_angle.Gains = GAINS,
) -> list[WingState]:
    state = wing_angle.State()
    messages = []
    for k in range(round(seconds * 1e6 / PERIOD_US)):
        t = k * PERIOD_US * 1e-6
        sample = Counts(k * PERIOD_US, counts(left(t)), counts((right or left)(t)))
        state, message = wing_angle.step(gains, state, sample)
        messages.append(message)
    return messages


def sine(frequency: float, amplitude: float, mean: float = 0.0, start: float = 0.0) -> Callable[[float], float]:
    return lambda t: mean + amplitude * math.sin(math.tau * frequency * t + start)


def phase_error(message: WingState, frequency: float, start: float) -> float:
    true = math.tau * frequency * message.time_us * 1e-6 + start
    return (message.phase - true + math.pi) % math.tau - math.pi


@given(
    frequency=st.floats(1.0, 15.0),
    amplitude=st.floats(0.3, 1.0),
    mean=st.floats(-0.3, 0.3),
    start=st.floats(0.0, 6.28),
)
def test_phase_and_frequency_after_one_stroke(frequency: float, amplitude: float, mean: float, start: float) -> None:
    """Within 2 degrees and 1 % from the first full stroke on, at 1 to 15 Hz, 200 samples a second."""
    messages = measured(sine(frequency, amplitude, mean, start), seconds=5.0 / frequency + 1.0)
    settled = [m for m in messages if m.strokes >= 1]
    assert settled
    for message in settled:
        assert abs(math.degrees(phase_error(message, frequency, start))) < 2.0
        assert message.frequency == pytest.approx(frequency, rel=0.01)
        assert message.flapping == 1


def test_strokes_are_counted() -> None:
    messages = measured(sine(4.0, 0.8), seconds=10.0)
    assert messages[-1].strokes == pytest.approx(39, abs=1)
    rises = [b.strokes - a.strokes for a, b in itertools.pairwise(messages)]
    assert set(rises) == {0, 1}


def test_left_and_right_are_told_apart() -> None:
    last = measured(sine(4.0, 0.6, 0.1), sine(4.0, 0.4, 0.1))[-1]
    assert last.amplitude_left == pytest.approx(0.6, rel=0.01)
    assert last.amplitude_right == pytest.approx(0.4, rel=0.01)
    assert last.mean_angle == pytest.approx(0.1, abs=0.004)


class Beat(NamedTuple):
    """Half cosines down and up, of different length: the true motion, from which the true phase is defined.

    The phase is 0 where the wing passes the stroke's middle on its way up, and runs in equal times from there.
    """

    frequency: float
    amplitude: float
    mean: float
    downstroke: float
    start: float

    def angle(self, t: float) -> float:
        turn = (t * self.frequency + self.start) % 1.0
        if turn < self.downstroke:
            return self.mean + self.amplitude * math.cos(math.pi * turn / self.downstroke)
        return self.mean - self.amplitude * math.cos(math.pi * (turn - self.downstroke) / (1.0 - self.downstroke))

    def phase(self, t: float) -> float:
        return math.tau * ((t * self.frequency + self.start - 0.5 * (1.0 + self.downstroke)) % 1.0)

    def error_deg(self, message: WingState) -> float:
        true = self.phase(message.time_us * 1e-6)
        return math.degrees((message.phase - true + math.pi) % math.tau - math.pi)


beats = st.builds(
    Beat, st.floats(1.0, 12.0), st.floats(0.25, 1.0), st.floats(-0.3, 0.3), st.floats(0.4, 0.6), st.floats(0.0, 1.0)
)


@given(beat=beats)
@example(Beat(10.48, 0.2664, -0.07914, 0.56957, 0.71028))
@example(Beat(11.906, 0.479, -0.2067, 0.5897, 0.60087))
def test_phase_and_frequency_of_unequal_halves_after_one_stroke(beat: Beat) -> None:
    """Within 2 degrees and 1 %; the ratio within 0.05: the encoder's steps blur when a flat top is passed."""
    settled = [m for m in measured(beat.angle, seconds=4.0 / beat.frequency + 1.0) if m.strokes >= 1]
    assert settled[0].time_us * 1e-6 < 3.0 / beat.frequency
    for message in settled:
        assert abs(beat.error_deg(message)) < 2.0
        assert message.frequency == pytest.approx(beat.frequency, rel=0.01)
        assert message.amplitude_left == pytest.approx(beat.amplitude, rel=0.02)
        assert message.downstroke_ratio == pytest.approx(beat.downstroke, abs=0.05)


class Crank(NamedTuple):
    """A motor's crank whose speed follows a moving throttle as a lag, from rest, and what the map makes of it."""

    slow: float
    """Hz; about which the throttle swings"""
    swing: float
    """-; of the frequency, either way"""
    rate: float
    """Hz; of the throttle's swing"""
    lag: float
    """s"""
    off: float
    """-; factor by which the map is wrong"""

    def simulate(self, gains: wing_angle.Gains, seconds: float) -> list[tuple[float, float, WingState]]:
        """True phase in turns, true frequency (Hz), and what is measured, at each sample once it has run up."""
        fine = 20
        dt = PERIOD_US * 1e-6 / fine
        speed, turns, state, stated = 0.0, 0.0, wing_angle.State(), []
        for k in range(round(seconds * 1e6 / PERIOD_US)):
            for i in range(fine):
                asked = self.slow * (1.0 + self.swing * math.sin(math.tau * self.rate * (k * fine + i) * dt))
                speed += dt / self.lag * (asked - speed)
                turns += speed * dt
            at = counts(0.6 * math.sin(math.tau * turns))
            commanded = wing_angle.Commanded(frequency=asked * self.off)
            state, message = wing_angle.step(gains, state, Counts((k + 1) * PERIOD_US, at, at), commanded)
            stated.append((turns, speed, message))
        return stated[round(8.0 * self.lag * 1e6 / PERIOD_US) :]


cranks = st.builds(
    Crank, st.floats(2.0, 6.0), st.floats(0.0, 0.15), st.floats(0.1, 0.5), st.floats(0.08, 0.2), st.floats(0.8, 1.25)
)


@given(crank=cranks)
@settings(max_examples=25, deadline=None)
def test_a_motors_phase_is_known_while_its_throttle_moves(crank: Crank) -> None:
    """And by the crossings alone it is not, by far: the throttle tells how the stroke goes on."""
    followed = crank.simulate(GAINS._replace(drive_lag=crank.lag), 6.0)
    for turns, speed, message in followed:
        if message.strokes >= 2:
            error = (message.phase / math.tau - turns + 0.5) % 1.0 - 0.5
            assert abs(error) * 360.0 < 2.0
            assert message.frequency == pytest.approx(speed, rel=0.03)


def test_by_its_crossings_alone_a_swinging_motors_phase_is_off() -> None:
    crank = Crank(3.0, 0.15, 0.4, 0.15, 1.0)
    errors: list[float] = []
    for lag in (0.15, 1.0):
        stated = crank.simulate(GAINS._replace(drive_lag=lag), 8.0)
        turned = [(m.phase / math.tau - turns + 0.5) % 1.0 - 0.5 for turns, _, m in stated if m.strokes >= 2]
        errors.append(max(map(abs, turned)) * 360.0)
    assert errors[0] < 2.0 < 4.0 < errors[1]


def test_a_motor_that_is_cut_runs_on_by_its_crossings() -> None:
    """The wings still beat while the clock of the throttle has stopped."""
    state = wing_angle.State()
    gains = GAINS._replace(drive_lag=0.1)
    for k in range(600):
        at = counts(0.6 * math.sin(math.tau * 4.0 * k * PERIOD_US * 1e-6))
        asked = wing_angle.Commanded(frequency=4.0 if k < 400 else 0.0)
        state, message = wing_angle.step(gains, state, Counts(k * PERIOD_US, at, at), asked)
    assert message.flapping == 1
    assert message.frequency == pytest.approx(4.0, rel=0.01)
    assert abs(math.degrees(phase_error(message, 4.0, 0.0))) < 2.0


@given(beat=beats, change=st.floats(0.6, 1.6))
def test_a_new_frequency_is_known_one_stroke_after_the_change(beat: Beat, change: float) -> None:
    """GIVEN a frequency that steps at a top THEN after the first stroke flown with it all is right."""
    tops = math.ceil(beat.start + 3.0)
    step = (tops - beat.start) / beat.frequency
    after = beat._replace(frequency=min(max(change * beat.frequency, 1.0), 12.0), start=0.0)

    def angle(t: float) -> float:
        return beat.angle(t) if t < step else after.angle(t - step)

    for message in measured(angle, seconds=step + 3.5 / after.frequency):
        since = message.time_us * 1e-6 - step
        # One whole stroke from crossing to crossing lies behind from the second upward crossing on.
        if since * after.frequency > 0.5 * (1.0 + beat.downstroke) + 1.15:
            assert abs(after.error_deg(message._replace(time_us=round(since * 1e6)))) < 2.0
            assert message.frequency == pytest.approx(after.frequency, rel=0.01)


def test_a_small_stroke_is_known_as_well_as_its_counts_tell() -> None:
    """At 0.1 rad a count is 1.8 degrees of phase: 1 % and 1.5 degrees RMS remain, and 4 degrees at most."""
    beat = Beat(4.0, 0.1, 0.2, 0.5, 0.3)
    errors = [beat.error_deg(m) for m in measured(beat.angle, seconds=20.0) if m.strokes >= 1]
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) < 1.5
    assert max(map(abs, errors)) < 4.0


def test_downstroke_ratio_of_either_side() -> None:
    """GIVEN wings whose downstrokes take 0.42 and 0.55 of the stroke THEN each side's ratio is told."""
    left, right = Beat(4.0, 0.6, 0.0, 0.42, 0.0), Beat(4.0, 0.6, 0.0, 0.55, -0.065)
    last = measured(left.angle, right.angle)[-1]
    assert last.downstroke_ratio_left == pytest.approx(0.42, abs=0.02)
    assert last.downstroke_ratio_right == pytest.approx(0.55, abs=0.02)


def test_rate_of_a_steady_turn() -> None:
    messages = measured(lambda t: 2.0 * t, seconds=0.5)
    assert all(m.rate_left == pytest.approx(2.0, abs=0.35) for m in messages[10:])
    mean = sum(m.rate_left for m in messages[10:]) / len(messages[10:])
    assert mean == pytest.approx(2.0, abs=0.02)


def test_rate_amplitude_while_flapping() -> None:
    peak = max(m.rate_left for m in measured(sine(4.0, 0.8)))
    assert peak == pytest.approx(0.8 * math.tau * 4.0, rel=0.03)


def test_rest_and_trembling_are_no_flapping() -> None:
    assert not any(m.flapping for m in measured(lambda t: 0.2))
    assert not any(m.flapping for m in measured(sine(5.0, 0.03)))


def test_stopping_is_noticed_within_one_and_a_half_periods() -> None:
    """GIVEN flapping at 4 Hz that stops at 2 s THEN flapping and frequency are 0 from 2.4 s on."""
    messages = measured(lambda t: sine(4.0, 0.8)(min(t, 2.0)), seconds=4.0)
    for message in messages:
        if 1.0 < message.time_us * 1e-6 < 2.0:
            assert message.flapping == 1
        if message.time_us * 1e-6 > 2.4:
            assert (message.flapping, message.frequency, message.phase) == (0, 0.0, 0.0)


def test_flapping_again_about_another_middle() -> None:
    def angle(t: float) -> float:
        return sine(4.0, 0.8)(t) if t < 2.0 else 0.5 if t < 4.0 else sine(3.0, 0.4, 0.6)(t)

    messages = measured(angle, seconds=6.0)
    assert not any(m.flapping for m in messages[500:800])
    assert messages[-1].frequency == pytest.approx(3.0, rel=0.01)
    assert messages[-1].mean_angle == pytest.approx(0.6, abs=0.005)


def test_change_of_frequency_is_followed_in_one_stroke() -> None:
    def angle(t: float) -> float:
        return 0.8 * math.sin(math.tau * (3.0 * min(t, 2.0) + 5.0 * max(0.0, t - 2.0)))

    messages = measured(angle)
    at = {round(m.time_us * 1e-6, 3): m for m in messages}
    assert at[1.9].frequency == pytest.approx(3.0, rel=0.01)
    assert at[2.25].frequency == pytest.approx(5.0, rel=0.01)


def test_counts_become_angles() -> None:
    gains = GAINS._replace(zero_left=100.0, zero_right=-50.0, sign_right=-1.0, gear_ratio=2.0)
    _, message = wing_angle.step(gains, wing_angle.State(), Counts(0, 1100, -1050))
    assert message.angle_left == pytest.approx(0.5 * math.pi)
    assert message.angle_right == pytest.approx(0.5 * math.pi)


def test_time_that_does_not_advance_changes_nothing() -> None:
    state, _ = wing_angle.step(GAINS, wing_angle.State(), Counts(5000, 10, 10))
    assert wing_angle.step(GAINS, state, Counts(5000, 500, 500))[0] == state
    assert wing_angle.step(GAINS, state, Counts(0, 500, 500))[0] == state


@given(
    st.lists(
        st.tuples(st.integers(-3, 400000), st.integers(-(2**31), 2**31 - 1), st.integers(-5000, 5000)), max_size=60
    )
)
def test_any_counts_give_finite_messages(steps: list[tuple[int, int, int]]) -> None:
    state = wing_angle.State()
    time_us = 0
    for dt, left, right in steps:
        time_us = max(0, time_us + dt)
        state, message = wing_angle.step(GAINS, state, Counts(time_us, left, right))
        assert all(math.isfinite(value) for value in message)
        assert 0.0 <= message.phase <= math.tau
        assert 0.0 <= message.frequency <= GAINS.fastest
        assert 0.0 <= message.downstroke_ratio <= 1.0


def commanded_errors(
    amplitude: Callable[[float], float], lag: Callable[[float], float], stated: float
) -> list[float]:
    """Phase errors (deg) in 5 s at 4 Hz of a wing ``lag(t)`` rad behind its command of amplitude ``stated``."""
    state, errors = wing_angle.State(), []
    for k in range(1000):
        t = k * PERIOD_US * 1e-6
        phase = math.tau * 4.0 * t
        angle = counts(0.2 + amplitude(t) * math.sin(phase - lag(t)))
        commanded = wing_angle.Commanded(4.0, phase % math.tau, stated)
        state, message = wing_angle.step(GAINS, state, Counts(k * PERIOD_US, angle, angle), commanded)
        if t > 1.5:
            error = message.phase - phase + lag(t)
            errors.append(math.degrees((error + math.pi) % math.tau - math.pi))
    return errors


def test_a_stroke_whose_amplitude_moves_keeps_its_phase_by_the_command() -> None:
    """GIVEN a servo drive half a radian behind its command, its amplitude moved at 0.8 Hz THEN within 2 degrees."""
    moving: Callable[[float], float] = lambda t: 0.3 + 0.06 * math.sin(math.tau * 0.8 * t)  # noqa: E731
    followed = commanded_errors(moving, lambda t: 0.5, 0.3)
    alone = commanded_errors(moving, lambda t: 0.5, 0.0)
    assert max(map(abs, followed)) < 2.0
    assert statistics.pstdev(followed) < 0.6 * statistics.pstdev(alone)


def test_a_wing_that_slips_against_its_command_is_measured() -> None:
    """GIVEN a wing 10 % slower than its command THEN the phase is that of the encoder."""
    errors = commanded_errors(lambda t: 0.4, lambda t: 0.1 * math.tau * 4.0 * t, 0.4)
    assert max(map(abs, errors)) < 2.0
    steps = commanded_errors(lambda t: 0.4, lambda t: 0.5 if t < 3.0 else 1.0, 0.4)
    assert max(map(abs, steps[-300:])) < 1.0
