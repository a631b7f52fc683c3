"""Smoothing and differentiation of signals, by name of the method.

* ``local_quadratic``: parabola through the neighbors of each sample (Savitzky & Golay, Analytical Chemistry 36(8),
  1964; Klein & Morelli, Aircraft System Identification, 2006, ch. 11).
* ``fourier``: sine series of the whole record with a Wiener filter (Morelli, J. Aircraft 32(4), 1995; Klein &
  Morelli, ch. 11).
* ``spline``: cubic smoothing spline, by generalized cross-validation (Craven & Wahba, Numerische Mathematik 31,
  1979).
* ``rts``: Kalman filter and Rauch-Tung-Striebel smoother (AIAA Journal 3(8), 1965) of a constant acceleration driven
  by white noise.
* ``stroke``: mean over a wing stroke.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter, rts_smoother
from scipy.fft import dct, dst
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import minimize_scalar
from scipy.signal import savgol_coeffs, savgol_filter

from logs.identification.data.experiment import Experiment, longest_run
from logs.identification.data.resampling import stroke_average, wing_period
from logs.identification.results import Array
from wingbeat.errors import InputError

RATE_SUFFIX = "_dot"
"""the derivative of signal q is q_dot"""
STROKES = "strokes"
"""-; the signal that counts wing strokes, for the method ``stroke``"""


class Smoothed(NamedTuple):
    """A smoothed signal and its derivative."""

    values: Array
    """as the signal; (N,)"""
    rates: Array
    """as the signal, per s; (N,)"""
    noise: float
    """as the signal; standard deviation of the noise"""


def whole(values: Array, least: int) -> Array:
    """``values`` (N,) as they are.

    Raises:
        InputError: fewer than ``least`` samples, or some are not finite.
    """
    if values.ndim != 1 or len(values) < least:
        raise InputError(f"a signal of {values.shape} samples is too short to be smoothed: {least} are needed")
    missing = int(np.sum(~np.isfinite(values)))
    if missing:
        raise InputError(
            f"{missing} of the signal's {len(values)} samples are missing: fill short gaps or split it first"
        )
    return values


def half_power(step: float, cut_off: float) -> float:
    """The cut-off in rad a sample from Hz.

    Raises:
        InputError: it does not lie between zero and half the sampling rate.
    """
    if not 0 < cut_off < 0.5 / step:
        raise InputError(
            f"a cut-off of {cut_off:g} Hz is not between 0 and {0.5 / step:g} Hz, half the sampling rate"
        )
    return 2 * np.pi * cut_off * step


class SmoothedExperiment(NamedTuple):
    """An experiment with smoothed signals."""

    experiment: Experiment
    """its signals smoothed, with their derivatives, named with `RATE_SUFFIX`"""
    noise: Mapping[str, float]
    """as the signal, by its name; standard deviation of the noise"""


def smoothed(experiment: Experiment, names: Sequence[str], method: str = "fourier") -> SmoothedExperiment:
    """The experiment with the signals ``names`` smoothed and differentiated by one of `METHODS`.

    Raises:
        InputError: no such method or signal, or a signal that the method cannot smooth, with its name.
    """
    if method not in METHODS:
        raise InputError(f"no method {method!r} to smooth with: it is one of {', '.join(METHODS)}")
    signals, units = dict(experiment.signals), dict(experiment.units)
    noise: dict[str, float] = {}
    for name in names:
        if name not in experiment.signals:
            raise InputError(f"{experiment.name} has no signal {name}")
        try:
            result = METHODS[method](experiment, experiment.signals[name])
        except InputError as reason:
            raise InputError(f"{experiment.name}, {name}: {reason}") from None
        signals[name], signals[name + RATE_SUFFIX] = result.values, result.rates
        units[name + RATE_SUFFIX] = f"{units[name]}/s"
        noise[name] = result.noise
    return SmoothedExperiment(experiment._replace(signals=signals, units=units), noise)


# --- local parabola -----------------------------------------------------------------------------------------

MIN_WIDTH = 5
"""-; samples in a parabola"""


def local_quadratic(values: Array, step: float, width: int = MIN_WIDTH) -> Smoothed:
    """Smoothed ``values`` (N,), ``step`` s apart, by parabolas over ``width`` samples (odd, five or more).

    At the ends the last complete parabola is used.

    Raises:
        InputError: the width is even or under five, too few samples, or some are missing.
    """
    if width < MIN_WIDTH or width % 2 == 0:
        raise InputError(f"a parabola over {width} samples: the width must be odd and {MIN_WIDTH} or more")
    whole(values, width + 2)
    smooth, rates = (savgol_filter(values, width, 2, deriv=order, delta=step, mode="interp") for order in (0, 1))
    half, count = width // 2, len(values)
    # The hat matrix of a parabola is a projection: the squares of its weights add up to the central one.
    central = float(savgol_coeffs(width, 2)[half])
    noise = float(np.sqrt(np.mean((values - smooth)[half : count - half] ** 2) / (1 - central)))
    return Smoothed(smooth, rates, noise)


# --- sine series --------------------------------------------------------------------------------------------

MIN_FOURIER = 16
GRID = 60
"""-; cut-offs tried before the best is refined"""
POWER = 6
"""-; of the ratio of the model spectra: coefficients of a smooth signal fall with the cube of their number"""


class FourierSmoothed(NamedTuple):
    """A smoothed signal and the cut-off that was found."""

    smoothed: Smoothed
    cut_off: float
    """Hz; at which the model spectra of signal and noise cross"""


class _SineSeries(NamedTuple):
    """A record as ends and sine coefficients, before any filter."""

    sines: Array
    """(N - 2,); of the record less the line through its ends, orthonormal"""
    lines: Array
    """(N - 2, 2); coefficients of the line's ends, each raised by one"""
    ends: Array
    """(2,); the end samples"""


