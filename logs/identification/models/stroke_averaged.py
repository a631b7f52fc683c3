"""Stroke-averaged longitudinal derivatives, and coefficients of up- and downstroke.

The model is `models.stability.longitudinal` with the state w. Z_w is Malladi's Z_alpha / V, M_w his M_alpha / V; the
derivatives contain the wings' apparent mass and downwash lag.

Two misprints: Eq. 19 multiplies the dynamic pressure by half the density again, which the definition of q(t) below
it already holds; the last term of Eq. 21 has lost the L of C_L. The angle of attack here is the fuselage's, between
its centreline and the stream, and not that of a section.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import ELEVATOR, Reference
from logs.identification.models.linear import LinearModel
from logs.identification.models.stability import Steady, longitudinal, short_period
from logs.identification.results import Array
from logs.identification.results import Array as Floats
from wingbeat.errors import InputError

UNITS = {
    "X_u": "1/s", "X_w": "1/s", "X_q": "m/s/rad", "X_delta": "m/s^2/rad",
    "Z_u": "1/s", "Z_w": "1/s", "Z_q": "m/s/rad", "Z_delta": "m/s^2/rad",
    "M_u": "rad/s/m", "M_w": "rad/s/m", "M_q": "1/s", "M_delta": "1/s^2",
    "tail_delay": "s", "tail_time_constant": "s",
}  # fmt: skip
TAIL_DELAY, TAIL_LAG = TAIL = ("tail_delay", "tail_time_constant")
"""parameters of the actuator"""
LONGITUDINAL = tuple(name for name in UNITS if name not in TAIL)
"""all derivatives: short period and speed together"""
SHORT_PERIOD = ("Z_w", "Z_q", "Z_delta", "M_w", "M_q", "M_delta")
"""the speed taken as constant"""
OUTPUTS = ("q", "a_x", "a_z", "theta")


class Matrices(NamedTuple):
    """State space ``x' = A x + B delta``, ``y = C x + D delta``; x = (u, w, q, theta), y = (q, a_x, a_z, theta)."""

    a: Array
    """(4, 4)"""
    b: Array
    """(4,)"""
    c: Array
    """(4, 4); a_x and a_z are specific forces at the IMU"""
    d: Array
    """(4,)"""


def model_of(names: tuple[str, ...], reference: Reference, aircraft: Aircraft) -> LinearModel:
    """The model of four states, or of w and q alone if no derivative of the force along x is among ``names``."""
    steady = Steady(
        reference.airspeed, reference.pitch, math.atan2(reference.w, reference.u), aircraft.imu_x, aircraft.imu_z
    )
    if any(name.startswith("X") for name in names):
        return longitudinal(steady, (ELEVATOR,), "w")
    return short_period(steady, (ELEVATOR,), "w")


def matrices(names: tuple[str, ...], values: Array, reference: Reference, aircraft: Aircraft) -> Matrices:
    """State space of derivatives ``names`` with ``values`` (p,); derivatives that are not named are zero."""
    model = model_of(LONGITUDINAL, reference, aircraft)
    given = dict(zip(names, values.tolist(), strict=True))
    system = model.matrices(np.array([given.get(name, 0.0) for name in model.parameters]))
    rows = [list(model.outputs).index(name) for name in OUTPUTS]
    a, b = system.a.copy(), system.b[:, 0].copy()
    if not any(name.startswith("X") for name in names):
        a[0], b[0] = 0.0, 0.0
    return Matrices(a, b, system.c[rows], system.d[rows, 0])


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
