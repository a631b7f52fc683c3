"""Covariance of a linear estimate whose residuals are autocorrelated.

An estimate that is linear in the samples, theta = W^T z, has the covariance W^T Gamma W with the autocovariance
Gamma of the residuals. Gamma is that of an autoregression. Its coefficients maximize the restricted likelihood, which
has no bias by the fitted regressors (Patterson & Thompson, Biometrika 58, 1971; Harville, JASA 72, 1977), and its
order has the least corrected information criterion (Hurvich & Tsai, Biometrika 76, 1989). The intervals are
Student's, with the degrees of freedom of each variance by the delta method (Satterthwaite, Biometrics Bulletin 2(6),
1946).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.signal import lfilter, lfiltic

from logs.identification.results import Array
from sim_bridge.compiled import njit

Complex = NDArray[np.complex128]
HIGHEST_ORDER = 8
SAMPLES_PER_ORDER = 10
"""-; samples that each coefficient needs"""
PRIOR = 0.75
"""-; weight of log(1 - kappa^2) in twice the log likelihood, a weak prior against a random walk"""
MAX_STEPS = 30
LONGEST_STEP = 1.0
"""-; of artanh(reflection coefficient)"""
ENOUGH = 1e-3
"""-; expected decrease of twice the log likelihood, below which a step is the last"""
MAX_FAILURES = 2
"""-; orders in a row without improvement, after which no higher one is tried"""
LEAST_CURVATURE = 1e-2
STEP = 1e-2
"""-; of artanh(reflection coefficient), for differences"""
MAX_SQUARES_RATIO = 4.0
"""-; expected over measured residual squares, above which an autoregression is rejected: it explains the response"""
NEVER = 1e10


class Linear(NamedTuple):
    """One record of a linear estimate."""

    weights: Array
    """(N, p); theta is the sum over records of weights^T response"""
    basis: Array
    """(N, p); orthonormal over all records, spans the columns that the residuals are orthogonal to"""
    residuals: Array
    """(N,); 0 where not used"""
    used: Array
    """-; (N,), 1.0 or 0.0"""


class Autoregression(NamedTuple):
    """Autoregressive noise."""

    reflections: Array
    """-; (k,), partial autocorrelations with reversed sign, in (-1, 1)"""
    variance: float
    """residual squared; of the innovations"""

    @property
    def filter(self) -> Array:
        """Coefficients (k + 1,) of the whitening filter, 1 first."""
        return predictors(self.reflections)[-1]

    def autocovariance(self, count: int) -> Array:
        """Autocovariance (count,) in residual squared, at lags 0 to ``count`` - 1."""
        return autocovariance(self.reflections, count) * self.variance


class Products(NamedTuple):
    """Sums over samples of products of columns at lags, by the number of samples of the run before."""

    sums: Array
    """(K + 1, K + 1, K + 1, m, m); [g, i, j] is the sum of column a at lag i times column b at lag j"""
    counts: Array
    """-; (K + 1,), samples with g before them, K or more for the last"""

    def of_order(self, order: int) -> Products:
        """The products that an autoregression of a lower ``order`` needs."""
        sums = self.sums[: order + 1, : order + 1, : order + 1].copy()
        sums[order] = self.sums[order:, : order + 1, : order + 1].sum(axis=0)
        return Products(sums, np.append(self.counts[:order], self.counts[order:].sum()))


class Noise(NamedTuple):
    """Noise model of a response."""

    model: Autoregression
    products: Products
    free: float
    """-; samples less fitted parameters"""

    def variance(self, transformed: Array) -> float:
        """Variance of the innovations at other artanh(reflections) (k,)."""
        return _restricted(self.products.sums, self.products.counts, transformed)[1] / self.free


class HacCovariance(NamedTuple):
    """Covariance of an estimate and its degrees of freedom."""

    covariance: Array
    """(p, p)"""
    degrees: Array
    """-; (p,), effective degrees of freedom of each parameter's variance"""


def white(records: tuple[Linear, ...]) -> HacCovariance:
    """Covariance for independent residuals of equal variance."""
    squares = float(sum(record.residuals @ record.residuals for record in records))
    free = _free(records)
    covariance = np.sum([r.weights.T @ r.weights for r in records], axis=0) * (squares / free)
    return HacCovariance(np.asarray(covariance), np.full(records[0].weights.shape[1], free))


