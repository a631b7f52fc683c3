"""Stroke-averaged coefficients of up- and down-stroke from measured forces (Malladi et al. 2007, Eq. 18 to 25).

`models.stroke_averages` has the equations; here is their inverse with intervals. Eq. 19 is one vector equation for
four coefficients. Written for each half of the stroke, and for every stroke, it is two linear systems of as many
pairs of equations as there are strokes; the variation between strokes is the error. Eq. 20 to 23 and 25 then relate
the coefficients of many strokes, or of many settings of a stand, to attitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.findings import Entry, Finding, not_estimated, register
from logs.identification.models.stroke_averaged import (
    WORST_CONDITION,
    Attitude,
    StrokeCoefficients,
    StrokeRecord,
    lift_regressors,
    mean_coefficients,
    moment_regressors,
)
from logs.identification.models.wing_strokes import MeasuredStrokes
from logs.identification.results import (
    Array,
    Estimate,
    EstimationResult,
    FitSeries,
    estimate,
    estimates,
    linear_result,
)
from logs.pages.document import DASHED, MODEL, POINTS, Chapter, Plot, Series
from wingbeat.errors import InputError

METHOD = "stroke-averaged coefficients"
EQUATIONS = (
    "Mean force of each half of a stroke = C_L times the mean of q l less C_D times that of q d (Malladi Eq. 18, 19)",
    "l is the direction of lift and d that of the velocity of each section of the wings, q its dynamic pressure times"
    " its area",
)
AXES = ("force_x", "force_z")
"""mean forces of half strokes forward and, against the up of the strokes' axes, down"""
BY_STROKE = ("C_L_up", "C_L_down", "C_D_up", "C_D_down")
"""coefficients of a single stroke; NaN if it does not determine them"""
LAWS = (
    "C_L of a half = C_L_alpha alpha + C_L_alpha_rate alpha' + C_L_elevator elevator + C_L_stiffness E (Eq. 20, 21);"
    " where the spar's stiffness E is not told its term is the constant C_L_0",
    "C_D of a half = C_D_min + K C_L^2 (Eq. 22, 23)",
)
FLAT = "the interval of K spans zero: C_L varies too little between the strokes for a polar"
MOMENT_LAW = "C_m = C_m_0 + C_m_alpha alpha + C_m_alpha_rate alpha' + C_m_elevator elevator (Eq. 25)"


register(
    {
        "polar_noise": Entry(
            "C_D_min and K rest on C_L of single strokes, whose noise biases K beyond its interval",
            "The regressor of the polar is an estimate: errors in variables attenuate K.",
        )
    }
)
LEAST_STROKES = 3
HALVES = ("up", "down")
INTERCEPTS = ("stiffness", "0", "min")
"""terms that are constant where nothing varies with them"""
HIDDEN = "the angle's noise hides which half of the stroke a sample is of"
"""of a stroke that has neither pressures nor forces: none of its samples could be told to be of one half"""
LEAST_VARIED = 1e-6
"""-; of a regressor's largest value"""
LIFT_UNITS = {"alpha": "1/rad", "alpha_rate": "s/rad", "elevator": "1/rad", "stiffness": "per unit of E"}
MOMENT_UNITS = {"0": "-", "alpha": "1/rad", "alpha_rate": "s/rad", "elevator": "1/rad"}


def stroke_coefficients(
    records: tuple[StrokeRecord, ...],
    forces: tuple[Array, ...],
    others: tuple[tuple[StrokeRecord, ...], ...] = (),
) -> tuple[EstimationResult, Array]:
    """C_L and C_D of both halves of M strokes by Eq. 19, and those of each stroke (M, 4) in the order of `BY_STROKE`.

    Args:
        records: of each stroke.
        forces: (N, k) N of each stroke; the wing's aerodynamic force at the record's instants, in its directions.
        others: the records as they would be by another measure of the motion. It is wrong in all strokes alike, which
            their scatter does not show: what each shifts the coefficients by is one more standard error.

    Raises:
        InputError: fewer than three strokes, or forces whose shape is not that of their record.
    """
    if len(records) < LEAST_STROKES or len(records) != len(forces):
        raise InputError(
            f"{len(records)} strokes and {len(forces)} forces: {LEAST_STROKES} strokes or more are needed"
        )
    for record, force in zip(records, forces, strict=True):
        if force.shape != record.lift_pressure.shape:
            raise InputError("a stroke's force has another shape than its dynamic pressure")
    found: list[Estimate] = []
    refused: list[Finding] = []
    for name in HALVES:
        outcome = _half(records, forces, name, others)
        if isinstance(outcome, str):
            refused += [not_estimated(f"{c}_{name}", outcome) for c in ("C_L", "C_D")]
        else:
            found += outcome
    alone = [_alone(record, force) for record, force in zip(records, forces, strict=True)]
    result = linear_result("stroke", tuple(found), refused, title=METHOD, equations=EQUATIONS, samples=len(records))
    return result, np.array(alone)


