"""Experiment: named signals of one maneuver on an equally spaced time base."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.results import Array


class Experiment(NamedTuple):
    """One maneuver, every signal (N,) in SI on one equally spaced time base."""

    name: str
    """-; label in reports"""
    time: Array
    """s; (N,), equally spaced"""
    signals: Mapping[str, Array]
    """as `units`, by name; (N,) each, NaN if a sample was not measured"""
    units: Mapping[str, str]
    """SI unit by the signal's name"""
    smoothed: Mapping[str, str] = {}
    """-; method by which a signal was smoothed, by its name"""
    steady: bool = False
    """-; rows are independent steady readings: their order and time mean nothing"""
    file: str = ""
    """-; name of the file that it was read from"""
    number: int = 0
    """-; of the maneuver, from 1; 0 without one"""

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def runs(mask: NDArray[np.bool_]) -> list[slice]:
    """The contiguous runs in which ``mask`` (N,) is true, in order."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    return [slice(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def longest_run(mask: NDArray[np.bool_]) -> slice:
    """The first of the longest `runs`; an empty slice if there is none."""
    return max(runs(mask), key=lambda run: run.stop - run.start, default=slice(0, 0))
