"""Flights in closed loop: of a linear aircraft, and of simulated ornithopters in the topics of PX4."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wingbeat
from logs.identification.data.flight import FlightData
from wingbeat.constants import STANDARD_GRAVITY

Array = NDArray[np.float64]
STEP = 0.005
AIRSPEED, FLAPPING = 7.0, 4.0
FLYING = 4.0
"""m/s; airspeed after the launch"""
SYSTEM = np.array([[-6.0, 7.0], [-6.0, -4.0]])
M_DELTA = 55.0
MISSION = """name = "hold"
title = "level flight"
[[item]]
kind = "takeoff"
altitude = 30
[[item]]
kind = "hold"
altitude = 30
heading_deg = 60
duration = 100
[[item]]
kind = "land"
north = 0
east = 0
heading_deg = 60
"""
LEVELS = ("none", "light", "small_uav_light", "small_uav_moderate")
VEHICLES = ("arizona_100cm", "robo_raven_ii_d")


def doublets(time: Array, amplitude: float, width: float, every: float) -> Array:
    """Return doublets, the first at 2 s."""
    since = (time - 2.0) % every
    shape = (since < width) * 1.0 - ((since >= width) & (since < 2.0 * width))
    return np.where(time > 2.0, amplitude * shape, 0.0)


def linear_flight(amplitude: float, gust: float, seed: int, duration: float = 60.0) -> FlightData:
    """Fly a linear short period in colored gusts with a pitch loop; doublets of ``amplitude`` (rad) are added."""
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (round(duration / STEP), 2))
    time = STEP * np.arange(len(noise))
    added = doublets(time, amplitude, 0.25, 4.0)
    elevator, states, rates = np.zeros(len(time)), np.zeros((len(time), 3)), np.zeros((len(time), 2))
    w = q = theta = gust_w = gust_q = integral = 0.0
    for row in range(len(time)):
        integral -= 0.6 * theta * STEP
        elevator[row] = -0.8 * theta - 0.1 * q + integral + added[row]
        gust_w += STEP * (-2.0 * gust_w) + gust * math.sqrt(STEP) * noise[row, 0]
        gust_q += STEP * (-3.0 * gust_q) + 2.0 * gust * math.sqrt(STEP) * noise[row, 1]
        rates[row] = SYSTEM @ (w, q) + np.array((0.0, M_DELTA)) * elevator[row] + (6.0 * gust_w, 6.0 * gust_q)
        states[row] = w, q, theta
        w, q, theta = w + STEP * rates[row, 0], q + STEP * rates[row, 1], theta + STEP * q
    force = rates[:, 0] - AIRSPEED * states[:, 1] - STANDARD_GRAVITY * np.cos(states[:, 2])
    nothing = np.zeros(len(time))
    number = np.where(time > 2.0, np.floor((time - 2.0) / 4.0) + 1.0, 0.0) if amplitude else nothing
    active = np.where((time > 2.0) & ((time - 1.5) % 4.0 < 3.5), 1.0, 0.0) if amplitude else nothing
    return FlightData(
        time, states[:, 1], nothing, force, states[:, 2], np.full(len(time), AIRSPEED), nothing, elevator,
        FLAPPING * time, active, number, added, nothing, pitch_setpoint=nothing,
    )  # fmt: skip


def px4_tables(seed: int, excited: bool, mission: Any, duration: float = 54.0) -> tuple[str, dict[str, Any]]:
    """Fly one bird in gusts in closed loop for ``duration`` s; return its name and topics of PX4."""
    random = np.random.default_rng(seed)
    vehicle = VEHICLES[seed % 2]
    amplitude = math.radians(random.uniform(1.0, 10.0)) if excited else 0.0
    width, every = random.uniform(0.15, 0.5), random.uniform(3.0, 6.0)
    turbulence, wind = LEVELS[random.integers(len(LEVELS))], random.uniform(0.0, 2.5)
    sim = wingbeat.Simulation(vehicle, mission, turbulence=turbulence, wind=wind, seed=seed)
    launch, stamps, added, total = math.inf, [], [], []
    while not sim.finished and sim.time < launch + duration:
        if launch == math.inf and sim.state.airspeed > FLYING:  # the launcher waits for steady air
            launch = sim.time
        pulse = float(doublets(np.array(sim.time - launch - 10.0), amplitude, width, every))
        command = sim.command._replace(elevator=sim.command.elevator + pulse)
        stamps.append(round(sim.time * 1e6))
        sim.step(command)
        added.append(pulse)
        total.append(command.elevator)
    tables = flight_tables(sim)
    torque = np.zeros((len(stamps), 3))
    torque[:, 1] = np.array(total) / 0.5
    tables["vehicle_torque_setpoint"] = np.array(stamps), {"xyz": torque}
    if excited:
        tables["excitation"] = np.array(stamps)[::2], {"pitch": np.array(added)[::2] / 0.5}
    return vehicle, tables


def flight_tables(flight: Any) -> dict[str, Any]:
    """Return IMU, attitude, setpoint, airspeed and position of a flight or simulation in the topics of PX4."""
    imu, attitude, air = flight["/sensors/imu"], flight["/attitude/ahrs"], flight["/main/air_data"]
    position, altitude, loop = flight["/main/position"], flight["/main/altitude"], flight["/stabilization/pitch"]

    def rows(columns: Any, *names: str) -> Array:
        return np.column_stack([columns[name] for name in names])

    axes = [f"{name}_{axis}" for name in ("gyro", "accel") for axis in "xyz"]
    count = min(len(position.time), len(altitude.time))
    moved = {"x": position["north"], "y": position["east"], "vx": position["v_north"], "vy": position["v_east"]}
    moved |= {"z": -altitude["altitude"], "vz": -altitude["climb_rate"]}
    return {
        "sensor_combined": (
            imu["time_us"], {"gyro_rad": rows(imu, *axes[:3]), "accelerometer_m_s2": rows(imu, *axes[3:])}
        ),
        "vehicle_attitude": (
            attitude["time_us"], {"q": rows(attitude, *(f"quaternion_{axis}" for axis in "wxyz"))}
        ),
        "vehicle_attitude_setpoint": (loop["time_us"], {"pitch_body": loop["pitch_setpoint"]}),
        "airspeed": (air["time_us"], {"true_airspeed_m_s": air["airspeed"]}),
        "vehicle_local_position": (
            position["time_us"][:count], {key: values[:count] for key, values in moved.items()}
        ),
    }  # fmt: skip
