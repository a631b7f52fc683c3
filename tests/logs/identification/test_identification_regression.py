"""Intervals that hold under coloured residuals and under noise in the regressors."""

from __future__ import annotations

import numpy as np
import pytest
from promised import promise_kept
from scipy.signal import lfilter

from logs.identification.estimators.least_squares import regress
from logs.identification.results import student_factor
from logs.identification.statistics.covariance import parzen


def slope_covered(seed: int, pole: float) -> bool:
    """Whether a slope's interval holds the truth with first-order coloured residuals and a slow regressor."""
    rng = np.random.default_rng(seed)
    x = lfilter([1.0], [1, -0.95], rng.normal(size=1500))
    residuals = lfilter([1.0], [1, -pole], rng.normal(size=1500))
    fit = regress(np.column_stack((np.ones(1500), x)), 1 + 0.5 * x + residuals, np.ones(1500))
    half = student_factor(fit.degrees) * np.sqrt(fit.covariance[1, 1])
    return bool(abs(fit.values[1] - 0.5) <= half)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_coverage(pole: float) -> None:
    covered = sum(slope_covered(seed, pole) for seed in range(50))
    assert covered >= 43


@pytest.mark.validate
@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_coverage_of_many(pole: float) -> None:
    share = float(np.mean([slope_covered(seed, pole) for seed in range(1000)]))
    promise_kept(f"regression on a slow regressor, pole {pole}", {"slope": share})


def test_white_residuals_give_the_textbook_errors() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=5000)
    fit = regress(np.column_stack((np.ones(5000), x)), 2 * x + rng.normal(size=5000), np.ones(5000))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), 1 / np.sqrt(5000), rtol=0.35)


def test_unused_samples_do_not_matter() -> None:
    rng = np.random.default_rng(2)
    x, used = rng.normal(size=400), np.tile([1.0, 1.0, 0.0, 1.0], 100)
    response = 3 * x + 0.1 * rng.normal(size=400)
    spoilt = np.where(used > 0, response, 1e3)
    one, other = (regress(x[:, None], r, used) for r in (response, spoilt))
    np.testing.assert_allclose(one.values, other.values)
    np.testing.assert_allclose(one.covariance, other.covariance)


def test_instruments_undo_the_attenuation_by_noise() -> None:
    rng = np.random.default_rng(3)
    true = np.sin(np.arange(4000) / 9)
    x = true + 0.3 * rng.normal(size=4000)
    instrument = (np.roll(x, 1) + np.roll(x, -1)) / 2
    response = 2 * true + 0.05 * rng.normal(size=4000)
    plain = regress(x[:, None], response, np.ones(4000)).values[0]
    free = regress(x[:, None], response, np.ones(4000), instruments=instrument[:, None]).values[0]
    assert plain < 1.8
    assert free == pytest.approx(2.0, abs=0.05)


def test_dependent_regressors_are_refused() -> None:
    x = np.arange(50.0)
    with pytest.raises(np.linalg.LinAlgError, match="dependent"):
        regress(np.column_stack((x, 2 * x)), x, np.ones(50))


def test_parzen_window_falls_from_one_to_zero() -> None:
    window = parzen(40)
    assert window[0] == 1
    assert np.all(np.diff(window) < 0)
    assert 0 < window[-1] < 1e-3
