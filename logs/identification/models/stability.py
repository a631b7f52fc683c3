"""Linear models of an aircraft about a steady flight, by their stability and control derivatives.

Dimensional derivatives (Etkin & Reid, Dynamics of Flight, 1996, ch. 4; Klein & Morelli, Aircraft System
Identification, 2006, ch. 3): forces per mass and moments per inertia. Angles, rates and inputs are deviations
from the steady flight, or whole where a constant (``Z_0``, ``M_0``, ...) or a bias of each maneuver takes up the
rest. Every derivative is a parameter ``<axis>_<signal>``, zero and fixed unless the problem names it; a regressor
that is no state (a measured sideslip, say) is an input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from logs.identification.estimators.engine.problem import Named
from logs.identification.models.linear import ONE, LinearModel, Term, Terms, linear_model, times
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

UNITS = {
    "alpha": "rad", "beta": "rad", "theta": "rad", "phi": "rad", "p": "rad/s", "q": "rad/s", "r": "rad/s",
    "w": "m/s", "u": "m/s", "v": "m/s",
}  # fmt: skip


class Steady(NamedTuple):
    """The flight about which the model is linear, and where its accelerometers are."""

    airspeed: float
    """m/s"""
    pitch: float = 0.0
    """rad"""
    alpha: float = 0.0
    """rad; angle of attack"""
    accelerometer_x: float = 0.0
    """m; forward of the center of mass"""
    accelerometer_z: float = 0.0
    """m; below the center of mass"""
    gravity: float = STANDARD_GRAVITY
    """m/s^2"""


def _derivatives(axis: str, regressors: Mapping[str, str]) -> Terms:
    """Terms ``axis_suffix`` times each regressor (signal to suffix), and the constant ``axis_0``."""
    return (*(Term(of, f"{axis}_{suffix}") for of, suffix in regressors.items()), Term(ONE, f"{axis}_0"))


def _parameters(rates: Mapping[str, str], regressors: Mapping[str, str]) -> dict[str, Named]:
    """Parameters of the axes (axis to the unit of what it gives), by name."""
    names: dict[str, Named] = {}
    for axis, unit in rates.items():
        for of, suffix in regressors.items():
            names[f"{axis}_{suffix}"] = Named(f"({unit})/({UNITS.get(of, 'rad')})")
        names[f"{axis}_0"] = Named(unit)
    return names


def _suffixes(states: tuple[str, ...], inputs: tuple[str, ...]) -> dict[str, str]:
    """What follows the axis in a derivative's name; a single input is ``delta``."""
    if len(set(states + inputs)) < len(states + inputs):
        raise InputError("a signal is a state or an input twice")
    suffixes = {name: name for name in states}
    single = len(inputs) == 1 and inputs[0] not in UNITS
    return suffixes | {name: "delta" if single else name for name in inputs}


def short_period(
    steady: Steady, inputs: tuple[str, ...] = ("delta_e",), vertical: str = "alpha", pitch: bool = False
) -> LinearModel:
    """The airspeed taken as constant; states ``vertical`` (alpha or w), q, and theta where ``pitch``.

    ``alpha' = Z_alpha alpha + (1 + Z_q) q + Z_delta delta + Z_0`` with Z in 1/s, or
    ``w' = Z_w w + (V + Z_q) q + ...`` with Z in m/s^2; ``q' = M_alpha alpha + M_q q + M_delta delta + M_0``.
    Gravity's change with theta enters the first where theta is a state. Outputs: alpha or w, q, theta, q_dot, a_z
    (specific force along the body's z at the accelerometer, gravity's steady part taken off) and n_z
    (``-a_z / g``, the load factor's change).

    Raises:
        InputError: ``vertical`` is neither alpha nor w, or an airspeed that is not positive.
    """
    _airspeed(steady)
    if vertical not in ("alpha", "w"):
        raise InputError(f"a short period has the state alpha or w, not {vertical}")
    states = (vertical, "q", "theta") if pitch else (vertical, "q")
    suffixes = _suffixes((vertical, "q"), inputs)
    scale = steady.airspeed if vertical == "alpha" else 1.0
    force, moment = _derivatives("Z", suffixes), _derivatives("M", suffixes)
    turn = Term("q", factor=steady.airspeed / scale)
    weight = Term("theta", factor=-steady.gravity * math.sin(steady.pitch) / scale)
    specific = times(scale, force) + times(-steady.accelerometer_x, moment)
    outputs = _state_outputs(states) | {
        "q_dot": ("rad/s^2", moment),
        "a_z": ("m/s^2", specific),
        "n_z": ("-", times(-1 / steady.gravity, specific)),
    }
    rates = {vertical: (*force, turn, *((weight,) if pitch else ())), "q": moment, "theta": (Term("q"),)}
    units = {"Z": "rad/s" if vertical == "alpha" else "m/s^2", "M": "rad/s^2"}
    named = {name: Named(UNITS[name]) for name in states}
    return linear_model(named, _input_units(inputs), _parameters(units, suffixes), rates, outputs)


