"""Nonlinear longitudinal motion in airspeed and angle of attack, by coefficients of drag, lift and moment.

``V' = -D/m + T cos(alpha + sigma)/m + g sin(alpha - theta)``, ``alpha' = q - (L + T sin(alpha + sigma))/(m V) +
g cos(alpha - theta)/V``, ``theta' = q``, ``q' = (qbar S c C_m + T l)/I_y`` (Klein & Morelli, Aircraft System
Identification, 2006, ch. 3; Jategaonkar, Flight Vehicle System Identification, 2006, ch. 4 and 5). Coefficients:

* ``C_D = C_D_0 + C_D_V V/V0 + C_D_alpha alpha + C_D_alpha2 alpha^2 + C_D_k C_L^2 + C_D_q q' + C_D_delta delta``
* ``C_L = C_L_0 + C_L_V V/V0 + C_L_alpha alpha + C_L_alpha2 alpha^2 + C_L_q q' + C_L_delta delta``
* ``C_m = C_m_0 + C_m_V V/V0 + C_m_alpha alpha + C_m_alpha2 alpha^2 + C_m_q q' + C_m_delta delta``

with ``q' = q c / (2 V0)``, or ``q c / (2 V)`` where `Airframe.rate_by_airspeed`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Named
from logs.identification.models.compiled import LONGEST_STEP, CompiledModel
from logs.identification.results import Array
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

_DRAG = ("0", "V", "alpha", "alpha2", "k", "q", "delta")
_OTHERS = ("0", "V", "alpha", "alpha2", "q", "delta")
COEFFICIENTS = (
    *(f"C_D_{name}" for name in _DRAG),
    *(f"C_L_{name}" for name in _OTHERS),
    *(f"C_m_{name}" for name in _OTHERS),
)
_PER_RADIAN = ("alpha", "q", "delta")
ELEVATOR, THRUST, DENSITY, PRESSURE = "delta_e", "thrust", "density", "dynamic_pressure"
CONSTANT, SIGNAL, MEASURED_PRESSURE = 0.0, 1.0, 2.0


class Airframe(NamedTuple):
    """What must be known of the aircraft."""

    mass: float
    """kg"""
    inertia_y: float
    """kg m^2"""
    area: float
    """m^2"""
    chord: float
    """m"""
    airspeed: float
    """m/s; V0, the reference of V and of the pitch rate"""
    density: float | str = 1.225
    """kg/m^3; or "density" where it is a signal, or "dynamic_pressure" where that one (Pa) is"""
    thrust_inclination: float = 0.0
    """rad; sigma, of the thrust above the body's x axis"""
    thrust_arm: float = 0.0
    """m; l, pitching moment (nose up) per thrust"""
    accelerometer_x: float = 0.0
    """m; forward of the center of mass"""
    accelerometer_z: float = 0.0
    """m; below the center of mass"""
    vane_x: float = 0.0
    """m; of the flow-angle sensor, forward of the center of mass: it feels ``-q x / V``"""
    gravity: float = STANDARD_GRAVITY
    """m/s^2"""
    rate_by_airspeed: bool = False
    """-; the pitch rate is made dimensionless by the airspeed of the moment, not by V0"""


@njit(cache=True, error_model="numpy")
def _loads(x: Array, u: Array, p: Array, c: Array) -> tuple[float, float, float]:
    """Drag and lift per mass in m/s^2, pitch acceleration in rad/s^2."""
    v, alpha, delta = x[0], x[1], u[0]
    relative = v / c[4]
    rate = x[3] * c[3] / (2 * (v if c[13] > 0 else c[4]))
    lift = p[7] + p[8] * relative + p[9] * alpha + p[10] * alpha * alpha + p[11] * rate + p[12] * delta
    drag = p[0] + p[1] * relative + p[2] * alpha + p[3] * alpha * alpha
    drag += p[4] * lift * lift + p[5] * rate + p[6] * delta
    moment = p[13] + p[14] * relative + p[15] * alpha + p[16] * alpha * alpha + p[17] * rate + p[18] * delta
    if c[5] == 2.0:
        force = u[2] * c[2]
    elif c[5] == 1.0:
        force = 0.5 * u[2] * v * v * c[2]
    else:
        force = 0.5 * c[6] * v * v * c[2]
    return drag * force / c[0], lift * force / c[0], (moment * force * c[3] + u[1] * c[8]) / c[1]


