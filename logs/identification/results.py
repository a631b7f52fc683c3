"""Results of identification: estimates with intervals, fit of each output, findings.

Each method returns one `EstimationResult`. Sets of results are `ModesResult` (every method), `AeroResult` (C_L, C_T,
C_m), `PathResult` and `FrequencyResult` (with their data), `Identification` (a log), `TableIdentification` (a map).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.findings import Finding, of_severity

Array = NDArray[np.float64]
CONFIDENCE = 0.95
SURE = 0.99
"""-; confidence of the tests that reject a model"""


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


class FitSeries(NamedTuple):
    """One measured output of one maneuver and the response of a model."""

    experiment: str
    """-; name of the maneuver"""
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
    """-; a prediction: not among the data that the model was fitted to"""
    steady: float = 0.0
    """as `unit`; of the steady flight, the reference of Theil's coefficient: gravity alone is no prediction"""
    independent: bool = False
    """-; the samples are steady readings without an order, which have no autocorrelation"""


class OutputFit(NamedTuple):
    """How one output of one maneuver follows the measurement."""

    experiment: str
    output: str
    unit: str
    held_out: bool
    """-; predicted, not fitted"""
    samples: int
    """-; with both measurement and model"""
    r_squared: float
    """-; NaN if the measurement is constant"""
    rms: float
    """as `unit`; root mean square of measured minus model"""
    theil: float
    """-; Theil's inequality coefficient, 0 for a perfect model, 1 for the worst"""
    white: bool | None
    """-; whether the residuals pass the whiteness tests; None if there are too few samples"""


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
    """each fitted or predicted output and its measurement"""
    samples: int = 0
    """-; fitted, over all experiments"""
    residual_deviation: float = math.nan
    """as the response; standard deviation of the residuals of a regression"""
    findings: tuple[Finding, ...] = ()
    initial: Mapping[str, float] = {}
    """SI; start values of the search by parameter; empty if there was no search"""
    fixed: Mapping[str, float] = {}
    """SI; parameters with a fixed value"""
    steps: tuple[Any, ...] = ()
    """steps of a stepwise regression"""
    title: str = ""
    """-; heading of the result in texts, such as "output error, short period" """
    response: str = ""
    """-; of a regression"""
    unnamed: Mapping[str, float] = {}
    """SI; parameters of the equations that the problem neither frees nor fixes, and the value of each"""
    chapters: tuple[Any, ...] = ()
    """`logs.pages.document.Chapter`; parts of the report that only this result has"""

    @property
    def failure(self) -> Finding | None:
        """The reason why there is no estimate at all; None if there is one."""
        return next((one for one in self.findings if one.severity == "withheld" and not one.subject), None)

    @property
    def withheld(self) -> tuple[Finding, ...]:
        """Parameters (subject) without an estimate, with the code of the reason."""
        return tuple(one for one in of_severity(self.findings, "withheld") if one.subject)

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
        matrix: Array = np.clip(self.covariance / np.outer(deviation, deviation), -1.0, 1.0)
        return matrix

    def value(self, name: str) -> float:
        """The estimate of one parameter.

        Raises:
            KeyError: the parameter has no estimate.
        """
        return {one.name: one.value for one in self.estimates}[name]

    def estimate(self, name: str) -> Estimate | None:
        """One parameter or derived number; None without an estimate."""
        return next((one for one in (*self.estimates, *self.derived) if one.name == name), None)


def linear_result(
    method: str, parameters: tuple[Estimate, ...], withheld: Iterable[Finding] = (), **more: Any
) -> EstimationResult:
    """Result of a regression; without ``parameters`` its failure is the first of the ``withheld``."""
    lost = tuple(withheld)
    if lost and not parameters:
        lost = (lost[0]._replace(subject=""), *lost)
    status: Status = "converged" if parameters else "not identifiable"
    return EstimationResult(
        method, more.pop("subject", method), status=status, estimates=parameters, findings=lost, **more
    )
