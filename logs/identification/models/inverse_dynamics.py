"""From motion to the wings' aerodynamic coefficients (Grauer et al. 2011, Eq. 13 to 16).

Eq. 13 is in `wing_air`: what of force and moment neither the bodies' inertia and weight nor the tail explain, the
wings made. Lift acts against the base's z axis, thrust along its x axis, the moment about the base's origin, and all
three are divided by the dynamic pressure at the wings' mean aerodynamic center. The fuselage's drag is among the
wings' loads, as in the paper.

What differentiation makes of noise lies at high frequency, and so does what a filter leaves out of the motion.
Coefficients and every regressor are therefore low-passed alike at the end: a relation that is linear in the
regressors, products among them, stays what it was.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.terms import parse, unit_of
from logs.identification.models.multibody import MovedVehicle, SimulatedVehicle, Wing, flap_columns, wing_air, wing_of
from logs.identification.motion_capture.motion import Speeds, low_passed
from logs.identification.results import Array
from wingbeat.errors import InputError

LOW_PASS = 15.0
"""Hz; keeps the second harmonic of a bird's stroke, which the wing's speed squared has"""
RINGING = 1.5
"""-; periods of the low-pass that are cut off at each end, where the filter knows one side only"""
SAMPLED = 3.0
"""-; samples kept per period of the low-pass"""
LEAST_PRESSURE = 1.0
"""Pa; below it (1.3 m/s) coefficients mean nothing"""
COEFFICIENTS = ("C_L", "C_T", "C_m")
STATES = {"v_x": "m/s", "v_z": "m/s", "omega_y": "rad/s", "theta_11": "rad", "theta_11_rate": "rad/s"}
"""Regressors of Grauer Eq. 17 to 19 and their units; theta_11 is positive with the wing down"""


class WingMotion(NamedTuple):
    """A vehicle's motion at equally spaced instants, wherever it was measured."""

    name: str
    time: Array
    """s; (N,)"""
    moved: MovedVehicle
    density: float
    """kg/m^3; of the air"""
    notes: tuple[str, ...] = ()
    """-; what was not measured and was taken from elsewhere, one clause each"""


class WingCoefficients(NamedTuple):
    """Coefficients of Eq. 14 to 16 with the motion that they depend on."""

    experiment: Experiment
    """signals `COEFFICIENTS`, `STATES` and their products, low-passed alike, without the ends of the record"""
    load: Array
    """N, N m; (N, 6), of the air on both wings about the base's origin, body axes; not low-passed"""
    pressure: Array
    """Pa; (N,), half the density times |v_mac|^2; not low-passed"""
    notes: tuple[str, ...] = ()


def moved_by_speeds(vehicle: SimulatedVehicle, records: Speeds, wind_ned: tuple[float, float, float]) -> MovedVehicle:
    """Return the motion of `motion_capture.speeds` for the mechanism of ``vehicle``, the wings' twists at rest."""
    twists = 2 if vehicle.wing.twists else 0
    still = np.zeros((len(records.time), twists))
    columns = [np.column_stack([values, still]) for values in (records.speeds, records.angles, records.rates)]
    wind = np.tile(np.asarray(wind_ned, float), (len(records.time), 1))
    return MovedVehicle(records.quaternion, columns[0], columns[1], columns[2], wind)


