"""Statistics of residuals: covariance with colored noise, whiteness, correlation, Theil's inequality coefficient."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from logs.identification.estimators.least_squares import regress
from logs.identification.statistics.covariance import autocovariance, colored_information, parzen
from logs.identification.statistics.fit_quality import autocorrelation, goodness, strong_pairs, theil, whiteness_of

LAGS = 31


def test_colored_information_is_the_sum_over_lags() -> None:
    rng = np.random.default_rng(0)
    used = [(rng.random((count, 2)) > 0.1).astype(float) for count in (300, 101)]
    residuals = [rng.normal(size=mask.shape) * mask for mask in used]
    slopes = [rng.normal(size=(*mask.shape, 3)) for mask in used]
    found = autocovariance(residuals, used, LAGS)
    count = np.sqrt(sum(mask.sum(axis=0) for mask in used))
    information = np.zeros((3, 3))
    for lag, taper in enumerate(parzen(LAGS)):
        products = sum(r[: len(r) - lag].T @ r[lag:] for r in residuals)
        np.testing.assert_allclose(found.lags[lag], taper * products / np.outer(count, count), atol=1e-12)
        for s in slopes:
            term = np.einsum("nip,ij,njq->pq", s[: len(s) - lag], found.lags[lag], s[lag:])
            information += term if lag == 0 else term + term.T
    np.testing.assert_allclose(colored_information(slopes, found), information, rtol=1e-9)


def test_spectrum_of_autocovariance_is_not_negative() -> None:
    """GIVEN differenced noise with gaps, without power at low frequencies."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        used = (rng.uniform(size=(200, 2)) < 0.9).astype(np.float64)
        found = autocovariance([np.diff(rng.normal(size=(201, 2)), axis=0) * used], [used], 60)
        spectra = np.fft.fft(found.lags, 512, axis=0)
        spectra = spectra + np.conj(spectra.transpose(0, 2, 1)) - found.lags[0]
        assert np.min(np.linalg.eigvalsh(spectra)) > -1e-12


@pytest.mark.parametrize("pole", [0.0, 0.8])
def test_covariance_is_that_of_known_noise(pole: float) -> None:
    rng = np.random.default_rng(1)
    design = np.column_stack((np.ones(3000), lfilter([1.0], [1.0, -0.9], rng.normal(size=3000))))
    noise = lfilter([1.0], [1.0, -pole], rng.normal(size=3200))[-3000:]
    weights = design @ np.linalg.inv(design.T @ design)
    gamma = toeplitz(pole ** np.arange(3000) / (1 - pole**2)) if pole else np.eye(3000)
    expected = np.sqrt(np.diag(weights.T @ gamma @ weights))
    fit = regress(design, noise, np.ones(3000))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), expected, rtol=0.25)
    white = np.sqrt(np.diag(regress(design, noise, np.ones(3000), covariance="white").covariance))
    assert pole <= 0 or np.all(white < 0.8 * expected)


def test_strong_correlations_are_listed() -> None:
    matrix = np.array([[1.0, 0.98, 0.0], [0.98, 1.0, -0.07], [0.0, -0.07, 1.0]])
    (pair,) = strong_pairs(("M_w", "M_q", "bias"), matrix)
    assert (pair.one, pair.other, pair.correlation) == ("M_w", "M_q", 0.98)


def test_white_noise_passes_and_colored_does_not() -> None:
    passed = sum(whiteness_of(np.random.default_rng(seed).normal(size=400)).white for seed in range(100))
    assert 80 <= passed <= 98
    assert not whiteness_of(lfilter([1.0], [1.0, -0.6], np.random.default_rng(1).normal(size=4000))).white


def test_probabilities_of_white_noise_are_uniform() -> None:
    results = [whiteness_of(np.random.default_rng(seed).normal(size=300)) for seed in range(200)]
    for which in ("ljung_box_probability", "runs_probability"):
        assert np.mean([getattr(one, which) < 0.5 for one in results]) == pytest.approx(0.5, abs=0.13)


def test_missing_residuals_are_left_out_and_too_few_fail() -> None:
    values = np.random.default_rng(5).normal(size=300)
    values[50:90] = np.nan
    assert whiteness_of(values).samples == 260
    assert "10 residuals" in whiteness_of(values[:10]).failure
    assert "all the same" in whiteness_of(np.ones(50)).failure


def test_theil_parts_sum_to_one_and_name_the_error() -> None:
    rng = np.random.default_rng(6)
    z = np.sin(np.arange(300) / 10)
    for predicted, part in ((z + 0.3, "bias"), (1.5 * z, "variance"), (z + 0.2 * rng.normal(size=300), "covariance")):
        result = theil(z, predicted)
        assert result.bias + result.variance + result.covariance == pytest.approx(1.0)
        assert getattr(result, part) > 0.9
        assert 0 < result.coefficient < 0.3
    assert theil(z, z).coefficient == 0.0
    assert theil(z, -z).coefficient == pytest.approx(1.0)
    assert theil(z, np.full(300, np.nan)).failure == "0 samples have both"


def test_goodness() -> None:
    z = np.array([0.0, 1.0, 2.0, 3.0, np.nan])
    result = goodness(z, np.array([0.1, 0.9, 2.1, 2.9, 5.0]))
    assert result.r_squared == pytest.approx(1 - 0.04 / 5)
    assert result.rms == pytest.approx(0.1)
    assert result.samples == 4
    assert np.isnan(goodness(np.ones(5), np.zeros(5)).r_squared)


def test_autocorrelation_is_that_of_measured_pairs() -> None:
    """GIVEN two records, one with a gap THEN each lag is the mean over the pairs of samples within one record."""
    rng = np.random.default_rng(4)
    records = (rng.normal(1.0, 1.0, 61), rng.normal(1.0, 1.0, 40))
    records[0][20:25] = np.nan
    result, pairs = autocorrelation(records, 30)
    mean = np.nanmean(np.concatenate(records))
    spread = np.nanmean((np.concatenate(records) - mean) ** 2)
    for lag in (0, 1, 7, 30):
        products = np.concatenate([(one[: len(one) - lag] - mean) * (one[lag:] - mean) for one in records])
        assert pairs[lag] == np.isfinite(products).sum()
        assert result[lag] == pytest.approx(np.nanmean(products) / spread, abs=1e-12)


@pytest.mark.parametrize("lags", [0, 3])
def test_empty_record_adds_nothing_to_autocorrelation(lags: int) -> None:
    one = np.random.default_rng(6).normal(size=30)
    result, pairs = autocorrelation((np.zeros(0), one), lags)
    alone, own_pairs = autocorrelation((one,), lags)
    np.testing.assert_allclose(result, alone)
    np.testing.assert_array_equal(pairs, own_pairs)
