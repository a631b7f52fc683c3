"""Structural modes and excitation of a vehicle fitted to the vibration of a flight.

A bank of modes covers the spectrum above the rigid body's motion; their power is a nonnegative least-squares fit of
the power spectral densities (Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23). The part of the
power that is concentrated at one stroke phase becomes impacts, the rest buffeting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.signal import freqz

from logs.vibration.analysis import PHASE_BINS, Array, Spectrum, loudest_bin
from sim_bridge.sensors.low_pass import corner, low_pass
from sim_bridge.vehicles.vibration import ModeSpec, VibrationSpec
from wingbeat.errors import InputError

LOWEST = 20.0
"""Hz; lower end of the fit"""
HIGHEST = 1500.0
"""Hz; upper end of the fit, as of `ModeSpec.frequency`"""
MODE_RATIO = 1.2
"""-; frequency of a mode over the one below"""
DAMPING = 0.08
"""-; modes of the bank overlap at half power"""
JITTER = 0.005
"""strokes; standard deviation of an impact's phase: 1.4 ms of 262 ms on a measured 0.9 kg ornithopter"""
UPPER_REVERSAL = 0.25
"""strokes; from the upper reversal to the largest upward force, in the middle of the downstroke"""


class VibrationFit(NamedTuple):
    """Sections of a vehicle file."""

    spec: VibrationSpec
    modes: dict[str, ModeSpec]
    impact_share: Array
    """(6,); share of the power above 40 Hz in impacts"""


