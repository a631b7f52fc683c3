"""Changes in units of the forecasts' scatter, beside dense linear algebra and beside the likelihood's own slope."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.estimators.flight.normalized_innovations import (
    gradient_terms,
    information,
    whitened,
    whitened_change,
)

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


def test_the_information_is_that_of_errors_and_covariances() -> None:
    """GIVEN whitened changes THEN it is F_ij = sum(s_i s_j) + sum(trace(G_i G_j)) / 2."""
    rng = np.random.default_rng(8)
    shift, growth = rng.normal(size=(4, COUNT, SIZE)), rng.normal(size=(4, COUNT, SIZE, SIZE))
    growth = growth + growth.transpose(0, 1, 3, 2)
    found = np.empty((4, 4))
    information(shift, growth, found)
    expected = np.einsum("aki,bki->ab", shift, shift) + np.einsum("akij,bkji->ab", growth, growth) / 2.0
    assert found == pytest.approx(expected, rel=1e-12)
