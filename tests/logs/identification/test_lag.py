"""What an actuator makes of an input: one function for the tail, for tables and for output error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from logs.identification.data.resampling import behind

STEP = 0.01
TIME = STEP * np.arange(300)
INPUT = np.where(TIME > 0.995, 0.2, 0.05) + 0.1 * np.sin(2 * np.pi * np.maximum(TIME - 1.5, 0.0))


def fine(lag: float, *, zoh: bool) -> np.ndarray:
    """The same lag by scipy at a hundredth of the step."""
    dense = STEP / 100 * np.arange(100 * (len(TIME) - 1) + 1)
    places = np.floor((dense + 1e-9) / STEP).astype(int)
    command = INPUT[places] if zoh else np.interp(dense, TIME, INPUT)
    _, out, _ = lsim(([1.0], [lag, 1.0]), command - INPUT[0], dense, interp=not zoh)
    return np.asarray(out)[::100] + INPUT[0]


@pytest.mark.parametrize("zoh", [True, False])
@pytest.mark.parametrize("lag", [0.004, 0.04, 0.5])
def test_a_lag_is_the_exact_solution(lag: float, zoh: bool) -> None:
    np.testing.assert_allclose(behind(INPUT, STEP, 0.0, lag, zoh=zoh), fine(lag, zoh=zoh), atol=1e-10)


def test_a_held_command_moves_nothing_before_its_time() -> None:
    step = np.where(np.arange(20) >= 10, 1.0, 0.0)
    late = behind(step, STEP, 0.0, 0.03, zoh=True)
    assert np.all(late[:11] == 0.0)
    np.testing.assert_allclose(late[10:], 1.0 - np.exp(-STEP * np.arange(10) / 0.03), atol=1e-14)


def test_a_delay_moves_what_is_linear_between_samples() -> None:
    late = behind(TIME, STEP, 0.025, 0.0, zoh=True)
    np.testing.assert_allclose(late, np.maximum(TIME - 0.025, 0.0), atol=1e-14)
    lead = behind(TIME, STEP, -0.02, 0.0, zoh=True)
    np.testing.assert_allclose(lead, np.minimum(TIME + 0.02, TIME[-1]), atol=1e-14)
    assert len(behind(np.zeros(0), STEP, 0.0, 0.1, zoh=True)) == 0


def test_delay_and_lag_may_come_in_either_order() -> None:
    first = behind(behind(INPUT, STEP, 0.03, 0.0, zoh=False), STEP, 0.0, 0.05, zoh=False)
    np.testing.assert_allclose(behind(INPUT, STEP, 0.03, 0.05, zoh=False), first, atol=1e-15)
