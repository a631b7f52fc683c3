"""The stroke map: one period of symmetric flapping flight, and the orbit that repeats itself.

Shooting: a trimmed flapping flight is a fixed point of the map from the start of one stroke to the start of the
next. Longitudinal flight only: both wings move alike and the lateral speeds stay zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle

INTERVALS = 40
"""pieces of a stroke over which the commanded angle is linear"""
SEA_LEVEL_DENSITY = 1.225
BODY_STATES = 4
"""forward speed, downward speed, pitch rate, pitch: the slow states, first in the vector"""


class StrokeInputs(NamedTuple):
    """What is constant over a stroke."""

    frequency: float
    """Hz; flapping"""
    amplitude: float
    """rad; half of the commanded stroke (servo drives)"""
    elevator: float
    """rad"""


class StrokeMeans(NamedTuple):
    """Averages over a stroke of the orbit."""

    airspeed: float
    """m/s"""
    climb_rate: float
    """m/s"""
    pitch: float
    """rad"""
    angle_of_attack: float
    """rad"""
    current: float
    """A"""
    electrical_power: float
    """W"""
    mechanical_power: float
    """W; both drives"""
    torque: float
    """N m; mean magnitude of one drive"""
    flap_amplitude: float
    """rad; half the achieved peak-to-peak stroke"""
    flap_rate: float
    """rad/s; greatest"""


class StrokeMap:
    """Maps the longitudinal state at the start of a stroke to that one period later."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self.vehicle = vehicle
        self.plant = Plant(vehicle)
        layout = self.plant.layout
        self.joints = paired_coordinates(self.plant)
        self.memory = BODY_STATES + 2 * len(self.joints)
        self.size = self.memory + layout.size - layout.aerodynamics
        self.around = k.Surroundings(0.0, 0.0, 0.0, SEA_LEVEL_DENSITY, k.FREE, 0.0, 0.0, 0.0)

    def unpack(self, z: Floats, inputs: StrokeInputs) -> None:
        """Put the longitudinal state into the plant: u, w, q, pitch, coordinates, their rates, the air's memory."""
        y, layout, n = self.plant.y, self.plant.layout, len(self.joints)
        y[:] = 0.0
        y[2] = -1000.0
        y[3], y[5] = math.cos(z[3] / 2), math.sin(z[3] / 2)
        y[7], y[9], y[11] = z[0], z[1], z[2]
        for i, places in enumerate(self.joints):
            for place in places:
                y[place] = z[BODY_STATES + i]
                y[layout.rate(place)] = z[BODY_STATES + n + i]
        if layout.elevator >= 0:
            y[layout.elevator] = inputs.elevator
        y[layout.crank_speed] = inputs.frequency
        y[layout.charge] = 0.3 * self.vehicle.battery.capacity
        y[layout.aerodynamics :] = z[self.memory :]

    def pack(self) -> Floats:
        """The longitudinal state of the plant."""
        y, layout = self.plant.y, self.plant.layout
        pitch = 2.0 * math.atan2(y[5], y[3])
        first = [places[0] for places in self.joints]
        rates = [layout.rate(place) for place in first]
        return np.concatenate(([y[7], y[9], y[11], pitch], y[first], y[rates], y[layout.aerodynamics :]))

    def controls(self, piece: int, inputs: StrokeInputs) -> k.Controls:
        """Commands over one of the `INTERVALS` pieces of the stroke."""
        cruise = self.vehicle.cruise
        ends = [
            cruise.stroke_mean + inputs.amplitude * math.sin(2.0 * math.pi * (piece + i) / INTERVALS) for i in (0, 1)
        ]
        throttle = throttle_for(inputs.frequency, self.vehicle)
        duration = 1.0 / (inputs.frequency * INTERVALS)
        return k.Controls(ends[0], ends[1], ends[0], ends[1], throttle, inputs.elevator, 0.0, duration, 1.0)

    def __call__(self, z: Floats, inputs: StrokeInputs) -> Floats:
        """The state (size,) one period after ``z``."""
        self.unpack(z, inputs)
        for piece in range(INTERVALS):
            self.plant.advance(self.controls(piece, inputs), self.around)
        return self.pack()

    def settle_wings(self, z: Floats, inputs: StrokeInputs, strokes: int) -> Floats:
        """The state with wings and wake after ``strokes`` periods of flight with the body's motion imposed."""
        free, self.around = self.around, self.around._replace(launcher=k.HELD)
        self.unpack(z, inputs)
        for _ in range(strokes):
            for piece in range(INTERVALS):
                self.plant.advance(self.controls(piece, inputs), self.around)
        self.around = free
        return np.concatenate((z[:4], self.pack()[4:]))

    def means(self, z: Floats, inputs: StrokeInputs) -> StrokeMeans:
        """Averages over the stroke that starts at ``z``."""
        self.unpack(z, inputs)
        rows = []
        for piece in range(INTERVALS):
            drive = self.plant.advance(self.controls(piece, inputs), self.around)
            y, flap = self.plant.y, self.plant.layout.flap[0]
            rate = float(y[self.plant.layout.rate(flap)])
            pitch, alpha = 2.0 * math.atan2(y[5], y[3]), math.atan2(y[9], y[7])
            power = max(drive.torque_left * rate, 0.0)
            rows.append(
                (math.hypot(y[7], y[9]), y[7] * math.sin(pitch) - y[9] * math.cos(pitch), pitch, alpha,
                 drive.current, drive.electrical_power, 2.0 * power, abs(drive.torque_left), y[flap], rate)
            )  # fmt: skip
        table = np.array(rows)
        mean = table.mean(axis=0)
        amplitude = 0.5 * float(np.ptp(table[:, 8]))
        return StrokeMeans._make((*mean[:8].tolist(), amplitude, float(np.max(np.abs(table[:, 9])))))


