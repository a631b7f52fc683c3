"""Chapter of the wings' coefficients: terms, numbers, and every step by which the terms were chosen."""

from __future__ import annotations

from collections.abc import Mapping

from logs.identification.estimators.wing_coefficients import AeroResult, CoefficientModel
from logs.identification.report.document import Bar, Chapter, Intervals
from logs.identification.report.labels import sentence
from logs.identification.report.steps import step_table

MODEL = (
    "Lift, thrust and pitching moment of the wings, found by the equations of motion (Grauer Eq. 13), over the"
    " dynamic pressure at the mean aerodynamic centre (Eq. 14 to 16), as sums of terms"
    " that a stepwise regression chose."
)


def aero_chapter(found: AeroResult, truths: Mapping[str, float]) -> Chapter:
    """What was taken from where, and a part for each of C_L, C_T and C_m."""
    notes = (MODEL, f"From {', '.join(found.records)}.", *map(sentence, found.notes))
    return Chapter("Wing coefficients", notes, parts=tuple(_part(one, truths) for one in found.models))


def _part(model: CoefficientModel, truths: Mapping[str, float]) -> Chapter:
    bars = tuple(Bar(e.name, e, truths.get(e.name)) for e in model.estimates)
    told = f"{100 * model.r_squared:.1f} % of its variance by these terms, {model.samples} samples."
    refused = [f"Not identified: {one.name}: {one.reason}." for one in model.unidentified]
    tables = (step_table(model.steps),) if model.steps else ()
    return Chapter(model.name, (told, *refused), tables, (Intervals("", bars),) if bars else ())
