"""What a GPS fix corrects in the velocity aiding, against plain matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from avionics.estimation import velocity_aiding as aiding
from avionics.messages import GpsFix
from wingbeat.constants import STANDARD_GRAVITY

Array = NDArray[np.float64]
NOISE = aiding.Noise(0.0, 0.0, gps_noise=0.3, gps_gate=5.0, gps_timeout=10.0, gps_delay=0.0)
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
INNOVATION = (0.4, -0.3, 0.5)
"""m/s; of the fix"""


def correlated() -> Array:
    """Covariance (14, 14) with correlations between all errors."""
    root = np.random.default_rng(7).normal(0.0, 0.1, (aiding.STATES, aiding.STATES))
    return root @ root.T


def fixed(p: Array, agreed: int, innovation: tuple[float, float, float]) -> tuple[aiding.State, aiding.Errors]:
    """Give a fix to the filter 0.1 s after the last one; ``p`` is updated in place."""
    state = aiding.start(0, LEVEL)._replace(accepted_us=0, agreed=agreed, past=(aiding.Moment(0, aiding.ZERO),))
    north, east, down = innovation
    fix = GpsFix(100_000, 0.0, 0.0, 0.0, north, east, down + 0.1 * STANDARD_GRAVITY, 1.0, 1.0, 3, 8)
    return aiding.fixed(state, p, NOISE, fix)


def updated(p: Array, index: int, innovation: float, corrected: list[int]) -> tuple[Array, Array]:
    """Covariance in the Joseph form, and errors, of a measurement of one state that corrects some of them."""
    h, k = np.zeros((1, aiding.STATES)), np.zeros((aiding.STATES, 1))
    h[0, index] = 1.0
    k[corrected, 0] = p[corrected, index] / (p[index, index] + NOISE.gps_noise**2)
    left = np.eye(aiding.STATES) - k @ h
    return left @ p @ left.T + NOISE.gps_noise**2 * k @ k.T, k[:, 0] * innovation


@pytest.mark.parametrize("agreed", [0, aiding.CONFIRMATIONS], ids=["unconfirmed", "confirmed"])
def test_a_fix_corrects_what_it_may(agreed: int) -> None:
    """GIVEN correlated errors WHEN a fix comes THEN only a confirmed one corrects sensor offsets."""
    p, every = correlated(), list(range(aiding.STATES))
    corrected = every if agreed else every[:9]
    expected, north = updated(p, 0, INNOVATION[0], corrected)
    expected, east = updated(expected, 1, INNOVATION[1] - north[1], corrected)
    errors = north + east
    turn, c, s = np.eye(aiding.STATES), math.cos(errors[5]), math.sin(errors[5])
    turn[3:5, 3:5] = (c, -s), (s, c)
    expected, down = updated(turn @ expected @ turn.T, 2, INNOVATION[2] - errors[2], [2])
    errors += down

    state, result = fixed(p, agreed, INNOVATION)
    np.testing.assert_allclose(p, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(state.offset, errors[:3], rtol=1e-9)
    np.testing.assert_allclose((*result.turn, *result.bias), errors[3:9], rtol=1e-9)
    np.testing.assert_allclose((*result.accel, *result.iron[:2]), errors[9:], rtol=1e-9)
    assert np.any(errors[9:] != 0.0) == (agreed > 0)


def test_the_climb_rate_alone_corrects_the_propagated_velocity_alone() -> None:
    state, errors = fixed(correlated(), aiding.CONFIRMATIONS, (0.0, 0.0, 0.5))
    assert state.offset[:2] == (0.0, 0.0) and 0.0 < state.offset[2] < 0.5
    assert errors == aiding.Errors(aiding.ZERO, aiding.ZERO, aiding.ZERO, aiding.ZERO)
