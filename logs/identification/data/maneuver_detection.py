"""From a flight to its manoeuvres by the logged excitation, any control and any kind of aircraft."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import cut
from logs.identification.results import Array
from wingbeat.errors import InputError

NEEDED = ("active", "manoeuvre", "aborted")
"""signals: 1 while a manoeuvre runs, its number, 1 where an envelope limit ended it"""


def excited(flight: Experiment, lead: float = 0.0, tail: float = 0.0) -> tuple[Experiment, ...]:
    """One experiment for each whole manoeuvre, ``lead`` s longer before and ``tail`` s behind where none other runs.

    They are called FLIGHT, manoeuvre NUMBER. One that was aborted, or that the record's ends cut, is left out.

    Raises:
        InputError: the flight tells no excitation, or has no whole manoeuvre.
    """
    missing = [name for name in NEEDED if name not in flight.signals]
    if missing:
        raise InputError(f"{flight.name} has no signal {', '.join(missing)} to find its manoeuvres by")
    active, number, aborted = (flight.signals[name] for name in NEEDED)
    spans = [s for s in maneuver_spans(active, number, aborted) if s.start > 0 and s.stop < len(active)]
    if not spans:
        raise InputError(f"{flight.name} has no whole manoeuvre that was not aborted")
    before, behind = (int(seconds / flight.step + 1e-6) for seconds in (lead, tail))
    free = ~((active > 0) & np.isfinite(number))
    return tuple(
        cut(flight, _widened(free, span, before, behind))._replace(
            name=f"{flight.name}, manoeuvre {number[span.start]:.0f}"
        )
        for span in spans
    )


def maneuver_spans(active: Array, number: Array, aborted: Array) -> list[slice]:
    """Samples of each manoeuvre, by its ``number`` while ``active``, but those that were ``aborted``; all (N,)."""
    label = np.where((active > 0) & np.isfinite(number), number, np.nan)
    same = (label[1:] == label[:-1]) | (np.isnan(label[1:]) & np.isnan(label[:-1]))
    bounds = np.concatenate(([0], np.flatnonzero(~same) + 1, [len(label)]))
    spans = [slice(int(a), int(b)) for a, b in pairwise(bounds) if np.isfinite(label[a])]
    return [span for span in spans if not was_aborted(number, aborted, label[span.start])]


def was_aborted(number: Array, aborted: Array, one: float) -> bool:
    """Whether an envelope limit ended manoeuvre ``one``."""
    return bool(np.any(aborted[number == one] > 0))


def _widened(free: NDArray[np.bool_], span: slice, before: int, behind: int) -> slice:
    start, stop = span.start, span.stop
    while start > 0 and span.start - start < before and free[start - 1]:
        start -= 1
    while stop < len(free) and stop - span.stop < behind and free[stop]:
        stop += 1
    return slice(start, stop)