def longitudinal(steady: Steady, inputs: tuple[str, ...] = ("delta_e",), vertical: str = "alpha") -> LinearModel:
    """Speed, angle of attack or vertical speed, pitch rate and pitch about a steady flight.

    ``u' = X_u u + X_alpha alpha + X_q q + X_delta delta - g cos(pitch) theta - V sin(alpha) q``; along z the same
    with Z for ``V alpha'``, with ``V cos(alpha) q`` and ``-g sin(pitch) theta``;
    ``q' = M_u u + M_alpha alpha + M_q q + M_delta delta``. X and Z are in m/s^2, M in rad/s^2. u and w are changes of
    the airspeed along the body axes (m/s); the state alpha is w / V. With ``vertical`` "w" the derivatives are X_w,
    Z_w and M_w. Outputs: u, w or alpha, q, theta, q_dot, a_x, a_z, n_z as in `short_period`, and alpha as a vane
    measures it, which depends on u about a steady angle of attack.

    Raises:
        InputError: ``vertical`` is neither alpha nor w, or an airspeed that is not positive.
    """
    _airspeed(steady)
    if vertical not in ("alpha", "w"):
        raise InputError(f"a longitudinal model has the state alpha or w, not {vertical}")
    v, g = steady.airspeed, steady.gravity
    scale = v if vertical == "alpha" else 1.0
    states = ("u", vertical, "q", "theta")
    suffixes = _suffixes(states[:3], inputs)
    x, z, m = (_derivatives(axis, suffixes) for axis in "XZM")
    sin, cos = math.sin(steady.pitch), math.cos(steady.pitch)
    rising, along = math.sin(steady.alpha), math.cos(steady.alpha)
    rates = {
        "u": (*x, Term("theta", factor=-g * cos), Term("q", factor=-v * rising)),
        vertical: (
            *times(1 / scale, z),
            Term("theta", factor=-g * sin / scale),
            Term("q", factor=v * along / scale),
        ),
        "q": m,
        "theta": (Term("q"),),
    }
    specific = z + times(-steady.accelerometer_x, m)
    outputs = _state_outputs(states) | {
        "alpha": ("rad", (Term(vertical, factor=along * scale / v), Term("u", factor=-rising / v))),
        "q_dot": ("rad/s^2", m),
        "a_x": ("m/s^2", x + times(steady.accelerometer_z, m)),
        "a_z": ("m/s^2", specific),
        "n_z": ("-", times(-1 / g, specific)),
    }
    units = {"X": "m/s^2", "Z": "m/s^2", "M": "rad/s^2"}
    named = {name: Named(UNITS[name]) for name in states}
    return linear_model(named, _input_units(inputs), _parameters(units, suffixes), rates, outputs)


def lateral(
    steady: Steady,
    inputs: tuple[str, ...] = ("delta_a", "delta_r"),
    states: tuple[str, ...] = ("beta", "p", "r", "phi"),
) -> LinearModel:
    """Sideslip, roll rate, yaw rate and bank about a steady flight; Y in m/s^2, L and N in rad/s^2.

    ``V beta' = Y_beta beta + Y_p p + Y_r r + Y_delta_a delta_a + ... + V sin(alpha) p - V cos(alpha) r +
    g cos(pitch) phi``, ``p' = L_beta beta + ...``, ``r' = N_beta beta + ...`` (the product of inertia contained in L
    and N), ``phi' = p + tan(pitch) r``. Of ``states`` any may be left out: a measured beta is then an input, as in
    models of p and r alone. Outputs: the states, p_dot, r_dot, and a_y (specific force at the accelerometer) with
    n_y = a_y / g.

    Raises:
        InputError: a state that there is not, or an airspeed that is not positive.
    """
    _airspeed(steady)
    known = ("beta", "p", "r", "phi")
    if not set(states) <= set(known) or not states:
        raise InputError(f"a lateral model has the states {', '.join(known)}, not {', '.join(states)}")
    suffixes = _suffixes(tuple(s for s in states if s != "phi"), tuple(i for i in inputs if i != "phi"))
    y, roll, yaw = (_derivatives(axis, suffixes) for axis in "YLN")
    beta, phi = (_there(terms, {*states, *inputs}) for terms in _lateral_kinematics(steady))
    rates = {"beta": times(1 / steady.airspeed, y) + beta, "p": roll, "r": yaw, "phi": phi}
    specific = y + times(steady.accelerometer_x, yaw) + times(-steady.accelerometer_z, roll)
    outputs = _state_outputs(states) | {
        "p_dot": ("rad/s^2", roll),
        "r_dot": ("rad/s^2", yaw),
        "a_y": ("m/s^2", specific),
        "n_y": ("-", times(1 / steady.gravity, specific)),
    }
    units = {"Y": "m/s^2", "L": "rad/s^2", "N": "rad/s^2"}
    named = {name: Named(UNITS[name]) for name in states}
    return linear_model(named, _input_units(inputs), _parameters(units, suffixes), rates, outputs)


def _lateral_kinematics(steady: Steady) -> tuple[Terms, Terms]:
    """What turning and gravity add to the rates of beta and phi."""
    beta = (
        Term("p", factor=math.sin(steady.alpha)),
        Term("r", factor=-math.cos(steady.alpha)),
        Term("phi", factor=steady.gravity * math.cos(steady.pitch) / steady.airspeed),
    )
    return beta, (Term("p"), Term("r", factor=math.tan(steady.pitch)))


def _there(terms: Terms, signals: set[str]) -> Terms:
    return tuple(term for term in terms if term.of in signals)


def _airspeed(steady: Steady) -> None:
    if not steady.airspeed > 0:
        raise InputError(f"a linear model needs a positive airspeed, not {steady.airspeed:g} m/s")


def _state_outputs(states: tuple[str, ...]) -> dict[str, tuple[str, Terms]]:
    return {name: (UNITS[name], (Term(name),)) for name in states}


def _input_units(inputs: tuple[str, ...]) -> dict[str, str]:
    return {name: UNITS.get(name, "rad") for name in inputs}
