"""The stroke map: one period of symmetric flapping flight, from the start of one stroke to the start of the next.

Longitudinal flight only: both wings move alike and the lateral speeds stay zero. Where a motor turns the crank, the
stroke ends when the crank has turned once and not when the period is over: the end is carried along the flow by what
the crank still lacks, exactly to first order, so that the map repeats itself on the same orbits and has the Jacobian
of the section at a whole turn.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.actuators.linkage import flap_motion
from sim_bridge.aerodynamics.models import find_model
from sim_bridge.plant import Means, Plant
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.errors import InputError

INTERVALS = 40
"""intervals of a stroke over which the commanded angle is linear"""
BODY_STATES = 4
"""forward speed, downward speed, pitch rate, pitch: the slow states, first in the vector"""
TURN = 2.0 * math.pi


class StrokeInputs(NamedTuple):
    """Constant inputs of a stroke."""

    frequency: float
    """Hz; flapping"""
    amplitude: float
    """rad; half of the commanded stroke (servo drives)"""
    elevator: float
    """rad"""
    throttle: float = 0.0
    """0 to 1; of a motor on a linkage"""


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
    """rad/s; maximum"""


class Stroke(NamedTuple):
    """One period of flight."""

    end: Floats
    """(size,); longitudinal state at the end of the stroke"""
    means: StrokeMeans
    phase_error: float
    """rad; crank angle beyond one turn, 0 without a motor"""


def check_memory(vehicle: SimulatedVehicle) -> None:
    """Reject an aerodynamic model with too much memory for a search over all its states.

    Raises:
        InputError: the model has too much memory.
    """
    name = vehicle.aerodynamics.model
    if find_model(name).keeps_wake:
        raise InputError(
            f"{vehicle.name}: no trim or linear model with {name}, its wake is thousands of states: use strip_theory"
        )


class StrokeMap:
    """Map of the longitudinal state at the start of a stroke to that one period later."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        """Build the plant.

        Raises:
            InputError: invalid bodies, or an aerodynamic model with a wake history.
        """
        check_memory(vehicle)
        self.vehicle = vehicle
        self.plant = Plant(vehicle)
        layout = self.plant.layout
        self.joints = paired_coordinates(self.plant)
        self.memory = BODY_STATES + 2 * len(self.joints)
        self.motor = vehicle.linkage is not None and vehicle.drive.kind == "linkage"
        self.crank = self.memory + layout.size - layout.aerodynamics
        """index of the crank speed, which is a state if a motor drives the crank"""
        self.size = self.crank + self.motor
        self.around = k.Surroundings(0.0, 0.0, 0.0, SEA_LEVEL_DENSITY, k.FREE, 0.0, 0.0, 0.0)
        self._wave = np.sin(TURN * np.arange(INTERVALS + 1) / INTERVALS)
        self._first = [places[0] for places in self.joints]
        self._rates = [layout.rate(place) for place in self._first]
        self._at_rest = self.pack()

    def start(self, inputs: StrokeInputs) -> Floats:
        """Return a state (size,) at rest, with the joints in the drive's position at the start of a stroke."""
        z = self._at_rest.copy()
        z[:BODY_STATES] = 0.0
        if self.vehicle.linkage is not None and self.motor:
            flap = flap_motion(self.vehicle.linkage, 0.0)
            i = next(i for i, places in enumerate(self.joints) if self.plant.layout.flap[0] in places)
            z[BODY_STATES + i] = flap.angle
            z[BODY_STATES + len(self.joints) + i] = flap.slope * TURN * inputs.frequency
            z[self.crank] = inputs.frequency
        return z

    def unpack(self, z: Floats, inputs: StrokeInputs) -> None:
        """Set the plant to a longitudinal state: u, w, q, pitch, coordinates, their rates, aerodynamic memory."""
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
        y[layout.crank_speed] = z[self.crank] if self.motor else inputs.frequency
        y[layout.charge] = 0.3 * self.vehicle.battery.capacity
        y[layout.aerodynamics :] = z[self.memory : self.crank]

    def pack(self, y: Floats | None = None) -> Floats:
        """Return the longitudinal state (size,) of the plant, or of another state vector of it."""
        y = self.plant.y if y is None else y
        layout, pitch = self.plant.layout, 2.0 * math.atan2(y[5], y[3])
        crank = y[layout.crank_speed : layout.crank_speed + self.motor]
        memory = y[layout.aerodynamics :]
        return np.concatenate(([y[7], y[9], y[11], pitch], y[self._first], y[self._rates], memory, crank))

    def controls(self, piece: int, inputs: StrokeInputs) -> k.Controls:
        """Return the commands over one of the `INTERVALS` intervals of the stroke."""
        mean = self.vehicle.cruise.stroke_mean
        ends = [mean + inputs.amplitude * float(self._wave[piece + i]) for i in (0, 1)]
        throttle = inputs.throttle if self.motor else throttle_for(inputs.frequency, self.vehicle)
        duration = 1.0 / (inputs.frequency * INTERVALS)
        return k.Controls(ends[0], ends[1], ends[0], ends[1], throttle, inputs.elevator, 0.0, duration, 1.0)

    def fly(self, z: Floats, inputs: StrokeInputs) -> Stroke:
        """Simulate the stroke that starts at ``z`` (size,); return its end and its averages."""
        self.unpack(z, inputs)
        rows = np.zeros((INTERVALS, 10))
        for piece in range(INTERVALS):
            drive = self.plant.advance(self.controls(piece, inputs), self.around)
            rows[piece] = self._row(drive)
        mean = rows.mean(axis=0)
        amplitude, rate = 0.5 * float(np.ptp(rows[:, 8])), float(np.max(np.abs(rows[:, 9])))
        means = StrokeMeans._make((*mean[:8].tolist(), amplitude, rate))
        phase_error = float(self.plant.y[self.plant.layout.crank_phase]) - TURN if self.motor else 0.0
        return Stroke(self.end(inputs), means, phase_error)

    def end(self, inputs: StrokeInputs) -> Floats:
        """Return the state (size,) after one turn of the crank, from the plant's state at the end of the period."""
        return self.pack(self.whole_turn(inputs))

    def whole_turn(self, inputs: StrokeInputs) -> Floats:
        """Extrapolate the plant's state vector to one full turn of the crank."""
        if not self.motor:
            return self.plant.y
        y, phase = self.plant.y.copy(), self.plant.layout.crank_phase
        rates = self.plant.evaluate(self.controls(INTERVALS - 1, inputs), self.around)
        return np.asarray(y + (TURN - y[phase]) / rates[phase] * rates)

    def _row(self, drive: Means) -> tuple[float, ...]:
        y, flap = self.plant.y, self.plant.layout.flap[0]
        rate = float(y[self.plant.layout.rate(flap)])
        pitch, alpha = 2.0 * math.atan2(y[5], y[3]), math.atan2(y[9], y[7])
        climb = y[7] * math.sin(pitch) - y[9] * math.cos(pitch)
        power, torque = 2.0 * max(drive.torque_left * rate, 0.0), abs(drive.torque_left)
        speed = math.hypot(y[7], y[9])
        return speed, climb, pitch, alpha, drive.current, drive.electrical_power, power, torque, float(y[flap]), rate

    def __call__(self, z: Floats, inputs: StrokeInputs) -> Floats:
        """Return the state (size,) one period after ``z``."""
        self.unpack(z, inputs)
        for piece in range(INTERVALS):
            self.plant.advance(self.controls(piece, inputs), self.around)
        return self.end(inputs)

    def settle_wings(self, z: Floats, inputs: StrokeInputs, strokes: int) -> Floats:
        """Return the state with wings and wake after ``strokes`` periods with prescribed body motion."""
        free, self.around = self.around, self.around._replace(launcher=k.HELD)
        self.unpack(z, inputs)
        for _ in range(strokes):
            for piece in range(INTERVALS):
                self.plant.advance(self.controls(piece, inputs), self.around)
        self.around = free
        return np.concatenate((z[:4], self.pack()[4:]))


def paired_coordinates(plant: Plant) -> list[tuple[int, ...]]:
    """Return the state indices of symmetric motion: coordinates of both sides, or of the plane of symmetry.

    Coordinates with a servo are inputs, not states.
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
    """Return the throttle, 0 to 1, of a crank drive at ``frequency`` Hz; 0 for other drives."""
    return _throttle(frequency, vehicle.drive.frequencies) if vehicle.drive.kind == "crank" else 0.0


@functools.lru_cache(maxsize=64)
def _throttle(frequency: float, table: tuple[float, ...]) -> float:
    """Cached, because it is called at each interval of a stroke with the same frequency."""
    return float(np.interp(frequency, table, np.linspace(0.0, 1.0, len(table))))
