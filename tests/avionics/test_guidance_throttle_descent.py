"""The descent by throttle alone on scripted measurements."""

import pytest

from avionics.guidance import throttle_descent
from avionics.guidance.throttle_descent import Gains, Measured, State

DT = 0.02
GAINS = Gains()


def descend(seconds: float, throttle: float, climb_rate: float, pitch: float = 0.1, gains: Gains = GAINS):
    state, flown = State(), throttle
    for _ in range(round(seconds / DT)):
        state, flown = throttle_descent.step(gains, state, DT, flown, 1.0, Measured(climb_rate, pitch))
    return state, flown


def test_throttle_descent_begins_at_the_throttle_flown() -> None:
    _, flown = descend(DT, 0.9, 1.7)
    assert flown == pytest.approx(0.9, abs=1.01 * GAINS.throttle_rate * DT)


def test_throttle_descent_in_climb_lowers_throttle_at_its_rate() -> None:
    _, flown = descend(5.0, 1.0, 3.0)
    assert flown == pytest.approx(1.0 - 5.0 * GAINS.throttle_rate, abs=1e-6)


@pytest.mark.parametrize(("climb_rate", "sign"), [(-GAINS.sink, 0), (-2.0, 1), (-0.5, -1)])
def test_throttle_descent_integrates_the_sink_error(climb_rate: float, sign: int) -> None:
    _, flown = descend(4.0, 0.4, climb_rate)
    assert flown - 0.4 == pytest.approx(4.0 * GAINS.integral * (-GAINS.sink - climb_rate), abs=1e-6)
    assert (flown > 0.4 + 1e-6) - (flown < 0.4 - 1e-6) == sign


def test_throttle_descent_adds_throttle_nose_up() -> None:
    """Only by how far the pitch is above its mean: a new mean pitch is no error after some time constants."""
    state, flown = descend(1.0, 0.4, -GAINS.sink)
    _, up = throttle_descent.step(GAINS, state, DT, flown, 1.0, Measured(-GAINS.sink, 0.3))
    assert up - flown == pytest.approx(GAINS.pitch * 0.2, rel=0.02)
    for _ in range(round(8.0 * GAINS.pitch_time / DT)):
        state, up = throttle_descent.step(GAINS, state, DT, up, 1.0, Measured(-GAINS.sink, 0.3))
    assert up == pytest.approx(flown, abs=0.001)


def test_throttle_descent_stays_in_its_limits() -> None:
    gains = GAINS._replace(throttle_min=0.2)
    assert descend(60.0, 0.5, 1.7, gains=gains)[1] == 0.2
    assert descend(60.0, 0.5, -9.0, gains=gains)[1] == 1.0


def test_throttle_in_a_bank_is_at_most_that_of_level_flight() -> None:
    limits = [throttle_descent.upper_limit(0.3, 1.0, bank) for bank in (0.0, -0.35, 0.5, 1.2)]
    assert limits == pytest.approx([1.0, 0.65, 0.3, 0.3])
