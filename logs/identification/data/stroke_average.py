"""Stroke averages: what is left of a flapping aircraft's signals when the wing's own motion is taken out.

Flapping repeats itself every stroke, so the mean over exactly one measured wing period removes it and all
its harmonics. The same average taken of a linear model's inputs and outputs keeps their relation.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from logs.identification.results import Array
from logs.strokes import interval_mean, time_at


def wing_period(time: Array, strokes: Array, at: Array) -> Array:
    """Measured wing period (s) around each time of ``at`` (M,); NaN within half a stroke of the record's ends."""
    now = np.interp(at, time, strokes)
    return time_at(time, strokes, now + 0.5) - time_at(time, strokes, now - 0.5)


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
