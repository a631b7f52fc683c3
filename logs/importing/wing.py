"""Wing strokes of a log of another program: from a phase, a frequency, a counter, pulses or the acceleration."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics as t
from logs.importing.counterparts import checked
from logs.importing.source import Array, ImportedTopic, Series
from logs.spectral_line import strongest_line
from wingbeat.errors import InputError

RATE = 50.0
"""Hz; of the topic if a slower source determines the strokes"""
WINDOW, HOP = 2.0, 0.25
"""s; of one estimate of the frequency from the acceleration, and from one to the next"""
BAND = (1.0, 30.0)
"""Hz; of a stroke"""
DISTINCT = 8.0
"""-; power of the strongest line over the mean of its band, from which wings beat"""
LONGEST_STROKE = 2.0
"""s; a longer time between two pulses is no stroke"""


class WingSource(NamedTuple):
    """Choice of the user."""

    topic: str = ""
    """topic of the source log; empty: what there is"""
    counts: float = 0.0
    """counts per turn of an encoder"""
    gear: float = 1.0
    """turns of the encoder, pulses or motor per stroke"""


Strokes = tuple[NDArray[np.int64], Array]
"""time in us, and strokes since the start of the log"""


def wing_topic(
    series: Mapping[str, Series], imu: ImportedTopic | None, choice: WingSource
) -> tuple[ImportedTopic, str] | None:
    """Return the wing's topic and what it was made of; None if nothing in the log shows strokes.

    Args:
        series: of the source log.
        imu: with the specific force.
        choice: of the user.

    Raises:
        InputError: the chosen topic is missing, or has no counter, frequency or phase.
    """
    if choice.topic:
        found = _from_topic(series, choice.topic, choice)
        if found is None:
            raise InputError(f"{choice.topic} has no column with a phase, a frequency, a count or rpm")
        return _made(choice.topic, *found)
    for name in sorted(series):
        if re.search(r"flap|wing_phase|hall_event", name):
            found = _from_topic(series, name, choice)
            if found is not None:
                return _made(name, *found)
    strokes = None if imu is None else _of_acceleration(imu.series)
    return (
        None if strokes is None else _made("specific force", strokes, "the fundamental of the vertical acceleration")
    )


def _from_topic(series: Mapping[str, Series], name: str, choice: WingSource) -> tuple[Strokes, str] | None:
    if name not in series:
        raise InputError(f"there is no topic {name}; it has: {', '.join(sorted(series))}")
    one = series[name]
    numbers = {key: values for key, values in one.columns.items() if values.dtype.kind in "iuf" and values.ndim == 1}
    valid = next((np.asarray(numbers[key], bool) for key in numbers if re.fullmatch(r"(is_)?valid", key)), None)
    if valid is not None and not valid.any():
        return None
    for pattern, build, text in BUILDERS:
        column = next((key for key in numbers if re.search(pattern, key)), None)
        if column is not None:
            values = np.asarray(numbers[column], float)
            good = np.isfinite(values) if valid is None else np.isfinite(values) & valid
            if good.sum() > 20 and np.ptp(values[good]) > 0.0:
                strokes = build(one.time_us[good] * 1e-6, values[good], choice)
                if strokes is not None:
                    return (one.time_us[good], strokes), f"{text} of {name}.{column}"
    if "hall" in name and len(one.time_us) > 20:
        return _of_pulses(one.time_us, choice), f"the pulses of {name}"
    return None


def _of_phase(time: Array, phase: Array, choice: WingSource) -> Array | None:
    """A phase in turns, rad or degrees, as its range tells."""
    span = float(np.ptp(phase))
    turn = 1.0 if span <= 1.5 else 2.0 * np.pi if span <= 7.0 else 360.0
    return np.asarray(np.unwrap(phase * 2.0 * np.pi / turn) / (2.0 * np.pi) / choice.gear, float)


def _of_frequency(time: Array, frequency: Array, choice: WingSource) -> Array | None:
    return _integrated(time, np.maximum(frequency, 0.0) / choice.gear)


def _of_rpm(time: Array, rpm: Array, choice: WingSource) -> Array | None:
    return _integrated(time, np.maximum(rpm, 0.0) / 60.0 / choice.gear)


def _of_counts(time: Array, counts: Array, choice: WingSource) -> Array | None:
    if choice.counts <= 0.0:
        return None
    # A single-turn encoder wraps at its counts, a counter at 16 or 32 bits; a step of half of it is none of the wing.
    steps = np.diff(counts)
    for span in (choice.counts, 2.0**16, 2.0**32):
        if np.ptp(counts) <= span:
            steps = np.where(np.abs(steps) > 0.5 * span, (steps + 0.5 * span) % span - 0.5 * span, steps)
            break
    return np.concatenate(([0.0], np.cumsum(steps))) / choice.counts / choice.gear


BUILDERS: tuple[tuple[str, Callable[[Array, Array, WingSource], Array | None], str], ...] = (
    (r"phase", _of_phase, "the phase"),
    (r"freq|_hz$|^hz$", _of_frequency, "the frequency"),
    (r"count|position", _of_counts, "the counts"),
    (r"rpm", _of_rpm, "the speed"),
)
"""pattern of a column's name, strokes from it, and text; in the order of preference"""


