"""Derivatives of the stroke-averaged longitudinal motion (Malladi Eq. 26-28; states u, w, q, theta).

The model is `models.stability.longitudinal` with the state w. Z_w is Malladi's Z_alpha / V, M_w his M_alpha / V; the
derivatives contain the wings' apparent mass and downwash lag.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import ELEVATOR, Reference
from logs.identification.models.linear import LinearModel
from logs.identification.models.stability import Steady, longitudinal, short_period
from logs.identification.results import Array

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
