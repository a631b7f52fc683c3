"""What `aided_fit` does from fix to fix, in compiled code.

Unknowns, 31: u, v, w (m/s; over ground), phi, theta, psi (rad) of the IMU's place; what the six inputs tell too much
(rad/s, m/s^2); two 3 x 3 matrices (-) of scales and misalignments, of rates and of forces, row by row; how late the
forces are behind the rates (s). The filter may carry six more behind them: the inputs' errors summed over the time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array
from sim_bridge.compiled import njit

MOTION, OFFSETS, MATRICES, LAG = 6, 6, 12, 30
"""-; how many move, and where the others begin"""
UNKNOWNS = 31


class Chain(NamedTuple):
    """A flight about a path, interval by interval, as the filter goes along it."""

    over: Array
    """(K, 6, 31); motion at an interval's end by the unknowns at its begin, as `carried` takes it"""
    shifts: Array
    """(K, 31); added to the means"""
    added: Array
    """(K, 31, 31); added to the covariances"""
    sums: Array
    """(K, 6, 31); what the six sums grow by, as `carried` takes it"""
    grown: Array
    """(K, 6); added to the sums"""
    slopes: Array
    """(K + 1, 3, 31); how the fixes follow the unknowns"""
    left: Array
    """m/s; (K + 1, 3), what the fixes differ by from the path"""
    noise: float
    """m/s; of a fix"""


@njit(cache=True)
def over_interval(carry: Array, gain: Array, inputs: Array, slopes: Array) -> tuple[Array, Array]:
    """Motion at an interval's end by the unknowns at its begin (6, 31), and what noise of the inputs adds (2, 6, 6).

    ``carry`` (N, 9, 9) and ``gain`` (N, 9, 6) are the steps' Jacobians, ``inputs`` and ``slopes`` (2 N + 1, 6) the
    measured inputs and the rates that a lag multiplies. The noise is of standard deviation 1, of rates and of forces.
    """
    over, spread = np.zeros((MOTION, UNKNOWNS)), np.zeros((2, MOTION, MOTION))
    for i in range(MOTION):
        over[i, i] = 1.0
    for k in range(carry.shape[0]):
        step, noise = np.ascontiguousarray(carry[k, :MOTION, :MOTION]), np.ascontiguousarray(gain[k, :MOTION])
        over = step @ over
        for i in range(MOTION):
            for a in range(6):
                over[i, OFFSETS + a] -= noise[i, a]
                over[i, LAG] += noise[i, a] * slopes[2 * k + 1, a]
                for b in range(3):
                    over[i, MATRICES + 3 * a + b] -= noise[i, a] * inputs[2 * k + 1, 3 * (a // 3) + b]
        for kind in range(2):
            part = np.ascontiguousarray(noise[:, 3 * kind : 3 * kind + 3])
            spread[kind] = step @ spread[kind] @ step.T + part @ part.T
    return over, spread


@njit(cache=True)
def carried(covariance: Array, over: Array, sums: Array, added: Array) -> None:
    """The ``covariance`` (n, n) an interval on, in place.

    The motion goes ``over`` (6, 31), the sums grow by ``sums`` (6, 31) where there are any; ``added`` (31,) to the
    variances of what walks, and (6, 6) inside it to the motion's.
    """
    rows = over @ covariance[:UNKNOWNS]
    near = np.ascontiguousarray(rows[:, :UNKNOWNS])
    if covariance.shape[0] > UNKNOWNS:
        more = sums @ covariance[:UNKNOWNS] + covariance[UNKNOWNS:]
        corner = np.ascontiguousarray(more[:, :UNKNOWNS]) @ sums.T + more[:, UNKNOWNS:]
        across = near @ sums.T + rows[:, UNKNOWNS:]
        covariance[UNKNOWNS:], covariance[:, UNKNOWNS:] = more, more.T
        covariance[UNKNOWNS:, UNKNOWNS:] = corner
        covariance[:MOTION, UNKNOWNS:], covariance[UNKNOWNS:, :MOTION] = across, across.T
    block = near @ over.T
    covariance[:MOTION, MOTION:UNKNOWNS] = rows[:, MOTION:UNKNOWNS]
    covariance[MOTION:UNKNOWNS, :MOTION] = rows[:, MOTION:UNKNOWNS].T
    covariance[:MOTION, :MOTION] = block
    covariance[:UNKNOWNS, :UNKNOWNS] += added


@njit(cache=True)
def filtered(chain: Chain, mean: Array, covariance: Array, means: Array, covariances: Array) -> float:
    """Kalman's filter over K intervals between K + 1 fixes; the logarithm of the likelihood, but for a constant.

    ``mean`` (n,) and ``covariance`` (n, n) are those before the first fix, and become those behind the last;
    ``means`` (K + 1, 31) and ``covariances`` (K + 1, 31, 31), where not empty, are filled with those behind each.
    """
    over, shifts, added, sums, grown, slopes, left, noise = chain
    likelihood, size = 0.0, mean.shape[0]
    for k in range(left.shape[0]):
        if k > 0:
            if size > UNKNOWNS:
                mean[UNKNOWNS:] += sums[k - 1] @ mean[:UNKNOWNS] + grown[k - 1]
            mean[:MOTION] = over[k - 1] @ mean[:UNKNOWNS]
            mean[:UNKNOWNS] += shifts[k - 1]
            carried(covariance, over[k - 1], sums[k - 1], added[k - 1])
        for row in range(3):
            reach = slopes[k, row] @ covariance[:UNKNOWNS]  # symmetric
            variance = slopes[k, row] @ reach[:UNKNOWNS] + noise**2
            surprise = left[k, row] - slopes[k, row] @ mean[:UNKNOWNS]
            mean += reach * (surprise / variance)
            covariance -= np.outer(reach, reach / variance)
            likelihood -= 0.5 * (np.log(variance) + surprise**2 / variance)
        if means.shape[0] > 0:
            means[k], covariances[k] = mean[:UNKNOWNS], covariance[:UNKNOWNS, :UNKNOWNS]
    return likelihood
