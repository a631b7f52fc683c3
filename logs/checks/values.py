"""Checks of single signals: clipping, frozen and never valid values, offsets at rest, saturation."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from logs.checks.findings import Finding
from logs.checks.log_data import Array, LogData, RawTopic, Signal
from logs.checks.timing import clusters, runs
from logs.vibration.analysis import clipped

AXES = "xyz"
LEAST = 50
"""rows of a signal that is checked"""
FROZEN_TIME, FROZEN_ROWS, FROZEN_FACTOR = 0.8, 20, 8
"""s, rows, multiple of the usual longest repetition of a value"""
REST_TIME = 1.5
"""s; at rest"""
REST_SHAKE, REST_TURN = 0.5, 0.02
"""m/s^2, rad/s; standard deviations at rest"""
GYRO_OFFSET = 0.03
"""rad/s"""
CURRENT_SHARE, CURRENT_LEAST = 0.1, 1.0
"""-, A; of the current in flight"""
START = 0.5
"""s; at the end of a part at rest, in which the launch may begin before a slow signal changes"""
LAUNCH_TIME = 1.0
"""s; of a throw, at whose end the outputs leave the ends at which they waited"""
SATURATED_TIME = 1.0
"""s"""
MEASURED = ("flap", "wing", "phase", "hall", "encoder", "airspeed", "rpm")
"""in the names of topics of sensors that an ornithopter needs"""


def check_values(log: LogData) -> Iterator[Finding]:
    """Check every signal by itself."""
    for role in ("gyro", "accel"):
        if role in log.signals:
            yield from _clipping(log.signals[role])
    for topic in log.raw:
        yield from _clip_counters(topic)
    for role in ("gyro", "accel", "mag", "attitude", "airspeed", "altitude", "position", "voltage", "current",
                 "flap_frequency", "gps_velocity", "flap_angle"):  # fmt: skip
        if role in log.signals:
            yield from _frozen(log, log.signals[role])
    for topic in log.raw:
        yield from _never_valid(topic)
    yield from _gyro_offset(log)
    yield from _current_offset(log)
    if "surfaces" in log.signals:
        yield from _saturation(log, log.signals["surfaces"])


def _clipping(signal: Signal) -> Iterator[Finding]:
    """A clipped signal has many samples at exactly its largest magnitude."""
    if len(signal.time) < LEAST:
        return
    for axis in range(signal.values.shape[1]):
        at = clipped(signal.values[:, axis])
        if len(at):
            yield from _clipped(signal, axis, signal.time[at], float(np.abs(signal.values[at, axis]).max()))


def _clipped(signal: Signal, axis: int, times: Array, limit: float) -> Iterator[Finding]:
    for rows in clusters(times):
        text = f"{signal.name} {AXES[axis]} is at {limit:.4g} in {len(rows)} samples"
        yield Finding(
            "clipping", "warning", signal.topic, float(times[rows[0]]), float(times[rows[-1]]), float(len(rows)), text
        )


def _clip_counters(topic: RawTopic) -> Iterator[Finding]:
    """Flags and counters of clipping that the autopilot logs itself."""
    for name, column in topic.columns.items():
        if "clip" not in name.lower() or column.dtype.kind not in "iufb":
            continue
        values = np.asarray(column, float)
        values = values if values.ndim == 1 else values.sum(axis=1)
        bits = any(word in name.lower() for word in ("bit", "flag", "mask"))
        counter = not bits and bool((np.diff(values) >= 0.0).all())
        active = (
            np.flatnonzero(np.diff(values, prepend=values[:1]) > 0.0) if counter else np.flatnonzero(values > 0.0)
        )
        for rows in clusters(topic.time[active]):
            times = topic.time[active[rows]]
            text = f"{name} reports clipping in {len(rows)} messages"
            yield Finding(
                "clipping", "warning", topic.name, float(times[0]), float(times[-1]), float(len(rows)), text
            )


def _frozen(log: LogData, signal: Signal) -> Iterator[Finding]:
    """A signal that usually changes repeats one value for long, but not its least one at rest."""
    if len(signal.time) < LEAST:
        return
    same = (np.diff(signal.values, axis=0) == 0.0).all(axis=1)
    if same.mean() > 0.9:
        return
    every = runs(same)
    lengths = [end - begin for begin, end in every]
    usual = float(np.median([*lengths, *[0] * int((~same).sum() - len(lengths))] or [0]))
    for begin, end in every:
        time = float(signal.time[end] - signal.time[begin])
        if time >= FROZEN_TIME and end - begin >= max(FROZEN_ROWS, FROZEN_FACTOR * usual) and _moves(signal, begin):
            least = bool((signal.values[begin] <= signal.values.min(axis=0)).all())
            if least and not _moving(log, signal.time[begin], signal.time[end] - START):
                continue  # a pitot in still air
            text = f"{signal.name} repeats one value for {time:.3g} s"
            yield Finding(
                "frozen", "error", signal.topic, float(signal.time[begin]), float(signal.time[end]), time, text
            )


def _moves(signal: Signal, begin: int) -> bool:
    """Return whether the signal changed in most steps before a run: it may wait at the start of a log."""
    changes = (np.diff(signal.values, axis=0) != 0.0).any(axis=1)[max(0, begin - 50) : begin]
    return len(changes) >= 10 and float(changes.mean()) > 0.5


def _never_valid(topic: RawTopic) -> Iterator[Finding]:
    """A flag of validity that is never set, or a measured column without a number."""
    if len(topic.time) < LEAST:
        return
    measured = any(word in topic.name.lower() for word in MEASURED)
    columns = {name: values for name, values in topic.columns.items() if values.ndim == 1}
    start, end, count = float(topic.time.min()), float(topic.time.max()), float(len(topic.time))
    for name, values in columns.items():
        flag = name.lower() in ("valid", "is_valid") or name.lower().endswith("_valid")
        if flag and measured and values.dtype.kind in "iufb" and not np.nan_to_num(np.asarray(values, float)).any():
            text = f"{name} is never set in {len(values)} messages"
            yield Finding("never_valid", "error", topic.name, start, end, count, text)
    floats = [name for name, values in columns.items() if values.dtype.kind == "f"]
    empty = [name for name in floats if np.isnan(columns[name]).all()] if measured else []
    if empty:
        # A source need not have every field of its topic.
        severity = "error" if empty == floats else "info"
        text = f"{', '.join(empty)}: no number in {count:.0f} messages"
        yield Finding("never_valid", severity, topic.name, start, end, count, text)


def rest(log: LogData) -> list[tuple[float, float]]:
    """Return the parts of at least 1.5 s in which IMU and attitude stand still."""
    if "gyro" not in log.signals or "accel" not in log.signals:
        return []
    gyro, accel = log.signals["gyro"], log.signals["accel"]
    return [
        part
        for part in _steady_parts(gyro, REST_TURN)
        if part[1] - part[0] >= REST_TIME and _shake(accel, part) < REST_SHAKE and _stands(log, part)
    ]


def _steady_parts(signal: Signal, limit: float) -> list[tuple[float, float]]:
    window = 0.5
    index = np.floor((signal.time - signal.time[0]) / window).astype(int)
    counts = np.bincount(index)
    filled = np.maximum(counts, 1)
    about = signal.values - signal.values.mean(axis=0)  # against cancellation in the squares
    sums, squares = (np.column_stack([np.bincount(index, c) for c in v.T]) for v in (about, about**2))
    means = sums / filled[:, None]
    deviations = np.sqrt(np.maximum(squares / filled[:, None] - means**2, 0.0))
    steady_blocks = (counts >= 3) & (deviations.max(axis=1) < limit)
    means = np.where(counts[:, None] > 0, means + signal.values.mean(axis=0), 0.0)
    steady = np.concatenate(([True], np.abs(np.diff(means, axis=0)).max(axis=1) < limit))
    begin = float(signal.time[0])
    return [(begin + first * window, begin + last * window) for first, last in runs(steady_blocks & steady)]


def _shake(signal: Signal, part: tuple[float, float]) -> float:
    values = signal.between(*part).values
    return float(values.std(axis=0).max()) if len(values) > 3 else math.inf


def _stands(log: LogData, part: tuple[float, float]) -> bool:
    """Return whether the attitude does not turn: a rate at rest is an offset."""
    attitude = log.signals.get("attitude")
    if attitude is None:
        return True
    values = attitude.between(*part).values
    if len(values) < 3:
        return True
    turned = np.ptp(np.unwrap(values, axis=0), axis=0).max()
    return bool(turned < 0.3 * GYRO_OFFSET * (part[1] - part[0]) + 0.02)


def _gyro_offset(log: LogData) -> Iterator[Finding]:
    for part in rest(log)[:1]:
        gyro = log.signals["gyro"].between(*part)
        mean = gyro.values.mean(axis=0)
        axis = int(np.abs(mean).argmax())
        if abs(mean[axis]) > GYRO_OFFSET:
            text = f"gyro {AXES[axis]} reads {mean[axis]:.3g} rad/s at rest"
            yield Finding("gyro_offset", "warning", gyro.topic, *part, float(mean[axis]), text)


def _current_offset(log: LogData) -> Iterator[Finding]:
    """Find a steady current that no drive draws."""
    current = log.signals.get("current")
    if current is None or len(current.time) < 10:
        return
    values = current.values[:, 0]
    high = float(np.percentile(values, 95))
    low = float(np.percentile(values, 2))
    level = max(CURRENT_SHARE * high, CURRENT_LEAST)
    near = np.abs(values - low) < 0.05 * abs(low) + 0.02
    for begin, end in runs(near):
        part = float(current.time[begin]), float(current.time[end - 1])
        steady = float(values[begin:end].std()) < 0.01 * abs(low) + 0.01
        if (
            end - begin >= 8
            and part[1] - part[0] >= REST_TIME
            and steady
            and low > level
            and _drive_stopped(log, (part[0], part[1] - START))
        ):
            text = f"{low:.3g} A with the drive at rest, {high:.3g} A in flight"
            yield Finding("current_offset", "error", current.topic, *part, low, text)
            return


def _drive_stopped(log: LogData, part: tuple[float, float]) -> bool:
    """Return whether nothing shows a beating wing or a running motor in a part of the log."""
    accel = log.signals.get("accel")
    shake = accel.between(*part).values if accel is not None else np.zeros((0, 3))
    if len(shake) > 10 and float(shake.std(axis=0).max()) > 1.5:
        return False
    for role in ("throttle", "flap_frequency"):
        signal = log.signals.get(role)
        values = signal.between(*part).values if signal is not None else np.zeros((0, 1))
        if len(values) and float(np.abs(values).max()) > 0.05:
            return False
    return True


def _saturation(log: LogData, signal: Signal) -> Iterator[Finding]:
    """An output that stays at one end of its range, although it moves otherwise."""
    for axis in range(signal.values.shape[1]):
        values = signal.values[:, axis]
        if np.ptp(values) <= 0.0 or len(np.unique(values)) < 20:
            continue
        for limit in (float(values.min()), float(values.max())):
            held = np.isclose(values, limit, rtol=1e-6, atol=1e-9)
            for begin, end in runs(held):
                last = min(end, len(values) - 1)
                time = float(signal.time[last] - signal.time[begin])
                if (
                    time >= SATURATED_TIME
                    and end - begin >= 8
                    and _moving(log, signal.time[begin], signal.time[last])
                ):
                    text = f"actuator {axis + 1} stays at {limit:.3g} for {time:.3g} s"
                    start, stop = float(signal.time[begin]), float(signal.time[last])
                    yield Finding("saturation", "warning", signal.topic, start, stop, time, text)


def _moving(log: LogData, start: float, end: float) -> bool:
    """Return whether the aircraft flies in a part: outputs before the launch wait at their ends."""
    accel = log.signals.get("accel")
    if accel is None:
        return True
    values = accel.between(start, end - LAUNCH_TIME).values
    return len(values) > 3 and float(values.std(axis=0).max()) > 0.5
