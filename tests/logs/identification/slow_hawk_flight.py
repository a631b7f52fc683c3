"""A Slow Hawk with rigid wings flown on its regression aerodynamics, and what marker cameras see of it.

The printed thrust is some 5 N of drag at any frequency: nothing could be flown for longer than a stroke or two. The
flown table has a higher C_T0 and is the printed one otherwise; whoever identifies it is not told any of it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.models.multibody import MovedVehicle
from logs.identification.motion_capture.coordinates import kinematic_chain
from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics import regression
from sim_bridge.aerodynamics.models import air_of
from sim_bridge.mechanism import Mechanism, build_mechanism
from sim_bridge.plant import Plant
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, vehicle_bodies, with_model
from wingbeat.rotation_arrays import dcms_from_quaternions

Floats = NDArray[np.float64]
STEP = 0.002
"""s; Grauer IV.C, 500 Hz"""
TABLE = regression.COLUMNS["time"]._replace(thrust_zero=0.1266)
TRUTH = {
    "C_L": {"v_x": TABLE.lift_forward, "v_z": TABLE.lift_heave, "omega_y": TABLE.lift_pitch_rate,
            "theta_11_rate": TABLE.lift_flap_rate},
    "C_T": {"theta_11_rate": TABLE.thrust_flap_rate, "theta_11^2": TABLE.thrust_flap_squared,
            "theta_11_rate^2": TABLE.thrust_flap_rate_squared},
    "C_m": {"omega_y": TABLE.moment_pitch_rate, "theta_11_rate": TABLE.moment_flap_rate},
}  # fmt: skip
"""Grauer Eq. 17 to 19 as flown, without the constants"""
ZEROS = {"C_L": TABLE.lift_zero, "C_T": TABLE.thrust_zero, "C_m": TABLE.moment_zero}
WING_MARKERS = [(-0.02, 0.6, 0.0), (0.0, 0.2, 0.0), (-0.2, 0.25, 0.0)]
"""m; wing tip, a third of the span, and on the secondary spar"""
MARKERS = {
    "fuselage": np.array([(0.2, 0.0, -0.03), (0.06, 0.08, 0.02), (0.06, -0.08, 0.02)]),
    "right_wing": np.array(WING_MARKERS),
    "left_wing": np.array([(x, -y, z) for x, y, z in WING_MARKERS]),
    "rudder": np.array([(0.0, 0.0, 0.0), (-0.17, 0.1, 0.0), (-0.17, -0.1, 0.0)]),
}
"""m; the twelve of Grauer IV.A: three around the nose, three on each wing, centre and sides of the tail"""


class SimulatedFlight(NamedTuple):
    """A flight as it was, every 2 ms."""

    states: Floats
    """(N, len(y)) of the plant"""
    rates: Floats
    """(N, 6 + c); of the speeds"""
    wing_loads: Floats
    """(N, 6) N, N m"""

    @property
    def time(self) -> Floats:
        return np.arange(len(self.states)) * STEP

    def cut(self, start: int, stop: int) -> SimulatedFlight:
        return SimulatedFlight(*(values[start:stop] for values in self))


@cache
def vehicle() -> SimulatedVehicle:
    hawk = with_model(load_vehicle("slow_hawk"), "regression")
    return hawk._replace(wing=hawk.wing._replace(twists=False))


@cache
def mechanism() -> Mechanism:
    return build_mechanism(vehicle())


@cache
def fly(seconds: float, seed: int) -> SimulatedFlight:
    """A flight with a multisine on the elevator and a slow swing of the throttle, its first half second left out."""
    plant = _launched()
    y, phases = plant.y, np.random.default_rng(seed).uniform(0.0, 2 * np.pi, 9)
    around = k.Surroundings(0.0, 0.0, 0.0, 1.225, k.FREE, 0.0, 0.0, 0.0)
    rows: list[tuple[Floats, Floats, Floats]] = []
    lines = 2 * np.pi * 0.45 * np.arange(1, 9)
    for tick in range(round((seconds + 0.5) / STEP)):
        t = tick * STEP
        pitch = math.asin(2.0 * (y[3] * y[5] - y[4] * y[6]))
        sink = math.cos(pitch) * y[9] - math.sin(pitch) * y[7]
        excited = 0.025 * float(np.sum(np.cos(lines * t + phases[:8])))
        elevator = -0.1 + excited + 0.8 * (0.05 + 0.1 * sink - pitch) - 0.15 * y[11]
        throttle = 0.6 - 0.15 * (9.2 - y[7]) + 0.07 * math.sin(2 * np.pi * 0.7 * t + phases[8])
        controls = k.Controls(0.0, 0.0, 0.0, 0.0, throttle, elevator, 0.0, STEP, 1.0)
        plant.advance(controls, around)
        plant.evaluate(controls, around)
        rows.append((y.copy(), plant.scratch.accelerations.copy(), plant.air_load()))
    return SimulatedFlight(*(np.array(column) for column in zip(*rows, strict=True))).cut(250, len(rows))


def _launched() -> Plant:
    plant = Plant(vehicle())
    flight = regression.RegressionParameters(TABLE, 0.3, 0.25)
    plant.parameters = plant.parameters._replace(air=air_of(regression.MODEL, flight))
    y = plant.y
    y[2], y[3:7] = -50.0, (math.cos(0.03), 0.0, math.sin(0.03), 0.0)
    y[7], y[9], y[plant.layout.crank_speed] = 9.2, 0.4, 5.9
    return plant


def moved(flight: SimulatedFlight) -> MovedVehicle:
    """The motion as it truly was."""
    y, c = flight.states, len(mechanism().layout.coordinates)
    speeds = np.column_stack([y[:, 7:13], y[:, 13 + c : 13 + 2 * c]])
    return MovedVehicle(y[:, 3:7], speeds, y[:, 13 : 13 + c], flight.rates, np.zeros((len(y), 3)))


def marked() -> dict[str, tuple[int, Floats]]:
    names = [body.name for body in vehicle_bodies(vehicle())[1]]
    return {name: (names.index(name), places) for name, places in MARKERS.items()}


def true_poses(flight: SimulatedFlight, body: str) -> tuple[Floats, Floats]:
    """Position (N, 3) and r_ned_from_body (N, 3, 3) of a body."""
    y, index = flight.states, marked()[body][0]
    chain, base = kinematic_chain(mechanism().tree, y[:, 13:17]), dcms_from_quaternions(y[:, 3:7])
    return y[:, :3] + np.einsum("nij,nj->ni", base, chain.position[index]), base @ chain.rotation[index]


def observed(flight: SimulatedFlight, noise: float, seed: int) -> dict[str, Floats]:
    """Positions (m, N, 3) m in NED of every body's markers with ``noise`` m along each axis."""
    random: Any = np.random.default_rng(seed)
    found = {}
    for body, places in MARKERS.items():
        position, rotation = true_poses(flight, body)
        exact = position[None] + np.einsum("nij,mj->mni", rotation, places)
        found[body] = exact + noise * random.normal(size=exact.shape)
    return found
