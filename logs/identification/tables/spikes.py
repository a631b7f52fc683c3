"""Samples of an output that are no noise and no motion: spikes, drop-outs, a channel that froze.

What a model leaves where it lacks something follows the motion, over neighbours that tell of each other: of a roll
acceleration 53 samples on end were more than 8 deviations off as an aileron moved, of a stall's buffet 121. To leave
those out would be to leave out what the flight tells. A spike stands apart from its own neighbours, and they do not
from one another; a channel that froze says the same number longer than anywhere else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from avionics.quantities import counted
from logs.identification.experiment import Experiment
from logs.identification.preparing.noise_level import MEDIAN_TO_DEVIATION
from logs.identification.results import Array, FitSeries
from logs.identification.tables.between import LEAST_RUN

Flags = NDArray[np.bool_]

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
                f"{one.experiment}: {counted(len(bad), 'sample')} of {one.output} from {one.time[bad[0]]:.6g} s on"
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
    found = np.zeros(len(left), bool)
    for begin, end in _runs(far):
        for a in range(begin, end):
            for b in range(a + 1, min(a + LONGEST, end) + 1):
                apart = all(_apart(one, a, b, OFF * deviation) for one in (measured, left))
                if apart and not _pushed(inputs, a, b):
                    found[a:b] = True
    places: list[int] = np.flatnonzero(found | _frozen(measured, far)).tolist()
    return places


def _runs(true: Flags) -> list[tuple[int, int]]:
    """Begin and end of each run of neighbours that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], true, [False])).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _apart(values: Array, a: int, b: int, least: float = 0.0) -> bool:
    """Whether ``values[a:b]`` jump away from the neighbours on both sides, by more than ``least``, and back."""
    places = np.arange(len(values))
    before, after = slice(max(a - BESIDE, 0), a), slice(b, b + BESIDE)
    sides = [(places[part][known], values[part][known]) for part in (before, after)
             for known in (np.isfinite(values[part]),)]  # fmt: skip
    if min(len(where) for where, _ in sides) < BESIDE - 2:
        return False
    (x0, y0), (x1, y1) = ((float(np.median(where)), float(np.median(what))) for where, what in sides)
    off = np.abs(values - (y0 + (y1 - y0) * (places - x0) / (x1 - x0)))
    near = np.concatenate([off[where] for where, _ in sides])
    shoulders = max(off[sides[0][0][-1]], off[sides[1][0][0]])
    return bool(np.min(off[a:b]) > max(least, APART * np.percentile(near, MOST_BESIDE), APART * shoulders))


def _pushed(inputs: Mapping[str, Array], a: int, b: int) -> bool:
    """Whether an input went away and back just before: what follows that is an answer."""
    return any(_apart(one, a - late, b - late) for one in inputs.values() for late in range(LATE + 1) if a >= late)


def _frozen(measured: Array, far: Flags) -> Flags:
    """(N,) of bool; the same number on end, far from the model, and longer than where the model follows."""
    same = np.append(np.diff(measured) == 0.0, False)
    runs = [(begin, end + 1) for begin, end in _runs(same)]
    held = [(begin, end) for begin, end in runs if np.any(far[begin:end])]
    elsewhere = max((end - begin for begin, end in runs if (begin, end) not in held), default=1)
    frozen = np.zeros(len(measured), bool)
    for begin, end in held:
        if end - begin >= max(FROZEN, TIMES_ELSEWHERE * elsewhere):
            frozen[begin:end] = True
    return frozen
