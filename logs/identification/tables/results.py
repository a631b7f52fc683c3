"""What a fit to a table comes to: numbers with intervals and starts, fit of each output, what was held out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.stepwise import Step
from logs.identification.models.modes import ModesResult
from logs.identification.report.document import Chapter
from logs.identification.results import Estimate, Fitted, Unidentified
from logs.identification.statistics.correlation import Pair, strong_pairs

LITTLE = 0.5
"""-; R^2 under which a model is said to explain little"""
EXPLAINS_LITTLE = "the model explains less than half of every output"


class OutputFit(NamedTuple):
    """How one output of one manoeuvre follows the measurement."""

    experiment: str
    output: str
    unit: str
    held_out: bool
    """-; predicted, not fitted"""
    samples: int
    """-; that both have"""
    r_squared: float
    """-; NaN where the measured does not vary"""
    rms: float
    """as `unit`; root mean square of measured minus model"""
    theil: float
    """-; Theil's inequality coefficient, 0 for a perfect model, 1 for the worst"""
    white: bool | None
    """-; whether the residuals' autocorrelation is that of white noise; None where too few samples tell"""


class TableFit(NamedTuple):
    """One fit that a map asked for."""

    subject: str
    """-; modes or aero"""
    fitted: Fitted
    converged: bool
    failure: str
    """-; why there are no numbers, empty where there are"""
    starts: Mapping[str, float]
    """SI; where the search began, by parameter; empty where there was none"""
    fixed: Mapping[str, float]
    """SI; what the map holds, by parameter"""
    outputs: tuple[OutputFit, ...]
    samples: int
    """-; fitted, over all manoeuvres"""
    model: str = ""
    """-; what the map calls the model; empty of a regression"""
    steps: tuple[Step, ...] = ()
    """of a stepwise regression"""
    chapters: tuple[Chapter, ...] = ()
    """of the report, beside those that every fit has"""
    modes: tuple[Estimate, ...] = ()
    """of a lateral model: what its Dutch roll, roll and spiral are known by"""
    lost: tuple[Unidentified, ...] = ()
    """those modes that it does not tell, and why"""
    unnamed: Mapping[str, float] = {}
    """SI; parameters in the model's equations that the map neither frees nor holds, and what they were left at"""

    @property
    def correlated(self) -> tuple[Pair, ...]:
        """Pairs of estimates that the data tells only together."""
        if self.fitted.correlation is None:
            return ()
        return strong_pairs(tuple(one.name for one in self.fitted.estimates), self.fitted.correlation)


class TableIdentification(NamedTuple):
    """Everything that was identified from one or several tables."""

    files: tuple[str, ...]
    experiments: tuple[str, ...]
    """-; names of the manoeuvres that were fitted"""
    held_out: tuple[str, ...]
    """-; names of those that were only predicted"""
    fits: tuple[TableFit, ...]
    modes: ModesResult | None
    """by every method; None where not asked for"""
    notes: tuple[str, ...]
    """-; what was dropped, filled or found strange, one sentence each"""
    missing: tuple[Unidentified, ...] = ()
    """what was asked for and is not to be had, and why"""
    records: tuple[Experiment, ...] = ()
    """the manoeuvres, fitted ones first"""
    inputs: tuple[str, ...] = ()
    """-; signals that the map calls inputs"""
    constants: Mapping[str, float] = {}
    """SI; what the map tells of the vehicle"""
    delays: tuple[Estimate, ...] = ()
    """s; by which signals were measured to be late, by their names"""


def finite(value: float | None) -> float | None:
    """A number as JSON can have it: None where it is not finite."""
    return float(value) if value is not None and math.isfinite(value) else None
