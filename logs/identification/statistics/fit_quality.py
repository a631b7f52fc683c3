"""Quality of a fit: determination, Theil's inequality, whiteness, correlated estimates.

Variance inflation, condition indices and variance-decomposition proportions: Belsley, Kuh, Welsch, Regression
Diagnostics, 1980, ch. 3; Klein & Morelli, Aircraft System Identification, 2006, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import chdtrc, ndtr

from logs.identification.results import Array, FitSeries, OutputFit

GOOD = 0.3
"""-; Theil's coefficient below which a prediction of flight data is good"""
BAND = 1.959963984540054
MIN_SAMPLES = 20
SIGNIFICANCE = 0.05


class Goodness(NamedTuple):
    """Fit of one output."""

    r_squared: float
    """-; fraction of the measured variance about its mean that the model explains; NaN if the measured is constant"""
    rms: float
    """as the output; root mean square error; NaN of fewer than two samples"""
    samples: int
    """-; with both"""


def goodness(measured: Array, modeled: Array) -> Goodness:
    """`Goodness` of ``modeled`` (N,) against ``measured`` (N,), NaN if missing."""
    known = np.isfinite(measured) & np.isfinite(modeled)
    count, z = int(known.sum()), measured[known]
    if count < 2:
        return Goodness(np.nan, np.nan, count)
    error = z - modeled[known]
    squares, total = float(error @ error), float(np.sum((z - z.mean()) ** 2))
    rms = float(np.sqrt(squares / count))
    if total <= 0 or np.ptp(z) == 0:  # the mean of a constant is rounded
        return Goodness(np.nan, rms, count)
    return Goodness(1 - squares / total, rms, count)


class Theil(NamedTuple):
    """Theil's inequality coefficient of one output, and the fractions of the mean square error.

    U = rms(z - y) / (rms(z) + rms(y)) (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 11; Theil,
    Economic Forecasts and Policy, 1961). Bias: the means differ; variance: the amplitudes differ; covariance: the
    rest, noise and timing.
    """

    coefficient: float
    """-; U, in [0, 1]"""
    bias: float
    variance: float
    covariance: float
    samples: int
    """-; with both"""
    failure: str = ""
    """-; why there are no numbers, empty if there are"""


