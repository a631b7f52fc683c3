"""Agreement of methods, and prediction of whole flights that were not fitted."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from logs.identification.data.maneuvers import Maneuver
from logs.identification.models.modes import KINDS, Mode, ModesResult
from logs.identification.results import CONFIDENCE, Estimate, FitSeries
from logs.identification.statistics.fit_quality import Theil, theil
from wingbeat.text import pluralize

LITTLE = 0.005
"""-; of a frequency, and of a damping as it is: a smaller difference is no disagreement, however sure both are"""


class Gap(NamedTuple):
    """Two methods further apart on one number than their errors allow."""

    first: str
    second: str
    clause: str
    """-; by how much"""


def agreement(modes: tuple[Mode, ...]) -> tuple[bool | None, str]:
    """Whether the methods agree (None: fewer than two gave a number), and one sentence on it.

    A difference counts where it exceeds the interval of the difference, both half widths added in squares and
    widened for the number of pairs looked at (Bonferroni). Methods that share the same noise differ by less: the
    test is on the safe side.
    """
    kind = next((k for k in KINDS if sum(m.of_kind(k) is not None for m in modes) >= 2), None)
    if kind is None:
        return None, f"no comparison: {_uncompared(modes)}"
    compared = [mode for mode in modes if mode.of_kind(kind) is not None]
    gaps = [gap for kind in KINDS for gap in _gaps(modes, kind)]
    if gaps:
        return False, f"{_outlier(compared, gaps)}: " + "; ".join(gap.clause for gap in gaps[:3])
    return True, f"{_count(len(compared))} methods agree within the 95 % interval of their difference"


def _uncompared(modes: tuple[Mode, ...]) -> str:
    """Why there is nothing to compare; the reasons of those that give no number stand at each of them."""
    giving = [mode.method for mode in modes if any(mode.of_kind(kind) is not None for kind in KINDS)]
    if not giving:
        return "no method gives a number"
    return f"{giving[0]} alone gives a number" if len(giving) == 1 else "no two methods give the same mode"


def _count(number: int) -> str:
    return "the two" if number == 2 else f"all {number}"


def _gaps(modes: tuple[Mode, ...], kind: str) -> list[Gap]:
    found = [(mode.method, mode.of_kind(kind)) for mode in modes]
    pairs = list(combinations([(method, pair) for method, pair in found if pair is not None], 2))
    wider = _widening(2 * len(pairs))
    gaps = []
    for (first, a), (second, b) in pairs:
        for one, other in ((a.frequency, b.frequency), (a.damping, b.damping)):
            allowed = wider * float(np.hypot(one.high - one.value, other.high - other.value))
            allowed = max(allowed, LITTLE * (abs(one.value) if one.unit != "-" else 1.0))
            if abs(one.value - other.value) > allowed:
                gaps.append(Gap(first, second, _clause(first, second, one, other, allowed)))
    return gaps


def _widening(looks: int) -> float:
    """How much wider an interval must be for all of ``looks`` to hold at once."""
    from scipy.special import ndtri  # with the rest of scipy.special 0.3 s, which a flight need not wait for

    alone = (1 - CONFIDENCE) / 2
    return float(ndtri(alone / max(looks / 2, 1)) / ndtri(alone))


def _clause(first: str, second: str, one: Estimate, other: Estimate, allowed: float) -> str:
    unit = "" if one.unit == "-" else f" {one.unit}"
    gap = f"{one.value - other.value:+.3g}{unit}, more than {allowed:.2g}{unit}"
    return f"{one.name} of {first} differs from that of {second} by {gap}"


def _outlier(compared: list[Mode], gaps: list[Gap]) -> str:
    """Who disagrees with whom: one method against most others is named alone."""
    if len(compared) == 2:
        return "the two methods disagree"
    against = {mode.method: {other for g in gaps for other in _others(g, mode.method)} for mode in compared}
    worst = max(against, key=lambda method: len(against[method]))
    rest = [gap for gap in gaps if worst not in (gap.first, gap.second)]
    if len(against[worst]) >= 2 and not rest:
        return f"{worst} disagrees with {len(against[worst])} of the {len(compared) - 1} other methods"
    named = dict.fromkeys(name for gap in gaps for name in (gap.first, gap.second))
    return f"{len(named)} of {len(compared)} methods disagree"


def _others(gap: Gap, method: str) -> tuple[str, ...]:
    pair = (gap.first, gap.second)
    return tuple(name for name in pair if method in pair and name != method)


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