@njit(cache=True, error_model="numpy")
def _rates(x: Array, u: Array, p: Array, c: Array, out: Array) -> None:
    drag, lift, pitching = _loads(x, u, p, c)
    v, alpha, theta, q = x[0], x[1], x[2], x[3]
    thrust = u[1] / c[0]
    out[0] = thrust * math.cos(alpha + c[7]) - drag + c[12] * math.sin(alpha - theta)
    out[1] = q + (c[12] * math.cos(alpha - theta) - lift - thrust * math.sin(alpha + c[7])) / v
    out[2] = q
    out[3] = pitching


@njit(cache=True, error_model="numpy")
def _observe(x: Array, u: Array, p: Array, c: Array, out: Array) -> None:
    drag, lift, pitching = _loads(x, u, p, c)
    v, alpha, theta, q = x[0], x[1], x[2], x[3]
    thrust, sin, cos = u[1] / c[0], math.sin(alpha), math.cos(alpha)
    out[0], out[1], out[2], out[3], out[4] = v, alpha - q * c[11] / v, theta, q, pitching
    out[5] = lift * sin - drag * cos + thrust * math.cos(c[7]) + c[10] * pitching - c[9] * q * q
    out[6] = -lift * cos - drag * sin - thrust * math.sin(c[7]) - c[9] * pitching - c[10] * q * q


def nonlinear_longitudinal(airframe: Airframe, longest_step: float = LONGEST_STEP) -> CompiledModel:
    """The model of ``airframe``: states V, alpha, theta, q; inputs delta_e, thrust (N), and the air where measured.

    Outputs: V, alpha (as the vane feels it), theta, q, q_dot, a_x, a_z (specific forces at the accelerometer).
    All of `COEFFICIENTS` are parameters, zero and fixed unless the problem names them.

    Raises:
        InputError: a mass, inertia, area, chord, airspeed or density that is not positive.
    """
    for name in ("mass", "inertia_y", "area", "chord", "airspeed"):
        if not getattr(airframe, name) > 0:
            raise InputError(f"the airframe's {name} must be positive, not {getattr(airframe, name):g}")
    air = air_source(airframe.density)
    inputs = {ELEVATOR: "rad", THRUST: "N"} | ({str(airframe.density): air[2]} if air[2] else {})
    return CompiledModel(
        states={
            "V": Named("m/s", airframe.airspeed), "alpha": Named("rad"), "theta": Named("rad"), "q": Named("rad/s"),
        },
        inputs=inputs,
        outputs={
            "V": "m/s", "alpha": "rad", "theta": "rad", "q": "rad/s", "q_dot": "rad/s^2", "a_x": "m/s^2",
            "a_z": "m/s^2",
        },
        parameters={name: Named(_unit(name)) for name in COEFFICIENTS},
        rates=_rates,
        observe=_observe,
        constants=_constants(airframe, air),
        longest_step=longest_step,
    )  # fmt: skip


def air_source(density: float | str) -> tuple[float, float, str]:
    """How the dynamic pressure is had, the constant density, and the unit of its signal."""
    if density == DENSITY:
        return SIGNAL, 0.0, "kg/m^3"
    if density == PRESSURE:
        return MEASURED_PRESSURE, 0.0, "Pa"
    if isinstance(density, str) or not density > 0:
        raise InputError(f'the density is a positive number, "{DENSITY}" or "{PRESSURE}", not {density}')
    return CONSTANT, float(density), ""


def _constants(airframe: Airframe, air: tuple[float, float, str]) -> Array:
    a = airframe
    return np.array([
        a.mass, a.inertia_y, a.area, a.chord, a.airspeed, air[0], air[1], a.thrust_inclination, a.thrust_arm,
        a.accelerometer_x, a.accelerometer_z, a.vane_x, a.gravity, float(a.rate_by_airspeed),
    ])  # fmt: skip


def _unit(name: str) -> str:
    kind = name.rsplit("_", 1)[1]
    return "1/rad^2" if kind == "alpha2" else "1/rad" if kind in _PER_RADIAN else "-"
