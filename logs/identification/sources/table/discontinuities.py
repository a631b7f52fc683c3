"""Manoeuvres written one behind the other under one running time: the motion jumps where one ends, as none does.

Fitted as one they share a start and biases that they do not have: Z_delta came out twice too large, outside its
interval. Where an angle or a rate is elsewhere from one sample to the next, and stays there, the record is cut, which
costs no more than a start and biases where it was one after all.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import cut
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array
from logs.identification.sources.table.maneuvers import Cut

STEADY = ("alpha", "beta", "theta", "phi", "p", "q", "r")
"""signals that go on where they were; an acceleration may follow an input at once, and speeds and heights are often
told more seldom than the rows"""
BESIDE = 4
"""-; samples on either side through which lines go"""
LEAST_PIECE = 16
"""-; samples on either side that are a manoeuvre"""
ABOVE_NOISE, ABOVE_MOTION, OF_RANGE = 8.0, 3.0, 0.05
"""-; a jump over the usual gap between the lines, over the largest step beside it, and over the signal's reach"""
STEPS = 2.5
"""-; of the least that the signal changes by, which is how finely it was told"""
WHOLE_TURN = 0.9 * 2.0 * np.pi
"""rad; from which on an angle went round and no further"""


register({
    "discontinuity": Entry(
        "{where}: {subject} jump at {times} s as no motion does; the record is cut there",
        "Maneuvers were written one after the other under one running time.",
        "set their limits in [manoeuvres]",
    ),
})  # fmt: skip


class _Joints(NamedTuple):
    """Where a record was put together."""

    places: tuple[int, ...]
    """-; first samples of what follows"""
    names: tuple[str, ...]
    """-; signals that jump"""


def apart(found: Cut) -> Cut:
    """The manoeuvres, cut where the motion jumps, which is said."""
    findings: list[Finding] = []
    fitted, held = (
        tuple(x for one in part for x in _pieces(one, findings)) for part in (found.fitted, found.held_out)
    )
    return found._replace(fitted=fitted, held_out=held, findings=(*found.findings, *findings)) if findings else found


def _pieces(one: Experiment, findings: list[Finding]) -> tuple[Experiment, ...]:
    joints = _joints(one)
    if not joints.places:
        return (one,)
    edges = (0, *joints.places, len(one.time))
    number, _, file = one.name.partition(" of ")
    told = ", ".join(f"{one.time[place]:.6g}" for place in joints.places)
    details = {"where": one.name, "times": told}
    findings.append(Finding("discontinuity", "warning", ", ".join(joints.names), details=details))
    return tuple(
        cut(one, slice(start, stop))._replace(name=f"{number}, part {place} of {file}")
        for place, (start, stop) in enumerate(pairwise(edges), 1)
    )


def _joints(one: Experiment) -> _Joints:
    known = [name for name in STEADY if name in one.signals]
    if not known or len(one.time) < 2 * LEAST_PIECE:
        return _Joints((), ())
    jumping = np.array([_jumps(np.asarray(one.signals[name], dtype=np.float64)) for name in known])
    jumping[:, : LEAST_PIECE - 1] = False
    jumping[:, len(one.time) - LEAST_PIECE :] = False
    places: list[int] = []
    for before in np.flatnonzero(jumping.any(axis=0)):
        if not places or before + 1 - places[-1] >= LEAST_PIECE:
            places.append(int(before) + 1)
    rows = [place - 1 for place in places]
    return _Joints(tuple(places), tuple(n for n, row in zip(known, jumping[:, rows], strict=True) if row.any()))


def _jumps(values: Array) -> Array:
    """(N - 1,) of bool; whether the signal is elsewhere from one sample to the next, and stays there."""
    steps, whole = np.abs(np.diff(values)), np.isfinite(values)
    moved = steps[steps > 0]
    if not len(moved) or not np.nanmedian(steps) > 0:  # told more seldom than the rows, or at rest: it has jumps
        return np.zeros(len(steps), dtype=bool)
    reach = float(np.ptp(np.percentile(values[whole], (1.0, 99.0))))
    gaps, beside = np.full((2, len(steps)), np.nan)
    inner = slice(BESIDE - 1, len(steps) - BESIDE + 1)
    gaps[inner] = _gaps(values)
    others = np.lib.stride_tricks.sliding_window_view(steps, 2 * BESIDE - 1)
    beside[inner] = np.delete(others, BESIDE - 1, axis=1).max(axis=1)  # not of the step itself
    usual = ABOVE_NOISE * 1.4826 * float(np.nanmedian(gaps)) if np.isfinite(gaps).any() else np.inf
    least = np.maximum(max(usual, OF_RANGE * reach, STEPS * float(moved.min())), ABOVE_MOTION * beside)
    return np.asarray((gaps > least) & (steps > least) & (steps < WHOLE_TURN))


def _gaps(values: Array) -> Array:
    """(N - 2 BESIDE + 1,); what lines through the samples before and those after leave open between two samples."""
    place = np.arange(BESIDE) - (BESIDE - 1) / 2.0
    before = 1.0 / BESIDE + place * (BESIDE / 2.0) / float(place @ place)
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * BESIDE)
    return np.asarray(np.abs(windows[:, BESIDE:] @ before[::-1] - windows[:, :BESIDE] @ before))
