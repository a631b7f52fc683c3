"""Which autoregression made the residuals of a linear regression, without the bias of their having been fitted.

Residuals are smaller and quicker than the noise that they stand for: p regressors took their part of it, and of slow
noise in a short record they took most. The likelihood of what is orthogonal to the regressors (restricted likelihood:
Patterson & Thompson, Biometrika 58, 1971; Harville, JASA 72, 1977) does not suffer from that. The order is the one of
least corrected information criterion (Hurvich & Tsai, Biometrika 76, 1989).

Each contiguous run of samples has its exact likelihood: its first samples are predicted from the few before them
(Levinson's recursion). All that depends on the samples is in products of them, summed once, so that the search costs
the same for ten thousand samples as for a hundred.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter, lfiltic

from logs.identification.results import Array

HIGHEST_ORDER = 4
PATIENCE = 2
"""-; orders in a row that may be no better before the search ends"""
SAMPLES_PER_ORDER = 10
"""-; samples that each coefficient asks for"""
PRIOR = 0.75
"""-; weight of log(1 - kappa^2) in twice the log likelihood: no short record is taken for a random walk"""
LARGEST = 1 - 1e-7
"""-; size of a reflection"""
LEAST_CURVATURE = 1e-2
STEP = 1e-3
NEVER = 1e10


class Autoregression(NamedTuple):
    """Noise that is the sum of its own past and of something white."""

    reflections: Array
    """-; (k,), partial autocorrelations with the sign turned, in (-1, 1)"""
    variance: float
    """residual squared; of the white part"""
    uncertainty: Array
    """(k, k); covariance of artanh(reflections)"""
    variances: Callable[[Array], float]
    """the white part's variance at other artanh(reflections) (k,)"""

    @property
    def filter(self) -> Array:
        """Coefficients (k + 1,) that make the noise white, 1 first."""
        return predictors(self.reflections)[-1]

    def autocovariance(self, count: int) -> Array:
        """Of the noise at lags 0 to ``count`` - 1, residual squared."""
        return autocovariance(self.reflections, count) * self.variance


class Products(NamedTuple):
    """Sums over samples of products of columns at lags, by how many samples of the run are before."""

    sums: Array
    """(K + 1, K + 1, K + 1, m, m); [g, i, j] is the sum of column a at lag i times column b at lag j"""
    counts: Array
    """-; (K + 1,), samples with g before them, K or more for the last"""

    def of_order(self, order: int) -> Products:
        """What an autoregression of a lower ``order`` needs."""
        sums = self.sums[: order + 1, : order + 1, : order + 1].copy()
        sums[order] = self.sums[order:, : order + 1, : order + 1].sum(axis=0)
        return Products(sums, np.append(self.counts[:order], self.counts[order:].sum()))


def predictors(reflections: Array) -> list[Array]:
    """Filters of orders 0 to k, (order + 1,) each, by Levinson's recursion."""
    filters = [np.ones(1)]
    for reflection in reflections:
        longer = np.append(filters[-1], 0.0)
        filters.append(longer + reflection * longer[::-1])
    return filters


def prediction_variances(reflections: Array) -> Array:
    """Variance (k + 1,) of what the filters of orders 0 to k leave, in that of the white part."""
    growth = np.append(1 - reflections**2, 1.0)
    return np.asarray(1 / np.cumprod(growth[::-1])[::-1])


def autocovariance(reflections: Array, count: int) -> Array:
    """Autocovariance (count,) of an autoregression whose white part has the variance 1."""
    filters, variances, order = predictors(reflections), prediction_variances(reflections), len(reflections)
    values = np.zeros(max(count, order + 1))
    values[0] = variances[0]
    for lag in range(1, order + 1):
        past = filters[lag - 1][1:] @ values[lag - 1 : 0 : -1]
        values[lag] = -reflections[lag - 1] * variances[lag - 1] - past
    if order and count > order + 1:
        past = lfiltic([1.0], filters[-1], values[order:0:-1])
        values[order + 1 :] = lfilter([1.0], filters[-1], np.zeros(count - order - 1), zi=past)[0]
    return values[:count]


def runs(used: Array, most: int) -> Array:
    """How many used samples without a gap are before each one, ``most`` at most; -1 for one that is not used."""
    places = np.arange(len(used))
    last_gap = np.maximum.accumulate(np.where(used > 0, -1, places))
    return np.where(used > 0, np.minimum(places - last_gap - 1, most), -1)


