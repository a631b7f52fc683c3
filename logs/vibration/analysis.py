"""Spectrum, stroke harmonics, level by stroke phase and clipping of an IMU in flapping flight.

Axes FRD, gyroscopes in rad/s, accelerometers in m/s^2. The stroke phase counts from the largest upward specific
force, in the middle of the downstroke.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt, welch

from logs.spectral_line import strongest_line
from wingbeat.errors import InputError

Array = NDArray[np.float64]
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
UNITS = ("rad/s",) * 3 + ("m/s^2",) * 3
HARMONICS = 10
"""stroke harmonics that are reported"""
RIGID_BODY = 20.0
"""Hz; stroke harmonics below it count as motion of the rigid body"""
BROADBAND = 40.0
"""Hz; lower end of the broadband level"""
PHASE_BINS = 16
SEGMENT = 256
"""samples of a Welch segment"""
LEAST_STROKES = 8
LEAST_STROKE = 0.5
"""m/s^2; amplitude of the stroke in the vertical specific force; that of wings that carry is about 10"""
IMPACT = 4.0
"""-; mean square at one stroke phase over the median, at which it is an impact"""
FREQUENCIES = (0.8, 40.0)
"""Hz; of a stroke"""
CLIPPED = 8
"""samples at the largest value"""
PILED, FAR = 0.6, 20
"""share of the samples near the largest value that are exactly there; its distance from the median in steps"""
RINGING = 0.14
"""strokes; time after an impact in which it rings"""
BAND_EDGES = (0.0, 10.0, 20.0, 40.0, 70.0, 100.0, 200.0, 400.0, 800.0, 1600.0)
"""Hz"""


class Spectrum(NamedTuple):
    """Vibration of one part of a flight."""

    rate: float
    """Hz; samples"""
    strokes: float
    """number of strokes"""
    stroke_frequency: float
    """Hz; mean"""
    harmonics: Array
    """(10, 6); amplitude of each harmonic of the stroke"""
    frequency: Array
    """(f,) Hz"""
    density: Array
    """(f, 6) unit^2/Hz, one-sided; without the mean and the harmonics below 20 Hz"""
    bands: tuple[tuple[float, float], ...]
    """Hz"""
    band_rms: Array
    """(b, 6); of `density`"""
    broadband: Array
    """(6,); RMS above 40 Hz"""
    by_phase: Array
    """(16, 6); RMS above 40 Hz by stroke phase"""
    by_stroke: Array
    """(s, 6); RMS above 40 Hz of each stroke"""
    ringing: float
    """Hz; largest line above 40 Hz, after impacts if there are any"""
    impacts: bool
    """whether the level at one stroke phase is that of impacts"""
    clipped: Array
    """(3,); share of samples with each accelerometer at its largest value"""


def analyze(time: Array, imu: Array) -> Spectrum:
    """Analyze a part of a flight with beating wings.

    Args:
        time: (n,) s.
        imu: (n, 6); see `AXES`.

    Raises:
        InputError: fewer than eight strokes, or no stroke of wings that carry is in the vertical acceleration.
    """
    even, signals = _evenly(time, imu)
    step = float(even[1])
    phase = stroke_phase(even, signals[:, 5])
    strokes = float(phase[-1] - phase[0])
    if strokes < LEAST_STROKES:
        raise InputError(f"{strokes:.1f} strokes are too few for a spectrum: at least {LEAST_STROKES}")
    stroke_frequency = strokes / float(even[-1])
    harmonics = _harmonics(signals, phase, HARMONICS)[1]
    amplitude = float(harmonics[:2, 5].max())
    if amplitude < LEAST_STROKE:
        raise InputError(
            f"no stroke in the vertical acceleration (its strongest line, {stroke_frequency:.3g} Hz, has "
            f"{amplitude:.2g} m/s^2): is this a part with beating wings?"
        )
    residual = signals - _harmonics(signals, phase, max(1, int(RIGID_BODY / stroke_frequency)))[0]
    frequency, density = welch(residual, 1.0 / step, "hann", min(SEGMENT, len(even)), axis=0)
    bands = _bands(0.5 / step)
    spacing = frequency[1] - frequency[0]
    band_rms = [
        np.sqrt(density[(frequency >= low) & (frequency < high)].sum(axis=0) * spacing) for low, high in bands
    ]
    high = high_pass(signals, step)
    by_phase = _rms_by(np.floor(phase % 1.0 * PHASE_BINS).astype(int), PHASE_BINS, high)
    impacts = has_impacts(by_phase)
    fast = np.where(frequency[:, None] >= broadband_corner(step), density, 0.0) / high.var(axis=0)
    return Spectrum(
        rate=1.0 / step,
        strokes=strokes,
        stroke_frequency=stroke_frequency,
        harmonics=harmonics,
        frequency=frequency,
        density=density,
        bands=bands,
        band_rms=np.array(band_rms),
        broadband=high.std(axis=0),
        by_phase=by_phase,
        by_stroke=_rms_by(np.floor(phase - phase[0]).astype(int), int(strokes), high),
        ringing=_ringing(high, phase, loudest_bin(by_phase) / PHASE_BINS, step)
        if impacts
        else float(frequency[fast.sum(axis=1).argmax()]),
        impacts=impacts,
        clipped=clipped_share(imu[:, 3:]),
    )


def _evenly(time: Array, imu: Array) -> tuple[Array, Array]:
    """Return times from 0 and samples at equal steps.

    Interpolation acts as a low-pass filter, so that samples without a gap are taken as they are, whatever the jitter
    of their time stamps.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if np.abs(time - time[0] - step * np.arange(len(time))).max() < step:
        return np.linspace(0.0, time[-1] - time[0], len(time)), imu
    step = float(np.median(np.diff(time)))
    even: Array = step * np.arange(int((time[-1] - time[0]) / step) + 1, dtype=np.float64)
    return even, np.column_stack([np.interp(even, time - time[0], column) for column in imu.T])


