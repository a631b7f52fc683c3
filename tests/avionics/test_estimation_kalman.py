"""The Kalman filter's equations beside those of filterpy."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import predict as peer_predict
from filterpy.kalman import update as peer_update

from avionics.estimation.kalman import Array, predict, update


def covariance(draw: np.random.Generator, size: int) -> Array:
    factor = draw.normal(size=(size, size))
    return np.asarray(factor @ factor.T + 0.1 * np.eye(size))


@pytest.mark.parametrize(("states", "measurements"), [(3, 1), (3, 2), (4, 4)])
def test_predict_and_update_are_bit_identical_to_filterpy(states: int, measurements: int) -> None:
    """GIVEN random matrices of the filters' sizes, WHEN both predict and update, THEN the results are equal."""
    draw = np.random.default_rng(7)
    for _ in range(200):
        x, p, f = draw.normal(size=states), covariance(draw, states), draw.normal(size=(states, states))
        b, u, q = draw.normal(size=(states, 2)), draw.normal(size=2), covariance(draw, states)
        z, h = draw.normal(size=measurements), draw.normal(size=(measurements, states))
        r = covariance(draw, measurements)
        for ours, peer in (
            (predict(x, p, f, q, u, b), peer_predict(x, p, F=f, Q=q, u=u, B=b)),
            (predict(x, p, f, q, 0.3, b[:, 0]), peer_predict(x, p, F=f, Q=q, u=0.3, B=b[:, 0])),
            (update(x, p, z, r, h), peer_update(x, p, z, r, H=h)),
        ):
            assert np.array_equal(ours[0], peer[0])
            assert np.array_equal(ours[1], peer[1])


def test_update_with_noise_far_below_the_covariance_keeps_it_positive_definite() -> None:
    """GIVEN a nearly exact measurement, WHEN it corrects, THEN the covariance has no negative eigenvalue."""
    p, h = np.diag([1e4, 1.0, 1.0]), np.array([[1.0, 1.0, 0.0]])
    x, p = update(np.zeros(3), p, np.array((5.0,)), np.array([[1e-12]]), h)
    assert np.linalg.eigvalsh(0.5 * (p + p.T))[0] >= -1e-9
    assert x[0] + x[1] == pytest.approx(5.0)
