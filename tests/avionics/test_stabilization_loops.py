"""The attitude loops: signs, limits, anti-windup, and a notch that takes the flapping out."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics.stabilization import pitch, roll, stroke_filter

PITCH = pitch.Gains(
    proportional=0.8,
    integral=0.5,
    damping=0.1,
    integral_max=0.2,
    elevator_trim=-0.05,
    elevator_min=-0.5,
    elevator_max=0.5,
    notch_width=0.4,
    rate_lag=0.0,
    trim_time=1.0,
    stick_pitch=0.4,
    release_time=0.15,
    airspeed=0.0,
)
ROLL = roll.Gains(
    proportional=1.5, integral=0.4, damping=0.2, integral_max=0.3, stick_roll=0.5, release_time=0.15, airspeed=7.0
)
DT = 0.01


def stationary(angle: float = 0.0, rate: float = 0.0, frequency: float = 0.0) -> pitch.Measured:
    return pitch.Measured(angle, rate, frequency)


@given(error=st.floats(0.01, 0.3))
def test_nose_below_setpoint_asks_for_nose_up_elevator(error: float) -> None:
    _, up = pitch.step(PITCH, pitch.initial(PITCH), 0, DT, error, stationary())
    _, down = pitch.step(PITCH, pitch.initial(PITCH), 0, DT, -error, stationary())
    assert up.elevator > PITCH.elevator_trim > down.elevator
    assert up.pitch_error == pytest.approx(error)


def test_pitch_damping_opposes_the_rate() -> None:
    _, status = pitch.step(PITCH, pitch.initial(PITCH), 0, DT, 0.0, stationary(rate=1.0))
    assert status.damping == pytest.approx(-0.1)
    assert status.elevator < PITCH.elevator_trim


@given(setpoint=st.floats(-3.0, 3.0), angle=st.floats(-1.5, 1.5), rate=st.floats(-20.0, 20.0))
def test_elevator_stays_within_its_limits(setpoint: float, angle: float, rate: float) -> None:
    _, status = pitch.step(PITCH, pitch.initial(PITCH), 0, DT, setpoint, stationary(angle, rate))
    assert PITCH.elevator_min <= status.elevator <= PITCH.elevator_max


def test_pitch_integral_rests_while_saturated_and_releases_at_once() -> None:
    state = pitch.initial(PITCH)
    for _ in range(500):
        state, status = pitch.step(PITCH, state, 0, DT, 1.5, stationary())
    assert status.saturated == 1
    assert state.integral == 0.0
    _, status = pitch.step(PITCH, state, 0, DT, -0.1, stationary())
    assert status.elevator < PITCH.elevator_trim


def test_pitch_integral_removes_a_steady_error_up_to_its_limit() -> None:
    state = pitch.initial(PITCH)
    for _ in range(2000):
        state, status = pitch.step(PITCH, state, 0, DT, 0.1, stationary())
    assert status.integral == pytest.approx(PITCH.integral_max)


def test_frozen_pitch_holds_the_mean_elevator_whatever_happens() -> None:
    state = pitch.initial(PITCH)
    for _ in range(1000):
        state, status = pitch.step(PITCH, state, 0, DT, 0.1, stationary(0.1))
    mean = state.elevator_mean
    for angle in (0.5, -0.5, 0.0):
        state, status = pitch.hold_trim(PITCH, state, 0, DT, 0.1, stationary(angle, 3.0))
        assert status.elevator == mean
    assert state.elevator_mean == mean


def notch_gain(signal_hz: float, notch_hz: float, width: float = 0.4) -> float:
    state, peak = stroke_filter.State(), 0.0
    notch = stroke_filter.notch(notch_hz, width, DT)
    for i in range(1500):
        state, y = stroke_filter.step(state, math.sin(2 * math.pi * signal_hz * i * DT), notch)
        peak = max(peak, abs(y)) if i > 1000 else 0.0
    return peak


def test_notch_takes_out_the_wing_frequency_and_leaves_slow_motion() -> None:
    assert notch_gain(4.0, 4.0) < 1e-6
    assert notch_gain(0.3, 4.0) > 0.98
    assert notch_gain(8.0, 4.0) > 0.8


def test_notch_starts_without_a_jump() -> None:
    notch = stroke_filter.notch(4.0, 0.4, DT)
    state, first = stroke_filter.step(stroke_filter.State(), 0.4, notch)
    _, second = stroke_filter.step(state, 0.4, notch)
    assert (first, second) == (pytest.approx(0.4), pytest.approx(0.4))


@pytest.mark.parametrize("frequency", [0.0, 60.0])
def test_notch_passes_when_it_cannot_be_placed(frequency: float) -> None:
    notch = stroke_filter.notch(frequency, 0.4, DT)
    assert stroke_filter.step(stroke_filter.State(0.3, 0.2, 1), 0.7, notch) == (stroke_filter.State(), 0.7)


def test_elevator_is_not_shaken_by_the_flapping() -> None:
    state, out = pitch.initial(PITCH), []
    for i in range(800):
        shake = math.sin(2 * math.pi * 4.0 * i * DT)
        state, status = pitch.step(PITCH, state, 0, DT, 0.0, stationary(0.05 * shake, 1.3 * shake, 4.0))
        out.append(status.elevator)
    assert max(out[500:]) - min(out[500:]) < 0.002


@given(error=st.floats(0.01, 0.5))
def test_left_wing_low_asks_to_roll_right(error: float) -> None:
    _, status = roll.step(ROLL, roll.State(), 0, DT, 0.0, roll.Measured(-error, 0.0))
    assert status.roll_command > 0.0
    _, mirrored = roll.step(ROLL, roll.State(), 0, DT, 0.0, roll.Measured(error, 0.0))
    assert mirrored.roll_command == pytest.approx(-status.roll_command)


@given(setpoint=st.floats(-2, 2), angle=st.floats(-3, 3), rate=st.floats(-30, 30))
def test_roll_command_is_limited(setpoint: float, angle: float, rate: float) -> None:
    _, status = roll.step(ROLL, roll.State(), 0, DT, setpoint, roll.Measured(angle, rate))
    assert -1.0 <= status.roll_command <= 1.0


def test_roll_integral_rests_while_saturated() -> None:
    state = roll.State()
    for _ in range(500):
        state, status = roll.step(ROLL, state, 0, DT, 1.0, roll.Measured(0.0, 0.0))
    assert status.saturated == 1
    assert state.integral == 0.0


def test_the_stick_leaves_no_integral_behind() -> None:
    state, status = roll.follow(0, 3.0)
    assert (state.integral, status.roll_command) == (0.0, 1.0)


def test_a_released_pitch_loop_takes_over_from_the_held_elevator_without_a_jump() -> None:
    state = pitch.initial(PITCH)
    state, held = pitch.hold_trim(PITCH, state, 0, DT, 0.3, stationary(0.1))
    asked = PITCH.elevator_trim + PITCH.proportional * 0.2
    elevators = []
    for _ in range(200):
        state, status = pitch.step(PITCH._replace(integral=0.0), state, 0, DT, 0.3, stationary(0.1))
        elevators.append(status.elevator)
    share = DT / (PITCH.release_time + DT)
    assert elevators[0] - held.elevator == pytest.approx(share * (asked - held.elevator))
    assert elevators[-1] == pytest.approx(asked, abs=1e-5)
    assert elevators == sorted(elevators)


def test_a_frozen_roll_loop_holds_its_trim_and_is_released_without_a_jump() -> None:
    state = roll.State(integral=0.12)
    state, held = roll.hold_trim(ROLL, state, 0, 0.0, roll.Measured(-0.2, 0.05))
    assert held.roll_command == 0.12
    _, first = roll.step(ROLL, state, 0, DT, 0.0, roll.Measured(-0.2, 0.05))
    _, at_once = roll.step(ROLL, state._replace(bridge=0.0), 0, DT, 0.0, roll.Measured(-0.2, 0.05))
    assert at_once.roll_command - 0.12 > 0.25
    assert abs(first.roll_command - 0.12) < 0.1 * (at_once.roll_command - 0.12)
