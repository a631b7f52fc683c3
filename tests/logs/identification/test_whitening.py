"""Changes in units of the forecasts' scatter, beside dense linear algebra and beside the likelihood's own slope."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.modes.whitening import gradient_terms, whitened, whitened_change

COUNT, SIZE, WIDTH = 7, 3, 1e-6


def roots(seed: int) -> np.ndarray:
    factors = np.random.default_rng(seed).normal(size=(COUNT, SIZE, SIZE))
    return np.linalg.cholesky(factors @ factors.transpose(0, 2, 1) + np.eye(SIZE))


def test_errors_and_covariance_are_divided_by_the_root() -> None:
    root, other, errors = roots(1), roots(2), np.random.default_rng(3).normal(size=(COUNT, SIZE))
    inverse = np.linalg.inv(root)
    white, growth = np.empty((COUNT, SIZE)), np.empty((COUNT, SIZE, SIZE))
    whitened(root, errors, white)
    whitened_change(root, other, 0.5, growth)
    assert white == pytest.approx(np.einsum("kij,kj->ki", inverse, errors), abs=1e-12)
    change = (other @ other.transpose(0, 2, 1) - root @ root.transpose(0, 2, 1)) / 0.5
    assert growth == pytest.approx(inverse @ change @ inverse.transpose(0, 2, 1), abs=1e-12)


def test_a_forecasts_part_of_the_slope_is_the_slope_of_its_likelihood() -> None:
    root, errors = roots(4), np.random.default_rng(5).normal(size=(COUNT, SIZE))
    later_root, later = (
        root + WIDTH * np.tril(roots(6)),
        errors + WIDTH * np.random.default_rng(7).normal(size=errors.shape),
    )

    def costs(lower: np.ndarray, wrong: np.ndarray) -> np.ndarray:
        white = np.linalg.solve(lower, wrong[:, :, None])[:, :, 0]
        return np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1) + (white**2).sum(axis=1) / 2.0

    shift, growth = np.empty((COUNT, SIZE)), np.empty((COUNT, SIZE, SIZE))
    white, parts = np.empty((COUNT, SIZE)), np.empty(COUNT)
    whitened(root, errors, white)
    whitened(root, (later - errors) / WIDTH, shift)
    whitened_change(root, later_root, WIDTH, growth)
    gradient_terms(shift, growth, white, parts)
    assert parts == pytest.approx((costs(later_root, later) - costs(root, errors)) / WIDTH, rel=1e-4, abs=1e-4)
