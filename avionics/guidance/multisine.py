"""Orthogonal multisines: sums of harmonics of one period, disjoint by channel.

Inputs without a common harmonic are orthogonal over the period, so that their responses can be separated after
simultaneous excitation (Morelli, "Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain",
IFAC SYSID 2003). The initial phases are those of Schroeder (IEEE Trans. Inf. Theory 16, 1970). Repeated clipping of
the signal improves them (van der Ouderaa et al., IEEE Trans. Instrum. Meas. 37, 1988), so that a given power requires
a small peak amplitude. The computation runs when an input is built, never in a tick.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Line = tuple[float, float, float]
"""frequency (rad/s), phase (rad), amplitude (of the channel) of one sine"""
Lines = tuple[Line, ...]

STARTS = (1.0, 0.5, 1.25, 0.75, 1.5, 0.9)
"""factors on the curvature of the Schroeder phases: the clipping method converges near its initial phases"""
ROUNDS: Final = 200
"""iterations of the clipping method for each start; about 12 ms in total"""
COARSE, FINE = 8, 32
"""samples per period of the highest harmonic, for the phase iteration and for the peak"""
DIGITS: Final = 6
"""decimal digits of a phase: no effect on the peak, and identical on every machine"""

Array = NDArray[np.float64]


def channel_harmonics(first: int, last: int, channels: int) -> tuple[tuple[int, ...], ...]:
    """Distribute the harmonics ``first`` to ``last`` alternately over ``channels``."""
    return tuple(tuple(range(first + channel, last + 1, channels)) for channel in range(channels))


def relative_peak_factor(signal: Array) -> float:
    """Return the range of ``signal`` (N,) relative to a sine of the same power.

    The relative peak factor of a sine is 1 (Morelli 2003).
    """
    rms = math.sqrt(float(np.mean(np.square(signal))))
    return float(np.ptp(signal)) / (2.0 * math.sqrt(2.0) * rms)


def design(harmonics: tuple[int, ...], period: float, amplitude: float) -> Lines:
    """Return sines of equal power at ``harmonics`` of ``period`` (s).

    Their sum begins at zero and its peak is ``amplitude``.
    """
    phases, peak = _improved(harmonics)
    base = math.tau / period
    share = amplitude / peak
    return tuple((base * k, phase, share) for k, phase in zip(harmonics, phases, strict=True))


def value(lines: Lines, elapsed: float) -> float:
    """Return the sum of ``lines`` at ``elapsed`` s after the start."""
    total = 0.0
    for frequency, phase, amplitude in lines:
        total += amplitude * math.sin(frequency * elapsed + phase)
    return total


@lru_cache(maxsize=64)
def _improved(harmonics: tuple[int, ...]) -> tuple[tuple[float, ...], float]:
    """Return optimized phases (rad) of unit sines and the peak of their sum."""
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
    """Return sums of cosines (S, N) over one period.

    Each row belongs to a row of ``phases`` (S, harmonics).
    """
    samples = 2 ** math.ceil(math.log2(oversampling * int(numbers[-1])))
    spectra = np.zeros((len(phases), samples // 2 + 1), dtype=np.complex128)
    spectra[:, numbers] = np.exp(1j * phases)
    signals: Array = np.fft.irfft(spectra, samples) * samples / 2.0
    return signals


def _starting_at_zero(numbers: NDArray[np.int64], phases: Array, signal: Array) -> tuple[float, ...]:
    """Return phases of sines that sum to zero at the start.

    The ``signal`` (N,) is shifted to start at a rising zero crossing.
    """
    rises = np.flatnonzero((signal <= 0.0) & (np.roll(signal, -1) > 0.0))
    low = math.tau * float(rises[0]) / len(signal)
    high = low + math.tau / len(signal)
    for _ in range(50):
        middle = 0.5 * (low + high)
        below = float(np.sum(np.cos(numbers * middle + phases))) <= 0.0
        low, high = (middle, high) if below else (low, middle)
    shifted = (numbers * low + phases + 0.5 * np.pi) % math.tau
    return tuple(round(float(phase), DIGITS) for phase in shifted)
