"""Which autoregression made the residuals of a linear regression, without the bias of their having been fitted.

Residuals are smaller and quicker than the noise that they stand for: p regressors took their part of it, and of slow
noise in a short record they took most. The likelihood of what is orthogonal to the regressors (restricted likelihood:
Patterson & Thompson, Biometrika 58, 1971; Harville, JASA 72, 1977) does not suffer from that. The order is the one of
least corrected information criterion (Hurvich & Tsai, Biometrika 76, 1989).

That likelihood does not ask what the regressors explain: where a response is smoother than what disturbs its
regressors, a slow noise that makes all of the response, and the coefficients chance, can be the likeliest. The
residuals as they are contradict it: an order under which they are less likely than as white noise is passed over.

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
DIFFERENCE = 1.5e-8
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
    growth = np.append(np.maximum(1 - reflections**2, 1 - LARGEST**2), 1.0)
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
    """Products (B, m, m) of the columns whitened by ``reflections`` (B, k), and the variances (B, k + 1) that
    whitening made equal."""
    count, order = reflections.shape
    growth = np.column_stack((1 - reflections**2, np.ones(count)))
    variances = 1 / np.cumprod(growth[:, ::-1], axis=1)[:, ::-1]
    filters = np.zeros((count, order + 1, order + 1))
    filters[:, 0, 0] = 1.0
    for k in range(order):
        filters[:, k + 1] = filters[:, k]
        filters[:, k + 1, : k + 2] += reflections[:, k, None] * filters[:, k, k + 1 :: -1]
    pairs = filters[:, :, :, None] * (filters / variances[:, :, None])[:, :, None, :]
    width = of.sums.shape[3]
    flat = pairs.reshape(count, -1) @ of.sums.reshape(-1, width**2)
    return flat.reshape(count, width, width), variances


def _diagonals(squares: Array) -> Array:
    """Diagonals (B, m) of the Cholesky factors of ``squares`` (B, m, m), NaN where there is none."""
    try:
        return np.asarray(np.diagonal(np.linalg.cholesky(squares), axis1=1, axis2=2))
    except np.linalg.LinAlgError:
        alone = len(squares) == 1
        return np.full((1, squares.shape[1]), np.nan) if alone else np.vstack([_diagonals(s[None]) for s in squares])


def _criteria(of: Products, transformed: Array) -> Array:
    """Minus twice the restricted log likelihood (B,) at artanh(reflections) (B, k) and the best white variance."""
    reflections = np.tanh(transformed)
    possible = np.all(np.abs(reflections) < LARGEST, axis=1)
    total, variances = _whitened(of, np.where(possible[:, None], reflections, 0.0))
    diagonals = _diagonals(total)
    possible &= diagonals[:, -1] > 0
    diagonals, reflections = (np.where(possible[:, None], a, b) for a, b in ((diagonals, 1.0), (reflections, 0.0)))
    free = of.counts.sum() - (of.sums.shape[3] - 1)
    weighted = 2 * np.log(diagonals).sum(axis=1) + 2 * (free - 1) * np.log(diagonals[:, -1])
    prior = PRIOR * np.sum(np.log(1 - reflections**2), axis=1)
    return np.where(possible, np.log(variances) @ of.counts + weighted - prior, NEVER)


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
        score = _criteria(of, start[None])[0] + 2 * (order + 1) * free / max(free - order - 2, 1.0)
        if score < best and (not order or _likelier_than_white(of, start)):
            best, chosen, since = score, (of, start), 0
        elif (since := since + 1) >= PATIENCE:
            break
    return _model(*chosen, free)


def _likelier_than_white(of: Products, at: Array) -> bool:
    """Whether the autoregression at artanh(reflections) ``at`` (k,) makes the residuals likelier, as they are."""

    def criterion(transformed: Array) -> float:
        total, variances = _whitened(of, np.tanh(transformed)[None])
        return float(np.log(variances[0]) @ of.counts + of.counts.sum() * np.log(max(total[0, -1, -1], 1e-300)))

    return criterion(at) < criterion(np.zeros(len(at)))


def _highest_order(used: list[Array], width: int) -> int:
    """The order that the samples' number and the length of their runs allow."""
    count = sum(float(mask.sum()) for mask in used)
    order = int(min(HIGHEST_ORDER, max((count - width) // SAMPLES_PER_ORDER, 0)))
    before = np.concatenate([runs(mask, HIGHEST_ORDER) for mask in used])
    while order and np.count_nonzero(before >= order) < count / 2:
        order -= 1
    return order


def _minimum(of: Products, start: Array) -> Array:
    shifts = np.vstack((np.zeros(len(start)), np.eye(len(start)) * DIFFERENCE))

    def with_slope(at: Array) -> tuple[float, Array]:
        here, *ahead = _criteria(of, at + shifts)
        return float(here), (np.array(ahead) - here) / DIFFERENCE

    found = minimize(with_slope, start, jac=True, method="BFGS", options={"gtol": 1e-2, "maxiter": 50})
    return np.asarray(found.x)


def _model(of: Products, at: Array, free: float) -> Autoregression:
    def variance(transformed: Array) -> float:
        total, _ = _whitened(of, np.tanh(transformed)[None])
        return float(_diagonals(total)[0, -1] ** 2 / free)

    if not variance(at) > 0:
        raise np.linalg.LinAlgError("the residuals tell nothing of their colour")
    return Autoregression(np.tanh(at), variance(at), _uncertainty(of, at), variance)


def _uncertainty(of: Products, at: Array) -> Array:
    """Covariance (k, k) of artanh(reflections): inverse curvature of the likelihood."""
    size = len(at)
    if not size:
        return np.zeros((0, 0))
    steps, rows, columns = np.eye(size) * STEP, *np.triu_indices(size)
    corners = [(a * b, a * steps[rows] + b * steps[columns]) for a in (1, -1) for b in (1, -1)]
    values = _criteria(of, np.vstack([at + shift for _, shift in corners])).reshape(4, -1)
    curvature = np.zeros((size, size))
    curvature[rows, columns] = np.array([sign for sign, _ in corners]) @ values / (8 * STEP**2)
    curvature[columns, rows] = curvature[rows, columns]
    values, vectors = np.linalg.eigh(curvature)
    return np.asarray((vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T)