class _Filtered(NamedTuple):
    """The record at one cut-off."""

    gain: Array
    """(N - 2,); the Wiener filter"""
    shift: Array
    """(2,); what the line's ends are raised by"""
    sines: Array
    """(N - 2,); not filtered, with the line's ends as estimated"""
    squares: float
    """of what is taken off"""
    score: float
    """of generalized cross-validation"""


def fourier_smoothing(values: Array, step: float, cut_off: float | None = None) -> FourierSmoothed:
    """Smoothed ``values`` (N,), ``step`` s apart; by default the ``cut_off`` (Hz) is that of cross-validation.

    The line between the record's ends is subtracted and the rest continued as an odd function, so that the sine
    coefficients of a smooth signal fall with the cube of their number and those of white noise are level. The Wiener
    filter of these spectra is ``1 / (1 + (k / k_c)^6)``. The cut-off k_c is chosen by generalized cross-validation
    (Golub, Heath & Wahba, Technometrics 21(2), 1979), and the ends of the line are fitted with the series.

    Raises:
        InputError: too few samples, some are missing, or the cut-off is not below half the sampling rate.
    """
    series = _sine_series(whole(values, MIN_FOURIER))
    count = len(values)
    number = _best_cut_off(series) if cut_off is None else half_power(step, cut_off) * (count - 1) / np.pi
    result = _filtered(series, number)
    sines = np.concatenate(([0.0], result.sines * result.gain, [0.0]))
    ends = series.ends + result.shift
    line = np.linspace(ends[0], ends[1], count)
    duration = step * (count - 1)
    scale = np.sqrt(2 / (count - 1))
    wave = np.zeros(count)
    wave[1:-1] = dst(sines[1:-1], type=1, norm="ortho")
    slopes = sines * np.arange(count) * np.pi / duration * scale
    rates = (ends[1] - ends[0]) / duration + dct(slopes, type=1) / 2
    noise = float(np.sqrt(result.squares / max(count - 2 - float(np.sum(result.gain)), 1.0)))
    return FourierSmoothed(Smoothed(line + wave, rates, noise), number / (2 * duration))


def _sine_series(values: Array) -> _SineSeries:
    count = len(values)
    line = np.linspace(values[0], values[-1], count)
    rise = np.linspace(0.0, 1.0, count)[1:-1]
    columns = np.column_stack((1 - rise, rise))
    return _SineSeries(
        dst((values - line)[1:-1], type=1, norm="ortho"),
        dst(columns, type=1, norm="ortho", axis=0),
        values[[0, -1]],
    )


def _filtered(series: _SineSeries, number: float) -> _Filtered:
    """The record filtered at the cut-off ``number`` k_c, the line's ends at the optimum for it."""
    count = len(series.sines) + 2
    gain = 1 / (1 + (np.arange(1, count - 1) / number) ** POWER)
    weight = 1 - gain
    # The end samples are measured too: raising the line there costs as much as their misfit.
    normal = series.lines.T @ (weight[:, None] * series.lines) + np.eye(2)
    shift = np.asarray(np.linalg.solve(normal, series.lines.T @ (weight * series.sines)), dtype=np.float64)
    sines = series.sines - series.lines @ shift
    squares = float(np.sum((weight * sines) ** 2) + shift @ shift)
    left = np.sum(weight)
    return _Filtered(gain, shift, sines, squares, squares / max(left, 1e-12) ** 2)


