"""Lateral motion: modes of a linear model, and the nonlinear model for output error.

Of the eigenvalues of sideslip, roll rate, yaw rate and bank the complex pair is the Dutch roll, the faster of the two
real ones the roll mode, the slower the spiral (Etkin, Dynamics of Atmospheric Flight, 1972, ch. 9.6). Where those two
are a complex pair as well, slower than the Dutch roll, they are the lateral phugoid. Errors by the delta method.

States beta, p, r, phi; airspeed, angle of attack, pitch angle and pitch rate are measured inputs (Klein & Morelli,
Aircraft System Identification, 2006, ch. 3):

* ``beta' = (a_y + g cos(theta) sin(phi)) / (V cos(beta)) + p sin(alpha) - r cos(alpha) - V'/V tan(beta)``
* ``I_x p' - I_xz r' = qbar S b C_l + I_xz p q + (I_y - I_z) q r``
* ``I_z r' - I_xz p' = qbar S b C_n + (I_x - I_y) p q - I_xz q r``
* ``phi' = p + tan(theta) (q sin(phi) + r cos(phi))``

with ``a_y = qbar S C_Y / m`` and, for a = Y, l, n and the controls delta,
``C_a = C_a_0 + C_a_beta beta + C_a_beta3 beta^3 + C_a_p p b/(2V) + C_a_r r b/(2V) + sum C_a_delta delta``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Named
from logs.identification.findings import Finding, not_estimated
from logs.identification.models.compiled import CompiledModel
from logs.identification.models.modes import Oscillation, computed, oscillation, over, pair_of
from logs.identification.models.nonlinear_longitudinal import air_source
from logs.identification.results import Array, Estimate
from logs.identification.statistics.covariance import ParameterUncertainty, propagate
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

DUTCH_ROLL, ROLL, SPIRAL, LATERAL_PHUGOID = "dutch_roll", "roll", "spiral", "lateral_phugoid"
TURNING = 1e-9
"""1/s; imaginary part of an eigenvalue that counts as real"""
System = Callable[[Array], Array]


LateralModes = tuple[tuple[Estimate, ...], tuple[Finding, ...]]
"""frequency (rad/s), damping ratio, period, time and cycles to half of what oscillates; time constants (s) of roll;
time to half or to double (s) of the spiral; and the modes that are withheld"""


def lateral_modes(system: System, values: Array, spread: ParameterUncertainty) -> LateralModes:
    """The modes of the ``system`` (4, 4) of sideslip, roll rate, yaw rate and bank that ``values`` (p,) make.

    ``spread`` is that of the parameters.
    """
    roots = np.linalg.eigvals(system(values)).astype(complex)
    if len(roots) != 4:
        why = "it takes sideslip, roll rate, yaw rate and bank among the model's states"
        return (), (*(not_estimated(kind, why) for kind in (DUTCH_ROLL, ROLL, SPIRAL)),)
    pairs = int(np.sum(roots.imag > TURNING))
    if pairs == 0:
        why = "no eigenvalues of the fitted model are a complex pair: it does not oscillate"
        return (), (*(not_estimated(kind, why) for kind in (DUTCH_ROLL, ROLL, SPIRAL)),)
    found = [_oscillation(DUTCH_ROLL, 0, system, values, spread)]
    if pairs == 2:
        found.append(_oscillation(LATERAL_PHUGOID, 1, system, values, spread))
        return _collected(found, [])
    rates = [computed(partial(_decay, system, place), values, spread) for place in (0, 1)]
    return _collected(found, [_constant(ROLL, rates[0]), _halving(SPIRAL, rates[1])])


def _collected(pairs: list[Oscillation | Finding], single: list[Estimate | Finding]) -> LateralModes:
    """All of it, sorted into what is known and what is not."""
    estimates: list[Estimate] = []
    for pair in pairs:
        estimates += pair.estimates if isinstance(pair, Oscillation) else ()
    estimates += [one for one in single if isinstance(one, Estimate)]
    return tuple(estimates), tuple(one for one in (*pairs, *single) if isinstance(one, Finding))


def _oscillation(
    kind: str, place: int, system: System, values: Array, spread: ParameterUncertainty
) -> Oscillation | Finding:
    """The complex pair that is the ``place``-th fastest."""

    def pair(at: Array) -> Array:
        roots = np.linalg.eigvals(system(at)).astype(complex)
        turning = roots[roots.imag > TURNING]
        chosen = turning[np.argsort(-np.abs(turning))][min(place, len(turning) - 1)] if len(turning) else roots[0]
        return np.array(pair_of(chosen, chosen.conjugate()))

    return oscillation(kind, *propagate(pair, values, spread))


def _decay(system: System, place: int, at: Array) -> float:
    """By how much (1/s) the ``place``-th fastest of the modes that do not oscillate decays."""
    roots = np.linalg.eigvals(system(at)).astype(complex)
    still = roots[np.abs(roots.imag) <= TURNING].real
    return float(-still[np.argsort(-np.abs(still))][place]) if len(still) > place else math.nan


def _constant(kind: str, rate: Estimate) -> Estimate | Finding:
    """The time in which a mode falls to 1/e."""
    found = over(f"{kind}_time_constant", "s", 1.0, rate)
    return not_estimated(kind, _neutral(rate)) if found is None or rate.value < 0 else found


def _halving(kind: str, rate: Estimate) -> Estimate | Finding:
    """The time in which a mode halves or doubles."""
    change = "half" if rate.value > 0 else "double"
    return over(f"{kind}_time_to_{change}", "s", math.log(2), rate) or not_estimated(kind, _neutral(rate))


def _neutral(rate: Estimate) -> str:
    if rate.high < 0:
        return "it grows: no mode that subsides"
    return f"its decay, {rate.value:.2g} ({rate.low:.2g} to {rate.high:.2g}) 1/s, may be none"


AXES = ("Y", "l", "n")
REGRESSORS = {"0": "-", "beta": "1/rad", "beta3": "1/rad^3", "p": "1/rad", "r": "1/rad"}
"""unit of the coefficient by its suffix; those of the controls follow"""
MEASURED = {"V": "m/s", "alpha": "rad", "theta": "rad", "q": "rad/s", "V_dot": "m/s^2"}
"""unit by measured input; they follow the controls"""
_REGRESSORS = len(REGRESSORS)


class LateralAirframe(NamedTuple):
    """What must be known of the aircraft."""

    mass: float
    """kg"""
    inertia_x: float
    """kg m^2"""
    inertia_z: float
    """kg m^2"""
    area: float
    """m^2"""
    span: float
    """m"""
    inertia_xz: float = 0.0
    """kg m^2"""
    inertia_y: float = 0.0
    """kg m^2; needed if the pitch rate is not zero"""
    density: float | str = 1.225
    """kg/m^3; or "density" or "dynamic_pressure" if that signal is measured"""
    accelerometer_x: float = 0.0
    """m; forward of the center of mass"""
    accelerometer_z: float = 0.0
    """m; below the center of mass"""
    vane_x: float = 0.0
    """m; of the sideslip sensor, forward of the center of mass: it measures ``r x / V`` too"""
    gravity: float = STANDARD_GRAVITY
    """m/s^2"""


@njit(cache=True, error_model="numpy")
def _accelerations(x: Array, u: Array, p: Array, c: Array) -> tuple[float, float, float]:
    """Side force per mass in m/s^2, roll and yaw acceleration in rad/s^2."""
    controls, count = int(c[0]), _REGRESSORS + int(c[0])
    beta, v, pitching = x[0], u[controls], u[controls + 3]
    rate = c[5] / (2 * v)
    if c[9] == 2.0:
        force = u[controls + 5] * c[4]
    elif c[9] == 1.0:
        force = 0.5 * u[controls + 5] * v * v * c[4]
    else:
        force = 0.5 * c[10] * v * v * c[4]
    totals = np.empty(3)
    for axis in range(3):
        k = axis * count
        total = p[k] + p[k + 1] * beta + p[k + 2] * beta**3 + (p[k + 3] * x[1] + p[k + 4] * x[2]) * rate
        for j in range(controls):
            total += p[k + _REGRESSORS + j] * u[j]
        totals[axis] = total * force
    roll = totals[1] * c[5] + c[6] * x[1] * pitching + (c[7] - c[3]) * pitching * x[2]
    yaw = totals[2] * c[5] + (c[2] - c[7]) * x[1] * pitching - c[6] * pitching * x[2]
    determinant = c[2] * c[3] - c[6] * c[6]
    return totals[0] / c[1], (c[3] * roll + c[6] * yaw) / determinant, (c[6] * roll + c[2] * yaw) / determinant


@njit(cache=True, error_model="numpy")
def _rates(x: Array, u: Array, p: Array, c: Array, out: Array) -> None:
    side, roll, yaw = _accelerations(x, u, p, c)
    k = int(c[0])
    v, alpha, theta, q, growth = u[k], u[k + 1], u[k + 2], u[k + 3], u[k + 4]
    weight = c[8] * math.cos(theta) * math.sin(x[3])
    out[0] = (side + weight) / (v * math.cos(x[0])) - growth / v * math.tan(x[0])
    out[0] += x[1] * math.sin(alpha) - x[2] * math.cos(alpha)
    out[1], out[2] = roll, yaw
    out[3] = x[1] + math.tan(theta) * (q * math.sin(x[3]) + x[2] * math.cos(x[3]))


@njit(cache=True, error_model="numpy")
def _observe(x: Array, u: Array, p: Array, c: Array, out: Array) -> None:
    side, roll, yaw = _accelerations(x, u, p, c)
    k = int(c[0])
    v, q = u[k], u[k + 3]
    out[0] = x[0] + x[2] * c[13] / v
    out[1], out[2], out[3], out[4], out[5] = x[1], x[2], x[3], roll, yaw
    out[6] = side + c[11] * (yaw + x[1] * q) + c[12] * (q * x[2] - roll)


def nonlinear_lateral(airframe: LateralAirframe, controls: tuple[str, ...] = ("delta_a", "delta_r")) -> CompiledModel:
    """The model of ``airframe``: states beta, p, r, phi; inputs the controls, `MEASURED`, and the air if measured.

    Outputs: beta (as a vane measures it), p, r, phi, p_dot, r_dot, a_y (specific force at the accelerometer).
    Coefficients are parameters, zero and fixed unless the problem names them.

    Raises:
        InputError: a mass, inertia, area, span or density that is not positive, or impossible products of inertia.
    """
    a = airframe
    for name in ("mass", "inertia_x", "inertia_z", "area", "span"):
        if not getattr(a, name) > 0:
            raise InputError(f"the airframe's {name} must be positive, not {getattr(a, name):g}")
    if not a.inertia_xz**2 < a.inertia_x * a.inertia_z:
        raise InputError(f"I_xz = {a.inertia_xz:g} kg m^2 is larger than I_x and I_z allow")
    kind, density, unit = air_source(a.density)
    suffixes = REGRESSORS | dict.fromkeys(controls, "1/rad")
    constants = np.array([
        len(controls), a.mass, a.inertia_x, a.inertia_z, a.area, a.span, a.inertia_xz, a.inertia_y, a.gravity, kind,
        density, a.accelerometer_x, a.accelerometer_z, a.vane_x,
    ], dtype=np.float64)  # fmt: skip
    return CompiledModel(
        states={"beta": Named("rad"), "p": Named("rad/s"), "r": Named("rad/s"), "phi": Named("rad")},
        inputs=dict.fromkeys(controls, "rad") | MEASURED | ({str(a.density): unit} if unit else {}),
        outputs={
            "beta": "rad", "p": "rad/s", "r": "rad/s", "phi": "rad", "p_dot": "rad/s^2", "r_dot": "rad/s^2",
            "a_y": "m/s^2",
        },
        parameters={f"C_{axis}_{name}": Named(unit) for axis in AXES for name, unit in suffixes.items()},
        rates=_rates,
        observe=_observe,
        constants=constants,
    )  # fmt: skip
