"""What is computed from the measured signals where a map asks for it: flow, angular accelerations, coefficients.

Klein & Morelli, Aircraft System Identification, 2006, chapter 3 (equations of motion solved for the aerodynamic
forces and moments) and 5 (as the responses of a regression). Body axes FRD about the centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_coeffs

from logs.identification.data.contiguous_runs import runs
from logs.identification.data.experiment import Experiment
from logs.identification.data.smoothing import MIN_WIDTH, local_quadratic
from logs.identification.diagnostics.sampling import jumps
from logs.identification.estimators.regressors import LINE, Averaging, average_of_slope
from logs.identification.models.rigid_body import acceleration_at_center
from logs.identification.results import Array
from wingbeat.errors import InputError

COEFFICIENTS = ("C_X", "C_Y", "C_Z", "C_L", "C_D", "C_l", "C_m", "C_n")
FORCES = ("a_x", "a_y", "a_z")
SLOPE_SPAN = 0.1
"""s; over which a parabola is laid to differentiate, five samples at the least"""
SLOPES = {
    "p_dot": ("p_dot",), "q_dot": ("q_dot",), "r_dot": ("r_dot",), "alpha_dot": ("alpha_dot",),
    "beta_dot": ("beta_dot",), "C_l": ("p_dot", "r_dot"), "C_m": ("q_dot",), "C_n": ("p_dot", "r_dot"),
}  # fmt: skip
"""-; what a signal that is made rests on, of the slopes of others"""


class Source(NamedTuple):
    """Where a derived signal looks things up: the manoeuvre's signals, then the constants of the map."""

    experiment: Experiment
    constants: Mapping[str, float]
    """SI, by name"""
    asked: str
    """-; the signal that is made, for complaints"""

    def get(self, name: str, otherwise: float | None = None) -> Array:
        """A signal (N,), or a constant as one.

        Raises:
            InputError: it is neither, and there is no ``otherwise``.
        """
        if name in self.experiment.signals:
            return np.asarray(self.experiment.signals[name], dtype=np.float64)
        value = self.constants.get(name, otherwise)
        if value is None:
            made = MADE.get(name)
            if made is not None and name != self.asked:
                return made[1](self._replace(asked=name))
            raise InputError(f"{self.asked} needs signals.{name} or constants.{name}")
        return np.full(len(self.experiment.time), value)

    def constant(self, name: str) -> float:
        """A constant of the vehicle.

        Raises:
            InputError: it was not told.
        """
        if name not in self.constants:
            raise InputError(f"{self.asked} needs constants.{name}")
        return self.constants[name]


def slope(values: Array, step: float, width: int | None = None) -> Array:
    """Derivative (N,) by local parabolas, run by run between what was not measured; NaN where a run is too short.

    They are laid over ``width`` samples, `slope_width` where none is told.
    """
    rates, width = np.full(len(values), np.nan), width or slope_width(step)
    for run in runs(np.isfinite(values)):
        if run.stop - run.start >= width + 2:
            rates[run] = local_quadratic(values[run], step, width).rates
    return rates


def slope_width(step: float, span: float = SLOPE_SPAN) -> int:
    """Samples, ``step`` s apart, over which a parabola is laid that spans ``span`` s."""
    return max(MIN_WIDTH, 2 * int(span / step / 2) + 1)


def averaging_of(experiments: Sequence[Experiment], wanted: Collection[str]) -> Averaging | None:
    """What `slope` averages of those of the ``wanted`` signals that rest on one; None where none does."""
    first = experiments[0]
    through = frozenset(
        name
        for name in SLOPES.keys() & wanted
        if name not in first.signals and any(rate not in first.signals for rate in SLOPES[name])
    )
    if not through:
        return None
    weights = savgol_coeffs(slope_width(first.step), 2, deriv=1, use="dot")
    curved, lined = average_of_slope(weights), average_of_slope(weights, LINE)
    if any(jumps(one.signals[name]) for one in experiments for name in wanted if name in one.signals):
        return Averaging(lined, curved, through)
    return Averaging(curved, lined, through)


def _rate(of: str) -> Callable[[Source], Array]:
    return lambda source: slope(source.get(of), source.experiment.step)


def _qbar(source: Source) -> Array:
    return np.asarray(0.5 * source.get("rho") * source.get("V") ** 2)


def _force(axis: int) -> Callable[[Source], Array]:
    """Coefficient along a body axis: (m a - T) / (qbar S)."""

    def of(source: Source) -> Array:
        mass, area = source.constant("mass"), source.constant("S")
        angle = source.constants.get("thrust_angle", 0.0)
        share = (np.cos(angle), 0.0, -np.sin(angle))[axis]
        pushed = share * source.get("thrust", 0.0)
        return np.asarray((mass * _at_centre(source, axis) - pushed) / (source.get("qbar") * area))

    return of


