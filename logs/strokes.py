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
"""Gap threshold in median periods of the wing topic: strokes in a longer pause are unknown."""
RESAMPLED = 64
"""-; default number of phases of a resampled stroke"""


class Strokes(NamedTuple):
    """Complete strokes in sequence, with pauses between runs of flapping and at gaps of the recording."""

    begin: Array
    """s; (M,), since boot"""
    end: Array
    """s; (M,), since boot"""
    number: NDArray[np.int64]
    """-; (M,), complete strokes since boot at its start"""

    @property
    def period(self) -> Array:
        """s; (M,), duration of each stroke."""
        return self.end - self.begin

    def slices(self, time: Array) -> list[slice]:
        """Return the slice of the samples at ``time`` (N,) in each stroke, its start included."""
        first, last = (np.searchsorted(time, each, side="left") for each in (self.begin, self.end))
        return [slice(int(low), int(high)) for low, high in zip(first, last, strict=True)]

    def means(self, time: Array, values: Array) -> Array:
        """Compute the mean of ``values`` (N,) or (N, k) over each stroke, (M,) or (M, k).

        The values are linear between samples. NaN if the samples do not span the stroke, or if two of them in it are
        further apart than its period. Unwrap angles first.
        """
        known = self._spanned(time)
        out = np.full((len(self.begin), *values.shape[1:]), np.nan)
        if known.any():
            out[known] = interval_mean(time, values.astype(np.float64), self.begin[known], self.end[known])
        return out

    def resampled(self, time: Array, values: Array, count: int = RESAMPLED) -> Array:
        """Resample ``values`` (N,) at ``count`` equal phase steps from 0 in each stroke: (M, count).

        The values are linear between samples, and the phase is linear in time within a stroke. NaN as in `means`.
        """
        at = self.begin[:, None] + self.period[:, None] * (np.arange(count) / count)
        out: Array = np.interp(at, time, values) if len(time) else np.full(at.shape, np.nan)
        out[~self._spanned(time)] = np.nan
        return out

    def _spanned(self, time: Array) -> NDArray[np.bool_]:
        """Return the strokes (M,) that samples at ``time`` (N,) span without a pause as long as the stroke."""
        if len(time) < 2 or not len(self.begin):
            return np.zeros(len(self.begin), bool)
        inside: NDArray[np.bool_] = (self.begin >= time[0]) & (self.end <= time[-1])
        first = np.clip(np.searchsorted(time, self.begin, side="right") - 1, 0, len(time) - 2)
        last = np.clip(np.searchsorted(time, self.end, side="left"), first + 1, len(time) - 1)
        bounds = np.column_stack((first, last)).ravel()
        # One more pause of zero length, since a stroke may end after the last sample.
        longest = np.maximum.reduceat(np.append(np.diff(time), 0.0), bounds)[::2]
        inside &= longest <= self.period
        return inside


def strokes(log: LogFile, start: float | None = None, end: float | None = None) -> Strokes:
    """Find the complete strokes in a log (from ``start`` to ``end``, s since boot) by the phase of ``/main/wing``.

    Raises:
        InputError: the log has no such topic, or a part of the file is damaged.
    """
    wing = log.columns(topics.WING, start, end)
    fields = ("phase", "strokes", "flapping")
    if any(field not in wing for field in fields):
        raise InputError(f"{log.path}: {topics.WING.name} has not the fields {', '.join(fields)}, which strokes need")
    return cut_strokes(wing.time, *(wing[field] for field in fields))


def cut_strokes(time: Array, phase: Array, count: NDArray[np.int64], flapping: NDArray[np.int64]) -> Strokes:
    """Find the complete strokes in the samples of a wing.

    Args:
        time: s; (N,).
        phase: rad; (N,), 0 to 2 pi.
        count: -; (N,), complete strokes since boot.
        flapping: -; (N,), 1 while the wings flap.
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
    """Yield the runs of samples in which the wings flap without a gap."""
    if len(time) < 2:
        return []
    step = np.diff(time)
    apart = (step > GAP_PERIODS * np.median(step)) | (np.diff(flapping) != 0)
    bounds = [0, *(np.flatnonzero(apart) + 1).tolist(), len(time)]
    return [slice(first, last) for first, last in itertools.pairwise(bounds) if flapping[first]]


# --- cuts and means -------------------------------------------------------------------------------------


def strokes_of(phase: Array) -> Array:
    """Return the strokes since the first sample, unwrapped and nondecreasing, from the wing ``phase`` in rad (N,)."""
    strokes: Array = np.maximum.accumulate(np.unwrap(phase)) / (2 * np.pi)
    return strokes


def time_at(time: Array, strokes: Array, stroke_counts: Array) -> Array:
    """Return the times (s) at which the stroke count ``strokes`` (N,) passed ``stroke_counts`` (M,), else NaN."""
    rising = np.concatenate(([True], np.diff(strokes) > 1e-9))
    found: Array = np.interp(stroke_counts, strokes[rising], time[rising], left=np.nan, right=np.nan)
    return found


def stroke_cuts(time: Array, strokes: Array) -> Array:
    """Return the times (s) at which a complete stroke ended and the next began."""
    stroke_counts = np.arange(np.ceil(strokes[0]), np.floor(strokes[-1]) + 1)
    return time_at(time, strokes, stroke_counts)


def integral(time: Array, values: Array, at: Array) -> Array:
    """Integrate ``values`` (N,) or (N, k) from ``time[0]`` to each time of ``at`` (M,), linear between samples."""
    columns = values.reshape(len(time), -1)
    width = np.diff(time)[:, None]
    whole = np.vstack((np.zeros(columns.shape[1]), np.cumsum(width * (columns[1:] + columns[:-1]) / 2, axis=0)))
    index = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    share = ((at - time[index]) / width[index, 0])[:, None]
    mean = columns[index] * (1 - share / 2) + columns[index + 1] * share / 2
    total: Array = whole[index] + mean * share * width[index]
    return total.reshape((len(at), *values.shape[1:]))


def interval_mean(time: Array, values: Array, start: Array, stop: Array) -> Array:
    """Average ``values`` (N,) or (N, k) over each interval from ``start`` (M,) to ``stop`` (M,), in seconds."""
    difference = integral(time, values, stop) - integral(time, values, start)
    means: Array = (difference.T / (stop - start)).T
    return means


def stroke_means(time: Array, values: Array, cuts: Array) -> Array:
    """Average ``values`` (N,) over each stroke between ``cuts`` (M,): (M - 1,)."""
    return interval_mean(time, values, cuts[:-1], cuts[1:])
