"""The stroke-averaged model of every axis: elevator and drive to the longitudinal motion, rudder to the lateral one.

Beside the elevator's A and B of `averaged`, in the same way: small doublets at several phases of the stroke, their
answers averaged over phases and stroke, explained by four states. The drive (commanded half stroke of servo drives,
throttle of others) acts through a first-order lag, the one that leaves the least of the answer unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from sim_bridge import plant_kernel as k
from sim_bridge.flight_mechanics.averaged import LENGTH, PHASES, SKIPPED, AveragedModel
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY

DRIVE_WIDTHS, RUDDER_WIDTHS = (0.25, 0.5), (0.1, 0.2, 0.4)
"""s; step widths of the doublets"""
DRIVE_STEP, RUDDER_STEP = 0.01, 0.01
"""rad of half stroke or - of throttle; rad: small enough for the response to be linear"""
LONGEST_LAG = 1.0
"""s; maximum lag of a drive"""

U, W, Q, PITCH = range(4)
V, P, R, ROLL = range(4)

Steer = Callable[[StrokeMap, int, float], k.Controls]
"""Commands over an interval of the stroke, with the sign of the doublet: -1, 0 or 1."""
Look = Callable[[StrokeMap], list[float]]
"""Record after an interval: four states and the achieved control."""


class AxesModel(NamedTuple):
    """Linear stroke-averaged model of all axes."""

    longitudinal: AveragedModel
    """of (u m/s, w m/s, q rad/s, theta rad) and the achieved elevator (rad)"""
    drive: Floats
    """(4,); of the same states, per commanded half stroke (rad, servo drives) or throttle (others), after the lag"""
    drive_lag: float
    """s; first-order lag from the command to its effect"""
    lateral: Floats
    """(4, 4); of (v m/s, p rad/s, r rad/s, roll rad), body axes"""
    rudder: Floats
    """(4,); of those and the achieved rudder (rad), nose right positive"""
    unexplained: Floats
    """(6,); unexplained fraction of variance of u', w', q' after the drive, of v', p', r' after the rudder"""


def axes_model(vehicle: SimulatedVehicle, orbit: Orbit, longitudinal: AveragedModel) -> AxesModel:
    """Linearize the stroke-averaged motion of all axes about ``orbit``; ``longitudinal`` is the elevator's model."""
    drive, lag, left = _drive(vehicle, orbit, longitudinal)
    lateral, rudder, left_across = _lateral(vehicle, orbit)
    return AxesModel(longitudinal, drive, lag, lateral, rudder, np.concatenate((left, left_across)))


def _drive(vehicle: SimulatedVehicle, orbit: Orbit, model: AveragedModel) -> tuple[Floats, float, Floats]:
    """Return B (4,) of the drive, its lag, and the unexplained variance of u', w', q'; A is that of the elevator."""
    step = 1.0 / (orbit.inputs.frequency * INTERVALS)
    answers = [_answer(vehicle, orbit, _driven(orbit), _along, width) for width in DRIVE_WIDTHS]
    rates = [_rates(answer, step) - answer[:, :4] @ model.a.T for answer in answers]
    wanted = np.vstack([rate[SKIPPED:-SKIPPED, :3] for rate in rates])

    def acting(lag: float) -> Floats:
        lagged = [_lagged(answer[:, 4], lag, step) for answer in answers]
        return np.concatenate([column[SKIPPED:-SKIPPED] for column in lagged])[:, None]

    def missed(lag: float) -> float:
        values = np.linalg.lstsq(acting(lag), wanted, rcond=None)[0]
        return float(np.sum(np.var(wanted - acting(lag) @ values, axis=0) / np.var(wanted, axis=0)))

    lag = float(minimize_scalar(missed, bounds=(0.0, LONGEST_LAG), method="bounded").x)
    values = np.linalg.lstsq(acting(lag), wanted, rcond=None)[0]
    whole = np.vstack([_rates(answer, step)[SKIPPED:-SKIPPED, :3] for answer in answers])
    left = np.var(wanted - acting(lag) @ values, axis=0) / np.var(whole, axis=0)
    return np.append(values[0], 0.0), lag, left


