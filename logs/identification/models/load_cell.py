"""The wings' air load from a six-axis load cell that the vehicle is bolted to.

A cell feels the air's load on the vehicle, its weight, and the inertia of the wings. What is not the air's is taken
off in one of two ways: by the multibody model (`wing_air` with the base at rest, where what the cell gives holds it),
or by a tare run of the same strokes in still air as thin as can be had, told over the wing's angle and direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from logs.identification.data.experiment import Experiment
from logs.identification.models.inverse_dynamics import (
    COEFFICIENTS,
    STATES,
    WingCoefficients,
    coefficients_of,
    product_units,
    products,
    states,
)
from logs.identification.models.multibody import (
    BASE,
    MovedVehicle,
    SimulatedVehicle,
    coordinate_count,
    flap_columns,
    wing_air,
    wing_of,
)
from logs.identification.motion_capture.motion import CUTOFF, low_passed
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.quaternions import quaternion_from_euler

LEAST_SAMPLES = 60
HARMONICS = 31
"""-; of a stroke at the most, by which a tare run is averaged"""
ENDS = 5.0
"""-; periods of the low-pass that a tare run is not averaged over at its ends"""
MOUNT_ROUNDING = 1e-6


class LoadCell(NamedTuple):
    """Where a load cell sits on the vehicle, and how."""

    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m; its origin in the base's axes"""
    r_frd_from_cell: Array = np.eye(3)
    """-; (3, 3), a rotation"""
    sign: float = 1.0
    """-; 1 where it tells the load of the vehicle on the cell, -1 where that of the cell on the vehicle"""


class StandRun(NamedTuple):
    """One run on a stand, N equally spaced instants."""

    name: str
    time: Array
    """s; (N,)"""
    load: Array
    """N, N m; (N, 6), force and moment in the cell's axes about its origin"""
    flap: Array
    """rad; (N,), of both wings, wing up positive"""
    airspeed: float
    """m/s; of the tunnel, 0 in still air"""
    pitch: float
    """rad; of the base to the stream, nose up, as to the horizon: the stream is level"""
    density: float
    """kg/m^3"""
    strokes: Array
    """-; (N,), since the first sample, never decreasing"""


def stand_coefficients(
    vehicle: SimulatedVehicle,
    run: StandRun,
    cell: LoadCell | None = None,
    tare: StandRun | None = None,
    cutoff: float = CUTOFF,
) -> WingCoefficients:
    """Coefficients of Eq. 14 to 16 from a ``run`` on a stand, low-passed at ``cutoff`` Hz (load and angle alike).

    With a ``tare`` run its mean load over the stroke is taken off, else what the multibody model says. The tail's
    load is that of the vehicle's plates.

    Raises:
        InputError: a run that is too short, has holes, no airflow or no stroke, or a mount that is no rotation.
    """
    cell = cell or LoadCell()
    moved, load = stand_motion(vehicle, run, cutoff), _on_base(run, cell, cutoff)
    air = wing_air(vehicle, moved, run.density)
    if tare is None:
        # Held at rest, the base's equations want from cell and air together what `wing_air` asks of the air alone.
        on_wings = load + air.load
    else:
        on_wings = load - _over_stroke(run, tare, cell, cutoff) + _tail_difference(vehicle, moved, run)
    force = air.pressure * wing_of(vehicle).area
    if not np.all(air.pressure > 1.0):
        raise InputError(f"{run.name}: the wings' mean speed falls to zero: coefficients would be divided by nothing")
    found = coefficients_of(on_wings, force, wing_of(vehicle).chord)
    signals = dict(zip(COEFFICIENTS, found, strict=True)) | states(vehicle, moved)
    signals |= products(signals)
    units = dict.fromkeys(COEFFICIENTS, "-") | STATES | product_units()
    return WingCoefficients(Experiment(run.name, run.time, signals, units), on_wings, air.pressure)