def autocorrelated(records: tuple[Linear, ...]) -> HacCovariance:
    """Covariance for residuals that are an autoregression.

    Raises:
        numpy.linalg.LinAlgError: no residuals to estimate it from.
    """
    return under(noise_of(records), records)


def noise_of(records: tuple[Linear, ...]) -> Noise:
    """Estimate the noise model from the residuals of ``records``; records without samples are ignored.

    Raises:
        numpy.linalg.LinAlgError: no residuals to estimate it from.
    """
    records = _not_empty(records)
    width = records[0].basis.shape[1]
    highest = _highest_order([record.used for record in records], width)
    columns = [np.column_stack((record.basis, record.residuals)) for record in records]
    everything = lag_products(columns, [record.used for record in records], highest)
    free = float(everything.counts.sum()) - width
    if free <= 0:
        raise np.linalg.LinAlgError("no residuals to estimate the noise from")
    best, start, chosen = np.inf, np.zeros(0), _noise(everything.of_order(0), np.zeros(0), free)
    failures, limit = 0, MAX_SQUARES_RATIO * _squares(records)
    for order in range(highest + 1):
        of = everything.of_order(order)
        start = _maximum(of.sums, of.counts, np.append(start, 0.0)) if order else start
        score = _restricted(of.sums, of.counts, start)[0] + 2 * (order + 1) * free / max(free - order - 2, 1.0)
        noise, failures = _noise(of, start, free), failures + 1
        if score < best and (not order or _expected_squares(noise.model, records) < limit):
            best, chosen, failures = score, noise, 0
        if failures >= MAX_FAILURES:
            break
    if not chosen.model.variance > 0:
        raise np.linalg.LinAlgError("no residuals to estimate the noise from")
    return chosen


def under(noise: Noise, records: tuple[Linear, ...]) -> HacCovariance:
    """Covariance of the estimate with the weights of ``records`` under ``noise``, theirs or a larger model's."""
    records = _not_empty(records)
    longest = max(len(record.used) for record in records)
    covariance = _quadratic(records, noise.model.autocovariance(longest))
    relative = 2 / noise.free + _relative_variance(records, noise)
    return HacCovariance(covariance, np.maximum(2 / relative, 1.0))


def predictors(reflections: Array) -> list[Array]:
    """Prediction-error filters of orders 0 to k, (order + 1,) each (Levinson's recursion)."""
    filters = [np.ones(1)]
    for reflection in reflections:
        longer = np.append(filters[-1], 0.0)
        filters.append(longer + reflection * longer[::-1])
    return filters


def autocovariance(reflections: Array, count: int) -> Array:
    """Autocovariance (count,) of an autoregression with innovations of variance 1."""
    filters, order = predictors(reflections), len(reflections)
    variances = 1 / np.append(np.cumprod(np.maximum(1 - reflections[::-1] ** 2, 1e-12))[::-1], 1.0)
    values = np.zeros(max(count, order + 1))
    values[0] = variances[0]
    for lag in range(1, order + 1):
        past = filters[lag - 1][1:] @ values[lag - 1 : 0 : -1]
        values[lag] = -reflections[lag - 1] * variances[lag - 1] - past
    if order and count > order + 1:
        past = lfiltic([1.0], filters[-1], values[order:0:-1])
        values[order + 1 :] = lfilter([1.0], filters[-1], np.zeros(count - order - 1), zi=past)[0]
    return values[:count]


def runs(used: Array, limit: int) -> Array:
    """Number of used samples in a row before each sample (N,), at most ``limit``; -1 for a sample not used."""
    index = np.arange(len(used))
    last_gap = np.maximum.accumulate(np.where(used > 0, -1, index))
    return np.where(used > 0, np.minimum(index - last_gap - 1, limit), -1)


def lag_products(columns: list[Array], used: list[Array], order: int) -> Products:
    """`Products` of records of ``columns`` (N_i, m) for autoregressions up to ``order``."""
    width = columns[0].shape[1]
    sums, counts = np.zeros((order + 1, order + 1, order + 1, width, width)), np.zeros(order + 1)
    for values, mask in zip(columns, used, strict=True):
        before = runs(mask, order)
        padded = np.vstack((np.zeros((order, width)), values)).ravel()
        lagged = np.lib.stride_tricks.sliding_window_view(padded, (order + 1) * width)[::width]  # oldest first
        for group in range(order + 1):
            rows = np.flatnonzero(before == group)
            counts[group] += len(rows)
            known = lagged[rows, (order - group) * width :]
            squares = (known.T @ known).reshape(group + 1, width, group + 1, width)
            sums[group, : group + 1, : group + 1] += squares.transpose(0, 2, 1, 3)[::-1, ::-1]
    return Products(sums, counts)