def _at_centre(source: Source, axis: int) -> Array:
    """Specific force along a body axis at the centre of mass; rates that are not measured count as none."""
    own = source.get(FORCES[axis])
    place = tuple(source.constants.get(name, 0.0) for name in ("imu_x", "imu_y", "imu_z"))
    if not any(place):
        return own
    omega = np.column_stack(_rates(source))
    turning = np.column_stack(
        [source.get(f"{rate}_dot", 0.0 if not np.any(omega[:, n]) else None) for n, rate in enumerate("pqr")]
    )
    measured = np.zeros_like(omega)
    measured[:, axis] = own
    return acceleration_at_center(measured, omega, turning, (place[0], place[1], place[2]))[:, axis]


def _lift(source: Source) -> Array:
    alpha = source.get("alpha")
    c_x, c_z = _force(0)(source), _force(2)(source)
    return np.asarray(c_x * np.sin(alpha) - c_z * np.cos(alpha))


def _drag(source: Source) -> Array:
    alpha = source.get("alpha")
    c_x, c_z = _force(0)(source), _force(2)(source)
    return np.asarray(-c_x * np.cos(alpha) - c_z * np.sin(alpha))


def _rates(source: Source) -> tuple[Array, Array, Array]:
    return source.get("p", 0.0), source.get("q", 0.0), source.get("r", 0.0)


def _rolling(source: Source) -> Array:
    p, q, r = _rates(source)
    i_xz = source.constants.get("I_xz", 0.0)
    moment = source.constant("I_x") * source.get("p_dot") - i_xz * (source.get("r_dot") + p * q)
    if np.any(q * r):
        moment = moment + (source.constant("I_z") - source.constant("I_y")) * q * r
    return np.asarray(moment / (source.get("qbar") * source.constant("S") * source.constant("b")))


def _pitching(source: Source) -> Array:
    p, _, r = _rates(source)
    moment = source.constant("I_y") * source.get("q_dot")
    if np.any(p) or np.any(r):
        i_xz = source.constants.get("I_xz", 0.0)
        if "I_x" in source.constants and "I_z" in source.constants:
            moment = moment + (source.constants["I_x"] - source.constants["I_z"]) * p * r
        moment = moment + i_xz * (p**2 - r**2)
    if "thrust" in source.experiment.signals or "thrust" in source.constants:
        angle = source.constants.get("thrust_angle", 0.0)
        arm = source.constants.get("thrust_z", 0.0) * np.cos(angle)
        arm += source.constants.get("thrust_x", 0.0) * np.sin(angle)
        moment = moment - arm * source.get("thrust")
    return np.asarray(moment / (source.get("qbar") * source.constant("S") * source.constant("c")))


def _yawing(source: Source) -> Array:
    p, q, r = _rates(source)
    i_xz = source.constants.get("I_xz", 0.0)
    moment = source.constant("I_z") * source.get("r_dot") - i_xz * (source.get("p_dot") - q * r)
    if np.any(p * q):
        moment = moment + (source.constant("I_y") - source.constant("I_x")) * p * q
    return np.asarray(moment / (source.get("qbar") * source.constant("S") * source.constant("b")))


MADE: dict[str, tuple[str, Callable[[Source], Array]]] = {
    "qbar": ("Pa", _qbar),
    "p_dot": ("rad/s^2", _rate("p")),
    "q_dot": ("rad/s^2", _rate("q")),
    "r_dot": ("rad/s^2", _rate("r")),
    "alpha_dot": ("rad/s", _rate("alpha")),
    "beta_dot": ("rad/s", _rate("beta")),
    "C_X": ("-", _force(0)),
    "C_Y": ("-", _force(1)),
    "C_Z": ("-", _force(2)),
    "C_L": ("-", _lift),
    "C_D": ("-", _drag),
    "C_l": ("-", _rolling),
    "C_m": ("-", _pitching),
    "C_n": ("-", _yawing),
}
"""What can be made, with its SI unit."""


def with_made(experiment: Experiment, wanted: set[str], constants: Mapping[str, float]) -> Experiment:
    """The experiment with those of ``wanted`` that are not measured but can be made.

    Raises:
        InputError: what one of them is made of is neither measured nor told.
    """
    signals, units = dict(experiment.signals), dict(experiment.units)
    for name in sorted(wanted & MADE.keys() - signals.keys()):
        unit, make = MADE[name]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            values = make(Source(experiment, constants, name))
        signals[name], units[name] = np.where(np.isfinite(values), values, np.nan), unit
    return experiment._replace(signals=signals, units=units)
