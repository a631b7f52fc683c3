"""The stroke map of free flight: all that moves, so that lateral motion about a symmetric orbit is included."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.quaternions import quaternion_from_euler

U, V, W, P, Q, R, ROLL, PITCH = range(8)
BODY = 8
"""states of the body, first in the vector; position and heading have no effect and are omitted"""
LATERAL = (V, P, R, ROLL)
LONGITUDINAL = (U, W, Q, PITCH)


class FreeMap:
    """Map of the full state at the start of a stroke to that one period later, with the inputs of an orbit.

    State: u, v, w m/s, p, q, r rad/s, roll, pitch rad, then every coordinate without a servo, their rates, the memory
    of the aerodynamic model, and the crank's speed in Hz if a motor drives it.
    """

    def __init__(self, vehicle: SimulatedVehicle, orbit: Orbit) -> None:
        self.orbit = orbit
        self.stroke = StrokeMap(vehicle)
        self.stroke.unpack(orbit.state, orbit.inputs)
        plant = self.stroke.plant
        kinds = plant.parameters.joints.kind
        coordinates = [k.COORDINATES + i for i in range(len(kinds)) if kinds[i] != k.FOLLOWS]
        rates = [plant.layout.rate(place) for place in coordinates]
        memory = range(plant.layout.aerodynamics, plant.layout.size)
        crank = [plant.layout.crank_speed] if self.stroke.motor else []
        self.places = [*coordinates, *rates, *memory, *crank]
        """indices in the plant's state vector of the states after those of the body"""
        self.coordinates = len(coordinates)
        self.calm = plant.y.copy()
        self.state = self._pack(self.calm)

    def _pack(self, y: Floats) -> Floats:
        w, a, b, c = y[3:7]
        roll = math.atan2(2.0 * (w * a + b * c), 1.0 - 2.0 * (a * a + b * b))
        pitch = math.asin(2.0 * (w * b - c * a))
        return np.concatenate((y[7:13], [roll, pitch], y[self.places]))

    def __call__(self, state: Floats) -> Floats:
        """Return the state (n,) one period after ``state``."""
        stroke, y = self.stroke, self.stroke.plant.y
        y[:] = self.calm
        y[3:7] = quaternion_from_euler(state[ROLL], state[PITCH], 0.0)
        y[7:13] = state[:6]
        y[self.places] = state[BODY:]
        for piece in range(INTERVALS):
            stroke.plant.advance(stroke.controls(piece, self.orbit.inputs), stroke.around)
        return self._pack(stroke.whole_turn(self.orbit.inputs))

    def jacobian(self) -> Floats:
        """Compute the monodromy matrix (n, n) about the orbit by central differences."""
        columns = []
        for i, value in enumerate(self.state):
            step = 1e-5 * max(1.0, abs(value))
            ends = []
            for sign in (1.0, -1.0):
                moved = self.state.copy()
                moved[i] += sign * step
                ends.append(self(moved))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.array(columns).T
