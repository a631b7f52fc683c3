"""Results of identification: estimates with intervals, fit of each output, findings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.findings import Finding, of_severity

Array = NDArray[np.float64]
CONFIDENCE = 0.95
SURE = 0.99
"""-; with which the data must ask for what a model has no place for"""


class Estimate(NamedTuple):
    """One identified number with its 95 % interval."""

    name: str
    """-; the symbol in the source's equation"""
    unit: str
    """-; its unit"""
    value: float
    """as `unit`"""
    standard_error: float
    """as `unit`"""
    low: float
    """as `unit`; of the 95 % interval"""
    high: float
    """as `unit`; of the 95 % interval"""

    def contains(self, truth: float) -> bool:
        """Whether ``truth`` lies inside the interval."""
        return self.low <= truth <= self.high


class Unidentified(NamedTuple):
    """A number that this data does not give, and why."""

    name: str
    """-; the symbol in the source's equation"""
    reason: str
    """-; one clause"""


class FitSeries(NamedTuple):
    """One measured output of one manoeuvre beside what a model makes of it."""

    experiment: str
    """-; the manoeuvre's name"""
    output: str
    """-; what was fitted or predicted"""
    unit: str
    """-; SI"""
    time: Array
    """s; (M,), equally spaced"""
    measured: Array
    """as `unit`; (M,)"""
    model: Array
    """as `unit`; (M,)"""
    held_out: bool = False
    """-; not among the data that the model was fitted to: a prediction"""
    steady: float = 0.0
    """as `unit`; of the steady flight, from which Theil's coefficient counts: gravity alone is no prediction"""


class Information(str):
    """A note that tells what was done, and casts no doubt on a number as all other notes do."""

    __slots__ = ()


class Fitted(NamedTuple):
    """What any method hands to the report: its model, its numbers, and how they fit."""

    method: str
    """-; what the report calls it"""
    equations: tuple[str, ...]
    """-; the model, one equation in symbols or one sentence each"""
    estimates: tuple[Estimate, ...]
    unidentified: tuple[Unidentified, ...] = ()
    correlation: Array | None = None
    """-; (p, p), of the estimates in their order"""
    series: tuple[FitSeries, ...] = ()
    notes: tuple[str, ...] = ()
    """-; what was dropped, taken from elsewhere or decided, one sentence each; `Information` where it is no doubt"""
    validation: str = ""
    """-; how the held-out manoeuvres were predicted, or why none were, one sentence; empty where nothing is to say"""


def student_factor(degrees: float, confidence: float = CONFIDENCE) -> float:
    """Half width of the interval of ``confidence`` in standard errors for ``degrees`` of freedom (at least one)."""
    from scipy.special import stdtrit  # takes 0.3 s, which a flight need not wait for

    return float(stdtrit(max(degrees, 1.0), 0.5 + confidence / 2))


def estimate(name: str, unit: str, value: float, standard_error: float, degrees: float = math.inf) -> Estimate:
    """An `Estimate` with Student's interval for ``degrees`` of freedom."""
    half = student_factor(degrees) * standard_error
    return Estimate(name, unit, value, standard_error, value - half, value + half)


def estimates(names: dict[str, str], values: Array, covariance: Array, degrees: float) -> tuple[Estimate, ...]:
    """One `Estimate` per entry of ``names`` (name to unit), from ``values`` (p,) and ``covariance`` (p, p)."""
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = zip(names.items(), values, errors, strict=True)
    return tuple(estimate(name, unit, float(value), float(error), degrees) for (name, unit), value, error in rows)


Status = Literal["converged", "not converged", "diverged", "not identifiable"]


class EstimationResult(NamedTuple):
    """Result of one estimator."""

    method: str
    """-; key of the registry, such as ``output_error``"""
    subject: str = ""
    """-; what was identified: modes, aero, path, ..."""
    model: str = ""
    """-; name of the model; empty for a regression or a method without a model"""
    equations: tuple[str, ...] = ()
    """-; the model, one equation in symbols or one sentence each"""
    status: Status = "converged"
    estimates: tuple[Estimate, ...] = ()
    """the parameters that the data determines"""
    covariance: Array | None = None
    """(p, p); of the estimates in their order"""
    degrees: float = math.inf
    """-; degrees of freedom of the intervals"""
    derived: tuple[Estimate, ...] = ()
    """numbers computed from the estimates, such as frequency and damping of a mode"""
    series: tuple[FitSeries, ...] = ()
    """each fitted or predicted output beside its measurement"""
    samples: int = 0
    """-; fitted, over all experiments"""
    findings: tuple[Finding, ...] = ()
    initial: Mapping[str, float] = {}
    """SI; start values of the search by parameter; empty if there was no search"""
    fixed: Mapping[str, float] = {}
    """SI; parameters that were held at a value"""
    steps: tuple[Any, ...] = ()
    """steps of a stepwise regression"""

    @property
    def withheld(self) -> tuple[Finding, ...]:
        """Parameters (subject) without an estimate, with the code of the reason."""
        return of_severity(self.findings, "withheld")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings that cast doubt on a number."""
        return of_severity(self.findings, "warning")

    @property
    def correlation(self) -> Array | None:
        """Correlation matrix (p, p) of the estimates."""
        if self.covariance is None:
            return None
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        matrix: Array = self.covariance / np.outer(deviation, deviation)
        return matrix

    def value(self, name: str) -> float:
        """The estimate of one parameter.

        Raises:
            KeyError: the parameter has no estimate.
        """
        return {one.name: one.value for one in self.estimates}[name]
