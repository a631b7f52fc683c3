"""[stroke] of a map: mean coefficients of up- and down-stroke from the wings' angle, the stream and their force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.aerodynamics.stroke_fits import Flight, derivative_fit, stroke_chapter, stroke_fit
from logs.identification.aerodynamics.strokes_measured import (
    Flapped,
    MeasuredStrokes,
    Planform,
    measured_strokes,
    planform_of,
    strokes_by_angle,
    strokes_by_count,
)
from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.strokes import AS_TOLD, Signs, doubts, without_impossible
from logs.identification.models.stroke_coefficients import LEAST_STROKES, MeanCoefficients
from logs.identification.results import Array, Estimate, Fitted, Information
from logs.identification.sources.table.constants import need
from logs.identification.sources.table.derived import Source
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signal_lookup import signal
from logs.identification.statistics.output_fit import output_fits
from logs.identification.tables.results import TableFit
from logs.strokes import interval_mean
from sim_bridge.aerodynamics.stroke_averages import Attitude
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


def stroke_fits(
    asked: StrokeSection, found: Cut, constants: Mapping[str, float], fill: float | None
) -> list[TableFit]:
    """The mean coefficients over all manoeuvres, and where asked for what they are functions of.

    Raises:
        InputError: a signal or constant is not there, or fewer than three strokes were measured whole.
    """
    if asked.wings not in (1, 2):
        raise InputError("stroke.wings must be 1 or 2")
    wing = planform_of(asked.planform)
    notes: list[str] = []
    flown, held = (
        [_flight(asked, one, constants, wing, notes) for one in part] for part in (found.fitted, found.held_out)
    )
    count = sum(len(one.strokes.records) for one in flown)
    if count < LEAST_STROKES:
        raise InputError(f"stroke: {pluralize(count, 'whole stroke')} found; {LEAST_STROKES} are needed ({notes[0]})")
    told, each = stroke_fit(flown, held)
    told = without_impossible(told)

    def turned(signs: Signs) -> tuple[Estimate, ...]:
        return stroke_fit([_flight(asked, one, constants, wing, [], signs) for one in found.fitted])[0].estimates

    fits = [_fit(told._replace(notes=(*doubts(told, turned), *notes, *told.notes)), count, each)]
    if asked.derivatives and told.estimates:
        fits.append(_fit(derivative_fit(flown, each.by_stroke), count, None))
    return fits


def _fit(told: Fitted, count: int, each: MeanCoefficients | None) -> TableFit:
    failure = "" if told.estimates else "; ".join(dict.fromkeys(one.reason for one in told.unidentified))
    return TableFit(
        "stroke", told, not failure, failure, {}, {}, output_fits(told.series), count,
        chapters=() if each is None else (stroke_chapter(each),),
    )  # fmt: skip


def _flight(
    asked: StrokeSection,
    one: Experiment,
    constants: Mapping[str, float],
    wing: Planform,
    notes: list[str],
    signs: Signs = AS_TOLD,
) -> Flight:
    """The strokes of a manoeuvre and what their coefficients may depend on.

    They are cut by the angle as told also with its sign turned: at its other passes one of few would be lost.
    """
    source = Source(one, constants, "stroke")
    need(dict(constants), *(() if "rho" in one.signals else ("rho",)), what="stroke")
    flap = signal(one, asked.flap, "rad", "stroke.flap")
    forward, down = (signal(one, getattr(asked, key), "N", f"stroke.{key}") for key in ("force_x", "force_z"))
    alpha, speed = source.get("alpha"), source.get("V")
    density = float(np.nanmean(source.get("rho")))
    flown = Flapped(
        one.time,
        signs.flap * flap,
        speed,
        alpha,
        np.column_stack((signs.force_x * forward, -signs.force_z * down)),
        density,
        asked.wings,
    )
    if asked.strokes is None:
        cuts = strokes_by_angle(one.time, flap)
    else:
        cuts = strokes_by_count(one.time, signal(one, asked.strokes, "-", "stroke.strokes"))
    strokes = measured_strokes(flown, wing, cuts)
    notes.append(_told(one.name, strokes, len(cuts[0])))
    return _with_attitude(asked, one, source, strokes)


def _told(name: str, strokes: MeasuredStrokes, found: int) -> Information:
    lost = found - len(strokes.records)
    left = f", {lost} with missing samples left out" if lost else ""
    rate = f" at {1 / float(np.mean(strokes.end - strokes.begin)):.3g} Hz" if len(strokes.records) else ""
    return Information(f"{name}: {pluralize(len(strokes.records), 'stroke')}{rate}{left}")


def _with_attitude(asked: StrokeSection, one: Experiment, source: Source, strokes: MeasuredStrokes) -> Flight:
    begin, end = strokes.begin, strokes.end
    alpha = _bridged(source.get("alpha"))
    rate = (np.interp(end, one.time, alpha) - np.interp(begin, one.time, alpha)) / np.maximum(end - begin, 1e-12)
    still = np.zeros(len(one.time))
    elevator = still if asked.elevator is None else signal(one, asked.elevator, "rad", "stroke.elevator")
    stiffness = (
        None
        if asked.stiffness is None
        else _mean(one, signal(one, asked.stiffness, None, "stroke.stiffness"), strokes)
    )
    moment = None
    if asked.moment is not None:
        arm = source.get("qbar") * source.constant("S") * source.constant("c")
        torque = signal(one, asked.moment, "N m", "stroke.moment")
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