def _integrated(time: Array, frequency: Array) -> Array:
    steps = 0.5 * (frequency[1:] + frequency[:-1]) * np.diff(time)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _of_pulses(time_us: NDArray[np.int64], choice: WingSource) -> Strokes:
    time = np.unique(time_us)
    return time, np.arange(len(time)) / choice.gear


def _of_acceleration(imu: Series) -> Strokes | None:
    """Follow the strongest line of the vertical specific force below 30 Hz."""
    time, force = imu.time_us * 1e-6, np.asarray(imu.columns["accel_z"], float)
    if len(time) < 200:
        return None
    step = float(np.median(np.diff(time)))
    if step <= 0.0 or 0.4 / step < BAND[0]:
        return None
    grid = np.arange(time[0], time[-1], step)
    values = np.interp(grid, time, force)
    length, hop = int(WINDOW / step), max(1, int(HOP / step))
    centers, frequencies = [], []
    for begin in range(0, len(values) - length, hop):
        part = values[begin : begin + length]
        line = strongest_line(part, step, BAND)
        beats = part.std() > 1.0 and line.distinction > DISTINCT
        centers.append(grid[begin] + 0.5 * WINDOW)
        frequencies.append(line.frequency if beats else 0.0)
    if not frequencies or np.mean(np.array(frequencies) > 0.0) < 0.1:
        return None
    even = np.arange(time[0], time[-1], 1.0 / RATE)
    strokes = _integrated(even, np.interp(even, centers, frequencies))
    return np.rint(even * 1e6).astype(np.int64), strokes


def _made(source: str, strokes: Strokes, text: str) -> tuple[ImportedTopic, str]:
    """Return the topic at the times of the strokes, at least at `RATE`."""
    time_us, count = strokes
    time_us, rows = np.unique(time_us, return_index=True)
    count = count[rows]
    if float(np.median(np.diff(time_us))) > 1.5e6 / RATE:
        even = np.arange(time_us[0], time_us[-1], round(1e6 / RATE))
        count, time_us = np.interp(even, time_us, count), even
    frequency = np.gradient(count, time_us * 1e-6)
    flapping = frequency > 1.0 / LONGEST_STROKE
    columns = {
        "phase": 2.0 * np.pi * (count % 1.0),
        "frequency": np.where(flapping, frequency, 0.0),
        "strokes": np.maximum(np.floor(count), 0.0),
        "flapping": flapping.astype(float),
    }
    made = checked(t.WING, Series(source, time_us, {}, {}), columns)
    return made._replace(source=source), text
