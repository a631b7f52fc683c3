"""Wing strokes: start, end, and signals in each stroke.

A stroke runs from one phase 0 to the next: the wings pass the stroke's middle upwards. Flapping repeats itself every
stroke, so the mean over exactly one removes it and all its harmonics.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.log_file import LogFile
from wingbeat.errors import InputError

Array = NDArray[np.float64]
GAP_PERIODS = 5.0
"""A pause in the wing's topic longer than this many median periods: nobody knows the strokes in it."""
RESAMPLED = 64
"""-; phases of a stroke that is resampled, if nothing is asked"""


class Strokes(NamedTuple):
    """Whole strokes in their order, with a pause between two where the wings stood still or nothing was recorded."""

    begin: Array
    """s; (M,), since boot"""
    end: Array
    """s; (M,), since boot"""
    number: NDArray[np.int64]
    """-; (M,), full strokes since boot when it began"""

    @property
    def period(self) -> Array:
        """s; (M,), how long each took."""
        return self.end - self.begin

    def slices(self, time: Array) -> list[slice]:
        """Which of the samples at ``time`` (N,) lie in each stroke, one at its begin included."""
        first, last = (np.searchsorted(time, each, side="left") for each in (self.begin, self.end))
        return [slice(int(low), int(high)) for low, high in zip(first, last, strict=True)]

    def means(self, time: Array, values: Array) -> Array:
        """Mean of ``values`` (N,) or (N, k) in each stroke, (M,) or (M, k), linear between samples.

        NaN where the samples do not span the stroke, or two of them in it are further apart than it is long. An angle
        that wraps is to be unwrapped before.
        """
        known = self._spanned(time)
        out = np.full((len(self.begin), *values.shape[1:]), np.nan)
        if known.any():
            out[known] = interval_mean(time, values.astype(np.float64), self.begin[known], self.end[known])
        return out

    def resampled(self, time: Array, values: Array, count: int = RESAMPLED) -> Array:
        """``values`` (N,) at ``count`` equal steps of phase, from 0 on, in each stroke: (M, count).

        Linear between samples; the phase grows evenly in time within a stroke. NaN as in `means`.
        """
        at = self.begin[:, None] + self.period[:, None] * (np.arange(count) / count)
        out: Array = np.interp(at, time, values) if len(time) else np.full(at.shape, np.nan)
        out[~self._spanned(time)] = np.nan
        return out

    def _spanned(self, time: Array) -> NDArray[np.bool_]:
        """Strokes (M,) that samples at ``time`` (N,) span without a pause as long as the stroke."""
        if len(time) < 2 or not len(self.begin):
            return np.zeros(len(self.begin), bool)
        inside: NDArray[np.bool_] = (self.begin >= time[0]) & (self.end <= time[-1])
        first = np.clip(np.searchsorted(time, self.begin, side="right") - 1, 0, len(time) - 2)
        last = np.clip(np.searchsorted(time, self.end, side="left"), first + 1, len(time) - 1)
        bounds = np.column_stack((first, last)).ravel()
        # One more pause of no length, since a stretch may end behind the last.
        longest = np.maximum.reduceat(np.append(np.diff(time), 0.0), bounds)[::2]
        inside &= longest <= self.period
        return inside


def strokes(log: LogFile, start: float | None = None, end: float | None = None) -> Strokes:
    """The whole strokes in a log (s since boot, from ``start`` to ``end``) by the phase of ``/main/wing``.

    Raises:
        InputError: the log has no such topic, or a part of the file is damaged.
    """
    wing = log.columns(topics.WING, start, end)
    fields = ("phase", "strokes", "flapping")
    if any(field not in wing for field in fields):
        raise InputError(f"{log.path}: {topics.WING.name} has not the fields {', '.join(fields)}, which strokes need")
    return cut_strokes(wing.time, *(wing[field] for field in fields))


def cut_strokes(time: Array, phase: Array, count: NDArray[np.int64], flapping: NDArray[np.int64]) -> Strokes:
    """Whole strokes of a wing's samples.

    Args:
        time: s; (N,).
        phase: rad; (N,), 0 to 2 pi.
        count: -; (N,), full strokes since boot.
        flapping: -; (N,), 1 while a stroke is measured.
    """
    good = np.isfinite(phase)
    good[1:] &= time[1:] > np.maximum.accumulate(time)[:-1]
    runs = [run for run in _runs(time[good], flapping[good]) if run.stop - run.start > 1]
    time, phase, count = time[good], phase[good], count[good]
    cut = [stroke_cuts(time[run], strokes_of(phase[run])) for run in runs]
    begin = np.concatenate([np.empty(0), *(cuts[:-1] for cuts in cut)])
    end = np.concatenate([np.empty(0), *(cuts[1:] for cuts in cut)])
    middle = np.searchsorted(time, (begin + end) / 2, side="right") - 1
    return Strokes(begin, end, count[middle].astype(np.int64))


def _runs(time: Array, flapping: NDArray[np.int64]) -> list[slice]:
    """Samples that belong together: the wings flap, and no pause lies between them."""
    if len(time) < 2:
        return []
    step = np.diff(time)
    apart = (step > GAP_PERIODS * np.median(step)) | (np.diff(flapping) != 0)
    bounds = [0, *(np.flatnonzero(apart) + 1).tolist(), len(time)]
    return [slice(first, last) for first, last in itertools.pairwise(bounds) if flapping[first]]


# --- cuts and means -------------------------------------------------------------------------------------


def strokes_of(phase: Array) -> Array:
    """Strokes since the first sample, unwrapped and never decreasing, from the wing ``phase`` in rad (N,)."""
    strokes: Array = np.maximum.accumulate(np.unwrap(phase)) / (2 * np.pi)
    return strokes


def time_at(time: Array, strokes: Array, stroke_counts: Array) -> Array:
    """Time (s) at which the stroke count ``strokes`` (N,) passed ``stroke_counts`` (M,); NaN outside the record."""
    rising = np.concatenate(([True], np.diff(strokes) > 1e-9))
    found: Array = np.interp(stroke_counts, strokes[rising], time[rising], left=np.nan, right=np.nan)
    return found


def stroke_cuts(time: Array, strokes: Array) -> Array:
    """Times (s) at which a whole stroke ended and the next began."""
    stroke_counts = np.arange(np.ceil(strokes[0]), np.floor(strokes[-1]) + 1)
    return time_at(time, strokes, stroke_counts)


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


def stroke_means(time: Array, values: Array, cuts: Array) -> Array:
    """Mean of ``values`` (N,) over each stroke between ``cuts`` (M,): (M - 1,)."""
    return interval_mean(time, values, cuts[:-1], cuts[1:])
