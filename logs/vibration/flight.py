"""Vibration of a recorded flight: which part is analyzed, the comparison with its quietest part, and advice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.reader import Log
from logs.vibration.analysis import AXES, RIGID_BODY, Array, Spectrum, analyze, high_pass
from wingbeat.errors import InputError

IMU_TOPIC, WING_TOPIC, AIR_TOPIC = "/sensors/imu", "/main/wing", "/main/air_data"
BLOCK = 2.0
"""s; parts that are compared"""
LONGEST = 12.0
"""s; of the analyzed part"""
STRONG = 0.5
"""-; share of the largest vertical acceleration at which the wings beat"""
CLIPPING, LEVEL, QUIET = 0.0, 5.0, 0.5
"""share of samples, m/s^2 RMS above 40 Hz of all axes together; limits of the advice, the last of that on a mount"""
MOUNT_STROKES, MOUNT_DAMPING, WORTHWHILE = 4.0, 0.2, 0.7
"""strokes per period of the softest mount; its damping ratio; share that a mount which helps leaves at most"""
LEVEL_TIME = 0.25
"""s; over which the square of the flap rate is averaged"""


Mask = NDArray[np.bool_]


class Advice(NamedTuple):
    """What to do about the vibration."""

    code: str
    severity: str
    """warning or info"""
    value: float
    text: str


class FlightVibration(NamedTuple):
    """Vibration of a flight."""

    start: float
    """s since boot"""
    end: float
    """s since boot"""
    spectrum: Spectrum
    quiet_start: float
    """s since boot; of the quietest two seconds"""
    quiet: Array
    """(6,); RMS above 40 Hz in the quietest two seconds"""
    flap_rate: float
    """rad/s; of a steady stroke with the mean squared level, which goes with the square of the flap rate; NaN without
    a wing angle"""
    airspeed: float
    """m/s; RMS true airspeed, NaN without one"""
    advice: tuple[Advice, ...]


def flight_vibration(log: Log, start: float | None = None, end: float | None = None) -> FlightVibration:
    """Analyze the longest part of a log with beating wings, or the part between two times.

    Args:
        log: with ``/sensors/imu``.
        start, end: s since boot.

    Raises:
        InputError: no IMU, or no part with at least eight strokes.
    """
    if IMU_TOPIC not in log.topics:
        raise InputError(f"{log.path}: no {IMU_TOPIC}")
    columns = log.columns(IMU_TOPIC)
    time, imu = columns.time, np.column_stack([columns[name] for name in AXES])
    finite = np.isfinite(imu).all(axis=1)
    time, imu = time[finite], imu[finite]
    if len(time) < 100 and len(finite) >= 100:
        missing = [name for name in AXES if not np.isfinite(columns[name]).any()]
        raise InputError(f"{log.path}: {IMU_TOPIC} has no {', '.join(missing) or 'samples of all axes together'}")
    if len(time) < 100:
        raise InputError(f"{log.path}: {len(time)} samples of the IMU are too few")
    high = high_pass(imu, float(np.median(np.diff(time))))
    if start is not None and end is not None and end <= start:
        raise InputError(f"the end, {end:g} s, is not after the start, {start:g} s")
    chosen = _part(time, imu[:, 5], start, end)
    if not chosen.any():
        raise InputError(f"{log.path}: no samples in this part: the IMU covers {time[0]:.1f} to {time[-1]:.1f} s")
    spectrum = analyze(time[chosen], imu[chosen])
    blocks = np.floor((time - time[0]) / BLOCK).astype(int)
    places = [i for i in range(blocks[-1] + 1) if np.count_nonzero(blocks == i) > 10]
    levels = np.array([high[blocks == i].std(axis=0) for i in places])
    row = int(levels[:, 3:].sum(axis=1).argmin())
    quietest = places[row]
    first, last = float(time[chosen][0]), float(time[chosen][-1])
    return FlightVibration(
        first, last, spectrum, float(time[0] + BLOCK * quietest), levels[row], _flap_rate(log, first, last),
        _airspeed(log, first, last), _advice(spectrum),
    )  # fmt: skip


def _part(time: Array, vertical: Array, start: float | None, end: float | None) -> Mask:
    """Return the samples to be analyzed."""
    if start is not None or end is not None:
        between: Mask = time >= (-math.inf if start is None else start)
        return between & (time <= (math.inf if end is None else end))
    blocks = np.floor((time - time[0]) / BLOCK).astype(int)
    level = np.array([vertical[blocks == i].std() if (blocks == i).any() else 0.0 for i in range(blocks[-1] + 1)])
    strong = level >= STRONG * np.percentile(level, 90)
    runs = np.flatnonzero(np.diff(np.concatenate(([0], strong.astype(int), [0]))))
    begin, stop = max(zip(runs[::2], runs[1::2], strict=True), key=lambda run: run[1] - run[0])
    middle, half = 0.5 * (begin + stop) * BLOCK, 0.5 * min(LONGEST, (stop - begin) * BLOCK)
    inside: Mask = (time - time[0] >= middle - half) & (time - time[0] < middle + half)
    return inside


def _flap_rate(log: Log, start: float, end: float) -> float:
    if WING_TOPIC not in log.topics:
        return math.nan
    wing = log.columns(WING_TOPIC)
    inside = (wing.time >= start) & (wing.time <= end)
    rate = 0.5 * (wing["rate_left"] + wing["rate_right"])[inside]
    if len(rate) < 2:
        return math.nan
    length = max(1, round(LEVEL_TIME * (len(rate) - 1) / float(np.ptp(wing.time[inside]))))
    level = np.convolve(rate**2, np.full(length, 1.0 / length), "valid")
    return float(np.mean(level**2) ** 0.25) if len(level) else math.nan


def _airspeed(log: Log, start: float, end: float) -> float:
    if AIR_TOPIC not in log.topics:
        return math.nan
    air = log.columns(AIR_TOPIC)
    speed = air["airspeed"][(air.time >= start) & (air.time <= end)]
    speed = speed[np.isfinite(speed)]
    return float(np.sqrt(np.mean(speed**2))) if len(speed) else math.nan


def _advice(spectrum: Spectrum) -> tuple[Advice, ...]:
    """Return findings on clipping, level and isolation."""
    found = []
    clipped = float(spectrum.clipped.max())
    if clipped > CLIPPING:
        axis = AXES[3 + int(spectrum.clipped.argmax())]
        text = f"{axis} is at its range in {100.0 * clipped:.1f} % of the samples: use a larger range or a soft mount"
        found.append(Advice("clipping", "warning", clipped, text))
    level = float(np.linalg.norm(spectrum.broadband[3:]))
    if level > LEVEL:
        text = f"{level:.1f} m/s^2 RMS above 40 Hz: mount the IMU softly, balance the drive, close its backlash"
        found.append(Advice("vibration", "warning", level, text))
    if level > QUIET:
        found.append(mount_advice(spectrum))
    return tuple(found)


def mount_advice(spectrum: Spectrum) -> Advice:
    """Return the natural frequency of the soft mount that leaves least of the accelerations above 20 Hz.

    Transmissibility of a spring and damper, see Rao, Mechanical Vibrations, section 9.10.
    """
    fast = spectrum.frequency >= RIGID_BODY
    frequency, power = spectrum.frequency[fast], spectrum.density[fast, 3:].sum(axis=1)
    mounts = np.linspace(MOUNT_STROKES * spectrum.stroke_frequency, float(frequency[-1]), 100)
    ratio = frequency / mounts[:, None]
    damped = (2.0 * MOUNT_DAMPING * ratio) ** 2
    left = np.sqrt(((1.0 + damped) / ((1.0 - ratio**2) ** 2 + damped)) @ power / power.sum())
    best = int(left.argmin())
    mount, share = float(mounts[best]), float(left[best])
    if share > WORTHWHILE:
        text = "a soft mount does not help: the vibration is too near the stroke"
        return Advice("isolation", "info", math.nan, text)
    text = f"a soft mount at {mount:.0f} Hz leaves {100.0 * share:.0f} % of the accelerations above 20 Hz"
    return Advice("isolation", "info", mount, text)
