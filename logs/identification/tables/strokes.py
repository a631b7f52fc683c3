"""[stroke] of a map: mean coefficients of up- and down-stroke from the wings' angle, the stream and their force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.stroke_coefficients import (
    LEAST_STROKES,
    Flight,
    MeanCoefficients,
    derivative_fit,
    stroke_chapter,
    stroke_fit,
)
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.stroke_averages import Attitude
from logs.identification.models.wing_strokes import (
    Flapped,
    MeasuredStrokes,
    Planform,
    measured_strokes,
    planform_of,
    strokes_by_angle,
    strokes_by_count,
)
from logs.identification.results import Array, EstimationResult, Fitted, from_fitted
from logs.identification.sources.table.constants import need
from logs.identification.sources.table.derived import Source
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signal_lookup import signal
from logs.strokes import interval_mean
from wingbeat.errors import InputError
from wingbeat.text import pluralize

EXAMPLE = """\
# Mean coefficients of up- and down-stroke (Malladi Eq. 18 to 25): wingbeat identify RUN.csv --map THIS.toml stroke
[time]
column = "t"                 # a stroke needs 8 samples or more
unit = "s"

[signals]
flap = { column = "wing", unit = "deg" }             # of both wings about the body's x axis, wing up positive
force_x = { column = "Fx", unit = "N" }              # of the air on the wings, body axes: forward and down;
force_z = { column = "Fz", unit = "N" }              # weight and the wings' inertia taken off before
V = { column = "tunnel", unit = "m/s" }              # or a constant
alpha = { column = "pitch", unit = "deg" }           # of the body's x axis to the stream, or a constant
elevator = { column = "elevator", unit = "deg" }

[constants]
rho = 1.2                    # kg/m^3, or altitude

[stroke]
planform = [[0.0, 0.25], [0.3, 0.25], [0.6, 0.0]]    # m: distance from the flapping axis, and chord there
wings = 2                    # that the force is of
derivatives = true           # Eq. 20 to 23: C_L by alpha, its rate and the elevator, C_D by C_L^2
elevator = "elevator"        # names of signals; stiffness = "E" and moment = "M" (Eq. 25, with S and c) as well
# strokes = "count"          # a signal that counts strokes, where the wings' angle should not cut them
"""


class StrokeSection(NamedTuple):
    """Section [stroke]."""

    planform: tuple[tuple[float, float], ...]
    """m; distance from the flapping axis and chord there, of one wing"""
    flap: str = "flap"
    force_x: str = "force_x"
    force_z: str = "force_z"
    strokes: str | None = None
    """a signal that counts them; by the wings' angle when not given"""
    wings: int = 2
    """that the force is of"""
    derivatives: bool = False
    """Eq. 20 to 25 over the strokes"""
    elevator: str | None = None
    stiffness: str | None = None
    moment: str | None = None


LARGEST = 10.0
"""-; mean coefficient beyond that of any wing: a plate normal to the stream has 2, a fly's wing 4"""

register({
    "strokes": Entry("{where}: {value:.0f} strokes{rate}{lost}", "Strokes of one record."),
    "negative_drag": Entry(
        "{subject} is negative: air at rest would drive the wings",
        "A drag coefficient is below zero with its whole interval.",
        "check the signs of flap, force_x and force_z, and that weight and inertia are subtracted",
    ),
    "large_coefficient": Entry(
        "{subject} = {value:.3g} is larger than that of any wing ({limit:.0f})",
        "A mean coefficient of a stroke is out of range.",
        "check the units of forces, planform and V",
    ),
})  # fmt: skip