def stand_motion(vehicle: SimulatedVehicle, run: StandRun, cutoff: float = CUTOFF) -> MovedVehicle:
    """The vehicle of a ``run``: base at rest in the stream, both wings at the low_passed angle, other joints at zero.

    Raises:
        InputError: the run is too short, not equally spaced, or has samples that are not numbers.
    """
    step, count = _step(run, cutoff), len(run.time)
    c = coordinate_count(vehicle)
    angle = low_passed(run.flap[:, None], step, cutoff)[:, 0]
    spline = CubicSpline(run.time, angle)
    coordinates, speeds, rates = np.zeros((count, c)), np.zeros((count, BASE + c)), np.zeros((count, BASE + c))
    for column in flap_columns(vehicle):
        coordinates[:, column] = angle
        speeds[:, BASE + column] = spline(run.time, 1)
        rates[:, BASE + column] = spline(run.time, 2)
    attitude = np.tile(quaternion_from_euler(0.0, run.pitch, 0.0), (count, 1))
    return MovedVehicle(attitude, speeds, coordinates, rates, np.tile((-run.airspeed, 0.0, 0.0), (count, 1)))


def _step(run: StandRun, cutoff: float) -> float:
    if len(run.time) < LEAST_SAMPLES:
        raise InputError(f"{run.name}: {len(run.time)} samples; a stand's run needs {LEAST_SAMPLES}")
    if not all(np.all(np.isfinite(values)) for values in (run.time, run.load, run.flap, run.strokes)):
        raise InputError(f"{run.name}: it has samples that are not numbers; cut or bridge them")
    steps = np.diff(run.time)
    if not (steps.min() > 0.0 and np.ptp(steps) < 0.01 * np.mean(steps)):
        raise InputError(f"{run.name}: its samples are not equally spaced; resample it")
    step = float(np.mean(steps))
    if not 0.0 < cutoff < 0.45 / step:
        raise InputError(f"{run.name}: a low-pass at {cutoff:g} Hz needs a rate above {cutoff / 0.45:g} Hz")
    return step


def _on_base(run: StandRun, cell: LoadCell, cutoff: float) -> Array:
    """N, N m; (N, 6), load of the vehicle on the cell, base's axes about the base's origin, low-passed."""
    r = np.asarray(cell.r_frd_from_cell, float)
    if r.shape != (3, 3) or np.abs(r @ r.T - np.eye(3)).max() > MOUNT_ROUNDING or np.linalg.det(r) < 0.0:
        raise InputError("the load cell's r_frd_from_cell is no rotation")
    load = cell.sign * low_passed(run.load, _step(run, cutoff), cutoff)
    force = load[:, :3] @ r.T
    moment = load[:, 3:] @ r.T + np.cross(np.asarray(cell.place, float), force)
    return np.column_stack([force, moment])


def _over_stroke(run: StandRun, tare: StandRun, cell: LoadCell, cutoff: float) -> Array:
    """(N, 6); the tare run's mean load at the stroke's phases of ``run``."""
    rates = [float(one.strokes[-1] - one.strokes[0]) / float(one.time[-1] - one.time[0]) for one in (run, tare)]
    if not min(rates) > 0.0 or float(tare.strokes[-1] - tare.strokes[0]) < 2.0:
        raise InputError(f"{tare.name}: a tare run needs two strokes or more")
    if abs(rates[0] - rates[1]) > 0.03 * rates[0]:
        raise InputError(f"{tare.name} flaps at {rates[1]:.3g} Hz, {run.name} at {rates[0]:.3g} Hz: inertia differs")
    load, turned = _on_base(tare, cell, cutoff), 2.0 * math.pi * tare.strokes
    most = max(min(HARMONICS, int(1.5 * cutoff / rates[1])), 1)
    series, wanted = _harmonics(turned, most), _harmonics(2.0 * math.pi * run.strokes, most)
    ends = math.ceil(ENDS / (cutoff * _step(tare, cutoff)))
    inside = slice(ends, len(load) - ends)
    return np.asarray(wanted @ np.linalg.lstsq(series[inside], load[inside], rcond=None)[0])


def _harmonics(phase: Array, most: int) -> Array:
    """(N, 1 + 2 ``most``); a Fourier series of the stroke's phase."""
    turns = np.outer(phase, np.arange(1, most + 1))
    return np.column_stack([np.ones(len(phase)), np.cos(turns), np.sin(turns)])


def _tail_difference(vehicle: SimulatedVehicle, moved: MovedVehicle, run: StandRun) -> Array:
    """(N, 6); what the stream does to the tail, taken off."""
    still = moved._replace(wind_ned=np.zeros_like(moved.wind_ned))
    return np.asarray(wing_air(vehicle, moved, run.density).load - wing_air(vehicle, still, run.density).load)
