"""Checks of wings, drive and battery, and of what identification needs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import binary_closing

from logs.checks.findings import Finding
from logs.checks.log_data import Array, LogData, Signal
from logs.checks.timing import runs
from logs.spectral_line import strongest_line
from logs.vibration.analysis import high_pass

WINDOW = 3.0
"""s; of one comparison of frequencies"""
BAND = (1.0, 40.0)
"""Hz; of a stroke"""
MISMATCH = 0.03
"""-; least relative difference of two frequencies"""
STEADY = 0.05
"""-; of the frequency: largest standard deviation in a window that is compared"""
DISTINCT = 6.0
"""-; power of a spectral line over the mean of its band"""
VIBRATION = 5.0
"""m/s^2; RMS above 40 Hz"""
PAUSE = 10
"""s; shorter pauses belong to a shaken part"""
SAG = 0.2
"""-; drop of the voltage under load over that at rest"""
INFORMATIVE = 0.01
"""rad or share; least standard deviation of an input"""
NEEDED: dict[str, tuple[str, ...]] = {
    "modes": ("gyro", "attitude", "surfaces"),
    "drive": ("current", "voltage", "flap_angle"),
    "aerodynamics": ("gyro", "accel", "attitude", "airspeed", "surfaces"),
}
"""roles that each subject of identification needs"""


def check_drive(log: LogData) -> Iterator[Finding]:
    """Check wings, vibration, battery and content."""
    yield from _flapping(log)
    yield from _vibration(log)
    yield from _sag(log)
    yield from _missing(log)
    yield from _informative(log)
    for line in log.damage:
        yield Finding("damaged", "error", "", 0.0, log.duration, math.nan, line)
    if log.boots > 1:
        text = f"{log.boots} boots in this file; the one with the most data is checked"
        yield Finding("boots", "info", "", 0.0, log.duration, float(log.boots), text)


def _flapping(log: LogData) -> Iterator[Finding]:
    """Compare the logged flapping frequency with the fundamental of the acceleration."""
    logged, accel = log.signals.get("flap_frequency"), log.signals.get("accel")
    if logged is None or accel is None or len(logged.time) < 5 or len(accel.time) < 200:
        return
    start, end = max(accel.time[0], logged.time[0]), min(accel.time[-1], logged.time[-1])
    window = min(WINDOW, 0.999 * (end - start))
    if window < 2.0:
        return
    ratios, times = [], []
    for begin in np.arange(start, end - window + 1e-9, window):
        told = logged.between(begin, begin + window).values[:, 0]
        measured = _fundamental(accel.between(begin, begin + window))
        if (
            len(told) >= 3
            and measured > 0.0
            and np.median(told) > BAND[0]
            and np.std(told) < STEADY * np.median(told)
        ):
            ratios.append(float(np.mean(told)) / measured)
            times.append(begin)
    if not ratios:
        return
    ratio = float(np.median(ratios))
    harmonic = min(abs(ratio / one - 1.0) for one in (0.5, 1.0, 2.0))  # of a bird with two equal halves of a stroke
    agree = np.abs(np.array(ratios) - ratio) < 0.02
    if harmonic > MISMATCH and agree.mean() > 0.6:
        text = f"the logged flapping frequency is {ratio:.4g} times that of the acceleration"
        yield Finding(
            "rate_mismatch_flapping", "error", logged.topic, float(times[0]), float(times[-1] + window), ratio, text
        )


def _fundamental(accel: Signal) -> float:
    """Return the frequency in Hz of the strongest line of the vertical acceleration; 0 without one."""
    if len(accel.time) < 100:
        return 0.0
    step = float(accel.time[-1] - accel.time[0]) / (len(accel.time) - 1)
    line = strongest_line(accel.values[:, 2], step, BAND)
    return line.frequency if line.distinction >= DISTINCT else 0.0


def _vibration(log: LogData) -> Iterator[Finding]:
    accel = log.signals.get("accel")
    if accel is None or len(accel.time) < 200:
        return
    step = float(np.median(np.diff(accel.time)))
    if step > 1.0 / 90.0:
        return  # too slow to see it
    level = np.sqrt((high_pass(accel.values, step) ** 2).sum(axis=1))
    index = np.floor(accel.time - accel.time[0]).astype(int)
    counts = np.maximum(np.bincount(index), 1)
    rms = np.sqrt(np.bincount(index, level**2) / counts)
    # Pauses of a few seconds do not divide a shaken part.
    shaken = binary_closing(np.pad(rms > VIBRATION, PAUSE), np.ones(PAUSE + 1))[PAUSE:-PAUSE]
    for first, last in runs(shaken):
        if last - first >= 2:
            size = float(rms[first:last].max())
            start, end = float(accel.time[0] + first), float(accel.time[0] + last)
            text = f"{size:.3g} m/s^2 RMS above 40 Hz"
            yield Finding("vibration", "warning", accel.topic, start, end, size, text)


def _sag(log: LogData) -> Iterator[Finding]:
    voltage = log.signals.get("voltage")
    if voltage is None or len(voltage.time) < 20:
        return
    values = voltage.values[:, 0]
    usual = float(np.percentile(values, 95))
    if usual <= 1.0:
        return
    low = values < (1.0 - SAG) * usual
    for first, last in runs(low):
        if last - first < 3:
            continue
        size = 1.0 - float(values[first:last].min()) / usual
        start, end = float(voltage.time[first]), float(voltage.time[last - 1])
        text = f"{float(values[first:last].min()):.3g} V, {100.0 * size:.3g} % below {usual:.3g} V"
        yield Finding("battery_sag", "warning", voltage.topic, start, end, size, text)


def _missing(log: LogData) -> Iterator[Finding]:
    for subject, roles in NEEDED.items():
        missing = [role.replace("_", " ") for role in roles if role not in log.signals]
        if missing:
            text = f"to identify {subject}: no {', no '.join(missing)}"
            yield Finding("missing_topic", "info", "", 0.0, log.duration, float(len(missing)), text)


def _informative(log: LogData) -> Iterator[Finding]:
    """Find inputs that do not move, or follow the pitch rate so closely that feedback explains them."""
    surfaces, gyro = log.signals.get("surfaces"), log.signals.get("gyro")
    if surfaces is None or gyro is None or len(surfaces.time) < 50:
        return
    whole = float(surfaces.time[0]), float(surfaces.time[-1])
    moved = surfaces.values.std(axis=0)
    if float(moved.max()) < INFORMATIVE:
        text = f"no input moves by more than {float(moved.max()):.2g}"
        yield Finding("not_informative", "info", surfaces.topic, *whole, float(moved.max()), text)
        return
    share = _explained(surfaces, gyro, log.signals.get("attitude"))
    if share > 0.95:
        text = f"pitch and pitch rate explain {100.0 * share:.0f} % of the input: no excitation of its own"
        yield Finding("not_informative", "info", surfaces.topic, *whole, share, text)


def _explained(surfaces: Signal, gyro: Signal, attitude: Signal | None) -> float:
    """Return the share of the first input that pitch, its integral and pitch rate explain."""
    time = surfaces.time
    columns = [np.ones_like(time), np.interp(time, gyro.time, gyro.values[:, 1])]
    if attitude is not None:
        pitch = np.interp(time, attitude.time, attitude.values[:, 1])
        columns += [pitch, np.cumsum(pitch - pitch.mean()) * float(np.median(np.diff(time)))]
    basis = np.column_stack(columns)
    values: Array = surfaces.values[:, 0]
    rest = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
    total = float(values.var())
    return 1.0 - float(rest.var()) / total if total > 0.0 and math.isfinite(total) else 0.0