def stroke_fits(
    section: StrokeSection, maneuvers: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """The mean coefficients over all maneuvers, and their derivatives if requested.

    Raises:
        InputError: a signal or constant is not there, or fewer than three complete strokes.
    """
    if section.wings not in (1, 2):
        raise InputError("stroke.wings must be 1 or 2")
    wing = planform_of(section.planform)
    findings: list[Finding] = []
    fitted, held = (
        [_flight(section, one, constants, wing, findings) for one in part]
        for part in (maneuvers.fitted, maneuvers.held_out)
    )
    count = sum(len(one.strokes.records) for one in fitted)
    if count < LEAST_STROKES:
        raise InputError(
            f"stroke: {pluralize(count, 'whole stroke')} maneuvers; {LEAST_STROKES} are needed ({findings[0].text})"
        )
    mean, each = stroke_fit(fitted, held)
    for one in mean.estimates:
        if one.low > LARGEST or one.high < -LARGEST:
            findings.append(Finding("large_coefficient", "warning", one.name, one.value, LARGEST))
        if one.name.startswith("C_D") and one.high < 0.0:
            findings.append(Finding("negative_drag", "warning", one.name, one.value, 0.0))
    first = _result(mean, count, each)
    fits = [first._replace(findings=(*first.findings, *findings))]
    if section.derivatives and mean.estimates:
        fits.append(_result(derivative_fit(fitted, each.by_stroke), count, None))
    return fits


def _result(fitted: Fitted, count: int, each: MeanCoefficients | None) -> EstimationResult:
    failure = "" if fitted.estimates else "; ".join(dict.fromkeys(one.reason for one in fitted.unidentified))
    chapters = () if each is None else (stroke_chapter(each),)
    return from_fitted(fitted, "stroke", failure, subject="stroke", samples=count, chapters=chapters)


def _flight(
    section: StrokeSection,
    one: Experiment,
    constants: Mapping[str, float],
    wing: Planform,
    findings: list[Finding],
) -> Flight:
    """The strokes of a maneuver and the variables of their coefficients."""
    source = Source(one, constants, "stroke")
    need(dict(constants), *(() if "rho" in one.signals else ("rho",)), what="stroke")
    flap = signal(one, section.flap, "rad", "stroke.flap")
    forward, down = (signal(one, getattr(section, key), "N", f"stroke.{key}") for key in ("force_x", "force_z"))
    alpha, speed = source.get("alpha"), source.get("V")
    density = float(np.nanmean(source.get("rho")))
    flown = Flapped(
        one.time,
        flap,
        speed,
        alpha,
        np.column_stack((forward, -down)),
        density,
        section.wings,
    )
    if section.strokes is None:
        cuts = strokes_by_angle(one.time, flap)
    else:
        cuts = strokes_by_count(one.time, signal(one, section.strokes, "-", "stroke.strokes"))
    strokes = measured_strokes(flown, wing, cuts)
    lost = len(cuts[0]) - len(strokes.records)
    rate = f" at {1 / float(np.mean(strokes.end - strokes.begin)):.3g} Hz" if len(strokes.records) else ""
    left_out = f", {lost} with missing samples left out" if lost else ""
    details = {"where": one.name, "rate": rate, "lost": left_out}
    findings.append(Finding("strokes", "info", "", float(len(strokes.records)), None, details))
    return _with_attitude(section, one, source, strokes)


def _with_attitude(section: StrokeSection, one: Experiment, source: Source, strokes: MeasuredStrokes) -> Flight:
    begin, end = strokes.begin, strokes.end
    alpha = _bridged(source.get("alpha"))
    rate = (np.interp(end, one.time, alpha) - np.interp(begin, one.time, alpha)) / np.maximum(end - begin, 1e-12)
    still = np.zeros(len(one.time))
    elevator = still if section.elevator is None else signal(one, section.elevator, "rad", "stroke.elevator")
    stiffness = (
        None
        if section.stiffness is None
        else _mean(one, signal(one, section.stiffness, None, "stroke.stiffness"), strokes)
    )
    moment = None
    if section.moment is not None:
        arm = source.get("qbar") * source.constant("S") * source.constant("c")
        torque = signal(one, section.moment, "N m", "stroke.moment")
        moment = _mean(one, torque, strokes) / _mean(one, arm, strokes)
    attitude = Attitude(_mean(one, alpha, strokes), rate, _mean(one, elevator, strokes))
    return Flight(one.name, strokes, attitude, stiffness, moment)


def _mean(one: Experiment, values: Array, strokes: MeasuredStrokes) -> Array:
    """Means (M,) over the strokes."""
    if not len(strokes.begin):
        return np.zeros(0)
    return interval_mean(one.time, _bridged(values), strokes.begin, strokes.end)


def _bridged(values: Array) -> Array:
    known, places = np.isfinite(values), np.arange(len(values))
    if not known.any():
        raise InputError("stroke: the angle of attack is missing all through a record")
    return np.interp(places, places[known], values[known])
