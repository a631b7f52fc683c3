"""Linear equation error in the frequency domain (Grauer Eq. 20, 21; Klein & Morelli, 2006, ch. 7).

A finite Fourier transform F at chosen frequencies turns z = X theta into complex equations, whose least squares
are theta = [Re(X^H F^H F X)]^-1 Re(X^H F^H F z). Read from the right that is linear in the samples: the estimate is
that of instrumental variables whose instruments Re(F^H F X) are the regressors' parts in the band. So its errors are
those of the same recipe as in the time domain: frequencies closer than one over the record's length, or a band on
which the residuals are not white, promise nothing that the record does not hold.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import CZT

from logs.identification.estimators.regression.design import Design, Record
from logs.identification.results import Array
from wingbeat.errors import InputError

BAND_SHARE = 0.99
"""-; of each regressor's variance that the default band holds"""
EVEN = 1e-9


def default_frequencies(design: Design) -> Array:
    """Multiples of one over the longest record's length, Hz, up to where the regressors have had their variance."""
    longest = max(design.records, key=lambda record: len(record.used))
    count = len(longest.used)
    centred = longest.regressors - longest.regressors.mean(axis=0)
    power = np.abs(np.fft.rfft(centred, axis=0)[1 : (count + 1) // 2]) ** 2
    shares = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    last = int(np.max(np.argmax(shares >= BAND_SHARE, axis=0))) + 1
    least = min(2 * len(design.names), len(power))
    return np.asarray(np.arange(1, max(last, least) + 1) / (count * design.step))


def checked(frequencies: Array, design: Design) -> Array:
    """``frequencies`` (F,) in Hz, sorted.

    Raises:
        InputError: none, or one that is not between 0 and half the sampling rate.
    """
    sorted_ = np.unique(np.asarray(frequencies, dtype=np.float64))
    half = 0.5 / design.step
    if not len(sorted_) or not np.all(np.isfinite(sorted_)) or sorted_[0] <= 0 or sorted_[-1] >= half:
        raise InputError(f"frequencies must lie between 0 and half the sampling rate, {half:g} Hz")
    return sorted_


def transform(columns: Array, frequencies: Array, step: float) -> Array:
    """Finite Fourier transform (F, k) of ``columns`` (N, k) at ``frequencies`` (F,) in Hz; their unit times s.

    Sum over samples of x exp(-j 2 pi f t) dt, by the chirp z-transform where the frequencies are equally spaced.
    """
    count = len(columns)
    spacing = _spacing(frequencies)
    if spacing is None:
        kernel = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(count) * step))
        return np.asarray(kernel @ columns * step)
    turn = 2j * np.pi * step
    chirp = CZT(count, len(frequencies), np.exp(-turn * spacing), np.exp(turn * frequencies[0]))
    return np.asarray(chirp(columns, axis=0) * step)


def in_band(columns: Array, frequencies: Array, step: float) -> Array:
    """Re(F^H F x) (N, k) of ``columns`` (N, k): their parts at ``frequencies`` (F,) in Hz, back in time.

    Scaled so that a signal inside the band comes back as itself where the frequencies are one over the length apart.
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
    return float(gaps.mean()) if np.ptp(gaps) <= EVEN * frequencies[-1] else None


def bridged(design: Design, longest: int) -> Design:
    """``design`` with runs of at most ``longest`` unused samples interpolated, and unused ends cut off.

    Raises:
        InputError: a longer run of samples that were not measured.
    """
    return design._replace(records=tuple(_bridge(record, design.step, longest) for record in design.records))


def _bridge(record: Record, step: float, longest: int) -> Record:
    there = np.flatnonzero(record.used > 0)
    if not len(there):
        raise InputError(f"{record.name}: not one sample has all signals of the regression")
    whole = slice(int(there[0]), int(there[-1]) + 1)
    gaps = np.diff(there) - 1
    if gaps.max(initial=0) > longest:
        start = there[int(np.argmax(gaps))] + 1
        raise InputError(
            f"{record.name}: {int(gaps.max())} samples in a row from {start * step:.3g} s after its start lack"
            f" a signal; the frequency domain bridges {longest} at most: cut the record there or use the time domain"
        )
    places = np.arange(whole.start, whole.stop)
    columns = [np.interp(places, there, column[there]) for column in record.regressors.T]
    response = np.interp(places, there, record.response[there])
    table = np.column_stack(columns) if columns else np.zeros((len(places), 0))
    return Record(record.name, table, response, np.ones(len(places)), int(record.start + whole.start))
