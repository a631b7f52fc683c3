"""Measurement errors of signals: time skew between two, noise level of one.

Cross-correlation finds the skew to a sample (Bendat & Piersol, Random Data, 4th ed., 2010, chapters 5 and 8; the
variance of a correlation between colored signals is Bartlett's, J. Royal Statistical Society 98, 1935). Between the
samples it is the shift of the first signal, smoothed by `fourier_smoothing`, that fits the second by least squares
with a gain and an offset: the maximum of the correlation again, but with a standard error, corrected for colored
residuals.

Tintner, The Variate Difference Method, 1940; the variances of the differences as in Anderson, The Statistical
Analysis of Time Series, 1971, chapter 3. The k-th difference of white noise has binomial(2k, k) times its
variance; the smooth part of the signal vanishes as k increases.
"""

from __future__ import annotations

from math import comb, sqrt
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import interpolated
from logs.identification.data.smoothing import Smoothed, fourier_smoothing, whole
from logs.identification.estimators.least_squares import regress
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, estimate
from wingbeat.errors import InputError

LEAST = 40
"""-; samples"""
LEAST_OVERLAP = 0.5
"""-; of the record that both signals share at the longest skew, at least"""
CLEAR = 2.0
"""-; standard deviations between the highest peak of the correlation and the next, at least"""
ITERATIONS = 20
NAME = "skew"


class _Peak(NamedTuple):
    """The highest of the correlation's peaks."""

    lag: int
    width: int
    """-; samples to the nearer adjacent minimum"""
    reason: str
    """-; why it is not usable; empty if it is"""


def skew_between(first: Array, second: Array, step: float, longest: float) -> Estimate | Finding:
    """Delay (s) of ``second`` (N,) behind ``first`` (N,), both sampled every ``step`` s.

    The signals agree up to a positive gain, an offset and noise. Skews up to ``longest`` s in both directions are
    tried; there is no estimate if the peak of the correlation is not clear of the next or at the end of the range.

    Raises:
        InputError: the signals differ in length, are shorter than 40 samples or twice the longest skew, or have gaps.
    """
    if len(first) != len(second):
        raise InputError(f"signals of {len(first)} and {len(second)} samples cannot be aligned: resample them first")
    reach = int(np.ceil(longest / step))
    if reach < 1 or reach > (1 - LEAST_OVERLAP) * len(first):
        raise InputError(f"a skew up to {longest:g} s cannot be estimated in {step * len(first):g} s of signals")
    smooth = fourier_smoothing(whole(first, LEAST), step).smoothed
    whole(second, LEAST)
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return not_estimated(NAME, "a signal does not change")
    peak = _highest(smooth.values, second, reach)
    return not_estimated(NAME, peak.reason) if peak.reason else _refined(smooth, second, step, peak)


def shifted(experiment: Experiment, names: tuple[str, ...], skew: float) -> Experiment:
    """The experiment with the signals ``names``, delayed by ``skew`` s, shifted back.

    Linear between samples; NaN if not measured.
    """
    moved = {name: interpolated(experiment.time, experiment.signals[name], experiment.time + skew) for name in names}
    return experiment._replace(signals={**experiment.signals, **moved})


def _overlap(first: Array, second: Array, lag: int) -> tuple[Array, Array]:
    count = len(first)
    return first[max(-lag, 0) : count - max(lag, 0)], second[max(lag, 0) : count - max(-lag, 0)]


def _highest(first: Array, second: Array, reach: int) -> _Peak:
    lags = np.arange(-reach, reach + 1)
    heights = np.array([np.corrcoef(*_overlap(first, second, int(lag)))[0, 1] for lag in lags])
    top = int(np.argmax(heights))
    lag = int(lags[top])
    independent = _independent(*_overlap(first, second, lag))
    spread = 1 / np.sqrt(max(independent - 3, 1.0))
    left, right = _valleys(heights, top)
    rival = float(np.max(np.concatenate((heights[:left], heights[right + 1 :])), initial=-1.0))
    reason = ""
    if top in (0, len(lags) - 1):
        reason = "the correlation still increases at the longest skew"
    elif _fisher(heights[top]) < CLEAR * spread:
        reason = f"the signals do not belong together: their correlation is {heights[top]:.2f} at the most"
    elif _fisher(heights[top]) - _fisher(rival) < CLEAR * spread:
        reason = f"ambiguous: the correlation has peaks of {heights[top]:.3f} and {rival:.3f}"
    return _Peak(lag, min(top - left, right - top), reason)


