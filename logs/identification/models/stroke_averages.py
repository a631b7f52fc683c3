"""Stroke-averaged coefficients of up- and down-stroke (Malladi et al. 2007, Eq. 18 to 25), for identification.

Two misprints: Eq. 19 multiplies the dynamic pressure by half the density again, which the definition of q(t) below
it already holds; the last term of Eq. 21 has lost the L of C_L. The angle of attack here is the fuselage's, between
its centreline and the stream, and not that of a section.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.results import Array as Floats
from wingbeat.errors import InputError

WORST_CONDITION = 1e6
"""-; of the system of one half stroke, beyond which lift and drag cannot be separated"""


class StrokeCoefficients(NamedTuple):
    """Mean coefficients of one stroke."""

    lift_up: float
    lift_down: float
    drag_up: float
    drag_down: float


class StrokeRecord(NamedTuple):
    """One stroke of a wing at N equally spaced instants, the last one interval before the stroke repeats."""

    period: float
    """s"""
    lift_pressure: Floats
    """(N, k) N; q(t) l: half the density times velocity squared times area, along the direction of lift"""
    drag_pressure: Floats
    """(N, k) N; q(t) d: the same along the velocity, against which drag acts"""
    down: NDArray[np.bool_]
    """(N,); during the down-stroke"""


class Attitude(NamedTuple):
    """Arguments of the mean coefficients, each a number or (M,) of M strokes."""

    alpha: Floats
    """rad; angle between the fuselage's centreline and the stream"""
    alpha_rate: Floats
    """rad/s"""
    elevator: Floats
    """rad"""


def stroke_record(
    period: float, velocity: Floats, area: Floats, density: float, down: NDArray[np.bool_]
) -> StrokeRecord:
    """Sum the dynamic pressure of Eq. 18 and 19 over the wing sections.

    Args:
        period: s; of the stroke.
        velocity: (N, n, 2) m/s; of each section through the air, forward along its chord and up along its normal.
        area: (n,) m^2; chord times width of each section.
        density: kg/m^3.
        down: (N,); during the down-stroke.
    """
    forward, up = velocity[..., 0], velocity[..., 1]
    weighted = 0.5 * density * area * np.hypot(forward, up)
    lift = np.stack([-(weighted * up).sum(axis=1), (weighted * forward).sum(axis=1)], axis=1)
    drag = np.stack([(weighted * forward).sum(axis=1), (weighted * up).sum(axis=1)], axis=1)
    return StrokeRecord(period, lift, drag, down)


def stroke_matrix(record: StrokeRecord) -> Floats:
    """The integrals of Eq. 19 over one stroke in N s: (k, 4) for C_L up and down, C_D up and down."""
    dt = record.period / len(record.down)
    halves = (~record.down, record.down)
    columns = [sign * pressure[half].sum(axis=0) * dt for sign, pressure in _signed(record) for half in halves]
    return np.stack(columns, axis=1)


def mean_force(coefficients: StrokeCoefficients, record: StrokeRecord) -> Floats:
    """Mean force (k,) in N of one stroke, Eq. 19."""
    return np.asarray(stroke_matrix(record) @ np.array(coefficients) / record.period)


def mean_coefficients(force: Floats, record: StrokeRecord) -> StrokeCoefficients:
    """Solve Eq. 19 for the coefficients of each half of the stroke; ``force`` (N, k) in N at the record's instants.

    Written once for each half, two components of force give four equations for the four coefficients.

    Raises:
        InputError: a half of the stroke is empty, or its lift and drag cannot be separated.
    """
    lift_up, drag_up = _half(force, record, ~record.down, "up-stroke")
    lift_down, drag_down = _half(force, record, record.down, "down-stroke")
    return StrokeCoefficients(lift_up, lift_down, drag_up, drag_down)


def lift_regressors(attitude: Attitude, stiffness: Floats) -> Floats:
    """Columns (M, 4) of Eq. 20 and 21: alpha, its rate, elevator, stiffness of the spar."""
    return _columns([*attitude, stiffness])


def moment_regressors(attitude: Attitude) -> Floats:
    """Columns (M, 4) of Eq. 25: one, alpha, its rate, elevator."""
    return _columns([1.0, *attitude])


def _signed(record: StrokeRecord) -> tuple[tuple[float, Floats], tuple[float, Floats]]:
    return (1.0, record.lift_pressure), (-1.0, record.drag_pressure)


def _columns(values: list[float | Floats]) -> Floats:
    return np.stack(np.broadcast_arrays(*[np.atleast_1d(np.asarray(value, float)) for value in values]), axis=1)


def _half(force: Floats, record: StrokeRecord, half: NDArray[np.bool_], name: str) -> tuple[float, float]:
    if not half.any():
        raise InputError(f"a stroke without {name} gives no coefficients of it")
    columns = [sign * pressure[half].sum(axis=0) for sign, pressure in _signed(record)]
    matrix = np.stack(columns, axis=1)
    if not np.linalg.cond(matrix) < WORST_CONDITION:
        raise InputError(f"lift and drag of the {name} cannot be told apart: the wing does not move through the air")
    lift, drag = np.linalg.lstsq(matrix, force[half].sum(axis=0), rcond=None)[0]
    return float(lift), float(drag)
