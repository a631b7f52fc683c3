"""[stroke] of a map: mean coefficients of up- and down-stroke from the wings' angle, the stream and their force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.stroke_coefficients import (
    LEAST_STROKES,
    Flight,
    derivative_fit,
    stroke_chapter,
    stroke_fit,
)
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.stroke_averaged import Attitude
from logs.identification.models.wing_strokes import (
    Flapped,
    Planform,
    measured_strokes,
    planform_of,
    strokes_by_angle,
    strokes_by_count,
)
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.table.derived import Source, signal
from logs.identification.sources.table.maneuvers import DataSplit
from logs.identification.sources.table.quantities import need
from logs.strokes import interval_mean
from wingbeat.errors import InputError
from wingbeat.text import pluralize


class StrokeSection(NamedTuple):
    """Section [stroke]."""

    planform: tuple[tuple[float, float], ...]
    """m; distance from the flapping axis and chord there, of one wing"""
    flap: str = "flap"
    force_x: str = "force_x"
    force_z: str = "force_z"
    strokes: str | None = None
    """a signal that counts them; by the wings' angle if not given"""
    wings: int = 2
    """that the force is of"""
    derivatives: bool = False
    """Eq. 20 to 25 over the strokes"""
    elevator: str | None = None
    stiffness: str | None = None
    moment: str | None = None


LARGEST = 10.0
"""-; larger than the mean coefficient of any wing: a plate normal to the stream has 2, a fly's wing 4"""

register({
    "strokes": Entry("{where}: {value:.0f} strokes{rate}{lost}", "Strokes of one record."),
    "negative_drag": Entry(
        "{subject} is negative: air at rest would drive the wings",
        "A drag coefficient is below zero with its whole interval.",
        "check signs of flap, force_x, force_z; subtract weight and inertia",
    ),
    "large_coefficient": Entry(
        "{subject} = {value:.3g} is larger than that of any wing ({limit:.0f})",
        "A mean coefficient of a stroke is out of range.",
        "check the units of forces, planform and V",
    ),
})  # fmt: skip


def stroke_fits(section: StrokeSection, data: DataSplit) -> list[EstimationResult]:
    """The mean coefficients over all maneuvers, and their derivatives if requested.

    Raises:
        InputError: a signal or constant is missing, or fewer than three complete strokes.
    """
    if section.wings not in (1, 2):
        raise InputError("stroke.wings must be 1 or 2")
    wing = planform_of(section.planform)
    findings: list[Finding] = []
    fitted, held = (
        [_flight(section, one, data.constants, wing, findings) for one in part]
        for part in (data.fitted, data.held_out)
    )
    count = sum(len(one.strokes.records) for one in fitted)
    if count < LEAST_STROKES:
        raise InputError(
            f"stroke: {pluralize(count, 'complete stroke')}; {LEAST_STROKES} are needed ({findings[0].text})"
        )
    mean, by_stroke = stroke_fit(fitted, held)
    for one in mean.estimates:
        if one.low > LARGEST or one.high < -LARGEST:
            findings.append(Finding("large_coefficient", "warning", one.name, one.value, LARGEST))
        if one.name.startswith("C_D") and one.high < 0.0:
            findings.append(Finding("negative_drag", "warning", one.name, one.value, 0.0))
    fits = [mean._replace(findings=(*mean.findings, *findings), chapters=(stroke_chapter(mean, by_stroke),))]
    if section.derivatives and mean.estimates:
        fits.append(derivative_fit(fitted, by_stroke))
    return fits


def _flight(
    section: StrokeSection, one: Experiment, constants: Mapping[str, float], wing: Planform, findings: list[Finding]
) -> Flight:
    """The strokes of a maneuver and the variables of their coefficients."""
    source = Source(one, constants, "stroke")

    def named(key: str, unit: str | None) -> Array | None:
        name = getattr(section, key)
        return None if name is None else signal(one, name, unit, f"stroke.{key}")

    need(dict(constants), *(() if "rho" in one.signals else ("rho",)), what="stroke")
    flap = signal(one, section.flap, "rad", "stroke.flap")
    forward, down = (signal(one, getattr(section, key), "N", f"stroke.{key}") for key in ("force_x", "force_z"))
    force = np.column_stack((forward, -down))
    density = float(np.nanmean(source.get("rho")))
    flapped = Flapped(one.time, flap, source.get("V"), source.get("alpha"), force, density, section.wings)
    counted = named("strokes", "-")
    cuts = strokes_by_angle(one.time, flap) if counted is None else strokes_by_count(one.time, counted)
    strokes = measured_strokes(flapped, wing, cuts)
    lost, count = len(cuts[0]) - len(strokes.records), len(strokes.records)
    details = {
        "where": one.name,
        "rate": f" at {1 / float(np.mean(strokes.end - strokes.begin)):.3g} Hz" if count else "",
        "lost": f", {lost} with missing samples left out" if lost else "",
    }
    findings.append(Finding("strokes", "info", "", float(count), None, details))

    def mean(values: Array) -> Array:
        """Means (M,) over the strokes."""
        if not len(strokes.begin):
            return np.zeros(0)
        return interval_mean(one.time, _interpolated(values), strokes.begin, strokes.end)

    alpha = _interpolated(source.get("alpha"))
    ends = (np.interp(at, one.time, alpha) for at in (strokes.begin, strokes.end))
    rate = -np.subtract(*ends) / np.maximum(strokes.end - strokes.begin, 1e-12)
    elevator, stiffness, moment = named("elevator", "rad"), named("stiffness", None), named("moment", "N m")
    attitude = Attitude(mean(alpha), rate, mean(np.zeros(len(one.time)) if elevator is None else elevator))
    coefficient = None
    if moment is not None:
        coefficient = mean(moment) / mean(source.get("qbar") * source.constant("S") * source.constant("c"))
    return Flight(one.name, strokes, attitude, None if stiffness is None else mean(stiffness), coefficient)


def _interpolated(values: Array) -> Array:
    known, places = np.isfinite(values), np.arange(len(values))
    if not known.any():
        raise InputError("stroke: a record has no sample of the angle of attack or of a mean over strokes")
    return np.interp(places, places[known], values[known])
