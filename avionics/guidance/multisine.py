"""Orthogonal multisines: sums of harmonics of one period, each harmonic on one channel alone.

Inputs without a common harmonic are orthogonal over the period, so they may be flown at once and told apart
(Morelli, "Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain", IFAC SYSID 2003). The
phases begin as Schroeder's (IEEE Trans. Inf. Theory 16, 1970) and are then improved by clipping the signal and
keeping the phases of what is left (van der Ouderaa et al., IEEE Trans. Instrum. Meas. 37, 1988), so that a given
power needs little travel. All of it is computed when an input is built, never in a tick.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Line = tuple[float, float, float]
"""frequency (rad/s), phase (rad), amplitude (of the channel) of one sine"""
Lines = tuple[Line, ...]

STARTS = (1.0, 0.5, 1.25, 0.75, 1.5, 0.9)
"""Schroeder's phases, and how much more or less curved ones: clipping stays near where it begins"""
ROUNDS = 200
"""clippings from each start; together some 12 ms"""
COARSE, FINE = 8, 32
"""samples per period of the highest harmonic: to improve the phases, and to measure the peak"""
DIGITS = 6
"""of a phase: far below what changes the peak, and the same on every machine"""

Array = NDArray[np.float64]


def channel_harmonics(first: int, last: int, channels: int) -> tuple[tuple[int, ...], ...]:
    """The harmonics ``first`` to ``last`` dealt out to the ``channels`` in turn, so that none is on two."""
    return tuple(tuple(range(first + channel, last + 1, channels)) for channel in range(channels))


def relative_peak_factor(signal: Array) -> float:
    """Range of a ``signal`` (N,) over that of a sine of the same power: 1 for a sine (Morelli 2003)."""
    rms = math.sqrt(float(np.mean(np.square(signal))))
    return float(np.ptp(signal)) / (2.0 * math.sqrt(2.0) * rms)


def design(harmonics: tuple[int, ...], period: float, amplitude: float) -> Lines:
    """Sines of equal power at ``harmonics`` of ``period`` (s) whose sum begins at zero and peaks at ``amplitude``."""
    phases, peak = _improved(harmonics)
    base = math.tau / period
    share = amplitude / peak
    return tuple((base * k, phase, share) for k, phase in zip(harmonics, phases, strict=True))


def value(lines: Lines, elapsed: float) -> float:
    """The sum of ``lines`` at ``elapsed`` s after the start."""
    total = 0.0
    for frequency, phase, amplitude in lines:
        total += amplitude * math.sin(frequency * elapsed + phase)
    return total


@lru_cache(maxsize=64)
def _improved(harmonics: tuple[int, ...]) -> tuple[tuple[float, ...], float]:
    """Phases (rad) of the harmonics as sines, and the peak of the sum of sines of amplitude 1."""
    numbers = np.array(harmonics)
    order = np.arange(1, len(harmonics) + 1)
    phases = -np.pi * np.outer(STARTS, order * (order - 1)) / len(harmonics)
    best, least = phases[0], math.inf
    for turn in range(ROUNDS):
        signals = _sums(numbers, phases, COARSE)
        peaks = np.max(np.abs(signals), axis=1)
        lowest = int(np.argmin(peaks))
        if peaks[lowest] < least:
            least, best = float(peaks[lowest]), phases[lowest]
        level = (peaks * (0.8 + 0.19 * turn / ROUNDS))[:, None]
        phases = np.angle(np.fft.rfft(np.clip(signals, -level, level))[:, numbers])
    signal = _sums(numbers, best[None, :], FINE)[0]
    return _starting_at_zero(numbers, best, signal), float(np.max(np.abs(signal)))


def _sums(numbers: NDArray[np.int64], phases: Array, oversampling: int) -> Array:
    """Sums of cosines (S, N) over one period, one row for each row of ``phases`` (S, harmonics)."""
    samples = 2 ** math.ceil(math.log2(oversampling * int(numbers[-1])))
    spectra = np.zeros((len(phases), samples // 2 + 1), dtype=np.complex128)
    spectra[:, numbers] = np.exp(1j * phases)
    signals: Array = np.fft.irfft(spectra, samples) * samples / 2.0
    return signals


def _starting_at_zero(numbers: NDArray[np.int64], phases: Array, signal: Array) -> tuple[float, ...]:
    """Phases of sines that sum to zero at the start: the same ``signal`` (N,), begun at a rise through zero."""
    rises = np.flatnonzero((signal <= 0.0) & (np.roll(signal, -1) > 0.0))
    low = math.tau * float(rises[0]) / len(signal)
    high = low + math.tau / len(signal)
    for _ in range(50):
        middle = 0.5 * (low + high)
        below = float(np.sum(np.cos(numbers * middle + phases))) <= 0.0
        low, high = (middle, high) if below else (low, middle)
    shifted = (numbers * low + phases + 0.5 * np.pi) % math.tau
    return tuple(round(float(phase), DIGITS) for phase in shifted)