def lift_derivatives(name: str, lift: Array, attitude: Attitude, stiffness: Array | None = None) -> EstimationResult:
    """Eq. 20 or 21: C_L (M,) of one half of M strokes on angle of attack, its rate, elevator and spar's stiffness.

    ``name`` is what the half is called, "up" or "down". Where the stiffness E did not vary its term is a constant.
    """
    regressors = lift_regressors(attitude, np.ones(len(lift)) if stiffness is None else stiffness)
    units = LIFT_UNITS if stiffness is not None else {**LIFT_UNITS, "stiffness": "-"}
    return _regressed({f"C_L_{name}_{term}": unit for term, unit in units.items()}, regressors, lift)


def drag_polar(name: str, lift: Array, drag: Array) -> EstimationResult:
    """Eq. 22 or 23: C_D (M,) of one half of M strokes on the square of its C_L (M,)."""
    columns = np.column_stack([np.ones(len(lift)), np.square(lift)])
    return _regressed({f"C_D_{name}_min": "-", f"K_{name}": "-"}, columns, drag)


def moment_derivatives(moment: Array, attitude: Attitude) -> EstimationResult:
    """Eq. 25: C_m (M,) of M strokes, made by Eq. 24, on angle of attack, its rate and elevator."""
    return _regressed(
        {f"C_m_{term}": unit for term, unit in MOMENT_UNITS.items()}, moment_regressors(attitude), moment
    )


def _half(
    records: tuple[StrokeRecord, ...],
    forces: tuple[Array, ...],
    name: str,
    others: tuple[tuple[StrokeRecord, ...], ...],
) -> tuple[Estimate, ...] | str:
    """Least squares over the strokes' impulses; errors by their scatter from stroke to stroke."""
    if any(np.isnan(a.lift_pressure).all() and np.isnan(b).all() for a, b in zip(records, forces, strict=True)):
        return HIDDEN
    systems = [_impulses(record, force, name) for record, force in zip(records, forces, strict=True)]
    whole, seen = np.vstack([one.matrix for one in systems]), np.concatenate([one.force for one in systems])
    if any(not len(one.matrix) for one in systems):
        return f"a stroke has no {name}-stroke"
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(seen))):
        return "a force or a speed is not a number"
    if not np.linalg.cond(whole) < WORST_CONDITION:
        return "lift and drag cannot be told apart: the wing does not move through the air"
    values = np.linalg.lstsq(whole, seen, rcond=None)[0]
    inverse = np.linalg.inv(whole.T @ whole)
    scores = np.array([one.matrix.T @ (one.force - one.matrix @ values) for one in systems])
    count = len(records)
    covariance = inverse @ (scores.T @ scores) @ inverse * count / (count - 1.0)
    for other in others:
        matrix = np.vstack([_impulses(one, force, name).matrix for one, force in zip(other, forces, strict=True)])
        shift = np.linalg.lstsq(matrix, seen, rcond=None)[0] - values
        covariance = covariance + np.outer(shift, shift)
    return estimates({f"C_L_{name}": "-", f"C_D_{name}": "-"}, values, covariance, count - 1.0)


class _Impulses(NamedTuple):
    """Eq. 19 of one half of a stroke."""

    matrix: Array
    """(k, 2) N s; of the pressures for C_L and C_D, (0, 2) where the stroke has no such half"""
    force: Array
    """(k,) N s"""


def _impulses(record: StrokeRecord, force: Array, name: str) -> _Impulses:
    half = record.down if name == "down" else ~record.down
    if not half.any():
        return _Impulses(np.zeros((0, 2)), np.zeros(0))
    step = record.period / len(record.down)
    lift, drag = (pressure[half].sum(axis=0) * step for pressure in (record.lift_pressure, record.drag_pressure))
    return _Impulses(np.column_stack([lift, -drag]), force[half].sum(axis=0) * step)


def _alone(record: StrokeRecord, force: NDArray[np.float64]) -> Array:
    if not all(np.isfinite(one).all() for one in (force, record.lift_pressure, record.drag_pressure)):
        return np.full(4, np.nan)
    try:
        return np.array(mean_coefficients(force, record))
    except InputError:
        return np.full(4, np.nan)


def _regressed(units: dict[str, str], columns: Array, response: Array) -> EstimationResult:
    """Least squares over strokes; what does not vary, or varies as another does, is refused."""
    good = np.isfinite(columns).all(axis=1) & np.isfinite(response)
    columns, response, names = columns[good], response[good], list(units)
    kept, refused = _independent(columns, names)
    degrees = len(response) - len(kept)
    if degrees < 1 or not kept:
        return linear_result("stroke", (), (not_estimated(n, f"{len(response)} strokes are too few") for n in names))
    taken = columns[:, kept]
    values = np.linalg.lstsq(taken, response, rcond=None)[0]
    left = response - taken @ values
    covariance = np.linalg.inv(taken.T @ taken) * float(left @ left) / degrees
    errors = np.sqrt(np.diag(covariance))
    found = tuple(
        estimate(names[column], units[names[column]], float(value), float(error), float(degrees))
        for column, value, error in zip(kept, values, errors, strict=True)
    )
    return linear_result("stroke", found, refused)