def products(columns: list[Array], used: list[Array], order: int) -> Products:
    """`Products` of records of ``columns`` (N_i, m), for autoregressions up to ``order``."""
    width = columns[0].shape[1]
    sums, counts = np.zeros((order + 1, order + 1, order + 1, width, width)), np.zeros(order + 1)
    for values, mask in zip(columns, used, strict=True):
        before = runs(mask, order)
        for group in range(order + 1):
            rows = np.flatnonzero(before == group)
            counts[group] += len(rows)
            lagged = np.hstack([values[rows - lag] for lag in range(group + 1)])
            squares = (lagged.T @ lagged).reshape(group + 1, width, group + 1, width)
            sums[group, : group + 1, : group + 1] += squares.transpose(0, 2, 1, 3)
    return Products(sums, counts)


def _whitened(of: Products, reflections: Array) -> tuple[Array, Array]:
    """Products (m, m) of the whitened columns, and the variances that whitening made equal."""
    variances = prediction_variances(reflections)
    filters = np.zeros((len(variances), len(variances)))
    for row, coefficients in zip(filters, predictors(reflections), strict=True):
        row[: len(coefficients)] = coefficients
    pairs = filters[:, :, None] * (filters / variances[:, None])[:, None, :]
    return np.tensordot(pairs, of.sums, axes=3), variances


def _squares(of: Products, reflections: Array) -> tuple[float, float, Array]:
    """Squares of the whitened last column free of the others, log determinant of those, and the variances."""
    total, variances = _whitened(of, reflections)
    try:
        diagonal = np.diag(np.linalg.cholesky(total))
    except np.linalg.LinAlgError:
        return np.nan, np.nan, variances
    return float(diagonal[-1] ** 2), 2 * float(np.sum(np.log(diagonal[:-1]))), variances


def _criterion(of: Products, transformed: Array) -> float:
    """Minus twice the restricted log likelihood at artanh(reflections), the white variance at its optimum."""
    reflections = np.tanh(transformed)
    if not np.all(np.abs(reflections) < LARGEST):
        return NEVER
    squares, determinant, variances = _squares(of, reflections)
    if not squares > 0:
        return NEVER
    free = of.counts.sum() - (of.sums.shape[3] - 1)
    prior = PRIOR * np.sum(np.log(1 - reflections**2))
    return float(of.counts @ np.log(variances) + determinant + free * np.log(squares) - prior)


def autoregression_of(basis: list[Array], residuals: list[Array], used: list[Array]) -> Autoregression:
    """The autoregression behind ``residuals`` (N_i,) of a regression on ``basis`` (N_i, p), orthonormal over all.

    Raises:
        numpy.linalg.LinAlgError: nothing is left to learn it from.
    """
    width = basis[0].shape[1]
    highest = _highest_order(used, width)
    columns = [np.column_stack((b, r)) for b, r in zip(basis, residuals, strict=True)]
    everything = products(columns, used, highest)
    free = float(everything.counts.sum()) - width
    best, since, start, chosen = np.inf, 0, np.zeros(0), (everything.of_order(0), np.zeros(0))
    for order in range(highest + 1):
        of = everything.of_order(order)
        if order:
            start = _minimum(of, np.append(start, 0.0))
        score = _criterion(of, start) + 2 * (order + 1) * free / max(free - order - 2, 1.0)
        if score < best:
            best, chosen, since = score, (of, start), 0
        elif (since := since + 1) >= PATIENCE:
            break
    return _model(*chosen, free)


def _highest_order(used: list[Array], width: int) -> int:
    """The order that the samples' number and the length of their runs allow."""
    count = sum(float(mask.sum()) for mask in used)
    order = int(min(HIGHEST_ORDER, max((count - width) // SAMPLES_PER_ORDER, 0)))
    before = np.concatenate([runs(mask, HIGHEST_ORDER) for mask in used])
    while order and np.count_nonzero(before >= order) < count / 2:
        order -= 1
    return order


def _minimum(of: Products, start: Array) -> Array:
    found = minimize(lambda at: _criterion(of, at), start, method="BFGS", options={"gtol": 1e-2, "maxiter": 50})
    return np.asarray(found.x)


def _model(of: Products, at: Array, free: float) -> Autoregression:
    def variance(transformed: Array) -> float:
        return _squares(of, np.tanh(transformed))[0] / free

    if not variance(at) > 0:
        raise np.linalg.LinAlgError("the residuals tell nothing of their colour")
    return Autoregression(np.tanh(at), variance(at), _uncertainty(of, at), variance)


def _uncertainty(of: Products, at: Array) -> Array:
    """Covariance (k, k) of artanh(reflections): inverse curvature of the likelihood."""
    size = len(at)
    if not size:
        return np.zeros((0, 0))
    curvature, steps = np.zeros((size, size)), np.eye(size) * STEP
    for i in range(size):
        for j in range(i, size):
            corners = ((a * b, _criterion(of, at + a * steps[i] + b * steps[j])) for a in (1, -1) for b in (1, -1))
            curvature[i, j] = curvature[j, i] = sum(sign * value for sign, value in corners) / (8 * STEP**2)
    values, vectors = np.linalg.eigh(curvature)
    return np.asarray((vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T)
