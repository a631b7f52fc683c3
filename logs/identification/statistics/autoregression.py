"""Which autoregression made the residuals of a linear regression, without the bias of their having been fitted.

Residuals are smaller and quicker than the noise that they stand for: p regressors took their part of it, and of slow
noise in a short record they took most. The likelihood of what is orthogonal to the regressors (restricted likelihood:
Patterson & Thompson, Biometrika 58, 1971; Harville, JASA 72, 1977) does not suffer from that. The order is the one of
least corrected information criterion (Hurvich & Tsai, Biometrika 76, 1989).

That likelihood does not ask what the regressors explain: where a response is smoother than what disturbs its
regressors, a slow noise that makes all of the response, and the coefficients chance, can be the likeliest. The
residuals as they are contradict it: an order under which they are less likely than as white noise is passed over, and
one of whose noise the regressors, which take a part of it, would have left more than all that there is. That is a
quadratic form of normal noise, as chi squared as its mean and variance make it (Satterthwaite, Biometrics Bulletin
2(6), 1946).

Each contiguous run of samples has its exact likelihood: its first samples are predicted from the few before them
(Levinson's recursion). All that depends on the samples is in products of them, summed once, so that the search costs
the same for ten thousand samples as for a hundred.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter, lfiltic, oaconvolve
from scipy.stats import chi2

from logs.identification.results import Array
from logs.identification.statistics.ar_likelihood import LARGEST, restricted

HIGHEST_ORDER = 4
PATIENCE = 2
"""-; orders in a row that may be no better before the search ends"""
SAMPLES_PER_ORDER = 10
"""-; samples that each coefficient asks for"""
PRIOR = 0.75
"""-; weight of log(1 - kappa^2) in twice the log likelihood: no short record is taken for a random walk"""
LEAST_CURVATURE = 1e-2
STEP = 1e-4
MOST_STEPS = 50
LONGEST_STEP = 1.0
"""-; of artanh(reflections), at a time"""
SMALL = 1e-3
"""-; of twice the log likelihood: a step that promises less is the last, and leaves the square of it"""
SHORTEST_SHARE = 1e-3
"""-; of a step, that is tried"""
UNLIKELY = 1e-3
"""-; probability of residuals as small as they are, below which a noise has not made them"""


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
    """`Products` of records of ``columns`` (N_i, m), N_i may be 0, for autoregressions up to ``order``."""
    width = columns[0].shape[1]
    sums, counts = np.zeros((order + 1, order + 1, order + 1, width, width)), np.zeros(order + 1)
    for values, mask in zip(columns, used, strict=True):
        if not len(mask):
            continue
        before = runs(mask, order)
        ahead = np.vstack((np.zeros((order, width)), values)).ravel()
        lagged = np.lib.stride_tricks.sliding_window_view(ahead, (order + 1) * width)[::width]  # the oldest first
        for group in range(order + 1):
            rows = np.flatnonzero(before == group)
            counts[group] += len(rows)
            known = lagged[rows, (order - group) * width :]
            squares = (known.T @ known).reshape(group + 1, width, group + 1, width)
            sums[group, : group + 1, : group + 1] += squares.transpose(0, 2, 1, 3)[::-1, ::-1]
    return Products(sums, counts)


def _criterion(of: Products, at: Array) -> tuple[float, Array]:
    """Minus twice the restricted log likelihood at artanh(reflections) ``at`` (k,), and its slopes (k,)."""
    slopes = np.empty(len(at))
    value: float = restricted(of.sums, of.counts, PRIOR, at, slopes)[0]
    return value, slopes


def _curvature(of: Products, at: Array) -> Array:
    """Second derivatives (k, k) of `_criterion`, by differences of its slopes."""
    steps = np.eye(len(at)) * STEP
    differences = np.array([_criterion(of, at + step)[1] - _criterion(of, at - step)[1] for step in steps])
    curvature: Array = (differences + differences.T) / (4 * STEP)
    return curvature


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

    def as_large(model: Autoregression) -> bool:
        return probability_of_less(model, basis, residuals, used) > UNLIKELY

    for order in range(highest + 1):
        of = everything.of_order(order)
        if order:
            start = _minimum(of, np.append(start, 0.0))
        score = _criterion(of, start)[0] + 2 * (order + 1) * free / max(free - order - 2, 1.0)
        if score < best and (not order or (_likelier_than_white(of, start) and as_large(_model(of, start, free)))):
            best, chosen, since = score, (of, start), 0
        elif (since := since + 1) >= PATIENCE:
            break
    return _model(*chosen, free)


def _likelier_than_white(of: Products, at: Array) -> bool:
    """Whether the autoregression at artanh(reflections) ``at`` (k,) makes the residuals likelier, as they are."""

    def criterion(reflections: Array) -> float:
        variances = prediction_variances(reflections)
        filters = [np.append(f, np.zeros(len(at) + 1 - len(f))) for f in predictors(reflections)]
        squares = np.einsum("gi,gj,gij,g->", filters, filters, of.sums[:, :, :, -1, -1], 1 / variances)
        return float(np.log(variances) @ of.counts + of.counts.sum() * np.log(max(squares, 1e-300)))

    return criterion(np.tanh(at)) < criterion(np.zeros(len(at)))


def probability_of_less(
    model: Autoregression, basis: list[Array], residuals: list[Array], used: list[Array]
) -> float:
    """That noise of the ``model`` leaves the regressors of ``basis`` no larger residuals than there are.

    With P what is orthogonal to the basis B and G the noise's covariance, r^T r has the mean tr(P G) and the variance
    2 tr(P G P G) = 2 (tr(G G) - 2 tr(B^T G G B) + tr(B^T G B B^T G B)).
    """
    gamma = model.autocovariance(max(map(len, used)))
    inner = np.zeros((basis[0].shape[1],) * 2)
    mean = variance = 0.0
    for columns, mask in zip(basis, used, strict=True):
        if not len(mask):
            continue
        through = oaconvolve(columns, _both_sides(gamma[: len(mask)])[:, None], mode="same", axes=0) * mask[:, None]
        pairs = oaconvolve(mask, mask[::-1])[len(mask) - 1 :]
        inner += columns.T @ through
        mean += float(mask.sum()) * gamma[0]
        squares = pairs * gamma[: len(mask)] ** 2
        variance += 2.0 * float(2.0 * squares.sum() - squares[0] - 2.0 * np.sum(through**2))
    mean -= float(np.trace(inner))
    variance += 2.0 * float(np.sum(inner**2))
    if not (mean > 0 and variance > 0):
        return 1.0
    squared = float(sum(residual @ residual for residual in residuals))
    return float(chi2.cdf(2.0 * squared * mean / variance, 2.0 * mean**2 / variance))


def _both_sides(autocovariance: Array) -> Array:
    """The ``autocovariance`` (N,) at lags from -(N - 1) to N - 1."""
    return np.concatenate((autocovariance[:0:-1], autocovariance))


def _highest_order(used: list[Array], width: int) -> int:
    """The order that the samples' number and the length of their runs allow."""
    count = sum(float(mask.sum()) for mask in used)
    order = int(min(HIGHEST_ORDER, max((count - width) // SAMPLES_PER_ORDER, 0)))
    before = np.concatenate([runs(mask, HIGHEST_ORDER) for mask in used])
    while order and np.count_nonzero(before >= order) < count / 2:
        order -= 1
    return order


def _minimum(of: Products, start: Array) -> Array:
    """Where `_criterion` is least: Newton's steps from ``start`` (k,), turned downhill where it is not convex."""
    at, (value, slopes) = start, _criterion(of, start)
    for _ in range(MOST_STEPS):
        sizes, axes = np.linalg.eigh(_curvature(of, at))
        step = -(axes / np.maximum(np.abs(sizes), LEAST_CURVATURE)) @ (axes.T @ slopes)
        step *= min(LONGEST_STEP / max(float(np.max(np.abs(step))), 1e-300), 1.0)
        promised, share = -float(slopes @ step), 1.0
        beyond = _criterion(of, at + step)
        while beyond[0] > value - 1e-4 * share * promised and share > SHORTEST_SHARE:
            share /= 2
            beyond = _criterion(of, at + share * step)
        if not beyond[0] < value:
            break
        at, (value, slopes) = at + share * step, beyond
        if promised < SMALL:
            break
    return at


def _model(of: Products, at: Array, free: float) -> Autoregression:
    if free <= 0:
        raise np.linalg.LinAlgError("the residuals tell nothing of their colour")

    def variance(transformed: Array) -> float:
        return float(restricted(of.sums, of.counts, PRIOR, transformed, np.empty(len(transformed)))[1]) / free

    if not variance(at) > 0:
        raise np.linalg.LinAlgError("the residuals tell nothing of their colour")
    return Autoregression(np.tanh(at), variance(at), _uncertainty(of, at), variance)


def _uncertainty(of: Products, at: Array) -> Array:
    """Covariance (k, k) of artanh(reflections): inverse curvature of the likelihood."""
    if not len(at):
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(_curvature(of, at) / 2)
    return np.asarray((vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T)