def paired_coordinates(plant: Plant) -> list[tuple[int, ...]]:
    """Places in the state vector of what moves in symmetric flight: a coordinate of both sides, or of the middle.

    What follows a servo is an input, not a state.
    """
    names = plant.layout.coordinates
    images = {part.mirror_of: name for name, part in plant.vehicle.bodies.items() if part.mirror_of}
    wing = plant.vehicle.wing
    images[f"{wing.right}.twist"] = f"{wing.left}.twist"
    found: list[tuple[int, ...]] = []
    for i, name in enumerate(names):
        if plant.parameters.joints.kind[i] == k.FOLLOWS or name in images.values():
            continue
        both = [names.index(images[name])] if images.get(name) in names else []
        found.append(tuple(k.COORDINATES + place for place in (*both, i)))
    return found


def throttle_for(frequency: float, vehicle: SimulatedVehicle) -> float:
    """Throttle 0 to 1 at which a crank drive turns at ``frequency`` Hz; 0 for servo drives."""
    table = vehicle.drive.frequencies
    if vehicle.drive.kind != "crank":
        return 0.0
    return float(np.interp(frequency, table, np.linspace(0.0, 1.0, len(table))))


class Orbit(NamedTuple):
    """A trimmed flapping flight."""

    state: Floats
    inputs: StrokeInputs
    means: StrokeMeans
    residual: float
    """largest difference between start and end of a stroke, in the state's units"""


def trim(vehicle: SimulatedVehicle, airspeed: float, climb_rate: float) -> Orbit:
    """Find elevator, drive and state at which the stroke repeats itself at a mean speed and climb.

    Newton's method on the stroke map with differences; the starting point lets the wings settle first. What
    sets the thrust is the commanded amplitude of servo drives, the frequency of a crank.

    Raises:
        BadInput: no orbit was found.
    """
    stroke = StrokeMap(vehicle)
    inputs = StrokeInputs(vehicle.cruise.frequency, vehicle.cruise.stroke_amplitude, 0.0)
    z = np.zeros(stroke.size)
    z[0], z[1], z[3] = airspeed, 0.1 * airspeed, 0.1 + climb_rate / airspeed
    z = stroke.settle_wings(z, inputs, 4)
    drive = inputs.frequency if vehicle.drive.kind == "crank" else inputs.amplitude
    x = np.concatenate((z, [drive, inputs.elevator]))
    best = math.inf
    for _ in range(40):
        residual = _residual(stroke, x, airspeed, climb_rate)
        best = float(np.max(np.abs(residual)))
        if best < 1e-9:
            break
        slope = _jacobian(stroke, x, airspeed, climb_rate, residual)
        step = np.asarray(np.linalg.lstsq(slope, -residual, rcond=1e-10)[0], dtype=np.float64)
        x = _damped(stroke, x, step, residual, airspeed, climb_rate)
    if not best < 1e-6:
        raise BadInput(
            f"{vehicle.name}: no trim at {airspeed:g} m/s climbing {climb_rate:g} m/s"
            f" (the stroke repeats to {best:.2g})"
        )
    inputs = _inputs(vehicle, x)
    return Orbit(x[:-2], inputs, stroke.means(x[:-2], inputs), best)


def _inputs(vehicle: SimulatedVehicle, x: Floats) -> StrokeInputs:
    cruise, drive, elevator = vehicle.cruise, float(x[-2]), float(x[-1])
    if vehicle.drive.kind == "crank":
        return StrokeInputs(drive, cruise.stroke_amplitude, elevator)
    return StrokeInputs(cruise.frequency, drive, elevator)


def _residual(stroke: StrokeMap, x: Floats, airspeed: float, climb_rate: float) -> Floats:
    inputs = _inputs(stroke.vehicle, x)
    end = stroke(x[:-2], inputs)
    means = stroke.means(x[:-2], inputs)
    return np.concatenate((end - x[:-2], [means.airspeed - airspeed, means.climb_rate - climb_rate]))


def _jacobian(stroke: StrokeMap, x: Floats, airspeed: float, climb_rate: float, residual: Floats) -> Floats:
    columns = []
    for i in range(x.shape[0]):
        moved = x.copy()
        step = 1e-5 * max(1.0, abs(x[i]))
        moved[i] += step
        columns.append((_residual(stroke, moved, airspeed, climb_rate) - residual) / step)
    return np.array(columns).T


def _damped(
    stroke: StrokeMap, x: Floats, step: Floats, residual: Floats, airspeed: float, climb_rate: float
) -> Floats:
    share = min(1.0, 0.3 / max(float(np.max(np.abs(step[[0, 1, 3, -2, -1]]))), 1e-12))
    for _ in range(8):
        trial = x + share * step
        if 0.02 < trial[-2] < 200.0:
            new = _residual(stroke, trial, airspeed, climb_rate)
            if np.all(np.isfinite(new)) and np.linalg.norm(new) < 1.02 * np.linalg.norm(residual):
                return trial
        share *= 0.5
    return x + share * step
