"""Stroke averages: what is left of a flapping aircraft's signals when the wing's own motion is taken out.

Flapping repeats itself every stroke, so the mean over exactly one measured wing period removes it and all
its harmonics. The same average taken of a linear model's inputs and outputs keeps their relation.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from logs.identification.results import Array


def strokes_of(phase: Array) -> Array:
    """Strokes since the first sample, unwrapped and never decreasing, from the wing ``phase`` in rad (N,)."""
    strokes: Array = np.maximum.accumulate(np.unwrap(phase)) / (2 * np.pi)
    return strokes


def time_at(time: Array, strokes: Array, wanted: Array) -> Array:
    """Time (s) at which the stroke count ``strokes`` (N,) passed ``wanted`` (M,); NaN outside the record."""
    rising = np.concatenate(([True], np.diff(strokes) > 1e-9))
    found: Array = np.interp(wanted, strokes[rising], time[rising], left=np.nan, right=np.nan)
    return found


def wing_period(time: Array, strokes: Array, at: Array) -> Array:
    """Measured wing period (s) around each time of ``at`` (M,); NaN within half a stroke of the record's ends."""
    now = np.interp(at, time, strokes)
    return time_at(time, strokes, now + 0.5) - time_at(time, strokes, now - 0.5)


def integral(time: Array, values: Array, at: Array) -> Array:
    """Integral of ``values`` (N,) or (N, k) from ``time[0]`` to each time of ``at`` (M,), linear between samples."""
    columns = values.reshape(len(time), -1)
    width = np.diff(time)[:, None]
    whole = np.vstack((np.zeros(columns.shape[1]), np.cumsum(width * (columns[1:] + columns[:-1]) / 2, axis=0)))
    index = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    share = ((at - time[index]) / width[index, 0])[:, None]
    mean = columns[index] * (1 - share / 2) + columns[index + 1] * share / 2
    total: Array = whole[index] + mean * share * width[index]
    return total.reshape((len(at), *values.shape[1:]))


def interval_mean(time: Array, values: Array, start: Array, stop: Array) -> Array:
    """Mean of ``values`` (N,) or (N, k) over each interval from ``start`` (M,) to ``stop`` (M,), in seconds."""
    difference = integral(time, values, stop) - integral(time, values, start)
    means: Array = (difference.T / (stop - start)).T
    return means


def stroke_average(time: Array, values: Array, period: Array, at: Array) -> Array:
    """Moving average of ``values`` (N,) or (N, k) over one wing ``period`` (M,) around each time of ``at`` (M,)."""
    return interval_mean(time, values, at - period / 2, at + period / 2)


def averaging_matrix(time: Array, period: Array, at: Array) -> csr_array:
    """The moving average of `stroke_average` as a sparse matrix (M, N), for signals that come again and again.

    ``time`` (N,) is equally spaced, and every average lies inside it.
    """
    step = float(time[1] - time[0])
    start, stop = ((at + side * period / 2 - time[0]) / step for side in (-1, 1))
    reach = np.arange(int(np.max(stop - start)) + 3)
    columns = np.floor(start).astype(int)[:, None] + reach
    weights = _under_hat(stop[:, None] - columns) - _under_hat(start[:, None] - columns)
    rows = np.broadcast_to(np.arange(len(at))[:, None], columns.shape)
    inside = (weights > 0) & (columns < len(time))
    scaled = weights * step / period[:, None]
    return csr_array((scaled[inside], (rows[inside], columns[inside])), shape=(len(at), len(time)))


def _under_hat(position: Array) -> Array:
    """Area of the triangle of base 2 and height 1 about 0, up to ``position``: linear interpolation's weight."""
    clipped = np.clip(position, -1, 1)
    return np.where(clipped < 0, (1 + clipped) ** 2 / 2, 1 - (1 - clipped) ** 2 / 2)


def stroke_cuts(time: Array, strokes: Array) -> Array:
    """Times (s) at which a whole stroke ended and the next began."""
    wanted = np.arange(np.ceil(strokes[0]), np.floor(strokes[-1]) + 1)
    return time_at(time, strokes, wanted)


def stroke_means(time: Array, values: Array, cuts: Array) -> Array:
    """Mean of ``values`` (N,) over each stroke between ``cuts`` (M,): (M - 1,)."""
    return interval_mean(time, values, cuts[:-1], cuts[1:])
