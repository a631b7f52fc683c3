"""Checks of signals against each other: sign, unit, delay, offset steps, interference, jumps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, correlate, sosfiltfilt

from logs.checks.findings import Finding
from logs.checks.log_data import Array, LogData, Signal
from logs.checks.timing import change_point
from logs.checks.values import AXES
from wingbeat.constants import STANDARD_GRAVITY

Mask = NDArray[np.bool_]
LEAST = 100
"""samples of a comparison"""
TURNING = 0.05
"""rad/s; least standard deviation of an angular rate that can be compared"""
OPPOSITE = -0.6
"""-; correlation of a rate and the attitude's, below which the sign is wrong"""
SKEW = 0.008
"""s; least delay between gyro and attitude that is reported"""
LONGEST_SKEW = 0.25
"""s"""
AIRSPEED_SKEW = 0.6
"""s; receivers of GPS are late by up to 0.3 s"""
UNIT_FACTORS = {57.29578: "deg/s", 1.0 / 57.29578: "rad/s twice converted", 1e3: "thousandths", 1e-3: "thousands"}
BIAS_STEP = 0.02
"""rad/s"""
STEP_WINDOW = 4.0
"""s; of the levels before and after a step"""
JUMP = 3.0
"""m; beyond the distance that the velocity explains"""
INTERFERENCE, INTERFERENCE_CORRELATION = 0.04, 0.6
"""share of the field by the drive current, correlation"""


def check_consistency(log: LogData) -> Iterator[Finding]:
    """Compare signals that measure the same motion."""
    yield from _gyro_and_attitude(log)
    yield from _gravity(log)
    yield from _airspeed_and_ground_speed(log)
    yield from _interference(log)
    yield from _position_jumps(log)


def body_rates(attitude: Signal) -> Array:
    """Return the body rates (n, 3) in rad/s by central differences of roll, pitch and yaw."""
    roll, pitch, yaw = np.unwrap(attitude.values, axis=0).T
    p, q, r = (np.gradient(angle, attitude.time) for angle in (roll, pitch, yaw))
    return np.column_stack((
        p - r * np.sin(pitch),
        q * np.cos(roll) + r * np.sin(roll) * np.cos(pitch),
        -q * np.sin(roll) + r * np.cos(roll) * np.cos(pitch),
    ))  # fmt: skip


def _gyro_and_attitude(log: LogData) -> Iterator[Finding]:
    gyro, attitude = log.signals.get("gyro"), log.signals.get("attitude")
    if gyro is None or attitude is None or min(len(gyro.time), len(attitude.time)) < LEAST:
        return
    if gyro.topic == attitude.topic and np.array_equal(gyro.values, attitude.values):
        return
    rates = body_rates(attitude)
    middle = 0.5 * (attitude.time[1:] + attitude.time[:-1])
    step = float(np.median(np.diff(attitude.time)))
    start, end = max(gyro.time[0], middle[0]), min(gyro.time[-1], middle[-1])
    grid = np.arange(start, end, max(step, 0.005))
    if len(grid) < LEAST:
        return
    corner = min(10.0, 0.3 / max(step, 0.005))
    measured, derived = (
        _smooth(np.column_stack([np.interp(grid, time, column) for column in values.T]), grid, corner)
        for time, values in ((gyro.time, gyro.values), (attitude.time, rates))
    )
    usable = _without_gaps(grid, gyro, attitude)
    if usable.sum() < LEAST:
        return
    whole = float(gyro.time[0]), float(gyro.time[-1])
    suspect = False
    for axis in range(3):
        a, b = measured[usable, axis], derived[usable, axis]
        if min(a.std(), b.std()) < TURNING:
            continue
        correlation = float(np.corrcoef(a, b)[0, 1])
        ratio = float(a.std() / b.std())
        if correlation < OPPOSITE:
            suspect = True
            text = f"gyro {AXES[axis]} has the opposite sign of the attitude's rate (correlation {correlation:.2f})"
            yield Finding("sign", "error", gyro.topic, *whole, correlation, text)
        for factor, unit in UNIT_FACTORS.items():
            if abs(correlation) > 0.8 and abs(math.log(ratio / factor)) < 0.3:
                suspect = True
                text = f"gyro {AXES[axis]} is {ratio:.3g} times the attitude's rate: {unit}?"
                yield Finding("unit", "error", gyro.topic, *whole, ratio, text)
    if suspect:
        return
    yield from _skew(grid, measured, derived, usable, gyro, attitude)
    yield from _bias_steps(grid, measured - derived, usable, gyro)


def _smooth(values: Array, grid: Array, corner: float) -> Array:
    rate = 1.0 / float(grid[1] - grid[0])
    filtered: Array = sosfiltfilt(butter(2, min(corner, 0.4 * rate), fs=rate, output="sos"), values, axis=0)
    return filtered


