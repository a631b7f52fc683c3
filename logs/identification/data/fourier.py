"""Finite Fourier transforms at chosen frequencies (Klein & Morelli, Aircraft System Identification, 2006, ch. 9)."""

from __future__ import annotations

import numpy as np
from scipy.signal import CZT

from logs.identification.results import Array
from wingbeat.errors import InputError

EQUAL = 1e-9
"""-; largest difference between spacings of equally spaced frequencies, relative to the highest"""


def check_frequencies(frequencies: Array, step: float) -> Array:
    """``frequencies`` (F,) in Hz, sorted.

    Raises:
        InputError: none, or one that is not between 0 and half the sampling rate.
    """
    ordered = np.unique(np.asarray(frequencies, dtype=np.float64))
    half = 0.5 / step
    if not len(ordered) or not np.all(np.isfinite(ordered)) or ordered[0] <= 0 or ordered[-1] >= half:
        raise InputError(f"frequencies must lie between 0 and half the sampling rate, {half:g} Hz")
    return ordered


def transform(columns: Array, frequencies: Array, step: float) -> Array:
    """Finite Fourier transform (F, k) of ``columns`` (N, k) at ``frequencies`` (F,) in Hz; their unit times s.

    Sum over samples of x exp(-j 2 pi f t) dt, by the chirp z-transform if the frequencies are equally spaced.
    """
    count, spacing = len(columns), _spacing(frequencies)
    if spacing is None:
        kernel = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(count) * step))
        return np.asarray(kernel @ columns * step)
    turn = 2j * np.pi * step
    chirp = CZT(count, len(frequencies), np.exp(-turn * spacing), np.exp(turn * frequencies[0]))
    return np.asarray(chirp(columns, axis=0) * step)


def in_band(columns: Array, frequencies: Array, step: float) -> Array:
    """Re(F^H F x) (N, k): the parts of ``columns`` (N, k) at ``frequencies`` (F,) in Hz, in the time domain.

    Scaled so that a signal inside the band is unchanged if the frequencies are one over the length apart.
    """
    count, spacing = len(columns), _spacing(frequencies)
    spectrum = transform(columns, frequencies, step)
    weight = 2.0 / (count * step)
    if spacing is None:
        kernel = np.exp(2j * np.pi * np.outer(np.arange(count) * step, frequencies))
        return np.asarray((kernel @ spectrum).real * weight)
    turn = 2j * np.pi * step
    chirp = CZT(len(frequencies), count, np.exp(turn * spacing))
    shift = np.exp(turn * frequencies[0] * np.arange(count))
    return np.asarray((chirp(spectrum, axis=0) * shift[:, None]).real * weight)


def _spacing(frequencies: Array) -> float | None:
    """Distance in Hz of equally spaced frequencies, None for others."""
    if len(frequencies) < 2:
        return None
    gaps = np.diff(frequencies)
    return float(gaps.mean()) if np.ptp(gaps) <= EQUAL * frequencies[-1] else None