def coefficients(
    vehicle: SimulatedVehicle, motion: WingMotion, cutoff: float | None = None, wing: Wing | None = None
) -> WingCoefficients:
    """Eq. 13 to 16 for ``motion`` of ``vehicle``, low-passed at ``cutoff`` Hz where given.

    Raises:
        InputError: the motion has other coordinates than the vehicle, samples that are not finite, no airspeed, or is
            too short or too slow for the cut-off.
    """
    moved, wing = motion.moved, wing or wing_of(vehicle)
    if not all(np.all(np.isfinite(values)) for values in moved):
        raise InputError(
            f"{motion.name}: inverse dynamics needs every sample of the motion; cut the record or bridge it"
        )
    air = wing_air(vehicle, moved, motion.density)
    if not np.all(air.pressure > LEAST_PRESSURE):
        raise InputError(
            f"{motion.name}: the wings' mean speed falls to zero: coefficients would be divided by nothing"
        )
    force = air.pressure * wing.area
    signals = dict(zip(COEFFICIENTS, coefficients_of(air.load, force, wing.chord), strict=True)) | states(
        vehicle, moved
    )
    signals |= products(signals)
    time = motion.time
    if cutoff is not None:
        time, signals = _low_passed(motion, signals, cutoff)
    units = dict.fromkeys(COEFFICIENTS, "-") | STATES | product_units()
    return WingCoefficients(Experiment(motion.name, time, signals, units), *air, motion.notes)


def coefficients_of(load: Array, force: Array, chord: float) -> tuple[Array, Array, Array]:
    """C_L, C_T, C_m (N,) of Eq. 14 to 16 from a load (N, 6) and S times the dynamic pressure (N,) in N."""
    return -load[:, 2] / force, load[:, 0] / force, load[:, 4] / (force * chord)


def states(vehicle: SimulatedVehicle, moved: MovedVehicle) -> dict[str, Array]:
    """The regressors `STATES` (N,): speeds of the base through the air, the wings' mean angle and its rate."""
    flaps = flap_columns(vehicle)
    w, x, y, z = (moved.quaternion / np.linalg.norm(moved.quaternion, axis=1, keepdims=True)).T
    wind = moved.wind_ned
    # Rows of r_frd_from_ned: the first and the third column of r_ned_from_frd.
    forward = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    downward = np.column_stack([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)])
    return {
        "v_x": moved.speeds[:, 0] - np.sum(forward * wind, axis=1),
        "v_z": moved.speeds[:, 2] - np.sum(downward * wind, axis=1),
        "omega_y": moved.speeds[:, 4],
        "theta_11": -moved.coordinates[:, flaps].mean(axis=1),
        "theta_11_rate": -moved.speeds[:, [6 + index for index in flaps]].mean(axis=1),
    }


def products(signals: Mapping[str, Array]) -> dict[str, Array]:
    """Squares and products of the states, by names such as ``theta_11^2`` and ``u*v_z``.

    In them the forward speed counts from the record's mean, as ``u``: it is nearly constant, and its product with a
    state would be that state once more.
    """
    signals = {**signals, "u": signals["v_x"] - float(np.mean(signals["v_x"]))}
    return {name: signals[a] * signals[b] for name, (a, b) in _pairs().items()}


def product_units() -> dict[str, str]:
    """SI unit of every one of `products`."""
    units = {**STATES, "u": STATES["v_x"]}
    return {name: unit_of(parse(name), units) for name in _pairs()}


def _pairs() -> dict[str, tuple[str, str]]:
    names = ("u", *(name for name in STATES if name != "v_x"))
    return {f"{a}^2" if a == b else f"{a}*{b}": (a, b) for a, b in combinations_with_replacement(names, 2)}


def _low_passed(motion: WingMotion, signals: dict[str, Array], cutoff: float) -> tuple[Array, dict[str, Array]]:
    step = float(motion.time[-1] - motion.time[0]) / (len(motion.time) - 1)
    ends = math.ceil(RINGING / (max(cutoff, 1e-3) * step))
    if len(motion.time) < 30 + 2 * ends or not 0.0 < cutoff < 0.45 / step:
        least = f"{30 + 2 * ends} samples and a rate above {cutoff / 0.45:g} Hz"
        raise InputError(f"{motion.name}: a low-pass at {cutoff:g} Hz needs {least}")
    # Residuals without anything in most of their band would have no white part to tell their errors by.
    every = max(int(1.0 / (SAMPLED * cutoff * step)), 1)
    kept = slice(ends, len(motion.time) - ends, every)
    table = low_passed(np.column_stack(list(signals.values())), step, cutoff)[kept]
    return motion.time[kept], dict(zip(signals, table.T, strict=True))