def stroke_phase(time: Array, vertical: Array) -> Array:
    """Return the stroke phase in strokes from a vertical specific force.

    A frequency and a cubic polynomial in time maximize the power of the first two harmonics.

    Args:
        time: (n,) s, evenly spaced.
        vertical: (n,) m/s^2; down is positive.

    Raises:
        InputError: no line in the spectrum between 0.8 and 40 Hz.
    """
    step, force = float(time[1] - time[0]), vertical - vertical.mean()
    first = strongest_line(vertical, step, FREQUENCIES, highest=0.45).frequency
    if first == 0.0:
        raise InputError("no stroke in the vertical acceleration: is this a part with beating wings?")
    phase = first * time
    length = min(max(1, round(2.0 / first / step)), (len(time) - 1) // 2)
    for _ in range(3):
        carrier = force * np.exp(-2j * np.pi * phase)
        smooth = np.convolve(carrier, np.hanning(2 * length + 1), "same")
        drift = np.unwrap(np.angle(smooth)) / (2.0 * np.pi)
        inside = slice(length // 2, len(time) - length // 2) if len(time) > 2 * length else slice(None)
        phase = phase + np.polyval(np.polyfit(time[inside], drift[inside], 3), time)
    # The fundamental's phase is now constant; zero is its minimum, the largest upward force.
    angle = np.angle((force * np.exp(-2j * np.pi * phase)).sum()) / (2.0 * np.pi)
    result: Array = phase + angle + 0.5
    return result


def clipped(values: Array) -> NDArray[np.int64]:
    """Return the samples of a signal (n,) that are at the range of its sensor.

    A clipped signal has many samples at exactly its largest or smallest value, and few beside it.
    """
    found: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
    steps = np.diff(np.unique(values))
    resolution = float(steps[steps > 1e-9].min(initial=np.inf))
    for limit in (float(values.max()), float(values.min())):
        at = np.flatnonzero(np.isclose(values, limit, rtol=1e-7, atol=1e-9))
        near = np.count_nonzero(np.abs(values - limit) < 0.02 * abs(limit))
        distance = abs(limit - float(np.median(values)))
        if len(at) >= CLIPPED and len(at) >= PILED * near and distance > max(0.5 * values.std(), FAR * resolution):
            found.append(at)
    return np.sort(np.concatenate(found))


def clipped_share(accelerometers: Array) -> Array:
    """Return the share of samples at the range of each accelerometer (n, 3)."""
    return np.array([len(clipped(column)) / len(column) for column in accelerometers.T])


def _harmonics(signals: Array, phase: Array, count: int) -> tuple[Array, Array]:
    """Return mean and harmonics of the stroke (n, 6), and the amplitude of each harmonic (count, 6)."""
    angles = 2.0 * np.pi * np.outer(phase, np.arange(1, count + 1))
    basis = np.column_stack([np.ones(len(phase)), np.cos(angles), np.sin(angles)])
    solution = np.linalg.lstsq(basis, signals, rcond=None)[0]
    return basis @ solution, np.hypot(solution[1 : count + 1], solution[count + 1 :])


def loudest_bin(by_phase: Array) -> int:
    """Return the phase bin with the largest mean square, every axis over its median."""
    return int((by_phase**2 / np.median(by_phase**2, axis=0)).mean(axis=1).argmax())


def has_impacts(by_phase: Array) -> bool:
    """Return whether one phase bin has the level of impacts."""
    square = by_phase**2
    return bool((square[loudest_bin(by_phase)] / np.median(square, axis=0)).mean() >= IMPACT)


def _ringing(high: Array, phase: Array, start: float, step: float) -> float:
    """Return the frequency in Hz with most power after a phase, beyond that of the whole stroke."""
    inside = (phase - start) % 1.0 < RINGING
    begins = np.flatnonzero(inside & ~np.roll(inside, 1))
    length = int(inside.sum() / max(1, len(begins)))
    scaled = high / high.std(axis=0)
    if length < 2 or not any(begin + length <= len(high) for begin in begins):
        return 0.25 / step  # too slow to see it

    def power(starts: Iterable[int]) -> Array:
        windows = [scaled[i : i + length] for i in starts if i + length <= len(high)]
        density: Array = np.mean([np.abs(np.fft.rfft(one, 1024, axis=0)) ** 2 for one in windows], axis=0).sum(axis=1)
        return density

    excess = power(begins) - power(range(0, len(high), length))
    return float(np.fft.rfftfreq(1024, step)[excess.argmax()])


def _bands(nyquist: float) -> tuple[tuple[float, float], ...]:
    edges = [edge for edge in BAND_EDGES if edge < 0.95 * nyquist]
    return tuple(zip(edges, [*edges[1:], nyquist], strict=True))


def broadband_corner(step: float) -> float:
    """Return the lower end of the broadband level: 40 Hz, or half the Nyquist frequency of a slower sensor."""
    return min(BROADBAND, 0.25 / step)


def high_pass(signals: Array, step: float) -> Array:
    """Return the part above `broadband_corner`."""
    filtered: Array = sosfiltfilt(
        butter(4, broadband_corner(step), "high", fs=1.0 / step, output="sos"), signals, axis=0
    )
    return filtered


def _rms_by(index: NDArray[np.int64], count: int, high: Array) -> Array:
    """Return the RMS (count, 6) of the samples of each index."""
    sums = np.column_stack([np.bincount(index, column**2, count)[:count] for column in high.T])
    counts = np.bincount(index, minlength=count)[:count]
    filled = np.flatnonzero(counts)
    # A stroke that takes a whole number of samples leaves phases without any.
    means = sums[filled] / counts[filled, None]
    every = np.arange(count)
    rms: Array = np.sqrt(np.column_stack([np.interp(every, filled, column) for column in means.T]))
    return rms
