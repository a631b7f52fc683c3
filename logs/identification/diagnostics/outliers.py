"""Samples of an output that are no noise and no motion: spikes, drop-outs, a channel that froze.

What a model leaves where it lacks something follows the motion, over neighbours that tell of each other: of a roll
acceleration 53 samples on end were more than 8 deviations off as an aileron moved, of a stall's buffet 121. To leave
those out would be to leave out what the flight tells. A spike stands apart from its own neighbours, and they do not
from one another; a channel that froze says the same number longer than anywhere else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from logs.identification.data.contiguous_runs import runs
from logs.identification.data.experiment import Experiment
from logs.identification.data.noise_level import MEDIAN_TO_DEVIATION
from logs.identification.diagnostics.intersample_behavior import LEAST_RUN
from logs.identification.results import Array, FitSeries
from wingbeat.text import pluralize

Flags = NDArray[np.bool_]
Places = NDArray[np.intp]

OFF = 8.0
"""-; robust standard deviations of the residuals, from which a sample is no noise; one in 1e15 of normal noise"""
LONGEST = 8
"""-; samples on end that are called a spike"""
BESIDE = 5
"""-; neighbours on either side that a spike is measured by"""
APART = 3.0
"""-; by how many times as far as its neighbours' a spike is off the line through them"""
MOST_BESIDE = 80.0
"""%; of the neighbours, of which that is so: a second spike may be among them"""
FROZEN = 4
"""-; same numbers on end, at the least, of a channel that froze"""
TIMES_ELSEWHERE = 2.0
"""-; by how many times as long as those elsewhere, which a coarse converter makes"""
LATE = 2
"""-; samples by which what a short push of an input does may come later"""


def spikes(series: Sequence[FitSeries], experiments: Sequence[Experiment], inputs: Sequence[str]) -> tuple[str, ...]:
    """What is said of outputs with samples that stand for nothing; ``experiments`` tell the ``inputs`` beside."""
    flown = {(one.name, float(one.time[0])): one for one in experiments}
    told = []
    for one in series:
        beside = flown.get((one.experiment, float(one.time[0])))
        pushed = {} if beside is None else {name: np.asarray(beside.signals[name]) for name in inputs}
        bad = _bad(one.measured, one.measured - one.model, pushed)
        if bad:
            told.append(
                f"{one.experiment}: {pluralize(len(bad), 'sample')} of {one.output} from {one.time[bad[0]]:.6g} s on"
                f" {'is' if len(bad) == 1 else 'are'} off by more than {OFF:.0f} times the usual, apart from"
                f" {'its' if len(bad) == 1 else 'their'} neighbours or frozen: spikes, drop-outs?"
                " missing = [...] leaves them out"
            )
    return tuple(told)


def _bad(measured: Array, left: Array, inputs: Mapping[str, Array]) -> list[int]:
    """Places of the samples that are spikes or frozen; ``left`` (N,) is what the model leaves of ``measured``."""
    known = left[np.isfinite(left)]
    if len(known) < LEAST_RUN:
        return []
    middle = float(np.median(known))
    deviation = MEDIAN_TO_DEVIATION * float(np.median(np.abs(known - middle)))
    far = np.abs(left - middle) > OFF * deviation if deviation else np.zeros(len(left), bool)
    found, starts = np.zeros(len(left), bool), np.flatnonzero(far)
    for length in range(1, LONGEST + 1):
        starts = starts[starts + length <= len(left)]
        starts = starts[far[starts + length - 1]]
        apart = starts
        for one in (measured, left):
            apart = apart[_apart(one, apart, length, OFF * deviation)]
        for place in apart[~_pushed(inputs, apart, length)]:
            found[place : place + length] = True
    places: list[int] = np.flatnonzero(found | _frozen(measured, far)).tolist()
    return places


def _apart(values: Array, starts: Places, length: int, least: float = 0.0) -> Flags:
    """Whether ``values`` jump away from the neighbours on both sides, by more than ``least``, and back.

    So for each of the ``starts`` (n,) and as many samples from there on as the ``length``; neighbours that are not
    measured, or beyond the record's ends, do not count; one is enough where no more are left to an end.
    """
    padded = np.concatenate((np.full(BESIDE, np.nan), values, np.full(BESIDE + length, np.nan)))
    seen, places = sliding_window_view(padded, length + 2 * BESIDE)[starts], np.arange(length + 2.0 * BESIDE)
    sides = (slice(0, BESIDE), slice(BESIDE + length, None))
    known = [np.isfinite(seen[:, side]) for side in sides]
    room = (starts, len(values) - length - starts)
    needed = [np.clip(one, 1, BESIDE - 2) for one in room]
    enough = np.all([np.sum(one, axis=1) >= few for one, few in zip(known, needed, strict=True)], axis=0)
    told, seen, known = np.zeros(len(starts), bool), seen[enough], [one[enough] for one in known]
    (x0, y0), (x1, y1) = (
        (_quantile(np.where(one, places[side], np.nan), 50.0), _quantile(np.where(one, seen[:, side], np.nan), 50.0))
        for side, one in zip(sides, known, strict=True)
    )
    off = np.abs(seen - (y0 + (y1 - y0) / (x1 - x0) * (places[:, None] - x0)).T)
    before, after = (np.where(one, off[:, side], np.nan) for side, one in zip(sides, known, strict=True))
    rows = np.arange(len(seen))
    last, first = BESIDE - 1 - np.argmax(known[0][:, ::-1], axis=1), np.argmax(known[1], axis=1)
    shoulders = np.maximum(before[rows, last], after[rows, first])
    near = np.maximum(_quantile(np.hstack((before, after)), MOST_BESIDE), shoulders)
    told[enough] = np.min(off[:, BESIDE : BESIDE + length], axis=1) > np.maximum(least, APART * near)
    return told


def _quantile(values: Array, percent: float) -> Array:
    """(n,); of what is known, at least one, in each row of ``values`` (n, k)."""
    rows, ordered = np.arange(len(values)), np.sort(values, axis=1)
    place = percent / 100.0 * (np.sum(np.isfinite(values), axis=1) - 1)
    low, high = np.floor(place).astype(int), np.ceil(place).astype(int)
    share = place - low
    return np.asarray((1.0 - share) * ordered[rows, low] + share * ordered[rows, high])


def _pushed(inputs: Mapping[str, Array], starts: Places, length: int) -> Flags:
    """Whether an input went away and back just before each of the ``starts``: what follows that is an answer."""
    pushed = np.zeros(len(starts), bool)
    for one in inputs.values():
        for late in range(LATE + 1):
            there = starts >= late
            pushed[there] |= _apart(one, starts[there] - late, length)
    return pushed


def _frozen(measured: Array, far: Flags) -> Flags:
    """(N,) of bool; the same number on end, far from the model, and longer than where the model follows."""
    same = np.append(np.diff(measured) == 0.0, False)
    equal = [(run.start, run.stop + 1) for run in runs(same)]
    held = [(begin, end) for begin, end in equal if np.any(far[begin:end])]
    elsewhere = max((end - begin for begin, end in equal if (begin, end) not in held), default=1)
    frozen = np.zeros(len(measured), bool)
    for begin, end in held:
        if end - begin >= max(FROZEN, TIMES_ELSEWHERE * elsewhere):
            frozen[begin:end] = True
    return frozen