@njit(cache=True)
def _restricted(sums: Array, counts: Array, at: Array) -> tuple[float, float]:
    """Minus twice the restricted log likelihood at ``at`` (k,), artanh(reflections), and the innovations' squares.

    With the whitened products of the columns ``[B r]``, B orthonormal, it is a function of the determinant of their
    matrix (m, m) and of the squares that B leaves of r.
    """
    order, width = len(at), sums.shape[3]
    filters, growth = np.zeros((order + 1, order + 1)), np.ones(order + 1)
    filters[0, 0] = 1.0
    value, samples = 0.0, 0.0
    for k in range(order - 1, -1, -1):
        unexplained = 1.0 - math.tanh(at[k]) ** 2
        if unexplained < 1e-12:
            return NEVER, 0.0
        growth[k] = growth[k + 1] / unexplained
        value -= PRIOR * math.log(unexplained)
    for k in range(order):
        for i in range(k + 2):
            filters[k + 1, i] = filters[k, i] + math.tanh(at[k]) * filters[k, k + 1 - i]
    total = np.zeros((width, width))
    for g in range(order + 1):
        samples += counts[g]
        value += counts[g] * math.log(growth[g])
        for i in range(g + 1):
            for j in range(g + 1):
                total += filters[g, i] * filters[g, j] / growth[g] * sums[g, i, j]
    for a in range(width):
        for b in range(a + 1):
            left = total[a, b]
            for c in range(b):
                left -= total[a, c] * total[b, c]
            if a > b:
                total[a, b] = left / total[b, b]
            elif left > 0:
                total[a, a] = math.sqrt(left)
            else:
                return NEVER, 0.0
        value += 2 * math.log(total[a, a])
    last = total[width - 1, width - 1]
    return value + 2 * (samples - width) * math.log(last), last**2


def _noise(of: Products, at: Array, free: float) -> Noise:
    return Noise(Autoregression(np.tanh(at), _restricted(of.sums, of.counts, at)[1] / free), of, free)


@njit(cache=True)
def _derivatives(sums: Array, counts: Array, at: Array) -> tuple[float, Array, Array]:
    """`_restricted`, its gradient (k,) and its second derivatives (k, k) by central differences."""
    order = len(at)
    gradient, curvature = np.zeros(order), np.zeros((order, order))
    for i in range(order):
        for j in range(i + 1):
            for sign_i in (1, -1):
                for sign_j in (1, -1):
                    moved = at.copy()
                    moved[i] += sign_i * STEP
                    moved[j] += sign_j * STEP
                    value = _restricted(sums, counts, moved)[0]
                    curvature[i, j] += sign_i * sign_j * value / (4 * STEP**2)
                    if i == j and sign_i == sign_j:
                        gradient[i] += sign_i * value / (4 * STEP)
            curvature[j, i] = curvature[i, j]
    return _restricted(sums, counts, at)[0], gradient, curvature


@njit(cache=True)
def _maximum(sums: Array, counts: Array, start: Array) -> Array:
    """Maximum of the restricted likelihood, artanh(reflections) (k,), from ``start`` (k,): Levenberg-Marquardt."""
    at: Array = start.copy()
    damping = 0.0
    for _ in range(MAX_STEPS):
        value, gradient, curvature = _derivatives(sums, counts, at)
        sizes, axes = np.linalg.eigh(curvature)
        slopes = axes.T @ gradient
        for _ in range(MAX_STEPS):
            step = -axes @ (slopes / (np.maximum(np.abs(sizes), LEAST_CURVATURE) + damping))
            step *= min(1.0, LONGEST_STEP / max(np.max(np.abs(step)), 1e-12))
            if _restricted(sums, counts, at + step)[0] <= value:
                damping *= 0.1
                break
            damping = max(10.0 * damping, 1e-3 * np.max(np.abs(sizes)))
        else:
            return at
        at = at + step
        if -(gradient @ step) < ENOUGH:
            return at
    return at


