"""Colour, whiteness, correlation, goodness and Theil's inequality against what is known of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.optimize import minimize
from scipy.signal import lfilter

from logs.identification.statistics.correlation import correlation_of
from logs.identification.statistics.goodness import goodness
from logs.identification.statistics.hac import (
    PRIOR,
    HacCovariance,
    Linear,
    Products,
    _restricted,
    _uncertainty,
    autocorrelated,
    autocovariance,
    lag_products,
    noise_of,
    predictors,
    runs,
    white,
)
from logs.identification.statistics.theil import theil
from logs.identification.statistics.whiteness import autocorrelation, whiteness_of


def test_autocovariance_is_that_of_the_filter() -> None:
    reflections = np.array([-0.8, 0.5, 0.2])
    impulse = lfilter([1.0], predictors(reflections)[-1], np.eye(1, 4000)[0])
    expected = [impulse[: 4000 - lag] @ impulse[lag:] for lag in range(30)]
    np.testing.assert_allclose(autocovariance(reflections, 30), expected, rtol=1e-8)
    np.testing.assert_allclose(autocovariance(np.zeros(0), 3), [1.0, 0.0, 0.0])


def test_runs_restart_after_a_gap() -> None:
    np.testing.assert_array_equal(runs(np.array([1.0, 1, 1, 0, 1, 1, 1, 1]), 2), [0, 1, 2, -1, 0, 1, 2, 2])
    np.testing.assert_array_equal(runs(np.array([0.0, 1, 0]), 2), [-1, 0, -1])


def test_the_autoregression_is_found_where_fitted_residuals_hide_it() -> None:
    """Slow noise in 100 samples, means and trends taken out: Yule-Walker finds 0.78, the likelihood 0.9."""
    poles, plain = [], []
    basis = np.linalg.qr(np.vander(np.linspace(-1, 1, 100), 4))[0]
    for seed in range(20):
        noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(seed).normal(size=600))[-100:]
        rest = noise - basis @ (basis.T @ noise)
        model = noise_of((Linear(basis, basis, rest, np.ones(100)),)).model
        poles.append(-model.reflections[0] if len(model.reflections) else 0.0)
        plain.append(rest[:-1] @ rest[1:] / (rest @ rest))
    assert np.mean(plain) < 0.8
    assert np.median(poles) == pytest.approx(0.9, abs=0.05)


def linear(design: np.ndarray, noise: np.ndarray) -> Linear:
    basis = np.linalg.qr(design)[0]
    return Linear(
        design @ np.linalg.inv(design.T @ design), basis, noise - basis @ (basis.T @ noise), np.ones(len(noise))
    )


@pytest.mark.parametrize("pole", [0.0, 0.8, -0.6])
def test_covariance_is_that_of_known_noise(pole: float) -> None:
    """On a long record W^T Gamma W with the true Gamma comes out."""
    rng = np.random.default_rng(1)
    design = np.column_stack((np.ones(3000), lfilter([1.0], [1.0, -0.9], rng.normal(size=3000))))
    noise = lfilter([1.0], [1.0, -pole], rng.normal(size=3200))[-3000:]
    record = linear(design, noise)
    gamma = toeplitz(pole ** np.arange(3000) / (1 - pole**2)) if pole else np.eye(3000)
    expected = np.sqrt(np.diag(record.weights.T @ gamma @ record.weights))
    found = autocorrelated((record,))
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), expected, rtol=0.25)
    textbook = np.sqrt(np.diag(white((record,)).covariance))
    assert pole <= 0 or np.all(textbook < 0.8 * expected)


def test_records_know_nothing_of_each_other() -> None:
    """The same flight twice halves the variance, in whatever order the samples stand."""
    rng = np.random.default_rng(2)
    design = np.column_stack((np.ones(200), rng.normal(size=200)))
    record = linear(design, lfilter([1.0], [1.0, -0.7], rng.normal(size=200)))
    twice = record._replace(weights=record.weights / 2, basis=record.basis / np.sqrt(2))
    one, two = autocorrelated((record,)), autocorrelated((twice, twice))
    np.testing.assert_allclose(two.covariance, one.covariance / 2, rtol=0.1)
    assert np.all(two.degrees > one.degrees)


def test_slow_noise_leaves_an_intercept_few_degrees_of_freedom() -> None:
    rng = np.random.default_rng(4)
    design = np.column_stack((np.ones(200), np.cos(2.5 * np.arange(200))))
    degrees = autocorrelated((linear(design, lfilter([1.0], [1.0, -0.95], rng.normal(size=200))),)).degrees
    assert degrees[0] < 12 < degrees[1]


def test_correlated_pairs_are_named() -> None:
    covariance = np.array([[4.0, 1.96, 0.0], [1.96, 1.0, -0.2], [0.0, -0.2, 9.0]])
    found = correlation_of(("M_w", "M_q", "bias"), covariance)
    assert [(pair.one, pair.other) for pair in found.strong] == [("M_w", "M_q")]
    assert found.strong[0].correlation == pytest.approx(0.98)
    np.testing.assert_allclose(np.diag(found.matrix), 1.0)
    assert np.isnan(correlation_of(("a", "b"), np.diag([1.0, 0.0])).matrix[1, 1])


def test_white_noise_passes_and_coloured_does_not() -> None:
    passed = sum(whiteness_of(np.random.default_rng(seed).normal(size=400)).white for seed in range(100))
    assert 80 <= passed <= 98
    slow = whiteness_of(lfilter([1.0], [1.0, -0.6], np.random.default_rng(1).normal(size=4000)))
    assert not slow.white
    assert slow.runs < slow.expected_runs
    assert slow.autocorrelation[1] == pytest.approx(0.6, abs=0.06)
    assert slow.share_outside > 0.05


def test_probabilities_of_white_noise_are_even() -> None:
    found = [whiteness_of(np.random.default_rng(seed).normal(size=300)) for seed in range(200)]
    for which in ("ljung_box_probability", "runs_probability"):
        assert np.mean([getattr(one, which) < 0.5 for one in found]) == pytest.approx(0.5, abs=0.13)
    assert np.mean([one.share_outside for one in found]) == pytest.approx(0.05, abs=0.015)


def test_missing_residuals_are_left_out_and_too_few_are_said() -> None:
    values = np.random.default_rng(5).normal(size=300)
    values[50:90] = np.nan
    assert whiteness_of(values).samples == 260
    assert "10 residuals" in whiteness_of(values[:10]).failure
    assert "all the same" in whiteness_of(np.ones(50)).failure


def test_theil_parts_sum_to_one_and_say_what_is_wrong() -> None:
    rng = np.random.default_rng(6)
    z = np.sin(np.arange(300) / 10)
    for predicted, part in ((z + 0.3, "bias"), (1.5 * z, "variance"), (z + 0.2 * rng.normal(size=300), "covariance")):
        found = theil(z, predicted)
        assert found.bias + found.variance + found.covariance == pytest.approx(1.0)
        assert getattr(found, part) > 0.9
        assert 0 < found.coefficient < 0.3
    assert theil(z, z).coefficient == 0.0
    assert theil(z, -z).coefficient == pytest.approx(1.0)
    assert theil(z, np.full(300, np.nan)).failure == "0 samples have both"


def test_goodness() -> None:
    z = np.array([0.0, 1.0, 2.0, 3.0, np.nan])
    found = goodness(z, np.array([0.1, 0.9, 2.1, 2.9, 5.0]), 2)
    assert found.r_squared == pytest.approx(1 - 0.04 / 5)
    assert found.adjusted == pytest.approx(1 - 0.02 / (5 / 3))
    assert found.nrmse == pytest.approx(0.1 / 3)
    assert found.samples == 4
    assert np.isnan(goodness(np.ones(5), np.zeros(5)).r_squared)


def test_autocorrelation_is_that_of_the_pairs_that_were_measured() -> None:
    """GIVEN two records, one with a gap THEN each lag is the mean over the pairs of samples within one record."""
    rng = np.random.default_rng(4)
    records = (rng.normal(1.0, 1.0, 61), rng.normal(1.0, 1.0, 40))
    records[0][20:25] = np.nan
    found, pairs = autocorrelation(records, 30)
    mean = np.nanmean(np.concatenate(records))
    spread = np.nanmean((np.concatenate(records) - mean) ** 2)
    for lag in (0, 1, 7, 30):
        products = np.concatenate([(one[: len(one) - lag] - mean) * (one[lag:] - mean) for one in records])
        assert pairs[lag] == np.isfinite(products).sum()
        assert found[lag] == pytest.approx(np.nanmean(products) / spread, abs=1e-12)


def dense_restricted(reflections: np.ndarray, design: np.ndarray, values: np.ndarray, used: np.ndarray) -> float:
    """Minus twice the restricted log likelihood by the whole covariance of runs that know nothing of each other."""
    runs_of = np.cumsum(np.diff(used, prepend=0.0) != 0)
    gamma = toeplitz(autocovariance(reflections, len(used))) * (runs_of[:, None] == runs_of)
    gamma, x, z = gamma[np.ix_(used > 0, used > 0)], design[used > 0], values[used > 0]
    inverse = np.linalg.inv(gamma)
    information = x.T @ inverse @ x
    rest = z - x @ np.linalg.solve(information, x.T @ inverse @ z)
    prior = PRIOR * np.sum(np.log(1 - reflections**2))
    both = np.linalg.slogdet(gamma)[1] + np.linalg.slogdet(information)[1]
    return float(both + (len(z) - x.shape[1]) * np.log(rest @ inverse @ rest) - prior)


def gapped(reflections: tuple[float, ...], count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orthonormal trends and cosines (N, 4), noise of ``reflections`` freed of them, and where it was measured."""
    rng = np.random.default_rng(seed)
    used = np.ones(count)
    used[count // 3 : count // 3 + 4] = used[count // 2] = 0.0
    design = np.vander(np.linspace(-1, 1, count), 3)
    design = np.column_stack((design, np.cos(0.3 * np.arange(count)))) * used[:, None]
    basis = np.linalg.qr(design)[0]
    noise = lfilter([1.0], predictors(np.array(reflections))[-1], rng.normal(size=count + 300))[-count:] * used
    return basis, noise - basis @ (basis.T @ noise), used


@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_restricted_likelihood_is_that_of_the_whole_covariance(order: int) -> None:
    """By sums of products, gaps and all."""
    basis, rest, used = gapped((-0.6,), 60, 7)
    of = lag_products([np.column_stack((basis, rest))], [used], order)
    rng = np.random.default_rng(1)
    points = [0.5 * rng.normal(size=order) for _ in range(6)]
    ours = [_restricted(of.sums, of.counts, at)[0] for at in points]
    dense = [dense_restricted(np.tanh(at), basis, rest, used) for at in points]
    np.testing.assert_allclose(np.diff(ours), np.diff(dense), rtol=1e-9)


LONG_ENOUGH = [
    (reflections, count)
    for count in (50, 250, 1250)
    for reflections in ((-0.9,), (-0.97,), (-0.8, 0.8), (0.5, 0.6, 0.4, 0.6))
] + [((-0.5,), 250), ((-0.5,), 1250)]
"""noise, and samples that tell its order"""


@pytest.mark.parametrize(("reflections", "count"), LONG_ENOUGH)
def test_the_autoregression_maximizes_the_restricted_likelihood(reflections: tuple[float, ...], count: int) -> None:
    """Of the order that made the noise; compared with SciPy's simplex search."""
    order = len(reflections)
    for seed in range(3):
        basis, rest, used = gapped(reflections, count, seed)
        noise = noise_of((Linear(basis, basis, rest, used),))
        assert len(noise.model.reflections) == order
        of = lag_products([np.column_stack((basis, rest))], [used], order)

        def criterion(at: np.ndarray, of: Products = of) -> float:
            return float(_restricted(of.sums, of.counts, at)[0])

        fine = {"xatol": 1e-6, "fatol": 1e-9, "maxfev": 5000, "maxiter": 5000}
        best = minimize(criterion, np.zeros(order), method="Nelder-Mead", options=fine)
        assert best.success
        at = np.arctanh(noise.model.reflections)
        assert criterion(at) == pytest.approx(best.fun, abs=1e-3)
        errors = np.sqrt(np.diag(_uncertainty(of, at)))
        np.testing.assert_array_less(np.abs(at - best.x), 0.03 * errors)


@pytest.mark.parametrize("count", [250, 1250])
def test_white_noise_needs_no_autoregression(count: int) -> None:
    for seed in range(3):
        basis, rest, used = gapped((), count, seed)
        model = noise_of((Linear(basis, basis, rest, used),)).model
        assert model.reflections.shape == (0,)
        assert model.variance == pytest.approx(rest @ rest / (used.sum() - basis.shape[1]))


def test_an_empty_record_adds_nothing_to_the_autoregression() -> None:
    basis, rest, used = gapped((-0.8,), 200, 1)
    alone = noise_of((Linear(basis, basis, rest, used),)).model
    beside = noise_of((Linear(basis[:0], basis[:0], rest[:0], used[:0]), Linear(basis, basis, rest, used))).model
    assert len(alone.reflections) > 0
    np.testing.assert_array_equal(beside.reflections, alone.reflections)
    assert beside.variance == alone.variance


@pytest.mark.parametrize("covariance_of", [white, autocorrelated])
def test_an_empty_record_adds_nothing_to_a_covariance(covariance_of: Callable[..., HacCovariance]) -> None:
    rng = np.random.default_rng(8)
    one = linear(
        np.column_stack((np.ones(200), rng.normal(size=200))), lfilter([1.0], [1.0, -0.7], rng.normal(size=200))
    )
    empty = Linear(one.weights[:0], one.basis[:0], one.residuals[:0], one.used[:0])
    for records in ((empty, one), (one, empty)):
        for found, alone in zip(covariance_of(records), covariance_of((one,)), strict=True):
            np.testing.assert_allclose(found, alone, rtol=1e-12)


def test_records_without_a_sample_are_an_error() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="no record has a sample"):
        autocorrelated((Linear(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0)),))


@pytest.mark.parametrize("lags", [0, 3])
def test_an_empty_record_adds_nothing_to_the_autocorrelation(lags: int) -> None:
    one = np.random.default_rng(6).normal(size=30)
    found, pairs = autocorrelation((np.zeros(0), one), lags)
    alone, own = autocorrelation((one,), lags)
    np.testing.assert_allclose(found, alone)
    np.testing.assert_array_equal(pairs, own)
