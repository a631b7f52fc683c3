"""How a model predicts whole flights that it was not fitted to: Theil's inequality, flight by flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.maneuvers import Manoeuvre
from logs.identification.estimators.flight.short_period import OUTPUT_ERROR
from logs.identification.estimators.flight.simulated_response import predicted
from logs.identification.models.modes import ModesResult
from logs.identification.results import FitSeries
from logs.identification.statistics.theil import Theil, theil
from wingbeat.text import pluralize


class Prediction(NamedTuple):
    """One output of one held-out flight, over all its manoeuvres."""

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
    """of the change from each manoeuvre's mean: gravity alone is no prediction"""


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
        return "; ".join(self._told(flight) for flight in self.held_out)

    def _told(self, flight: str) -> str:
        own = [one for one in self.predictions if one.flight == flight]
        shares = ", ".join(f"{one.output} {one.theil.coefficient:.3f}" for one in own if not one.theil.failure)
        return f"{flight} ({pluralize(own[0].manoeuvres, 'manoeuvre')}), predicted and not fitted: Theil's U {shares}"


def validation(result: ModesResult) -> Validation | None:
    """How output error's model predicts the held-out flights; None where nothing is held out.

    First states and sensors' biases are those of each manoeuvre (Jategaonkar, Flight Vehicle System Identification,
    2006, chapter 11).
    """
    if not result.held_out or result.problem is None:
        return None
    flights = tuple(dict.fromkeys(_flight(one) for one in result.held_out))
    fit = result.fits[0]
    if fit.failure:
        return Validation(flights, (), f"{' and '.join(flights)} not predicted: {OUTPUT_ERROR}: {fit.failure}")
    found: list[Prediction] = []
    for flight in flights:
        held = tuple(one for one in result.held_out if _flight(one) == flight)
        series = predicted(result.problem, fit, held)
        outputs = dict.fromkeys(one.output for one in series)
        found += [_prediction(flight, len(held), [s for s in series if s.output == name]) for name in outputs]
    return Validation(flights, tuple(found))


def _flight(one: Manoeuvre) -> str:
    return "" if one.flight is None else one.flight.name


def _prediction(flight: str, manoeuvres: int, series: list[FitSeries]) -> Prediction:
    measured, model = (np.concatenate([getattr(s, key) - s.steady for s in series]) for key in ("measured", "model"))
    rms = float(np.sqrt(np.mean((measured - model) ** 2)))
    return Prediction(flight, manoeuvres, series[0].output, series[0].unit, rms, theil(measured, model))
