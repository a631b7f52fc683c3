"""How a model predicts whole flights that it was not fitted to: Theil's inequality, flight by flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.maneuvers import Maneuver
from logs.identification.models.modes import ModesResult
from logs.identification.results import FitSeries
from logs.identification.statistics.fit_quality import Theil, theil
from wingbeat.text import pluralize


class Prediction(NamedTuple):
    """One output of one held-out flight, over all its maneuvers."""

    flight: str
    """-; name of its log"""
    manoeuvres: int
    """-; how many were predicted"""
    output: str
    """-; q, a_x or a_z"""
    unit: str
    """-; SI"""
    rms: float
    """as `unit`; root mean square of measured minus predicted"""
    theil: Theil
    """of the change from each maneuver's mean: gravity alone is no prediction"""


class Validation(NamedTuple):
    """What was held out, and how it was predicted."""

    held_out: tuple[str, ...]
    """-; names of the flights"""
    predictions: tuple[Prediction, ...]
    failure: str = ""
    """-; why there are none, empty where there are"""

    @property
    def statement(self) -> str:
        """One clause a flight."""
        if self.failure:
            return self.failure
        return "; ".join(self._flight_statement(flight) for flight in self.held_out)

    def _flight_statement(self, flight: str) -> str:
        own = [one for one in self.predictions if one.flight == flight]
        shares = ", ".join(f"{one.output} {one.theil.coefficient:.3f}" for one in own if not one.theil.failure)
        return f"{flight} ({pluralize(own[0].manoeuvres, 'maneuver')}), predicted and not fitted: Theil's U {shares}"


def validation(result: ModesResult) -> Validation | None:
    """How output error's model predicts the flights that were held out; None if there are none.

    Initial states and sensor biases are those of each maneuver (Jategaonkar, Flight Vehicle System Identification,
    2006, chapter 11).
    """
    if not result.held_out or not result.results:
        return None
    flights = tuple(dict.fromkeys(_flight(one) for one in result.held_out))
    by_output = result.results[0]
    if by_output.status != "converged":
        why = "; ".join(one.text for one in by_output.findings)
        return Validation(flights, (), f"{' and '.join(flights)} not predicted: {by_output.method}: {why}")
    predictions: list[Prediction] = []
    for flight in flights:
        names = {one.name for one in result.held_out if _flight(one) == flight}
        series = [one for one in by_output.series if one.held_out and one.experiment in names]
        outputs = dict.fromkeys(one.output for one in series)
        predictions += [_prediction(flight, len(names), [s for s in series if s.output == name]) for name in outputs]
    return Validation(flights, tuple(predictions))


def _flight(one: Maneuver) -> str:
    return "" if one.flight is None else one.flight.name


def _prediction(flight: str, maneuvers: int, series: list[FitSeries]) -> Prediction:
    measured, model = (np.concatenate([getattr(s, key) - s.steady for s in series]) for key in ("measured", "model"))
    rms = float(np.sqrt(np.mean((measured - model) ** 2)))
    return Prediction(flight, maneuvers, series[0].output, series[0].unit, rms, theil(measured, model))
