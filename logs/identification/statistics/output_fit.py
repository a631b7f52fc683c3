"""How each output of each manoeuvre follows the measurement, fitted or predicted."""

from __future__ import annotations

from logs.identification.results import FitSeries, OutputFit
from logs.identification.statistics.goodness import goodness
from logs.identification.statistics.theil import theil
from logs.identification.statistics.whiteness import whiteness_of


def output_fits(series: tuple[FitSeries, ...]) -> tuple[OutputFit, ...]:
    """One line for each measured output beside its model."""
    return tuple(_fit(one) for one in series)


def _fit(one: FitSeries) -> OutputFit:
    good, whiteness = goodness(one.measured, one.model), whiteness_of(one.measured - one.model)
    untested = one.independent or whiteness.failure
    return OutputFit(
        one.experiment, one.output, one.unit, one.held_out, good.samples, good.r_squared, good.rms,
        theil(one.measured, one.model).coefficient, None if untested else whiteness.white,
    )  # fmt: skip
