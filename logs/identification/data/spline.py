"""Smoothing spline: the cubic spline that trades misfit against bending.

Reinsch, Smoothing by Spline Functions, Numerische Mathematik 10, 1967; the trade by generalised cross-validation,
Craven & Wahba, Numerische Mathematik 31, 1979. On an even time base the spline passes a frequency f with the gain
1 / (1 + (f / f_c)^4). Its samples may be uneven or missing.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.optimize import minimize_scalar

from logs.identification.data.smoothed import Smoothed, half_power
from logs.identification.results import Array
from wingbeat.errors import InputError

LEAST = 8
GRID = 12
"""-; cut-offs tried before the best is refined"""


def smoothing_spline(time: Array, values: Array, cut_off: float | None = None) -> Smoothed:
    """Smoothed ``values`` (N,) at rising ``time`` (s; N,); the ``cut_off`` (Hz) is found where none is given.

    NaN is a sample that was not measured; inside the record the spline bridges it, before the first and behind
    the last measured sample the result is NaN.

    Raises:
        InputError: fewer than eight samples, time that does not rise, or a cut-off above half the sampling rate.
    """
    good = np.isfinite(values)
    at, measured = time[good], values[good]
    if len(at) < LEAST:
        raise InputError(f"a spline needs {LEAST} measured samples, not {len(at)}")
    if np.any(np.diff(at) <= 0):
        raise InputError("time does not rise from sample to sample")
    step = float(np.median(np.diff(at)))
    circular = _best(at, measured, step) if cut_off is None else half_power(step, cut_off) / step
    fitted = _fit(at, measured, step, circular)
    residuals = measured - fitted(at)
    noise = float(np.sqrt(np.sum(residuals**2) / max(len(at) - _degrees(at, step, circular), 1.0)))
    outside = (time < at[0]) | (time > at[-1])
    smooth, rates = (np.where(outside, np.nan, curve(time)) for curve in (fitted, fitted.derivative()))
    return Smoothed(smooth, rates, noise)


def _fit(time: Array, values: Array, step: float, circular: float) -> BSpline:
    """The spline with the cut-off ``circular`` (rad/s), in a time that runs by one from sample to sample."""
    begin = time[0]
    scaled = make_smoothing_spline((time - begin) / step, values, lam=(circular * step) ** -4)
    return BSpline(scaled.t * step + begin, scaled.c, scaled.k)


def _degrees(time: Array, step: float, circular: float) -> float:
    """Trace of the hat matrix, by the frequencies that a beam with free ends rings at."""
    ringing = np.pi * (np.arange(3, len(time) + 1) - 1.5) / (time[-1] - time[0])
    # Evenly spaced samples see sin(x) / x more than the frequency near half the sampling rate.
    seen = 2 * np.sin(np.minimum(ringing * step, np.pi) / 2) / step
    return 2 + float(np.sum(1 / (1 + (seen / circular) ** 4)))


def _best(time: Array, values: Array, step: float) -> float:
    """The cut-off (rad/s) by generalised cross-validation."""

    def score(logarithm: float) -> float:
        circular = float(np.exp(logarithm))
        residuals = values - _fit(time, values, step, circular)(time)
        left = max(len(time) - _degrees(time, step, circular), 1e-9)
        return float(np.log(residuals @ residuals / left**2 + 1e-300))

    grid = np.linspace(np.log(np.pi / (time[-1] - time[0])), np.log(0.7 * np.pi / step), GRID)
    scores = [score(each) for each in grid]
    middle = int(np.argmin(scores))
    low, high = grid[max(middle - 1, 0)], grid[min(middle + 1, GRID - 1)]
    return float(np.exp(minimize_scalar(score, bounds=(low, high), method="bounded", options={"xatol": 3e-2}).x))