def _best_cut_off(series: _SineSeries) -> float:
    """The cut-off number by generalized cross-validation."""
    count = len(series.sines)

    def score(logarithm: float) -> float:
        return float(np.log(_filtered(series, np.exp(logarithm)).score + 1e-300))

    return _minimum(score, np.log(1.0), np.log(count), GRID, 1e-3)


def _minimum(score: Callable[[float], float], low: float, high: float, count: int, tolerance: float) -> float:
    """Exponential of the number between ``low`` and ``high`` with the least score: on a grid, then refined."""
    grid = np.linspace(low, high, count)
    best = int(np.argmin([score(each) for each in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, count - 1)]
    return float(np.exp(minimize_scalar(score, bounds=bounds, method="bounded", options={"xatol": tolerance}).x))


# --- smoothing spline ---------------------------------------------------------------------------------------

MIN_SPLINE = 8
SPLINE_GRID = 12
"""-; cut-offs tried before the best is refined"""


def smoothing_spline(time: Array, values: Array) -> Smoothed:
    """Smoothed ``values`` (N,) at increasing ``time`` (s; N,) by generalized cross-validation.

    On an even time base the gain is ``1 / (1 + (f / f_c)^4)``. NaN is a sample that was not measured; inside the
    record the spline bridges it, outside the result is NaN.

    Raises:
        InputError: fewer than eight samples, or time that does not increase.
    """
    good = np.isfinite(values)
    at, measured = time[good], values[good]
    if len(at) < MIN_SPLINE:
        raise InputError(f"a spline needs {MIN_SPLINE} measured samples, not {len(at)}")
    if np.any(np.diff(at) <= 0):
        raise InputError("time does not rise from sample to sample")
    step = float(np.median(np.diff(at)))
    places = (at - at[0]) / step
    cut_off_rad = _best_spline(places, measured)
    spline = make_smoothing_spline(places, measured, lam=cut_off_rad**-4)
    inside, curves = (time >= at[0]) & (time <= at[-1]), (spline, spline.derivative())
    smooth, rates = (np.where(inside, curve((time - at[0]) / step), np.nan) for curve in curves)
    freedom = max(len(at) - _degrees(places, cut_off_rad), 1.0)
    noise = float(np.sqrt(np.sum((measured - smooth[good]) ** 2) / freedom))
    return Smoothed(smooth, rates / step, noise)


def _degrees(places: Array, cut_off: float) -> float:
    """Trace of the hat matrix at a ``cut_off`` (rad per sample), by the natural frequencies of a free beam."""
    natural = np.pi * (np.arange(3, len(places) + 1) - 1.5) / (places[-1] - places[0])
    # The gain of even samples near half the sampling rate is that of a higher frequency, by sin(x) / x.
    sampled = 2 * np.sin(np.minimum(natural, np.pi) / 2)
    return 2 + float(np.sum(1 / (1 + (sampled / cut_off) ** 4)))


def _best_spline(places: Array, values: Array) -> float:
    """The cut-off (rad per sample) by generalized cross-validation.

    Without a grid, SciPy's own ends in a local minimum: 50 % more noise is left of a sine at 100 Hz.
    """

    def score(logarithm: float) -> float:
        cut_off = float(np.exp(logarithm))
        residuals = values - make_smoothing_spline(places, values, lam=cut_off**-4)(places)
        left = max(len(places) - _degrees(places, cut_off), 1e-9)
        return float(np.log(residuals @ residuals / left**2 + 1e-300))

    return _minimum(score, np.log(np.pi / (places[-1] - places[0])), np.log(0.7 * np.pi), SPLINE_GRID, 3e-2)


# --- Rauch-Tung-Striebel smoother ---------------------------------------------------------------------------

MIN_RTS, MIN_TUNED = 16, 64
"""-; samples; samples without a gap from which noise and cut-off are estimated"""
INITIAL_INFLATION = 10.0
"""-; of the initial standard errors, since the samples they come from are used again"""
ORDER = 3
"""-; states: value, rate, acceleration"""


def rts(values: Array, step: float) -> Smoothed:
    """Smoothed ``values`` (N,), ``step`` s apart; NaN is a sample that was not measured, and is bridged.

    On a long record the gain at a circular frequency w is ``1 / (1 + (w / w_c)^6)`` for a spectral density
    ``S = R dt w_c^6`` of the process noise. Noise variance R and cut-off are those of `fourier_smoothing` of the
    longest piece without a gap.

    Raises:
        InputError: too few samples, no piece of 64 samples without a gap, or no noise.
    """
    measured = int(np.sum(np.isfinite(values)))
    if measured < MIN_RTS:
        raise InputError(f"the smoother needs {MIN_RTS} measured samples, not {measured}")
    longest = values[longest_run(np.isfinite(values))]
    if len(longest) < MIN_TUNED:
        raise InputError(f"no {MIN_TUNED} samples without a gap to estimate the noise from")
    known = fourier_smoothing(longest, step)
    noise = known.smoothed.noise
    if not noise > 0:
        raise InputError("the signal has no noise, which the smoother needs for its weights")
    # In standard deviations and radians of the cut-off all states are of one size, which keeps the covariances exact.
    scaled_step = half_power(step, known.cut_off)
    first = values[np.isfinite(values)][0]
    scaled = (values - first) / noise
    kalman = _kalman_filter(scaled_step, scaled)
    readings = [value if np.isfinite(value) else None for value in scaled]
    states, covariances, _, _ = kalman.batch_filter(readings, update_first=True)
    count = len(values)
    smooth = rts_smoother(states, covariances, [kalman.F] * count, [kalman.Q] * count)[0]
    return Smoothed(first + noise * smooth[:, 0], noise * scaled_step / step * smooth[:, 1], noise)


def _kalman_filter(step: float, scaled: Array) -> KalmanFilter:
    """The filter before its first sample: a parabola through the first radian, with inflated errors.

    Infinite initial errors would leave rounding errors of the covariances only.
    """
    kalman = KalmanFilter(dim_x=ORDER, dim_z=1)
    kalman.F = np.array([[1.0, step, step**2 / 2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    kalman.H = np.eye(ORDER)[:1]
    kalman.R = np.eye(1)
    kalman.Q = Q_continuous_white_noise(ORDER, step, step)
    known = np.flatnonzero(np.isfinite(scaled))
    near = known[: max(int(np.searchsorted(known, known[0] + 1 / step)), 2 * ORDER)]
    powers = np.column_stack([np.ones(len(near)), near * step, (near * step) ** 2 / 2])
    covariance = np.linalg.inv(powers.T @ powers)
    kalman.x, kalman.P = covariance @ (powers.T @ scaled[near]), covariance * INITIAL_INFLATION**2
    return kalman


def stroke_smoothed(time: Array, values: Array, strokes: Array) -> Smoothed:
    """Moving average of ``values`` (N,) over one measured wing period around each sample, with its slope.

    ``strokes`` (N,) are counted at the same equally spaced ``time`` (s; N,) and never decrease. Within half a stroke
    of the record's ends all is NaN. ``noise`` is the standard deviation of what was averaged away: the shaking.

    Raises:
        InputError: the record holds no whole stroke, or samples are missing.
    """
    whole(values, 4)
    whole(strokes, 4)
    period = wing_period(time, strokes, time)
    inside = np.isfinite(period)
    if inside.sum() < 2:
        raise InputError(f"no stroke average: the record holds {strokes[-1] - strokes[0]:.1f} strokes")
    at, window = time[inside], period[inside]
    smooth, rates = np.full(len(time), np.nan), np.full(len(time), np.nan)
    smooth[inside] = stroke_average(time, values, window, at)
    ends = [np.interp(at + side * window / 2, time, values) for side in (-1, 1)]
    # Leibniz: both ends of the window move, and it widens.
    widening = np.gradient(window, at) * ((ends[0] + ends[1]) / 2 - smooth[inside])
    rates[inside] = (ends[1] - ends[0] + widening) / window
    return Smoothed(smooth, rates, float(np.std((values - smooth)[inside])))


# --- by name ------------------------------------------------------------------------------------------------


def _stroke(experiment: Experiment, values: Array) -> Smoothed:
    if STROKES not in experiment.signals:
        raise InputError(f"no signal {STROKES} to average over")
    return stroke_smoothed(experiment.time, values, experiment.signals[STROKES])


METHODS: Mapping[str, Callable[[Experiment, Array], Smoothed]] = {
    "local_quadratic": lambda experiment, values: local_quadratic(values, experiment.step),
    "fourier": lambda experiment, values: fourier_smoothing(values, experiment.step).smoothed,
    "spline": lambda experiment, values: smoothing_spline(experiment.time, values),
    "rts": lambda experiment, values: rts(values, experiment.step),
    "stroke": _stroke,
}
"""by name, each with its default bandwidth; ``spline`` and ``rts`` bridge gaps"""