def _lateral(vehicle: SimulatedVehicle, orbit: Orbit) -> tuple[Floats, Floats, Floats]:
    """Return A (4, 4), B (4,) of the rudder, and the unexplained variance of v', p', r'."""
    step, pitch = 1.0 / (orbit.inputs.frequency * INTERVALS), orbit.means.pitch
    answers = [_answer(vehicle, orbit, _ruddered(orbit), _across, width) for width in RUDDER_WIDTHS]
    gravity = np.array([STANDARD_GRAVITY * math.cos(pitch), 0.0, 0.0])
    rates = np.vstack([(_rates(a, step)[:, :3] - a[:, [ROLL]] * gravity)[SKIPPED:-SKIPPED] for a in answers])
    regressors = np.vstack([answer[SKIPPED:-SKIPPED][:, [V, P, R, 4]] for answer in answers])
    values = np.linalg.lstsq(regressors, rates, rcond=None)[0]
    left = np.var(rates - regressors @ values, axis=0) / np.var(rates, axis=0)
    a, b = np.zeros((4, 4)), np.zeros(4)
    a[:3, :3], b[:3] = values[:3].T, values[3]
    a[V, ROLL], a[ROLL, P], a[ROLL, R] = gravity[0], 1.0, math.tan(pitch)
    return a, b, left


def _driven(orbit: Orbit) -> Steer:
    def steer(stroke: StrokeMap, piece: int, side: float) -> k.Controls:
        inputs, change = orbit.inputs, side * DRIVE_STEP
        if stroke.vehicle.drive.kind == "servo":
            return stroke.controls(piece, inputs._replace(amplitude=inputs.amplitude + change))
        controls = stroke.controls(piece, inputs)
        return controls._replace(throttle=controls.throttle + change)

    return steer


def _ruddered(orbit: Orbit) -> Steer:
    def steer(stroke: StrokeMap, piece: int, side: float) -> k.Controls:
        return stroke.controls(piece, orbit.inputs)._replace(rudder=side * RUDDER_STEP)

    return steer


def _along(stroke: StrokeMap) -> list[float]:
    return [*stroke.pack()[:4].tolist(), 0.0]


def _across(stroke: StrokeMap) -> list[float]:
    w, x, y, z = stroke.plant.y[3:7]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    rudder = stroke.plant.layout.rudder
    return [*stroke.plant.y[[8, 10, 12]].tolist(), roll, float(stroke.plant.y[rudder]) if rudder >= 0 else 0.0]


def _answer(vehicle: SimulatedVehicle, orbit: Orbit, steer: Steer, look: Look, width: float) -> Floats:
    """Return states and control (N, 5) after a doublet per unit of it, averaged over phases and over one stroke."""
    strokes = math.ceil(LENGTH * orbit.inputs.frequency)
    length, pieces = strokes * INTERVALS, round(width * orbit.inputs.frequency * INTERVALS)
    rest = _simulated(vehicle, orbit, steer, look, np.zeros(length + INTERVALS))
    total = np.zeros((length, 5))
    for phase in range(PHASES):
        late = phase * INTERVALS // PHASES
        sides = np.zeros(length + INTERVALS)
        sides[late : late + pieces], sides[late + pieces : late + 2 * pieces] = 1.0, -1.0
        change = _simulated(vehicle, orbit, steer, look, sides) - rest
        total += change[late : late + length] / PHASES
    padded = np.vstack((np.zeros((INTERVALS, 5)), total))
    window = np.ones(INTERVALS) / INTERVALS
    return np.column_stack([np.convolve(column, window, "valid") for column in padded.T])


def _simulated(vehicle: SimulatedVehicle, orbit: Orbit, steer: Steer, look: Look, sides: Floats) -> Floats:
    """Simulate the record (N, 5) after each interval; the last column is the command if no servo angle exists."""
    stroke = StrokeMap(vehicle)
    stroke.unpack(orbit.state, orbit.inputs)
    rows = np.zeros((len(sides), 5))
    for i, side in enumerate(sides.tolist()):
        stroke.plant.advance(steer(stroke, i % INTERVALS, side), stroke.around)
        rows[i] = look(stroke)
        if look is _along:
            rows[i, 4] = side * DRIVE_STEP
    return rows


def _rates(answer: Floats, step: float) -> Floats:
    """Return the derivatives (N, 4) of the states per second."""
    return np.asarray(np.gradient(answer[:, :4], step, axis=0))


def _lagged(signal: Floats, lag: float, step: float) -> Floats:
    """Apply a first-order lag to a signal (N,) that is constant over each step."""
    keep = math.exp(-step / lag) if lag > 1e-9 else 0.0
    found, value = np.zeros(len(signal)), 0.0
    for i, wanted in enumerate(signal.tolist()):
        value = wanted + (value - wanted) * keep
        found[i] = value
    return found