def _without_gaps(grid: Array, *signals: Signal) -> Mask:
    usable = np.ones(len(grid), bool)
    for signal in signals:
        steps = np.diff(signal.time)
        for row in np.flatnonzero(steps > max(0.2, 5.0 * float(np.median(steps)))).tolist():
            usable &= (grid < signal.time[row] - 0.3) | (grid > signal.time[row + 1] + 0.3)
    return usable


def _skew(
    grid: Array, measured: Array, derived: Array, usable: Mask, gyro: Signal, attitude: Signal
) -> Iterator[Finding]:
    """Find the delay of the attitude behind the gyro by their cross-correlation over all axes."""
    step = float(grid[1] - grid[0])
    found = []
    for axis in range(3):
        a, b = (np.where(usable, one[:, axis] - np.median(one[usable, axis]), 0.0) for one in (measured, derived))
        if min(a[usable].std(), b[usable].std()) < TURNING:
            continue
        lag, peak = _delay(a, b, step, LONGEST_SKEW)
        if peak > 0.7:
            found.append((lag, a[usable].std()))
    if not found:
        return
    weights = np.array([weight for _, weight in found])
    lag = float(np.average([one for one, _ in found], weights=weights))
    if abs(lag) >= max(SKEW, 0.5 * float(np.median(np.diff(attitude.time)))):
        late, early = (attitude.topic, gyro.topic) if lag > 0.0 else (gyro.topic, attitude.topic)
        text = f"{abs(lag) * 1e3:.3g} ms behind {early}"
        start, end = float(grid[0]), float(grid[-1])
        yield Finding("time_skew", "warning", late, start, end, abs(lag), text)


def _delay(a: Array, b: Array, step: float, longest: float) -> tuple[float, float]:
    """Return the delay of b behind a in s, by a parabola about the peak of the correlation, and the peak."""
    most = int(longest / step)
    norm = math.sqrt(float(a @ a) * float(b @ b)) or 1.0
    lags = np.arange(-most, most + 1)
    values = correlate(b, a, method="fft")[len(a) - 1 - most : len(a) + most]
    place = int(values.argmax())
    shift = 0.0
    if 0 < place < len(values) - 1:
        left, top, right = values[place - 1 : place + 2]
        bend = left - 2.0 * top + right
        shift = 0.5 * (left - right) / bend if bend else 0.0
    return float((lags[place] + shift) * step), float(values[place] / norm)


def _bias_steps(grid: Array, residual: Array, usable: Mask, gyro: Signal) -> Iterator[Finding]:
    """Find a step of the median difference between the gyro and the attitude's rate."""
    found: list[Finding] = []
    for axis in range(3):
        block = 0.5
        index = np.floor((grid - grid[0]) / block).astype(int)
        edges = np.searchsorted(index, np.arange(index[-1] + 2))
        parts = (residual[first:last, axis][usable[first:last]] for first, last in itertools.pairwise(edges.tolist()))
        medians = np.array([np.median(part) if len(part) > 5 else np.nan for part in parts])
        width = int(STEP_WINDOW / block)
        if len(medians) < 2 * width:
            continue
        if not np.isfinite(np.diff(medians)).any():
            continue
        noise = 1.4826 * float(np.nanmedian(np.abs(np.diff(medians)))) or 1e-4
        sizes = np.zeros(len(medians))
        windows = np.lib.stride_tricks.sliding_window_view(medians, width)
        levels, known = np.nanmedian(windows, axis=1), np.isfinite(windows).sum(axis=1) >= width - 2
        both = known[width:] & known[:-width]
        sizes[width : width + len(both)][both] = (levels[width:] - levels[:-width])[both]
        place = int(np.abs(sizes).argmax())
        if abs(sizes[place]) > max(BIAS_STEP, 6.0 * noise):
            at = _step_time(grid, residual[:, axis], float(grid[0] + block * place), STEP_WINDOW)
            text = f"gyro {AXES[axis]} steps by {sizes[place]:.3g} rad/s against the attitude"
            found.append(Finding("bias_step", "warning", gyro.topic, at, at, float(sizes[place]), text))
    if found:
        yield max(found, key=lambda one: abs(one.value))


def _step_time(grid: Array, values: Array, center: float, window: float) -> float:
    inside = np.flatnonzero((grid >= center - window) & (grid <= center + window))
    return float(grid[inside[change_point(values[inside])]])


