"""Signals computed from measured ones: flow, angular accelerations, coefficients; signals that sections name.

Klein & Morelli, Aircraft System Identification, 2006, chapter 3 (equations of motion solved for the aerodynamic
forces and moments) and 5 (as the responses of a regression). Body axes FRD about the center of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import savgol_coeffs

from logs.identification.data.experiment import Experiment, runs
from logs.identification.data.smoothing import MIN_WIDTH, local_quadratic
from logs.identification.diagnostics.estimates import jumps
from logs.identification.estimators.regressors import LINE, Averaging, average_of_slope
from logs.identification.models.rigid_body import acceleration_at_center
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

if TYPE_CHECKING:
    from logs.identification.sources.table.maneuvers import DataSplit

COEFFICIENTS = ("C_X", "C_Y", "C_Z", "C_L", "C_D", "C_l", "C_m", "C_n")
FORCES = ("a_x", "a_y", "a_z")
SLOPE_SPAN = 0.1
"""s; over which a parabola is laid to differentiate, five samples at the least"""
SLOPES = {
    "p_dot": ("p_dot",), "q_dot": ("q_dot",), "r_dot": ("r_dot",), "alpha_dot": ("alpha_dot",),
    "beta_dot": ("beta_dot",), "C_l": ("p_dot", "r_dot"), "C_m": ("q_dot",), "C_n": ("p_dot", "r_dot"),
}  # fmt: skip
"""derivatives that a computed signal contains"""


class Source(NamedTuple):
    """Where a derived signal looks values up: the maneuver's signals, then the constants of the map."""

    experiment: Experiment
    constants: Mapping[str, float]
    """SI, by name"""
    requested: str
    """-; the signal that is computed, for messages"""

    def get(self, name: str, otherwise: float | None = None) -> Array:
        """A signal (N,), or a constant as one.

        Raises:
            InputError: it is neither, and there is no ``otherwise``.
        """
        if name in self.experiment.signals:
            return np.asarray(self.experiment.signals[name], dtype=np.float64)
        value = self.constants.get(name, otherwise)
        if value is None:
            if name in DERIVED and name != self.requested:
                return DERIVED[name][1](self._replace(requested=name))
            raise InputError(f"{self.requested} needs signals.{name} or constants.{name}")
        return np.full(len(self.experiment.time), value)

    def constant(self, name: str) -> float:
        """A constant of the vehicle.

        Raises:
            InputError: it is not given.
        """
        if name not in self.constants:
            raise InputError(f"{self.requested} needs constants.{name}")
        return self.constants[name]


def slope(values: Array, step: float, width: int | None = None) -> Array:
    """Derivative (N,) by local parabolas, run by run between what was not measured; NaN where a run is too short.

    The parabolas have ``width`` samples, by default `slope_width`.
    """
    rates, width = np.full(len(values), np.nan), width or slope_width(step)
    for run in runs(np.isfinite(values)):
        if run.stop - run.start >= width + 2:
            rates[run] = local_quadratic(values[run], step, width).rates
    return rates


def slope_width(step: float, span: float = SLOPE_SPAN) -> int:
    """Samples, ``step`` s apart, over which a parabola is laid that spans ``span`` s."""
    return max(MIN_WIDTH, 2 * int(span / step / 2) + 1)


def averaging_of(experiments: Sequence[Experiment], names: Collection[str]) -> Averaging | None:
    """The averaging of `slope` in those of the signals ``names`` that contain a derivative; None if none does."""
    first = experiments[0]
    through = frozenset(
        name
        for name in SLOPES.keys() & names
        if name not in first.signals and any(rate not in first.signals for rate in SLOPES[name])
    )
    if not through:
        return None
    weights = savgol_coeffs(slope_width(first.step), 2, deriv=1, use="dot")
    curved, lined = average_of_slope(weights), average_of_slope(weights, LINE)
    if any(jumps(one.signals[name]) for one in experiments for name in names if name in one.signals):
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
        return np.asarray((mass * _at_center(source, axis) - pushed) / (source.get("qbar") * area))

    return of


def _at_center(source: Source, axis: int) -> Array:
    """Specific force along a body axis at the center of mass; rates that are not measured count as none."""
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


