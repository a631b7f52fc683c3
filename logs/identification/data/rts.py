"""Rauch-Tung-Striebel smoother: a signal whose highest derivative wanders, forwards and back.

Rauch, Tung & Striebel, Maximum Likelihood Estimates of Linear Dynamic Systems, AIAA Journal 3(8), 1965, with the
Kalman filter and the smoother of filterpy. The model is a constant acceleration (or jerk) driven by white noise of
the spectral density S. On a long record such a smoother of order p passes a circular frequency w with the gain
1 / (1 + (w / w_c)^2p), where S = R dt w_c^2p: so the cut-off and the noise's variance R say all that it must know.
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter, rts_smoother

from logs.identification.data.contiguous_runs import longest_run
from logs.identification.data.fourier_smoothing import fourier_smoothing
from logs.identification.data.smoothed import Smoothed, half_power
from logs.identification.results import Array
from wingbeat.errors import InputError

MODELS = {"acceleration": 3, "jerk": 4}
"""what is constant but for white noise, and the number of states that takes"""
LEAST = 16
LEAST_TUNED = 64
"""-; samples without a gap from which noise and cut-off are found"""
LITTLE = 10.0
"""-; by which the standard errors of the first state are blown up, since the samples they are from come again"""


class Tuning(NamedTuple):
    """What the smoother knows of signal and noise."""

    noise: float
    """as the signal; standard deviation of a sample's white noise"""
    cut_off: float
    """Hz; half of a sine of this frequency is taken for noise"""


def tuning_of(values: Array, step: float) -> Tuning:
    """Noise and cut-off by Fourier smoothing of the longest piece of ``values`` (N,) without a gap.

    Raises:
        InputError: no piece has 64 samples.
    """
    longest = values[longest_run(np.isfinite(values))]
    if len(longest) < LEAST_TUNED:
        raise InputError(
            f"no {LEAST_TUNED} samples without a gap to tell noise from signal: give the smoother's tuning"
        )
    found = fourier_smoothing(longest, step)
    return Tuning(found.smoothed.noise, found.cut_off)


def rts(values: Array, step: float, tuning: Tuning | None = None, model: str = "acceleration") -> Smoothed:
    """Smoothed ``values`` (N,), ``step`` s apart, with standard errors; NaN is a sample that was not measured.

    A gap is bridged and the standard errors grow in it. ``model`` is one of `MODELS`.

    Raises:
        InputError: too few samples, or a tuning that is not positive or above half the sampling rate.
    """
    measured = int(np.sum(np.isfinite(values)))
    if measured < LEAST:
        raise InputError(f"the smoother needs {LEAST} measured samples, not {measured}")
    known = tuning_of(values, step) if tuning is None else tuning
    if not known.noise > 0:
        raise InputError("the signal has no noise that a smoother could weigh it with")
    circular = half_power(step, known.cut_off) / step
    # In noises and in radians of the cut-off all states are of one size, which keeps the covariances exact.
    first = values[np.isfinite(values)][0]
    scaled = (values - first) / known.noise
    kalman = _filter(circular * step, MODELS[model], scaled)
    readings = [value if np.isfinite(value) else None for value in scaled]
    states, covariances, _, _ = kalman.batch_filter(readings, update_first=True)
    count = len(values)
    smooth, spread, _, _ = rts_smoother(states, covariances, [kalman.F] * count, [kalman.Q] * count)
    errors = np.sqrt(np.maximum(np.diagonal(spread, axis1=1, axis2=2), 0.0))
    size, rate = known.noise, known.noise * circular
    return Smoothed(first + size * smooth[:, 0], rate * smooth[:, 1], size, size * errors[:, 0], rate * errors[:, 1])


def _filter(step: float, order: int, scaled: Array) -> KalmanFilter:
    """The filter before its first reading, which knows of the state little more than nothing."""
    kalman = KalmanFilter(dim_x=order, dim_z=1)
    kalman.F = np.array(
        [[step ** (j - i) / factorial(j - i) if j >= i else 0.0 for j in range(order)] for i in range(order)]
    )
    kalman.H = np.eye(order)[:1]
    kalman.R = np.eye(1)
    kalman.Q = Q_continuous_white_noise(order, step, step)
    kalman.x, kalman.P = _start(step, order, scaled)
    return kalman


def _start(step: float, order: int, scaled: Array) -> tuple[Array, Array]:
    """State and covariance at the first sample: those of a polynomial through the next radian, blown up.

    A start that knew nothing at all would leave nothing of the covariances but rounding errors.
    """
    known = np.flatnonzero(np.isfinite(scaled))
    near = known[: max(int(np.searchsorted(known, known[0] + 1 / step)), 2 * order)]
    powers = np.column_stack([(near * step) ** power / factorial(power) for power in range(order)])
    covariance = np.asarray(np.linalg.inv(powers.T @ powers), dtype=np.float64)
    return covariance @ (powers.T @ scaled[near]), covariance * LITTLE**2