def _gravity(log: LogData) -> Iterator[Finding]:
    """Compare the mean specific force with gravity in the attitude's axes."""
    accel, attitude = log.signals.get("accel"), log.signals.get("attitude")
    if accel is None or len(accel.time) < LEAST:
        return
    size = float(np.median(np.linalg.norm(_blocks(accel), axis=1)))
    whole = float(accel.time[0]), float(accel.time[-1])
    for factor, unit in ((1.0 / STANDARD_GRAVITY, "g"), (1e3 / STANDARD_GRAVITY, "mg"), (100.0, "cm/s^2")):
        if abs(size / (STANDARD_GRAVITY * factor) - 1.0) < 0.2:
            text = f"the mean specific force is {size:.3g} m/s^2: in {unit}?"
            yield Finding("unit", "error", accel.topic, *whole, size / STANDARD_GRAVITY, text)
            return
    if attitude is None or len(attitude.time) < LEAST:
        return
    inside = (accel.time >= attitude.time[0]) & (accel.time <= attitude.time[-1])
    if inside.sum() < LEAST:
        return
    time, force = accel.time[inside], accel.values[inside]
    roll, pitch = (np.interp(time, attitude.time, attitude.values[:, i]) for i in (0, 1))
    expected = -STANDARD_GRAVITY * np.column_stack(
        (-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch))
    )
    down = float(force[:, 2].mean())
    if down * float(expected[:, 2].mean()) < 0.0 and abs(down) > 4.0:
        text = f"accel z reads {down:.3g} m/s^2 in the mean, gravity is {expected[:, 2].mean():.3g}"
        yield Finding("sign", "error", accel.topic, *whole, down, text)


def _blocks(signal: Signal) -> Array:
    """Return means (m, k) over one second."""
    index = np.floor(signal.time - signal.time[0]).astype(int)
    counts = np.bincount(index)
    used = counts > 0
    sums = np.column_stack([np.bincount(index, column) for column in signal.values.T])
    means: Array = sums[used] / counts[used, None]
    return means


def _airspeed_and_ground_speed(log: LogData) -> Iterator[Finding]:
    airspeed = log.signals.get("airspeed")
    ground = log.signals.get("gps_velocity") or log.signals.get("velocity")
    if airspeed is None or ground is None or min(len(airspeed.time), len(ground.time)) < LEAST:
        return
    speed = np.hypot(*ground.values[:, :2].T)
    start, end = max(airspeed.time[0], ground.time[0]), min(airspeed.time[-1], ground.time[-1])
    grid = np.arange(start, end, 0.1)
    if len(grid) < 200:
        return
    measured, derived = np.interp(grid, airspeed.time, airspeed.values[:, 0]), np.interp(grid, ground.time, speed)
    flying = derived > 3.0
    if flying.sum() < 100:
        return
    ratio = float(np.median(measured[flying]) / np.median(derived[flying]))
    whole = float(airspeed.time[0]), float(airspeed.time[-1])
    for factor, unit in ((3.6, "km/h"), (1.944, "kn"), (100.0, "cm/s"), (2.237, "mph")):
        if abs(ratio / factor - 1.0) < 0.08 and abs(np.corrcoef(measured, derived)[0, 1]) > 0.7:
            text = f"the airspeed is {ratio:.3g} times the ground speed: in {unit}?"
            yield Finding("unit", "error", airspeed.topic, *whole, ratio, text)
            return


def _interference(log: LogData) -> Iterator[Finding]:
    """Regress the measured field strength on the current of the drive."""
    mag, current = log.signals.get("mag"), log.signals.get("current") or log.signals.get("throttle")
    if mag is None or current is None or min(len(mag.time), len(current.time)) < LEAST:
        return
    start, end = max(mag.time[0], current.time[0]), min(mag.time[-1], current.time[-1])
    grid = np.arange(start, end, 0.25)
    if len(grid) < 40:
        return
    strength = np.interp(grid, mag.time, np.linalg.norm(mag.values, axis=1))
    drive = np.interp(grid, current.time, current.values[:, 0])
    usual = float(np.median(strength))
    if usual <= 0.0 or drive.std() < 1e-6:
        return
    correlation = float(np.corrcoef(strength, drive)[0, 1])
    slope = correlation * float(strength.std() / drive.std())
    change = abs(slope) * float(np.percentile(drive, 95) - np.percentile(drive, 5)) / usual
    if abs(correlation) > INTERFERENCE_CORRELATION and change > INTERFERENCE:
        text = f"the field changes by {100.0 * change:.3g} % with the drive current (correlation {correlation:.2f})"
        yield Finding("magnetic_interference", "warning", mag.topic, float(start), float(end), change, text)


def _position_jumps(log: LogData) -> Iterator[Finding]:
    """Compare each step of the position with the velocity."""
    position, velocity = log.signals.get("position"), log.signals.get("velocity")
    if position is None or len(position.time) < LEAST:
        return
    steps, times = np.diff(position.values[:, :2], axis=0), np.diff(position.time)
    speed = np.zeros((len(times), 2))
    if velocity is not None and len(velocity.time) > 1:
        middle = 0.5 * (position.time[1:] + position.time[:-1])
        speed = np.column_stack([np.interp(middle, velocity.time, column) for column in velocity.values[:, :2].T])
    rest = np.linalg.norm(steps - speed * times[:, None], axis=1)
    usual = float(np.percentile(rest, 95))
    for row in np.flatnonzero((rest > max(JUMP, 8.0 * usual)) & (times < 2.0)).tolist():
        at = float(position.time[row + 1])
        text = f"{rest[row]:.3g} m in {times[row]:.2g} s that the velocity does not explain"
        yield Finding("position_jump", "warning", position.topic, at, at, float(rest[row]), text)