DERIVED: dict[str, tuple[str, Callable[[Source], Array]]] = {
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
"""signals that can be computed, with their SI unit"""


def with_derived(experiment: Experiment, names: set[str], constants: Mapping[str, float]) -> Experiment:
    """The experiment with those of ``names`` that are not measured but can be computed.

    Raises:
        InputError: an argument of one of them is neither measured nor given.
    """
    signals, units = dict(experiment.signals), dict(experiment.units)
    for name in sorted(names & DERIVED.keys() - signals.keys()):
        unit, make = DERIVED[name]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            values = make(Source(experiment, constants, name))
        signals[name], units[name] = np.where(np.isfinite(values), values, np.nan), unit
    return experiment._replace(signals=signals, units=units)


# --- signals that a section names -----------------------------------------------------------------------------

LEAST_COMPARED, IDENTICAL = 10, 1e-9
"""-; samples from which two signals are compared; 1 minus the size of a correlation that is only rounding"""


def signal(one: Experiment, name: str, unit: str | None, key: str) -> Array:
    """The signal (N,) that the map's ``key`` names, in SI ``unit``; None accepts any.

    Raises:
        InputError: it is not in [signals], is in another unit, or has no sample.
    """
    if name not in one.signals:
        guess = did_you_mean(name, one.signals)
        raise InputError(f"{key} = {name!r} is not in [signals]{guess}; there are: {', '.join(one.signals)}")
    known = one.units.get(name, "-")
    if unit is not None and known != unit:
        raise InputError(f"signals.{name} is in {known}; {key} must be in {unit}")
    values = np.asarray(one.signals[name], dtype=np.float64)
    if not np.any(np.isfinite(values)):
        raise InputError(f"{one.name}: {name} ({key}) was not measured")
    return values


def band_frequencies(band: tuple[float, float], experiments: tuple[Experiment, ...], key: str) -> Array:
    """Frequencies (F,) in Hz of a ``band`` in Hz, one over the longest record's length apart.

    Raises:
        InputError: the band does not increase from above 0, or contains none; ``key`` is that of its section.
    """
    low, high = band
    length = max(len(one.time) * one.step for one in experiments)
    found = np.arange(max(np.ceil(low * length), 1.0), np.floor(high * length) + 1.0) / length
    if not 0 < low < high or not len(found):
        raise InputError(f"{key}: frequency_band = [{low:g}, {high:g}] Hz contains no frequency")
    return found


def check_distinct(
    experiments: Sequence[Experiment], inputs: Sequence[str], outputs: Sequence[str], key: str
) -> None:
    """Reject an output that is an input up to scale and offset: any fit to it is perfect and means nothing.

    Raises:
        InputError: it names both; ``key`` is that of the section.
    """
    for first, second in product(inputs, outputs):
        if first == second:
            raise InputError(f"{key}: {first} is in inputs and in outputs")
        pairs = [
            (np.asarray(one.signals[first]), np.asarray(one.signals[second]))
            for one in experiments
            if first in one.signals and second in one.signals
        ]
        both = np.concatenate([np.column_stack(pair) for pair in pairs]) if pairs else np.zeros((0, 2))
        both = both[np.all(np.isfinite(both), axis=1)]
        if len(both) < LEAST_COMPARED or not np.all(np.ptp(both, axis=0) > 0.0):
            continue
        if 1.0 - abs(float(np.corrcoef(both.T)[0, 1])) < IDENTICAL:
            raise InputError(f"{key}: input {first} and output {second} are one signal: is it the same column?")


# --- flow angles at the center of mass ------------------------------------------------------------------------

VANE = "vane_x"
VANE_RATES = (("alpha", "q", 1.0), ("beta", "r", -1.0))


def at_center_of_mass(data: DataSplit, used: Collection[str]) -> DataSplit:
    """The maneuvers with flow angles at the center of mass if ``constants`` have the position of the vanes.

    ``alpha = alpha_vane + q x / V`` and ``beta = beta_vane - r x / V`` of a vane x m ahead (Klein & Morelli 2006,
    sec. 10.2). An angle that no fit uses (``used``) is left as it is if its rate is not measured.

    Raises:
        InputError: the rate or the airspeed is missing.
    """
    position = data.constants.get(VANE, 0.0)
    if not position:
        return data

    def moved(one: Experiment) -> Experiment:
        signals = dict(one.signals)
        for angle, rate, sign in VANE_RATES:
            if angle not in signals or (rate not in signals and angle not in used):
                continue
            if rate not in signals:
                raise InputError(f"constants.{VANE} needs signals.{rate}: {angle} of the center of mass needs both")
            speed = Source(one, data.constants, f"constants.{VANE}").get("V")
            turning = np.asarray(signals[rate]) * position / np.where(speed > 0.0, speed, np.nan)
            signals[angle] = np.asarray(signals[angle]) + sign * turning
        return one._replace(signals=signals)

    return data.map(moved)
