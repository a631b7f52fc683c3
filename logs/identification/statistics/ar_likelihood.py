"""The restricted likelihood of an autoregression and its slopes, from products of samples alone; compiled.

With the columns ``[B r]`` of an orthonormal basis and of residuals, and filters of the orders 0 to k that Levinson's
recursion makes of the reflections, minus twice the logarithm of the restricted likelihood is a function of one matrix
(m, m), the columns' whitened products: of its determinant and of the squares that it leaves of ``r``. Both have
slopes in closed form, and what they ask of the samples is one number for each pair of lags.
"""

from __future__ import annotations

import math

from logs.identification.results import Array
from sim_bridge.compiled import njit

LARGEST = 1 - 1e-7
"""-; size of a reflection"""
NEVER = 1e10


@njit(cache=True)
def _levinson(at: Array, reflections: Array, filters: Array, slopes: Array, growth: Array) -> bool:
    """Fill the filters (k + 1, k + 1) of orders 0 to k, their ``slopes`` (k, k + 1, k + 1) by each of ``at`` (k,) and
    the ``growth`` (k + 1,) of the variance that each leaves; false where that has no end."""
    order = len(at)
    filters[:] = 0.0
    slopes[:] = 0.0
    filters[0, 0] = 1.0
    growth[order] = 1.0
    for k in range(order):
        reflections[k] = math.tanh(at[k])
        if not abs(reflections[k]) < LARGEST:
            return False
    for k in range(order - 1, -1, -1):
        growth[k] = growth[k + 1] / (1 - reflections[k] ** 2)
    for k in range(order):
        turned = 1 - reflections[k] ** 2
        for i in range(k + 2):
            filters[k + 1, i] = filters[k, i] + reflections[k] * filters[k, k + 1 - i]
            slopes[k, k + 1, i] = turned * filters[k, k + 1 - i]
            for j in range(k):
                slopes[j, k + 1, i] = slopes[j, k, i] + reflections[k] * slopes[j, k, k + 1 - i]
    return True


@njit(cache=True, fastmath={"reassoc", "contract"})
def _whitened(sums: Array, filters: Array, growth: Array, total: Array) -> None:
    """Fill ``total`` (m, m) with the products of the whitened columns."""
    orders, width = len(growth), len(total)
    total[:] = 0.0
    for g in range(orders):
        for i in range(g + 1):
            for j in range(i, g + 1):
                share = filters[g, i] * filters[g, j] / growth[g] * (1.0 if i == j else 2.0)
                for a in range(width):
                    for b in range(width):
                        total[a, b] += share * sums[g, i, j, a, b]
    for a in range(width):
        for b in range(a):
            total[a, b] = total[b, a] = (total[a, b] + total[b, a]) / 2


@njit(cache=True)
def _factorised(total: Array) -> bool:
    """Cholesky's lower factor in place of the lower half of ``total`` (m, m); false where there is none."""
    for a in range(len(total)):
        for b in range(a + 1):
            left = total[a, b]
            for c in range(b):
                left -= total[a, c] * total[b, c]
            if a == b:
                if not left > 0:
                    return False
                total[a, a] = math.sqrt(left)
            else:
                total[a, b] = left / total[b, b]
    return True


@njit(cache=True)
def _inverse(lower: Array, inverse: Array, spare: Array) -> None:
    """Fill ``inverse`` (m, m) with that of L L^T, ``lower`` holding L; ``spare`` (m, m) holds the inverse of L."""
    width = len(lower)
    for b in range(width):
        for a in range(b, width):
            left = 1.0 if a == b else 0.0
            for c in range(b, a):
                left -= lower[a, c] * spare[c, b]
            spare[a, b] = left / lower[a, a]
    for a in range(width):
        for b in range(a + 1):
            left = 0.0
            for c in range(a, width):
                left += spare[c, a] * spare[c, b]
            inverse[a, b] = inverse[b, a] = left


@njit(cache=True, fastmath={"reassoc", "contract"})
def _lagged(sums: Array, weights: Array, pairs: Array) -> None:
    """Fill ``pairs`` (k + 1, k + 1, k + 1): the sum of ``weights`` (m, m) times the products at each pair of lags."""
    width = len(weights)
    for g in range(len(pairs)):
        for i in range(g + 1):
            for j in range(i, g + 1):
                found = 0.0
                for a in range(width):
                    for b in range(width):
                        found += weights[a, b] * sums[g, i, j, a, b]
                pairs[g, i, j] = pairs[g, j, i] = found


@njit(cache=True)
def restricted(sums: Array, counts: Array, prior: float, at: Array, gradient: Array) -> tuple[float, float]:
    """Minus twice the restricted log likelihood at ``at`` (k,), artanh(reflections), and the residuals' squares left.

    ``sums`` (k + 1, k + 1, k + 1, m, m) and ``counts`` (k + 1,) are `autoregression.Products`; a ``prior`` times the
    logarithm of ``1 - reflection^2`` is added to twice the likelihood, whose slopes come into ``gradient`` (k,).
    `NEVER` and zero where there is no such autoregression.
    """
    order, width = len(at), sums.shape[3]
    reflections, growth = at.copy(), counts.copy()
    filters, slopes = sums[0, :, :, 0, 0].copy(), sums[:order, :, :, 0, 0].copy()
    gradient[:] = 0.0
    if not _levinson(at, reflections, filters, slopes, growth):
        return NEVER, 0.0
    total = sums[0, 0, 0].copy()
    _whitened(sums, filters, growth, total)
    if not _factorised(total):
        return NEVER, 0.0
    free, value, last = 1.0 - width, 0.0, total[width - 1, width - 1]
    for g in range(order + 1):
        free += counts[g]
        value += counts[g] * math.log(growth[g])
    for a in range(width):
        value += 2 * math.log(total[a, a])
    value += 2 * (free - 1) * math.log(last)
    for k in range(order):
        value -= prior * math.log(1 - reflections[k] ** 2)
    if order:
        weights, pairs = total.copy(), sums[:, :, :, 0, 0].copy()
        _inverse(total, weights, total.copy())
        _add_square(weights, (free - 1) * last**2)
        _lagged(sums, weights, pairs)
        _slopes((counts, prior), (reflections, filters, slopes, growth), pairs, gradient)
    return value, last**2


@njit(cache=True)
def _add_square(inverse: Array, weight: float) -> None:
    """Add ``weight`` times the square of the last column of ``inverse`` (m, m) to it."""
    last = inverse[-1].copy()
    for a in range(len(last)):
        for b in range(len(last)):
            inverse[a, b] += weight * last[a] * last[b]


@njit(cache=True)
def _slopes(
    known: tuple[Array, float], levinson: tuple[Array, Array, Array, Array], pairs: Array, gradient: Array
) -> None:
    """Fill ``gradient`` (k,): what the variances, the prior and, by the ``pairs`` of lags, the products do.

    ``known`` are counts and prior of `restricted`, ``levinson`` the reflections and what `_levinson` makes of them.
    """
    (counts, prior), (reflections, filters, slopes, growth) = known, levinson
    for k in range(len(gradient)):
        total = 2 * prior * reflections[k]
        for g in range(len(counts)):
            change = 0.0
            for i in range(g + 1):
                for j in range(g + 1):
                    share = -reflections[k] * filters[g, i] if g <= k else slopes[k, g, i]
                    change += 2 * share * filters[g, j] * pairs[g, i, j]
            total += change / growth[g]
            if g <= k:
                total += 2 * reflections[k] * counts[g]
        gradient[k] = total
