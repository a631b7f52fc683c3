"""Clock offset from the magnitude of the angular rate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from avionics import topics as t
from logs.importing.source import ImportedTopic
from logs.reader import Log
from wingbeat.errors import InputError

Array = NDArray[np.float64]
STEP = 0.005
"""s; period of the common time base"""
LEAST_OVERLAP = 3.0
"""s; least overlap of the two signals"""
LEAST_CORRELATION = 0.6
"""-; least correlation: below it the two did not measure the same motion"""
RIVAL = 0.95
"""ratio to the best correlation that no other lag may exceed: periodic flapping alone correlates at every stroke"""
LOBE = 0.15
"""s; half width of the peak around the best lag"""


class Signal(NamedTuple):
    """Magnitude of an angular rate over time."""

    time: Array
    """s; (N,)"""
    rate: Array
    """rad/s; (N,)"""


class Alignment(NamedTuple):
    """Offset of one clock to the other."""

    offset: float
    """s; to be added to the times of the first clock"""
    correlation: float
    """-; of the two signals at this offset, at most 1"""


def of_log(log: Log) -> Signal:
    """Return the angular rate of a log's IMU, or of its attitude.

    Raises:
        InputError: the log has neither.
    """
    for topic, names in ((t.IMU, _GYRO), (t.ATTITUDE, _RATES)):
        if topic.name in log.topics:
            columns = log.columns(topic)
            if len(columns.time):
                return _signal(columns.time, np.stack([columns[name] for name in names]))
    raise InputError(f"{log.path} has no angular rate to align with: neither {t.IMU.name} nor {t.ATTITUDE.name}")


def of_import(imported: list[ImportedTopic]) -> Signal:
    """Return the angular rate of imported topics.

    Raises:
        InputError: there is no angular rate.
    """
    for topic, names in ((t.IMU, _GYRO), (t.ATTITUDE, _RATES)):
        for one in imported:
            if one.topic is topic:
                signal = _signal(one.series.time_us * 1e-6, np.stack([one.series.columns[name] for name in names]))
                if len(signal.time):
                    return signal
    raise InputError("it has no angular rate that its clock could be aligned by")


_GYRO = ("gyro_x", "gyro_y", "gyro_z")
_RATES = ("roll_rate", "pitch_rate", "yaw_rate")


def _signal(time: NDArray[Any], rates: NDArray[Any]) -> Signal:
    size = np.sqrt((rates**2).sum(axis=0))
    good = np.isfinite(size)
    return Signal(np.asarray(time[good], np.float64), np.asarray(size[good], np.float64))


def align(first: Signal, second: Signal) -> Alignment:
    """Find the offset of the first clock to the second, to a fraction of the step.

    Raises:
        InputError: they overlap too little, or the offset is ambiguous.
    """
    a, b = _uniform(first), _uniform(second)
    least = round(LEAST_OVERLAP / STEP)
    if min(len(a), len(b)) < least:
        raise InputError(f"the clocks cannot be aligned: less than {LEAST_OVERLAP:g} s of angular rate")
    correlation = _correlation(a, b, least)
    best = int(np.argmax(correlation))
    peak = float(correlation[best])
    far = np.abs(np.arange(len(correlation)) - best) > LOBE / STEP
    if peak < LEAST_CORRELATION:
        raise InputError(f"the clocks cannot be aligned: the angular rates agree to {peak:.2f} at best")
    if far.any() and correlation[far].max() > RIVAL * peak:
        raise InputError("the clocks cannot be aligned: the angular rates agree at several offsets")
    lag = best - (len(a) - 1) + _vertex(correlation, best)
    return Alignment(float(second.time[0] - first.time[0] + lag * STEP), peak)


def _uniform(signal: Signal) -> Array:
    base = np.arange(signal.time[0], signal.time[-1], STEP)
    values: Array = np.interp(base, signal.time, signal.rate)
    return values


def _correlation(a: Array, b: Array, least: int) -> Array:
    """Correlation coefficient of ``b`` and the shifted ``a`` where they overlap, for every shift, 0 for few."""
    a, b = a - a.mean(), b - b.mean()
    n = correlate(np.ones_like(b), np.ones_like(a), method="fft").round()
    n = np.maximum(n, 1.0)
    sums_a, squares_a = (correlate(np.ones_like(b), x, method="fft") / n for x in (a, a * a))
    sums_b, squares_b = (correlate(x, np.ones_like(a), method="fft") / n for x in (b, b * b))
    spread = np.maximum(squares_a - sums_a**2, 0.0) * np.maximum(squares_b - sums_b**2, 0.0)
    together = correlate(b, a, method="fft") / n - sums_a * sums_b
    known = (n >= least) & (spread > 1e-12 * a.var() * b.var())
    return np.asarray(np.where(known, together / np.sqrt(np.where(known, spread, 1.0)), 0.0), float)


def _vertex(values: Array, best: int) -> float:
    """Of the parabola through the best value and its neighbours, in steps from the best."""
    if not 0 < best < len(values) - 1:
        return 0.0
    before, here, after = values[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0
