"""The wing drives and the tail: stroke, smooth start and stop, limits, signs."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics.mixing import flapping, tail
from wingbeat.errors import InputError

SERVO = flapping.Gains(
    drive="servo",
    throttle_points=(0.0, 1.0),
    frequency_points=(1.0, 5.0),
    throttle_cut=0.05,
    frequency_rate=8.0,
    start_time=0.5,
    amplitude_points=(0.8, 0.8),
    mean_angle=0.1,
    glide_angle=0.25,
    travel_min=-0.9,
    travel_max=1.0,
)
MOTOR = SERVO._replace(
    drive="motor",
    throttle_points=(0.0, 0.25, 0.5, 0.75, 1.0),
    frequency_points=(0.0, 2.25, 4.75, 5.75, 7.25),
    amplitude_points=(0.8,) * 5,
)
TAIL = tail.Gains(
    rudder_share=0.4,
    yaw_share=0.5,
    asymmetry_share=0.2,
    elevator_min=-0.4,
    elevator_max=0.5,
    rudder_max=0.6,
    servo_rate=6.0,
)
DT = 0.005


def flap(throttle: float, seconds: float, gains: flapping.Gains = SERVO, asymmetry: float = 0.0, state=None):
    state = state or flapping.State()
    flown = []
    for i in range(round(seconds / DT)):
        state, command, stroke = flapping.step(gains, state, i * 5000, DT, throttle, asymmetry)
        flown.append((command, stroke))
    return state, flown


def test_wings_glide_below_the_cut() -> None:
    state, flown = flap(0.04, 1.0)
    assert {stroke.left for _, stroke in flown} == {SERVO.glide_angle}
    assert state.frequency == 0.0


@pytest.mark.parametrize(("throttle", "amplitude"), [(0.25, 0.3), (0.5, 0.4), (1.0, 0.6)])
def test_the_stroke_follows_the_throttle(throttle: float, amplitude: float) -> None:
    gains = SERVO._replace(amplitude_points=(0.2, 0.6))
    _, flown = flap(throttle, 5.0, gains)
    assert max(stroke.left for _, stroke in flown[400:]) == pytest.approx(SERVO.mean_angle + amplitude, abs=0.01)


@pytest.mark.parametrize(("throttle", "frequency"), [(0.25, 2.0), (0.5, 3.0), (1.0, 5.0)])
def test_full_strokes_have_the_mapped_frequency_and_constant_amplitude(throttle: float, frequency: float) -> None:
    _, flown = flap(throttle, 5.0)
    settled = [stroke.left for _, stroke in flown[400:]]
    upward = sum(a < SERVO.mean_angle <= b for a, b in itertools.pairwise(settled))
    assert upward == pytest.approx(frequency * 3.0, abs=1.0)
    assert max(settled) == pytest.approx(SERVO.mean_angle + 0.8, abs=0.01)
    assert min(settled) == pytest.approx(SERVO.mean_angle - 0.8, abs=0.01)


def test_start_and_stop_are_smooth_and_end_in_the_glide() -> None:
    state, start = flap(0.75, 3.0)
    state, stop = flap(0.0, 3.0, state=state)
    angles = [stroke.left for _, stroke in start + stop]
    fastest = 0.8 * 2 * math.pi * 4.0 + (0.8 + 0.15) / SERVO.start_time
    assert max(abs(b - a) for a, b in itertools.pairwise(angles)) <= fastest * DT
    assert stop[-1][0].frequency == 0.0
    assert angles[-1] == SERVO.glide_angle


@given(throttle=st.floats(0, 1), asymmetry=st.floats(-0.5, 0.5), phase=st.floats(0, 6.28))
def test_commands_stay_within_the_travel(throttle: float, asymmetry: float, phase: float) -> None:
    state = flapping.State(phase, 4.0, 1.0)
    _, _, stroke = flapping.step(SERVO, state, 0, DT, throttle, asymmetry)
    assert SERVO.travel_min <= stroke.left <= SERVO.travel_max
    assert SERVO.travel_min <= stroke.right <= SERVO.travel_max


def test_positive_asymmetry_enlarges_the_left_stroke() -> None:
    _, flown = flap(0.5, 3.0, asymmetry=0.2, gains=SERVO._replace(travel_min=-1.5, travel_max=1.5))
    left = [stroke.left for _, stroke in flown[300:]]
    right = [stroke.right for _, stroke in flown[300:]]
    assert max(left) - min(left) == pytest.approx(1.6 * 1.2, abs=0.03)
    assert max(right) - min(right) == pytest.approx(1.6 * 0.8, abs=0.03)


def test_motor_passes_the_throttle_and_reports_malladis_frequencies() -> None:
    for throttle, frequency in zip(MOTOR.throttle_points[1:], MOTOR.frequency_points[1:], strict=True):
        _, command, stroke = flapping.step(MOTOR, flapping.State(), 0, DT, throttle, 0.1)
        assert stroke == flapping.Stroke(0.0, 0.0, throttle)
        assert command.frequency == frequency


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"drive": "steam"}, "steam"),
        ({"throttle_points": (0.0, 0.5, 0.4)}, "equal length"),
        ({"throttle_points": (0.5, 0.5)}, "rise"),
    ],
)
def test_drive_that_makes_no_sense_is_refused(change: dict, word: str) -> None:
    with pytest.raises(InputError, match=word):
        flapping.check(SERVO._replace(**change))


def settle(command: tail.TailCommand) -> tail.Tail:
    state = tail.State()
    for _ in range(200):
        state, moved = tail.step(TAIL, state, DT, command)
    return moved


def test_rolling_right_turns_the_rudder_right_and_enlarges_the_left_stroke() -> None:
    moved = settle(tail.TailCommand(0.1, 0.5, 0.0, 0.0, 0.0, 0))
    assert moved.rudder == pytest.approx(0.2)
    assert moved.asymmetry == pytest.approx(0.1)
    assert moved.elevator == pytest.approx(0.1)


def test_yaw_stick_turns_the_rudder_right() -> None:
    assert settle(tail.TailCommand(0.0, 0.0, 0.6, 0.0, 0.0, 0)).rudder == pytest.approx(0.3)


@given(elevator=st.floats(-2, 2), roll=st.floats(-1, 1), yaw=st.floats(-1, 1), before=st.floats(-0.4, 0.4))
def test_tail_respects_travel_and_rate(elevator: float, roll: float, yaw: float, before: float) -> None:
    _, moved = tail.step(TAIL, tail.State(before, before), DT, tail.TailCommand(elevator, roll, yaw, 0.0, 0.0, 0))
    assert TAIL.elevator_min <= moved.elevator <= TAIL.elevator_max
    assert abs(moved.rudder) <= TAIL.rudder_max
    assert abs(moved.elevator - before) <= TAIL.servo_rate * DT + 1e-12
    assert abs(moved.rudder - before) <= TAIL.servo_rate * DT + 1e-12


def test_an_excitation_is_reported_as_applied_not_as_wished() -> None:
    moved = settle(tail.TailCommand(0.45, 0.0, 0.0, 0.2, 0.0, 1))
    assert moved.applied_elevator == pytest.approx(0.05)
    state = tail.State(0.1, 0.0)
    _, moved = tail.step(TAIL, state, DT, tail.TailCommand(0.1, 0.0, 0.0, 0.2, 0.0, 1))
    assert moved.applied_elevator == pytest.approx(TAIL.servo_rate * DT)
