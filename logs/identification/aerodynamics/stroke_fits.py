"""Coefficients of up- and down-stroke as any method's fit: Malladi Eq. 19, and Eq. 20 to 25 over its strokes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.aerodynamics.strokes_measured import MeasuredStrokes
from logs.identification.models.stroke_coefficients import (
    HALVES,
    Derivatives,
    MeanCoefficients,
    drag_polar,
    lift_derivatives,
    moment_derivatives,
    stroke_coefficients,
)
from logs.identification.report.document import DASHED, MODEL, POINTS, Chapter, Plot, Series
from logs.identification.results import Array, FitSeries, Fitted, Unidentified
from sim_bridge.aerodynamics.stroke_averages import Attitude, StrokeCoefficients, StrokeRecord

METHOD = "stroke-averaged coefficients"
EQUATIONS = (
    "Mean force of each half of a stroke = C_L times the mean of q l less C_D times that of q d (Malladi Eq. 18, 19)",
    "l is the direction of lift and d that of the velocity of each section of the wings, q its dynamic pressure times"
    " its area",
)
AXES = ("force_x", "force_z")
"""mean forces of half strokes forward and, against the up of the strokes' axes, down"""
BY_STROKE = ("C_L_up", "C_L_down", "C_D_up", "C_D_down")
"""columns of `MeanCoefficients.by_stroke`"""
LAWS = (
    "C_L of a half = C_L_alpha alpha + C_L_alpha_rate alpha' + C_L_elevator elevator + C_L_stiffness E (Eq. 20, 21);"
    " where the spar's stiffness E is not told its term is the constant C_L_0",
    "C_D of a half = C_D_min + K C_L^2 (Eq. 22, 23)",
)
NOISY = "C_D_min and K rest on C_L of single strokes: noise in it takes of K what the interval does not hold"
FLAT = "the interval of K spans zero: C_L varies too little between the strokes for a polar"
MOMENT_LAW = "C_m = C_m_0 + C_m_alpha alpha + C_m_alpha_rate alpha' + C_m_elevator elevator (Eq. 25)"


class Flight(NamedTuple):
    """The strokes of one record, and what their coefficients are functions of."""

    name: str
    strokes: MeasuredStrokes
    attitude: Attitude
    """(M,) each; means over the strokes"""
    stiffness: Array | None = None
    """(M,); of the spar"""
    moment: Array | None = None
    """-; (M,), C_m of every stroke by Eq. 24"""


def stroke_fit(flown: Sequence[Flight], held: Sequence[Flight] = ()) -> tuple[Fitted, MeanCoefficients]:
    """C_L and C_D of both halves over all strokes ``flown``, beside the halves' mean forces of these and of those
    ``held``.

    Raises:
        InputError: fewer than three strokes.
    """
    records = tuple(record for one in flown for record in one.strokes.records)
    forces = tuple(force for one in flown for force in one.strokes.forces)
    versions = [one.strokes.others for one in flown if one.strokes.records]
    others = tuple(tuple(record for part in parts for record in part) for parts in zip(*versions, strict=True))
    found = stroke_coefficients(records, forces, others)
    values = {one.name: one.value for one in found.estimates}
    series: list[FitSeries] = []
    if not found.unidentified:
        told = StrokeCoefficients(values["C_L_up"], values["C_L_down"], values["C_D_up"], values["C_D_down"])
        series = [one for flight in flown for one in _series(flight, told, held_out=False)]
        series += [one for flight in held for one in _series(flight, told, held_out=True)]
    return Fitted(METHOD, EQUATIONS, found.estimates, found.unidentified, None, tuple(series)), found