def fit(
    spectrum: Spectrum, reference_rate: float, bandwidths: tuple[float, float] = (0.0, 0.0), flow: float = 0.0
) -> VibrationFit:
    """Fit modes and excitation.

    Args:
        spectrum: of a part of a flight.
        reference_rate: rad/s; RMS flap rate in it.
        bandwidths: Hz; first-order low pass of gyroscopes and accelerometers of the simulated vehicle, 0 for none.
        flow: buffeting by the airspeed in that part, over that by the stroke.

    Raises:
        InputError: the samples are too slow.
    """
    nyquist = min(0.5 * spectrum.rate, HIGHEST)
    if nyquist < 1.5 * LOWEST:
        raise InputError(f"samples at {spectrum.rate:.4g} Hz are too slow to fit modes above {LOWEST:g} Hz")
    count = max(1, math.ceil(math.log(0.97 * nyquist / LOWEST) / math.log(MODE_RATIO)))
    centers = [*(LOWEST * MODE_RATIO ** (np.arange(count) + 0.5)), spectrum.ringing]
    used = (spectrum.frequency >= LOWEST) & (spectrum.frequency < 0.97 * nyquist)
    frequency, density = spectrum.frequency[used], spectrum.density[used]
    average = np.sinc(frequency / spectrum.rate) ** 2  # the IMU averages between samples
    gains = [average * _sensor_gain(frequency, bandwidth, spectrum.rate) for bandwidth in bandwidths]
    unit = np.column_stack([_unit_density(frequency, at) for at in centers])
    rotation = unit / (2.0 * np.pi * np.array(centers)) ** 2
    shapes = [density * gains[i][:, None] for i, density in enumerate((rotation, unit))]
    phases, share = _impacts(spectrum)
    power = np.empty((len(centers), 6))
    for axis in range(6):
        shape, measured = shapes[axis // 3], density[:, axis]
        power[-1, axis] = share[axis] * spectrum.broadband[axis] ** 2 / (shape[:, -1].sum() * np.ptp(frequency[:2]))
        smooth = np.convolve(np.pad(measured, 3, "edge"), np.full(7, 1.0 / 7.0), "valid")
        rest = measured - power[-1, axis] * shape[:, -1]
        power[:-1, axis] = nnls(shape[:, :-1] / smooth[:, None], rest / smooth)[0]
    modes = {f"mode_{round(at)}_hz": _mode(at, np.sqrt(power[i]), i) for i, at in enumerate(centers[:-1])}
    if phases:
        # Mean square of a decaying oscillation once a stroke: omega dv^2 / (4 zeta period).
        impact = _mode(spectrum.ringing, np.sqrt(power[-1]), 0)
        omega, period = 2.0 * math.pi * spectrum.ringing, 1.0 / spectrum.stroke_frequency
        kick = impact.buffet * math.sqrt(4.0 * DAMPING * period / omega)
        modes["impact"] = impact._replace(buffet=0.0, kick=round(kick, 6))
    modes = {name: mode._replace(buffet=round(mode.buffet / (1.0 + flow), 4)) for name, mode in modes.items()}
    # From one stroke to the next: a drift of the stroke rate is no scatter.
    scatter = float(np.std(np.diff(np.log(spectrum.by_stroke[:, 3:].mean(axis=1))))) / math.sqrt(2.0)
    spec = VibrationSpec(round(reference_rate, 3), phases, JITTER if phases else 0.0, round(scatter, 3))
    return VibrationFit(spec, {name: mode for name, mode in modes.items() if mode.buffet or mode.kick}, share)


def modeled_density(fit: VibrationFit, spectrum: Spectrum) -> Array:
    """Return the spectral density (f, 6) of fitted modes at the frequencies of a spectrum, averaged by the IMU."""
    frequency, period = spectrum.frequency, 1.0 / spectrum.stroke_frequency
    total = np.zeros((len(frequency), 6))
    for mode in fit.modes.values():
        omega = 2.0 * math.pi * mode.frequency
        square = mode.buffet**2 + omega * mode.kick**2 / (4.0 * mode.damping * period)
        shapes = np.array((*mode.rotation, *mode.translation)) ** 2 * square
        shapes[:3] /= omega**2
        total += _unit_density(frequency, mode.frequency)[:, None] * shapes
    averaged: Array = total * np.sinc(frequency / spectrum.rate)[:, None] ** 2
    return averaged


def _sensor_gain(frequency: Array, bandwidth: float, rate: float) -> Array:
    """Return the power gain of the low pass of a simulated sensor."""
    keep, before, now = low_pass(corner(bandwidth), 1.0 / rate)
    response = freqz((now, before), (1.0, -keep), frequency, fs=rate)[1]
    gain: Array = np.abs(response) ** 2
    return gain


def _unit_density(frequency: Array, center: float) -> Array:
    """Return the one-sided spectral density (f,) of a mode with an RMS acceleration of 1 m/s^2.

    Args:
        frequency: (f,) Hz.
        center: Hz; natural frequency.
    """

    def response(at: Array) -> Array:
        square = (at / center) ** 2
        density: Array = square / ((1.0 - square) ** 2 + (2.0 * DAMPING) ** 2 * square)
        return density

    # The integral over all frequencies is pi center / (4 damping).
    return response(frequency) * 4.0 * DAMPING / (np.pi * center)


def _impacts(spectrum: Spectrum) -> tuple[tuple[float, ...], Array]:
    """Return the phases of impacts from the upper reversal, and their share (6,) of the power above 40 Hz."""
    square = spectrum.by_phase**2
    peak, median = loudest_bin(spectrum.by_phase), np.median(square, axis=0)
    if not spectrum.impacts:
        return (), np.zeros(6)
    # The level follows an impact: it happens where its bin begins.
    phase = (peak / PHASE_BINS + UPPER_REVERSAL) % 1.0
    return (round(phase, 4),), np.maximum(1.0 - median / square.mean(axis=0), 0.0)


def _mode(center: float, rms: Array, number: int) -> ModeSpec:
    """Return a mode whose largest translation is 1, or whose largest rotation is 100 rad/m.

    Args:
        center: Hz.
        rms: (6,); RMS response of each axis by unit RMS modal acceleration, gyroscopes first.
        number: of the mode, which alternates the signs of its shape.
    """
    # A rotation of 100 rad/m weighs as much as a translation of 1, which keeps both in their ranges.
    size = float(max(rms[3:].max(), rms[:3].max() / 100.0)) or 1.0
    signs = np.array([1.0 if (number >> bit) & 1 else -1.0 for bit in range(6)])
    shape = signs * rms / size
    buffet = 0.0 if not rms.any() else size
    return ModeSpec(round(float(center), 2), DAMPING, _three(shape[3:]), _three(shape[:3]), round(buffet, 4))


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) + 0.0 for value in values)  # no negative zero
    return x, y, z