def _fisher(correlation: float) -> float:
    """Fisher's transformation, whose variance is the same for any correlation."""
    return float(np.arctanh(np.clip(correlation, -0.999999, 0.999999)))


def _valleys(heights: Array, top: int) -> tuple[int, int]:
    """Minima of the correlation to the left and right of its highest peak, or its ends."""
    falling = np.diff(heights)
    right = top + int(np.argmax(np.append(falling[top:] > 0, True)))
    left = top - int(np.argmax(np.append(falling[:top][::-1] < 0, True)))
    return left, right


def _independent(first: Array, second: Array) -> float:
    """Independent pairs of samples, by Bartlett's formula."""
    product = _correlation(first) * _correlation(second)
    return float(len(first) / max(1 + 2 * np.sum(product[1 : len(first) // 4]), 1.0))


def _correlation(values: Array) -> Array:
    centered = values - np.mean(values)
    power = np.abs(np.fft.rfft(centered, 2 * len(values))) ** 2
    sums = np.fft.irfft(power)[: len(values)]
    correlation: Array = sums / sums[0]
    return correlation


def _refined(smooth: Smoothed, second: Array, step: float, peak: _Peak) -> Estimate | Finding:
    """Gauss-Newton on the shift, gain and offset from the ``peak``, staying on it."""
    time = step * np.arange(len(second))
    curve = CubicHermiteSpline(time, smooth.values, smooth.rates)
    slope, skew = curve.derivative(), peak.lag * step
    for _ in range(ITERATIONS):
        at = time - skew
        used = ((at >= time[0]) & (at <= time[-1])).astype(float)
        fit = regress(np.column_stack((curve(at), -slope(at), np.ones(len(at)))), second, used)
        gain, change = fit.values[0], fit.values[1] / fit.values[0]
        error = float(np.sqrt(fit.covariance[1, 1]) / abs(gain))
        skew += float(change)
        if not gain > 0 or abs(skew / step - peak.lag) > max(2, peak.width):
            break
        if abs(change) < 1e-3 * max(error, 1e-6 * step):
            return estimate(NAME, "s", skew, error, fit.degrees)
    return not_estimated(NAME, "the shift of the one signal onto the other did not converge")


HIGHEST = 8
"""-; order of differences"""
THIRD = 3
"""-; order of the difference that has only noise and steps of a motion"""
MEDIAN_TO_DEVIATION = 1.4826
"""-; standard deviation of a normal variable over its median size"""
SETTLED = 2.0
"""-; standard deviations: decrease of the estimate by the next order, below which the order is sufficient"""


def noise_level(values: Array) -> float:
    """Standard deviation of the white noise in equally spaced ``values`` (N,), in their unit.

    Of correlated noise only the part that differs between adjacent samples counts.

    Raises:
        InputError: too few samples, or some are missing.
    """
    whole(values, 2 * HIGHEST)
    before = _variance(values, 1)
    for order in range(1, HIGHEST):
        after = _variance(values, order + 1)
        if before - after <= SETTLED * before * sqrt(_spread_of_change(order) / (len(values) - order)):
            return sqrt(before)
        before = after
    return sqrt(before)


def noise_with_steps(values: Array) -> float:
    """The same for ``values`` (N,) with steps, as of a control, or NaN: by the median of the third difference.

    A step is in four of them, which changes the median little. It needs nearly three times the samples for the same
    accuracy. 0 if no four adjacent samples were measured.
    """
    return noise_of_differences(third_differences(values))


def third_differences(values: Array) -> Array:
    """Of ``values`` (N,) or (N, k): (N - 3, ...), none if there are fewer than four."""
    return np.asarray(np.diff(values, THIRD, axis=0))


def noise_of_differences(differences: Array) -> float:
    """Standard deviation of the white noise whose `third_differences` (N,) these are, NaN left out."""
    known = np.abs(differences[np.isfinite(differences)])
    return MEDIAN_TO_DEVIATION * float(np.median(known)) / sqrt(_growth(THIRD)) if len(known) else 0.0


def _growth(order: int) -> int:
    """Variance of the difference of white noise with variance 1."""
    return comb(2 * order, order)


def _variance(values: Array, order: int) -> float:
    return float(np.mean(np.diff(values, order) ** 2)) / _growth(order)


def _spread_of_change(order: int) -> float:
    """N times the variance of the change from one order to the next, for white noise of variance 1."""
    here, there = _growth(order), _growth(order + 1)
    return 2 * (
        comb(4 * order, 2 * order) / here**2
        - 2 * comb(4 * order + 2, 2 * order + 1) / (here * there)
        + comb(4 * order + 4, 2 * order + 2) / there**2
    )