def _is_constant(column: Array) -> bool:
    return bool(np.ptp(column) < LEAST_VARIED * np.max(np.abs(column)))


def _independent(columns: Array, names: list[str]) -> tuple[list[int], tuple[Finding, ...]]:
    """Columns each of which is not made of those before it, and what is said of the others."""
    kept: list[int] = []
    refused: list[Finding] = []
    for index, name in enumerate(names):
        size = float(np.linalg.norm(columns[:, index]))
        rest = columns[:, index]
        if kept:
            rest = rest - columns[:, kept] @ np.linalg.lstsq(columns[:, kept], rest, rcond=None)[0]
        if size == 0.0:
            refused.append(not_estimated(name, "its regressor is zero in all strokes"))
        elif not name.endswith(INTERCEPTS) and _is_constant(columns[:, index]):
            refused.append(not_estimated(name, "its regressor is the same in all strokes"))
        elif float(np.linalg.norm(rest)) < size / WORST_CONDITION:
            others = ", ".join(names[i] for i in kept)
            refused.append(not_estimated(name, f"its regressor varies as those of {others} do"))
        else:
            kept.append(index)
    return kept, tuple(refused)


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


def stroke_fit(flights: Sequence[Flight], validation: Sequence[Flight] = ()) -> tuple[EstimationResult, Array]:
    """`stroke_coefficients` of all ``flights``, with the halves' mean forces of these and of those ``validation``.

    Raises:
        InputError: fewer than three strokes.
    """
    records = tuple(record for one in flights for record in one.strokes.records)
    forces = tuple(force for one in flights for force in one.strokes.forces)
    versions = [one.strokes.others for one in flights if one.strokes.records]
    others = tuple(tuple(record for part in parts for record in part) for parts in zip(*versions, strict=True))
    found, by_stroke = stroke_coefficients(records, forces, others)
    values = {one.name: one.value for one in found.estimates}
    series: list[FitSeries] = []
    if not found.withheld:
        told = StrokeCoefficients(values["C_L_up"], values["C_L_down"], values["C_D_up"], values["C_D_down"])
        series = [one for flight in flights for one in _series(flight, told, held_out=False)]
        series += [one for flight in validation for one in _series(flight, told, held_out=True)]
    return found._replace(series=tuple(series)), by_stroke


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


def derivative_fit(flights: Sequence[Flight], by_stroke: Array) -> EstimationResult:
    """Eq. 20 to 23 on the coefficients of every stroke (M, 4), and Eq. 25 where the moment is known."""
    attitude = Attitude(
        *(np.concatenate(columns) for columns in zip(*(one.attitude for one in flights), strict=True))
    )
    stiffness = _joined([one.stiffness for one in flights])
    laws: list[EstimationResult] = []
    for place, half in enumerate(HALVES):
        laws.append(lift_derivatives(half, by_stroke[:, place], attitude, stiffness))
        laws.append(_polar(half, by_stroke[:, place], by_stroke[:, 2 + place]))
    moment = _joined([one.moment for one in flights])
    if moment is not None:
        laws.append(moment_derivatives(moment, attitude))
    found = tuple(one for law in laws for one in law.estimates)
    refused = tuple(one for law in laws for one in law.withheld)
    equations = (*LAWS, *((MOMENT_LAW,) if moment is not None else ()))
    if stiffness is None:
        found = tuple(one._replace(name=one.name.replace("_stiffness", "_0")) for one in found)
        refused = tuple(one._replace(subject=one.subject.replace("_stiffness", "_0")) for one in refused)
    title, noisy = "derivatives of the strokes' coefficients", Finding("polar_noise", "warning")
    return linear_result("stroke", found, (*refused, noisy), title=title, equations=equations, samples=len(by_stroke))


def _polar(half: str, lift: Array, drag: Array) -> EstimationResult:
    """Eq. 22 or 23, refused where C_L varies too little for its square to be told from the constant."""
    found = drag_polar(half, lift, drag)
    if any(one.name.startswith("K_") and one.contains(0.0) for one in found.estimates):
        lost = tuple(not_estimated(one.name, FLAT) for one in found.estimates)
        return linear_result("stroke", (), (*found.withheld, *lost))
    return found


def _joined(columns: list[Array | None]) -> Array | None:
    there = [column for column in columns if column is not None]
    return np.concatenate(there) if there and len(there) == len(columns) else None


def stroke_chapter(mean: EstimationResult, by_stroke: Array) -> Chapter:
    """The coefficients of every stroke alone, beside those of all together."""
    number = np.arange(1, len(by_stroke) + 1, dtype=np.float64)
    together = {one.name: one.value for one in mean.estimates}
    plots = []
    for name, column in zip(BY_STROKE, by_stroke.T, strict=True):
        lines = [Series("each stroke alone", number, column, style=POINTS)]
        if name in together:
            lines.append(Series("all together", number, np.full(len(number), together[name]), MODEL, DASHED))
        plots.append(Plot("", "stroke", "-", name, "-", tuple(lines)))
    said = "Of one stroke alone: its two halves tell two coefficients each, so that what it has of noise is in them."
    return Chapter("Strokes", (said,), plots=tuple(plots))
