"""Finds the elevator's inputs by its motion, for logs in which no excitation topic tells them.

An input is a movement from rest to rest: doublets, 3-2-1-1 and pulses, by a program or by hand. What a stabilisation
moves never rests, so that its answers to the motion, which would be taken for its cause, are not among them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array
from wingbeat.errors import InputError

QUICK = 0.1
"""s; in which the elevator moves by `LEAST_STEP` at the least"""
LEAST_STEP = 0.02
"""rad; less is trimmed, not excited"""
GAP = 0.5
"""s; steps closer together are one input"""
LONGEST = 2.5
"""s; what moves longer is flown by its loops or trimmed"""
REST = 0.4
"""s; that the elevator stands still before and behind an input, at the least ..."""
LONGEST_REST = 1.0, 2.0
"""s; ... and that is taken before and behind it, at the most"""
STILL = 0.1
"""-; of the input's size: how far it moves while it stands still"""
FLAPPING = 0.75
"""-; of the usual stroke rate: a slower one is no flapping flight"""


class Inputs(NamedTuple):
    """What an excitation topic would have told, every array (N,)."""

    active: Array
    """-; 1 from the rest before an input to that behind it"""
    manoeuvre: Array
    """-; number of the input, from 1; 0 where there is none"""
    excitation: Array
    """rad; elevator minus its value at rest before"""


class _Span(NamedTuple):
    """Samples of one input."""

    start: int
    """first of the rest before"""
    first: int
    last: int
    """of the movement"""
    stop: int
    """behind the rest that follows"""


def find_inputs(time: Array, elevator: Array, strokes: Array) -> Inputs:
    """The inputs in the ``elevator`` command (rad) flown with flapping wings; ``time`` (s) equally spaced, all (N,).

    Raises:
        InputError: there is none.
    """
    step = float(time[1] - time[0])
    found = [span for first, last in _movements(elevator, step) if (span := _at_rest(elevator, step, first, last))]
    rates = [float(strokes[span.stop - 1] - strokes[span.start]) / (span.stop - span.start) for span in found]
    flown = [span for span, rate in zip(found, rates, strict=True) if rate > FLAPPING * max(rates)]
    active, number, excitation = (np.zeros(len(time)) for _ in range(3))
    for count, span in enumerate(flown, 1):
        active[span.start : span.stop] = 1.0
        number[span.start : span.stop] = count
        moved = slice(span.first, span.last + 1)
        excitation[moved] = elevator[moved] - np.mean(elevator[span.start : span.first])
    if not flown:
        raise InputError("its elevator nowhere moves quickly from rest to rest in flapping flight")
    return Inputs(active, number, excitation)


def _movements(elevator: Array, step: float) -> list[tuple[int, int]]:
    """First and last sample of each quick movement, with what of it may be slower before and behind."""
    behind = max(round(QUICK / step), 1)
    change = np.abs(elevator[behind:] - elevator[:-behind])
    quick = np.flatnonzero(change > LEAST_STEP)
    if not len(quick):
        return []
    apart = np.flatnonzero(np.diff(quick) * step > GAP)
    firsts, lasts = quick[[0, *(apart + 1)]], quick[[*apart, -1]]
    return [(int(first), int(last) + behind) for first, last in zip(firsts, lasts, strict=True)]


def _at_rest(elevator: Array, step: float, first: int, last: int) -> _Span | None:
    """A movement with the rest before and behind it; None where it does not rest, or lasts too long."""
    least, before, behind = (round(seconds / step) for seconds in (REST, *LONGEST_REST))
    if first < least or last + least >= len(elevator) or (last - first) * step > LONGEST:
        return None
    base = float(np.median(elevator[first - least : first]))
    size = float(np.max(np.abs(elevator[first : last + 1] - base)))
    earlier = _still(elevator[max(first - before, 0) : first][::-1], STILL * size)
    later = _still(elevator[last + 1 : last + 1 + behind], STILL * size)
    return _Span(first - earlier, first, last, last + 1 + later) if min(earlier, later) >= least else None


def _still(elevator: Array, within: float) -> int:
    """How many samples, from the first on, lie within so much (rad) of each other."""
    spread = np.maximum.accumulate(elevator) - np.minimum.accumulate(elevator)
    return int(np.argmax(spread > within)) if np.any(spread > within) else len(elevator)
