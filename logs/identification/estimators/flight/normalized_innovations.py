"""Changes of forecasts' errors and of their covariance, each in units of the forecasts' own scatter."""

from __future__ import annotations

from logs.identification.results import Array
from sim_bridge.compiled import njit


@njit(cache=True)
def whitened(root: Array, errors: Array, out: Array) -> None:
    """Fill ``out`` (K, m) with ``L^-1 e`` of every forecast; ``root`` (K, m, m) is Cholesky's lower factor L."""
    count, m = errors.shape
    for k in range(count):
        for i in range(m):
            total = errors[k, i]
            for j in range(i):
                total -= root[k, i, j] * out[k, j]
            out[k, i] = total / root[k, i, i]


@njit(cache=True)
def whitened_change(root: Array, other: Array, width: float, out: Array) -> None:
    """Fill ``out`` (K, m, m) with ``L^-1 (L' L'^T - L L^T) L^-T / width``, L' of ``other``: a covariance's slope."""
    count, m = root.shape[0], root.shape[1]
    for k in range(count):
        for i in range(m):
            for j in range(i + 1):
                total = 0.0
                for s in range(j + 1):
                    total += other[k, i, s] * other[k, j, s] - root[k, i, s] * root[k, j, s]
                out[k, i, j] = out[k, j, i] = total / width
        for j in range(m):
            for i in range(m):
                for s in range(i):
                    out[k, i, j] -= root[k, i, s] * out[k, s, j]
                out[k, i, j] /= root[k, i, i]
        for i in range(m):
            for j in range(m):
                for s in range(j):
                    out[k, i, j] -= root[k, j, s] * out[k, i, s]
                out[k, i, j] /= root[k, j, j]


@njit(cache=True)
def gradient_terms(shift: Array, growth: Array, white: Array, out: Array) -> None:
    """Fill ``out`` (K,) with each forecast's part of the slope of minus the logarithm of the likelihood.

    ``shift`` (K, m) is the whitened change of the errors, ``growth`` (K, m, m) of their covariance, ``white`` (K, m)
    the whitened errors (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 5; Klein & Morelli, Aircraft
    System Identification, 2006, ch. 6).
    """
    count, m = white.shape
    for k in range(count):
        total = 0.0
        for i in range(m):
            total += shift[k, i] * white[k, i] + growth[k, i, i] / 2.0
            for j in range(m):
                total -= white[k, i] * growth[k, i, j] * white[k, j] / 2.0
        out[k] = total


@njit(cache=True)
def information(shift: Array, growth: Array, out: Array) -> None:
    """Fill ``out`` (n, n) with the information of n parameters whose whitened changes are those of `gradient_terms`.

    ``shift`` is (n, K, m), ``growth`` (n, K, m, m). Through BLAS, whose threads wait for a busy core, this took most
    of a fit's time.
    """
    n, count, m = shift.shape
    for one in range(n):
        for other in range(one + 1):
            total = 0.0
            for k in range(count):
                for i in range(m):
                    total += shift[one, k, i] * shift[other, k, i]
                    for j in range(m):
                        total += growth[one, k, i, j] * growth[other, k, i, j] / 2.0
            out[one, other] = out[other, one] = total
