"""Vibration of a recorded flight: which part is analyzed, the comparison with its quietest part, and advice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.reader import Log
from logs.vibration.analysis import AXES, Array, Spectrum, analyze, high_pass
from wingbeat.errors import InputError

IMU_TOPIC, WING_TOPIC = "/sensors/imu", "/main/wing"
BLOCK = 2.0
"""s; parts that are compared"""
LONGEST = 12.0
"""s; of the analyzed part"""
STRONG = 0.5
"""-; share of the largest vertical acceleration at which the wings beat"""
CLIPPING, LEVEL = 0.0, 5.0
"""share of samples, m/s^2 RMS above 40 Hz; limits of the advice"""


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
    """rad/s; RMS of the measured flap rate, NaN without a wing angle"""
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
    if len(time) < 100:
        raise InputError(f"{log.path}: {len(time)} samples of the IMU are too few")
    high = high_pass(imu, float(np.median(np.diff(time))))
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
        _advice(spectrum),
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
    return float(np.sqrt(np.mean(rate**2))) if len(rate) else math.nan


def _advice(spectrum: Spectrum) -> tuple[Advice, ...]:
    """Return findings on clipping, level and isolation."""
    found = []
    clipped = float(spectrum.clipped.max())
    if clipped > CLIPPING:
        axis = AXES[3 + int(spectrum.clipped.argmax())]
        text = f"{axis} is at its range in {100.0 * clipped:.1f} % of the samples: use a larger range or a soft mount"
        found.append(Advice("clipping", "warning", clipped, text))
    level = float(spectrum.broadband[3:].max())
    if level > LEVEL:
        text = f"{level:.1f} m/s^2 RMS above 40 Hz: mount the IMU softly, balance the drive, close its backlash"
        found.append(Advice("vibration", "warning", level, text))
    # Half of the ringing frequency attenuates it by 3; four times the stroke leaves its motion as it is.
    mount = max(0.5 * spectrum.ringing, 4.0 * spectrum.stroke_frequency)
    gain = 1.0 / abs((spectrum.ringing / mount) ** 2 - 1.0)
    text = f"a soft mount at {mount:.0f} Hz leaves {gain:.2f} of the ringing at {spectrum.ringing:.0f} Hz"
    found.append(Advice("isolation", "info", mount, text))
    return tuple(found)
