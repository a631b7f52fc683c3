"""Grauer, Ulrich, Hubbard, Pines, Humbert 2011: Table 1 flown, and the spatial kinematics of V.B.

The stroke is chosen: half cosines between the printed extrema at the printed phases (V.A), a fuselage that flies
straight and level at 9.2 m/s, and an elliptic wing with the printed span and area. The heave and pitch of the flight
are not printed as histories.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from sim_bridge.aerodynamics.regression import (
    COLUMNS,
    MODEL,
    RECORDED_HEAVE,
    Regression,
    Regressors,
    carrying_heave,
    coefficients,
    level_heave,
)
from sim_bridge.flight_mechanics.prescribed import SLOW_HAWK_STROKE, elliptic_wing, steady_flight
from sim_bridge.flight_mechanics.spatial import SpatialKinematics, draw_spatial, spatial_kinematics
from sim_bridge.flight_mechanics.stroke_loads import prescribed_loads
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure, unreproducible
from sim_bridge.vectors import Floats
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

SPEED, FREQUENCY, MASS = 9.2, 5.91, 0.45
"""m/s, Hz, kg; V.A"""
SEMISPAN, AREA = 0.6, 0.3
"""m, m^2; of both wings"""
CHORD = AREA / (2.0 * SEMISPAN)
ROOT = 2.0 * AREA / (math.pi * SEMISPAN)
"""m; root chord of the elliptic wing of that area"""
HINGE = np.array([0.05, 0.02, -0.03])
"""m; chosen, without effect if the fuselage does not rotate"""
WING = elliptic_wing(SEMISPAN, ROOT, 75, HINGE)
WEIGHT = MASS * STANDARD_GRAVITY
LEVEL_LIFT = WEIGHT / (0.5 * 1.225 * SPEED**2 * AREA)
"""-; lift coefficient of level flight"""
SETTINGS = {column: Regression(column, AREA, CHORD) for column in COLUMNS}
INSTANTS = 200
"""instants of a stroke on the paper's grid"""
ANGLE, REDUCED, REYNOLDS, SECTION_SPEED = (-0.94, 0.86), (0.0458, 0.7404), (19000.0, 232000.0), (8.9, 11.0)
"""rad, -, -, m/s; V.B"""
WORDS = ("least", "greatest")
ELLIPSE = (
    "our ellipse is narrower than the wing at mid-span and wider at its tip; the planform is printed as a picture"
)
LIFT = {
    "time": "|v_mac|^2 over a stroke is 14 % above the airspeed's, which makes up for it",
    "frequency": "nearly five times the weight: the printed column cannot be that of the flight",
}
CONTRADICTION = "11.0 m/s contradicts the paper's own angles of attack: 9.2 m/s over cos(0.94) is 15.6 m/s"
BRAKE = "as printed, the theta_dot squared row makes flapping a brake: no steady flight, its sign is doubtful"


def stroke_fields() -> SpatialKinematics:
    """Compute the fields over span and stroke on the paper's grid."""
    return spatial_kinematics(WING, steady_flight(SLOW_HAWK_STROKE, INSTANTS, SPEED))


def simulated_loads(column: str, angle: float = 0.0) -> Floats:
    """Compute loads (N, 6) in N, N m over a stroke by a column of Table 1, at an ``angle`` of attack in rad."""
    return prescribed_loads(MODEL, SETTINGS[column], WING, steady_flight(SLOW_HAWK_STROKE, INSTANTS, SPEED, angle))


def spatial_rows() -> list[Row]:
    """Compare the ranges of V.B."""
    fields = stroke_fields()
    angle, speed = fields.angle_of_attack, fields.speed
    frequency, reynolds = fields.reduced_frequency, fields.reynolds
    rows = [
        compare_share(figure("V.B", f"{word} {quantity}", unit, printed), computed, share, why)
        for quantity, unit, ends, field, share, why in (
            ("angle of attack", "rad", ANGLE, angle, 0.05, ""),
            ("reduced frequency", "-", REDUCED, frequency, 0.1, ELLIPSE),
            ("Reynolds number", "-", REYNOLDS, reynolds, 0.1, ELLIPSE),
        )
        for word, printed, computed in zip(WORDS, ends, _ends(field), strict=True)
    ]
    least, greatest = (
        figure("V.B", f"{w} section speed", "m/s", v) for w, v in zip(WORDS, SECTION_SPEED, strict=True)
    )
    return [
        *rows,
        compare_share(least, float(speed.min()), 0.05),
        unreproducible(greatest, float(speed.max()), CONTRADICTION),
    ]


def _ends(field: Floats) -> tuple[float, float]:
    return float(field.min()), float(field.max())


def table_rows() -> list[Row]:
    """Compare both columns of Table 1 in level flight at the mean airspeed."""
    return [row for column in COLUMNS for row in _column_rows(column)]


def _column_rows(column: str) -> list[Row]:
    level = coefficients(COLUMNS[column], Regressors(SPEED, 0.0, 0.0, 0.0, 0.0)).lift
    where, low, high = f"Table 1, {column} domain", *RECORDED_HEAVE
    needed = figure(where, "C_L at 9.2 m/s against level flight's", "-", LEVEL_LIFT)
    heave = figure(where, "heave speed that carries the weight", "m/s", low, high)
    needed_heave = carrying_heave(SETTINGS[column], SPEED, LEVEL_LIFT)
    thrust = figure(where, "mean thrust of a steady stroke", "N", 0.0, math.inf)
    return [
        compare_share(needed, level, 0.15, LIFT[column]),
        compare(heave, needed_heave, why=f"the range is the one recorded; {_trims(column)}"),
        unreproducible(thrust, float(simulated_loads(column)[:, 0].mean()), BRAKE),
    ]


def _trims(column: str) -> str:
    try:
        level_heave(SETTINGS[column], SPEED, LEVEL_LIFT)
    except InputError as refusal:
        return f"refused: {refusal}"
    return "trims"


def draw_plots(folder: Path) -> list[Path]:
    """Draw Fig. 8's polar plots into a new file of ``folder``, created if missing.

    Raises:
        InputError: the file exists, or matplotlib is not installed.
    """
    path = folder / "grauer_fig_8.png"
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    folder.mkdir(parents=True, exist_ok=True)
    draw_spatial(stroke_fields(), path, f"Slow Hawk over a stroke, {SPEED:g} m/s, {FREQUENCY:g} Hz (Grauer Fig. 8)")
    return [path]


CHECKS = (Check("spatial kinematics", spatial_rows), Check("Table 1", table_rows, slow=True))
