"""What every method but the flapping ones works on: named signals of one manoeuvre on an even time base."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from logs.identification.results import Array


class Experiment(NamedTuple):
    """One manoeuvre, every signal (N,) in SI on one equally spaced time base."""

    name: str
    """-; what it is called in reports"""
    time: Array
    """s; (N,), equally spaced"""
    signals: Mapping[str, Array]
    """as `units`, by name; (N,) each, NaN where a sample was not measured"""
    units: Mapping[str, str]
    """SI unit by the signal's name"""
    smoothed: Mapping[str, str] = {}
    """-; method by which a signal was smoothed, by its name"""
    steady: bool = False
    """-; rows are independent steady readings: their order and time mean nothing"""

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)