def _uncertainty(of: Products, at: Array) -> Array:
    """Covariance (k, k) of artanh(reflections): inverse curvature of the log likelihood."""
    values, vectors = np.linalg.eigh(_derivatives(of.sums, of.counts, at)[2] / 2)
    return np.asarray((vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T)


def _highest_order(used: list[Array], width: int) -> int:
    """Highest order that the number of samples and the length of their runs allow."""
    count = sum(float(mask.sum()) for mask in used)
    order = int(min(HIGHEST_ORDER, max((count - width) // SAMPLES_PER_ORDER, 0)))
    before = np.concatenate([runs(mask, HIGHEST_ORDER) for mask in used])
    while order and np.count_nonzero(before >= order) < count / 2:
        order -= 1
    return order


def _not_empty(records: tuple[Linear, ...]) -> tuple[Linear, ...]:
    if not (some := tuple(record for record in records if len(record.used))):
        raise np.linalg.LinAlgError("no record has a sample")
    return some


def _squares(records: tuple[Linear, ...]) -> float:
    return float(sum(record.residuals @ record.residuals for record in records))


def _expected_squares(model: Autoregression, records: tuple[Linear, ...]) -> float:
    """Expected squares of the residuals that the regression leaves of noise of the ``model``.

    Where a response is smoother than the noise of its regressors, slow noise that makes all of the response can have
    the largest restricted likelihood; the residuals it would leave are then much larger than the measured ones.
    """
    gamma = model.autocovariance(max(len(record.used) for record in records))
    explained = _quadratic(tuple(record._replace(weights=record.basis) for record in records), gamma)
    return float(sum(record.used.sum() for record in records) * gamma[0] - np.trace(explained))


def _free(records: tuple[Linear, ...]) -> float:
    count = sum(float(record.used.sum()) for record in records)
    return float(max(count - records[0].weights.shape[1], 1.0))


def _fast_length(samples: int) -> int:
    """An even length of at least ``samples`` with a fast Fourier transform."""
    return 2 * int(next_fast_len((samples + 1) // 2, real=True))


def _quadratic(records: tuple[Linear, ...], gamma: Array) -> Array:
    """Sum over records of W^T Gamma W (p, p) with the autocovariance ``gamma`` (longest,) by lag."""
    width = records[0].weights.shape[1]
    total = np.zeros((width, width))
    for record in records:
        size = _fast_length(2 * len(record.used))
        spectrum = _spectrum(record.weights, size)
        total += (spectrum.conj().T @ (spectrum * _density(gamma[: len(record.used)], size)[:, None])).real
    return total


def _spectrum(weights: Array, size: int) -> Complex:
    """Fourier transform (F, p) of ``weights`` (N, p), zero-padded to ``size``: 2 N or more."""
    return np.asarray(rfft(weights, size, axis=0) / np.sqrt(size))


def _density(gamma: Array, size: int) -> Array:
    """One-sided spectral density (F,) of an autocovariance ``gamma`` (N,) at the frequencies of `_spectrum`."""
    padding = np.zeros(size + 1 - 2 * len(gamma))
    density = rfft(np.concatenate((gamma, padding, gamma[:0:-1]))).real
    density[1:-1] *= 2
    return np.asarray(density)


def _relative_variance(records: tuple[Linear, ...], noise: Noise) -> Array:
    """Variance (p,) of the logarithm of each parameter's variance, from that of the autoregression."""
    at = np.arctanh(noise.model.reflections)
    if not len(at):
        return np.zeros(records[0].weights.shape[1])
    longest = max(len(record.used) for record in records)
    sizes = [_fast_length(2 * len(record.used)) for record in records]
    powers = [np.abs(_spectrum(record.weights, size)) ** 2 for record, size in zip(records, sizes, strict=True)]

    def logarithms(transformed: Array) -> Array:
        gamma = autocovariance(np.tanh(transformed), longest) * noise.variance(transformed)
        parts = [
            _density(gamma[: len(r.used)], size) @ power
            for r, size, power in zip(records, sizes, powers, strict=True)
        ]
        return np.asarray(np.log(np.maximum(np.sum(parts, axis=0), 1e-300)))

    steps = np.eye(len(at)) * STEP
    slopes = np.array([(logarithms(at + step) - logarithms(at - step)) / (2 * STEP) for step in steps])
    return np.asarray(np.einsum("ka,kl,la->a", slopes, _uncertainty(noise.products, at), slopes))