def _series(flight: Flight, coefficients: StrokeCoefficients, held_out: bool) -> list[FitSeries]:
    """Mean force of both halves of every stroke, up and down in turn, as measured and by Eq. 19.

    Of halves, since every stroke's mean is the same on a steady run: of what noise makes of it nothing is explained.
    """
    strokes = flight.strokes
    if not strokes.records:
        return []
    pairs = list(zip(strokes.records, strokes.forces, strict=True))
    measured = np.array([_halves(record, force) for record, force in pairs]).reshape(-1, 2)
    model = np.array([_halves(record, _force(coefficients, record)) for record, _ in pairs]).reshape(-1, 2)
    period = float(np.mean(strokes.end - strokes.begin))
    time = np.asarray(strokes.begin[0] + period / 2 * np.arange(len(measured)), dtype=np.float64)
    columns = ((AXES[0], 0, 1.0), (AXES[1], 1, -1.0))
    return [
        FitSeries(flight.name, name, "N", time, sign * measured[:, place], sign * model[:, place], held_out)
        for name, place, sign in columns
    ]


def _halves(record: StrokeRecord, force: Array) -> Array:
    """(2, k) N; means of ``force`` (N, k) over up- and down-stroke."""
    return np.array([force[half].mean(axis=0) for half in (~record.down, record.down)])


def _force(coefficients: StrokeCoefficients, record: StrokeRecord) -> Array:
    """(N, k) N; of Eq. 19 at every instant."""
    lift = np.where(record.down, coefficients.lift_down, coefficients.lift_up)[:, None]
    drag = np.where(record.down, coefficients.drag_down, coefficients.drag_up)[:, None]
    return np.asarray(lift * record.lift_pressure - drag * record.drag_pressure)


def derivative_fit(flown: Sequence[Flight], by_stroke: Array) -> Fitted:
    """Eq. 20 to 23 on the coefficients of every stroke (M, 4), and Eq. 25 where the moment is known."""
    attitude = Attitude(*(np.concatenate(columns) for columns in zip(*(one.attitude for one in flown), strict=True)))
    stiffness = _joined([one.stiffness for one in flown])
    laws: list[Derivatives] = []
    for place, half in enumerate(HALVES):
        laws.append(lift_derivatives(half, by_stroke[:, place], attitude, stiffness))
        laws.append(_polar(half, by_stroke[:, place], by_stroke[:, 2 + place]))
    moment = _joined([one.moment for one in flown])
    if moment is not None:
        laws.append(moment_derivatives(moment, attitude))
    found = tuple(one for law in laws for one in law.estimates)
    refused = tuple(one for law in laws for one in law.unidentified)
    equations = (*LAWS, *((MOMENT_LAW,) if moment is not None else ()))
    if stiffness is None:
        found = tuple(one._replace(name=one.name.replace("_stiffness", "_0")) for one in found)
        refused = tuple(one._replace(name=one.name.replace("_stiffness", "_0")) for one in refused)
    return Fitted("derivatives of the strokes' coefficients", equations, found, refused, notes=(NOISY,))


def _polar(half: str, lift: Array, drag: Array) -> Derivatives:
    """Eq. 22 or 23, refused where C_L varies too little for its square to be told from the constant."""
    found = drag_polar(half, lift, drag)
    if any(one.name.startswith("K_") and one.contains(0.0) for one in found.estimates):
        lost = tuple(Unidentified(one.name, FLAT) for one in found.estimates)
        return Derivatives((), (*found.unidentified, *lost))
    return found


def _joined(columns: list[Array | None]) -> Array | None:
    there = [column for column in columns if column is not None]
    return np.concatenate(there) if there and len(there) == len(columns) else None


def stroke_chapter(found: MeanCoefficients, method: str = "Strokes") -> Chapter:
    """The coefficients of every stroke alone, beside those of all together."""
    number = np.arange(1, len(found.by_stroke) + 1, dtype=np.float64)
    together = {one.name: one.value for one in found.estimates}
    plots = []
    for name, column in zip(BY_STROKE, found.by_stroke.T, strict=True):
        lines = [Series("each stroke alone", number, column, style=POINTS)]
        if name in together:
            lines.append(Series("all together", number, np.full(len(number), together[name]), MODEL, DASHED))
        plots.append(Plot("", "stroke", "-", name, "-", tuple(lines)))
    said = "Of one stroke alone: its two halves tell two coefficients each, so that what it has of noise is in them."
    return Chapter(method, (said,), plots=tuple(plots))
