"""Are residuals white? If not, the model lacks something or the noise is coloured, and only corrected errors hold.

A residual that is white has autocorrelations inside +-1.96/sqrt(N) at 95 % of the lags; Ljung & Box (Biometrika 65,
1978) put the lags into one number; the runs test (Wald & Wolfowitz, Annals of Mathematical Statistics 11, 1940)
counts changes of sign: too few of them say that the model drifts from the data, whatever the distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import chdtrc, ndtr

from logs.identification.results import Array

BAND = 1.959963984540054
LEAST_SAMPLES = 20
PROBABLE = 0.05


class Whiteness(NamedTuple):
    """What the tests say of one output's residuals."""

    autocorrelation: Array
    """-; (L,), at lags 0 to L - 1"""
    band: float
    """-; half width of the 95 % band of white noise"""
    share_outside: float
    """-; of the lags 1 to L - 1 outside the band; 0.05 is expected of white noise"""
    ljung_box: float
    """-; Q, chi-squared with as many degrees of freedom as lags less `fitted`"""
    ljung_box_probability: float
    """-; of such a Q or a larger one when the residuals are white"""
    runs: int
    """-; of one sign"""
    expected_runs: float
    """-; of white noise"""
    runs_probability: float
    """-; of a number of runs so far from the expected when the residuals are white"""
    samples: int
    """-; used"""
    failure: str = ""
    """-; why there are no numbers, empty when there are"""

    @property
    def white(self) -> bool:
        """Whether neither test speaks against it at 5 %."""
        return not self.failure and min(self.ljung_box_probability, self.runs_probability) >= PROBABLE


def whiteness_of(residuals: Array, fitted: int = 0, lags: int | None = None) -> Whiteness:
    """`Whiteness` of ``residuals`` (N,), NaN where there is none, of a model with ``fitted`` parameters of the noise.

    ``fitted`` counts parameters that model the residuals' own past (none in a regression). The lags are those up to
    a tenth of the record, 5 at least, unless told.
    """
    there = np.isfinite(residuals)
    count = int(there.sum())
    if count < LEAST_SAMPLES:
        return _nothing(count, f"{count} residuals; {LEAST_SAMPLES} are the least")
    if np.ptp(residuals[there]) <= 0:
        return _nothing(count, "the residuals are all the same")
    number = min(lags if lags is not None else max(len(residuals) // 10, 5), len(residuals) // 2)
    correlation, pairs = autocorrelation((residuals,), number)
    band = BAND / np.sqrt(count)
    outside = np.abs(correlation[1:]) > BAND / np.sqrt(np.maximum(pairs[1:], 1.0))
    q = float(count * (count + 2) * np.sum(correlation[1:] ** 2 * pairs[1:] / count / np.maximum(pairs[1:], 1.0)))
    probability = float(chdtrc(max(number - fitted, 1), q))
    runs, expected, by_chance = _runs(residuals[there])
    return Whiteness(
        correlation, band, float(outside.mean()), q, probability, runs, expected, by_chance, count
    )  # fmt: skip


def autocorrelation(records: Sequence[Array], lags: int) -> tuple[Array, Array]:
    """Autocorrelation (lags + 1,) over ``records`` (N_i,) about their common mean, and the pairs that each is from.

    NaN where there is no residual; at 95 % of the lags white noise stays within `BAND` over the root of the pairs.
    """
    there = [np.isfinite(one) for one in records]
    known = np.concatenate([one[own] for one, own in zip(records, there, strict=True)])
    mean = float(known.mean())
    centred = [np.where(own, one - mean, 0.0) for one, own in zip(records, there, strict=True)]
    sums, pairs = _lagged(centred, lags), np.round(_lagged([own.astype(np.float64) for own in there], lags))
    spread = sums[0] / pairs[0]
    return sums / np.maximum(pairs, 1.0) / (spread if spread > 0 else 1.0), pairs


def _lagged(records: list[Array], lags: int) -> Array:
    """Sums of products (lags + 1,) of samples so far apart in one record."""
    total = np.zeros(lags + 1)
    for one in records:
        size = next_fast_len(max(len(one), 1) + lags, real=True)  # so long that nothing wraps around
        total += np.fft.irfft(np.abs(np.fft.rfft(one, size)) ** 2, size)[: lags + 1]
    return total


def _runs(values: Array) -> tuple[int, float, float]:
    """Runs of one sign about the median, their expected number, and the probability of being so far from it."""
    above = values > np.median(values)
    ups, downs = float(above.sum()), float((~above).sum())
    runs = 1 + int(np.count_nonzero(np.diff(above)))
    total = ups + downs
    expected = 1 + 2 * ups * downs / total
    variance = (expected - 1) * (expected - 2) / (total - 1)
    distance = abs(runs - expected) / np.sqrt(variance) if variance > 0 else 0.0
    return runs, expected, float(2 * ndtr(-distance))


def _nothing(count: int, why: str) -> Whiteness:
    return Whiteness(np.zeros(0), np.nan, np.nan, np.nan, np.nan, 0, np.nan, np.nan, count, why)
