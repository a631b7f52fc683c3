"""Global Fourier smoothing: a sine series of the whole record, cut off where noise takes over.

Morelli, Estimating Noise Characteristics from Flight Test Data Using Optimal Fourier Smoothing, J. Aircraft 32(4),
1995; Klein & Morelli, Aircraft System Identification, 2006, chapter 11. The line between the record's ends is
taken off and the rest continued as an odd function, so that the sine coefficients of a smooth signal fall with the
cube of their number while those of white noise stay level. The Wiener filter of these two spectra is
1 / (1 + (k / k_c)^6), where k_c is the number at which they cross.

Two things are not left to the eye. Where the spectra cross is chosen by generalised cross-validation (Golub, Heath &
Wahba, Technometrics 21(2), 1979), since a signal such as a doublet's response has a peak in its spectrum. And the
ends of the line are estimated with the series, by least squares weighted with the spectra: through the two noisy end
samples it would put a jump into the odd continuation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.fft import dct, dst
from scipy.optimize import minimize_scalar

from logs.identification.data.smoothed import Smoothed, half_power, whole
from logs.identification.results import Array

LEAST = 16
GRID = 60
"""-; cut-offs tried before the best is refined"""
POWER = 6
"""-; of the ratio of the modelled spectra: a smooth signal's coefficients fall with the cube"""


class FourierSmoothed(NamedTuple):
    """A smoothed signal and the cut-off that was found."""

    smoothed: Smoothed
    cut_off: float
    """Hz; where the modelled spectra of signal and noise cross"""


class _Series(NamedTuple):
    """A record as ends and sine coefficients, before any filter."""

    sines: Array
    """(N - 2,); of the record less the line through its ends, orthonormal"""
    lines: Array
    """(N - 2, 2); coefficients of what raising either end of the line by one takes off"""
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
    """of generalised cross-validation"""


def fourier_smoothing(values: Array, step: float, cut_off: float | None = None) -> FourierSmoothed:
    """Smoothed ``values`` (N,), ``step`` s apart; the ``cut_off`` (Hz) is found where none is given.

    Raises:
        InputError: too few samples, some are missing, or the cut-off is not below half the sampling rate.
    """
    series = _series(whole(values, LEAST))
    count = len(values)
    number = _best(series) if cut_off is None else half_power(step, cut_off) * (count - 1) / np.pi
    found = _filtered(series, number)
    kept = np.concatenate(([0.0], found.sines * found.gain, [0.0]))
    ends = series.ends + found.shift
    line = np.linspace(ends[0], ends[1], count)
    duration = step * (count - 1)
    scale = np.sqrt(2 / (count - 1))
    wave = np.zeros(count)
    wave[1:-1] = dst(kept[1:-1], type=1, norm="ortho")
    slopes = kept * np.arange(count) * np.pi / duration * scale
    rates = (ends[1] - ends[0]) / duration + dct(slopes, type=1) / 2
    noise = float(np.sqrt(found.squares / max(count - 2 - float(np.sum(found.gain)), 1.0)))
    return FourierSmoothed(Smoothed(line + wave, rates, noise), number / (2 * duration))


def _series(values: Array) -> _Series:
    count = len(values)
    line = np.linspace(values[0], values[-1], count)
    rise = np.linspace(0.0, 1.0, count)[1:-1]
    columns = np.column_stack((1 - rise, rise))
    return _Series(
        dst((values - line)[1:-1], type=1, norm="ortho"),
        dst(columns, type=1, norm="ortho", axis=0),
        values[[0, -1]],
    )


def _filtered(series: _Series, number: float) -> _Filtered:
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


def _best(series: _Series) -> float:
    """The cut-off number by generalised cross-validation."""
    count = len(series.sines)

    def score(logarithm: float) -> float:
        return float(np.log(_filtered(series, np.exp(logarithm)).score + 1e-300))

    grid = np.linspace(np.log(1.0), np.log(count), GRID)
    scores = [score(each) for each in grid]
    middle = int(np.argmin(scores))
    low, high = grid[max(middle - 1, 0)], grid[min(middle + 1, GRID - 1)]
    return float(np.exp(minimize_scalar(score, bounds=(low, high), method="bounded", options={"xatol": 1e-3}).x))