def theil(measured: Array, predicted: Array) -> Theil:
    """`Theil` of ``predicted`` (N,) against ``measured`` (N,), NaN if missing; deviations from trim."""
    known = np.isfinite(measured) & np.isfinite(predicted)
    z, y, count = measured[known], predicted[known], int(known.sum())
    if count < 2:
        return Theil(np.nan, np.nan, np.nan, np.nan, count, f"{count} samples have both")
    error, size = float(np.mean((z - y) ** 2)), float(np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    if size <= 0:
        return Theil(np.nan, np.nan, np.nan, np.nan, count, "both are zero throughout")
    if error <= 0:
        return Theil(0.0, 0.0, 0.0, 0.0, count)
    bias, variance = (z.mean() - y.mean()) ** 2 / error, (z.std() - y.std()) ** 2 / error
    covariance = 2 * (z.std() * y.std() - np.mean((z - z.mean()) * (y - y.mean()))) / error
    return Theil(float(np.sqrt(error)) / size, float(bias), float(variance), float(covariance), count)


class Whiteness(NamedTuple):
    """Whiteness tests of one output's residuals."""

    ljung_box_probability: float
    """-; p-value of the statistic of Ljung & Box, Biometrika 65, 1978"""
    runs_probability: float
    """-; p-value of the number of runs of one sign (Wald & Wolfowitz, Ann. Math. Statistics 11, 1940)"""
    samples: int
    failure: str = ""
    """-; why there are no numbers, empty if there are"""

    @property
    def white(self) -> bool:
        """Whether neither test rejects whiteness at 5 %."""
        return not self.failure and min(self.ljung_box_probability, self.runs_probability) >= SIGNIFICANCE


def whiteness_of(residuals: Array) -> Whiteness:
    """`Whiteness` of ``residuals`` (N,), NaN if missing, over lags up to a tenth of the record, at least 5."""
    known = np.isfinite(residuals)
    count = int(known.sum())
    if count < MIN_SAMPLES:
        return Whiteness(np.nan, np.nan, count, f"{count} residuals; {MIN_SAMPLES} are the least")
    if np.ptp(residuals[known]) <= 0:
        return Whiteness(np.nan, np.nan, count, "the residuals are all the same")
    lags = min(max(len(residuals) // 10, 5), len(residuals) // 2)
    correlation, pairs = autocorrelation((residuals,), lags)
    q = float(count * (count + 2) * np.sum(correlation[1:] ** 2 * pairs[1:] / count / np.maximum(pairs[1:], 1.0)))
    return Whiteness(float(chdtrc(lags, q)), _runs_probability(residuals[known]), count)


def autocorrelation(records: Sequence[Array], lags: int) -> tuple[Array, Array]:
    """Autocorrelation (lags + 1,) over ``records`` (N_i,), NaN if missing, about their mean, and pairs per lag.

    At 95 % of the lags that of white noise is within `BAND` over the root of the pairs.
    """
    known = [np.isfinite(one) for one in records]
    mean = float(np.concatenate([one[used] for one, used in zip(records, known, strict=True)]).mean())
    centered = [np.where(used, one - mean, 0.0) for one, used in zip(records, known, strict=True)]
    sums, pairs = _lagged(centered, lags), np.round(_lagged([used.astype(np.float64) for used in known], lags))
    variance = sums[0] / pairs[0]
    return sums / np.maximum(pairs, 1.0) / (variance if variance > 0 else 1.0), pairs


def _lagged(records: list[Array], lags: int) -> Array:
    """Sums (lags + 1,) of products of samples at each lag within a record."""
    total = np.zeros(lags + 1)
    for one in records:
        size = next_fast_len(max(len(one), 1) + lags, real=True)
        total += np.fft.irfft(np.abs(np.fft.rfft(one, size)) ** 2, size)[: lags + 1]
    return total


def _runs_probability(values: Array) -> float:
    """p-value of the number of runs about the median."""
    above = values > np.median(values)
    ups, downs = float(above.sum()), float((~above).sum())
    runs, total = 1 + int(np.count_nonzero(np.diff(above))), ups + downs
    expected = 1 + 2 * ups * downs / total
    variance = (expected - 1) * (expected - 2) / (total - 1)
    return float(2 * ndtr(-abs(runs - expected) / np.sqrt(variance))) if variance > 0 else 1.0


def output_fits(series: tuple[FitSeries, ...]) -> tuple[OutputFit, ...]:
    """`OutputFit` of each measured output."""
    return tuple(_output_fit(one) for one in series)


def _output_fit(one: FitSeries) -> OutputFit:
    fit, whiteness = goodness(one.measured, one.model), whiteness_of(one.measured - one.model)
    untested = one.independent or whiteness.failure
    return OutputFit(
        one.experiment, one.output, one.unit, one.held_out, fit.samples, fit.r_squared, fit.rms,
        theil(one.measured, one.model).coefficient, None if untested else whiteness.white,
    )  # fmt: skip


DEPENDENT = 1e6
"""-; condition index above which regressors are linearly dependent"""
NOTABLE = 30.0
"""-; condition index above which regressors are collinear (Belsley)"""
PROPORTION = 0.5
"""-; of a parameter's variance from one combination, above which it is involved (Belsley)"""
INVOLVED = 1e-3
"""-; of the largest entry of a vanishing combination: smaller ones are rounding"""
STRONG = 0.9
"""-; magnitude of a correlation that is reported (Klein & Morelli ch. 5)"""


class Collinearity(NamedTuple):
    """Diagnostics of p regressors; the largest condition index last."""

    names: tuple[str, ...]
    """-; (p,)"""
    inflation: Array
    """-; (p,), variance inflation; infinite if the regressor depends on others"""
    indices: Array
    """-; (p,), condition index of each combination"""
    proportions: Array
    """-; (p, p), fraction of the variance of parameter j from combination k at [j, k]"""
    combinations: Array
    """-; (p, p), combination k of the scaled regressors in column k"""

    def groups(self, above: float = NOTABLE) -> tuple[tuple[str, ...], ...]:
        """Names of the regressors in each combination with a condition index over ``above``."""
        groups = []
        for column in np.flatnonzero(self.indices > above):
            inside = self._involved(int(column))
            if np.count_nonzero(inside) > 1:
                groups.append(tuple(name for name, yes in zip(self.names, inside, strict=True) if yes))
        return tuple(groups)

    def _involved(self, column: int) -> Array:
        """Whether each regressor takes part in one combination (p,)."""
        weight = np.abs(self.combinations[:, column])
        if self.indices[column] > DEPENDENT:
            return np.asarray(weight > INVOLVED * weight.max())
        proportion = self.proportions[:, self.indices > NOTABLE].sum(axis=1)
        return np.asarray((proportion > PROPORTION) & (weight > 0.1 * weight.max()))


def collinearity(regressors: Array, names: tuple[str, ...]) -> Collinearity:
    """Diagnostics of ``regressors`` (N, p), centered if there is an intercept.

    A column of zeros has an infinite index and inflation and depends on itself alone.
    """
    norms = np.linalg.norm(regressors, axis=0)
    missing = np.zeros((max(len(names) - len(regressors), 0), len(names)))
    scaled = np.vstack((regressors / np.where(norms > 0, norms, 1.0), missing))
    _, singular, transposed = np.linalg.svd(scaled, full_matrices=False)
    with np.errstate(divide="ignore"):
        parts = (transposed.T / np.maximum(singular, np.finfo(float).tiny ** 0.25)) ** 2
        indices = singular[0] / singular if len(singular) and singular[0] > 0 else np.full(len(names), np.inf)
    inflation = parts.sum(axis=1)
    dependent = np.any(np.abs(transposed[indices > DEPENDENT]) > INVOLVED, axis=0)
    return Collinearity(
        names, np.where(dependent, np.inf, inflation), np.asarray(indices), parts / inflation[:, None], transposed.T
    )


class Pair(NamedTuple):
    """Two parameters with correlated errors."""

    one: str
    other: str
    correlation: float
    """-; in [-1, 1]"""


def strong_pairs(names: tuple[str, ...], matrix: Array) -> tuple[Pair, ...]:
    """The pairs of ``names`` (p,) whose correlation in ``matrix`` (p, p) exceeds `STRONG`, the strongest first."""
    rows, columns = np.nonzero(np.triu(np.abs(np.nan_to_num(matrix)) > STRONG, 1))
    pairs = [Pair(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.correlation)))
