"""A flight of which everything is prescribed: attitude and velocity are sums of sines, the rest follows exactly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.models.rigid_body import UNITS
from logs.identification.models.rigid_body import SensorPositions as Places
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

FINE = 8
"""-; steps of the truth in a sample"""
NOISE = {"airspeed": 0.2, "alpha": 0.004, "beta": 0.004, "phi": 0.004, "theta": 0.004, "psi": 0.008,
         "altitude": 0.5, "climb_rate": 0.2, "north": 0.8, "east": 0.8}  # fmt: skip
INPUT_NOISE = {"p": 0.003, "q": 0.003, "r": 0.003, "a_x": 0.05, "a_y": 0.05, "a_z": 0.05}
ERRORS = {"bias_p": 0.01, "bias_q": -0.006, "bias_r": 0.004, "bias_a_x": 0.15, "bias_a_y": -0.1, "bias_a_z": 0.2,
          "bias_alpha": 0.02, "scale_alpha": 0.08, "bias_beta": -0.015, "scale_beta": -0.05}  # fmt: skip
PLACES = Places((0.3, 0.05, -0.1), (1.2, -0.5, 0.0), (1.5, 0.4, 0.1), (1.5, -0.4, 0.1))


class Flight(NamedTuple):
    """How a flight differs from the standard one."""

    seed: int = 0
    duration: float = 20.0
    step: float = 0.02
    noise: float = 1.0
    input_noise: float = 1.0
    colour: float = 0.0
    """-; correlation of an output's noise from sample to sample"""
    errors: dict[str, float] = ERRORS
    places: Places = PLACES
    longitudinal: bool = False
    wind: tuple[float, float] = (0.0, 0.0)
    activity: float = 1.0


class Wave(NamedTuple):
    """Values and rates, (N,) each."""

    value: Array
    rate: Array


def wave(time: Array, mean: float, sines: tuple[tuple[float, float, float], ...]) -> Wave:
    """A mean and sines of amplitude, circular frequency and phase."""
    value, rate = np.full(len(time), mean), np.zeros(len(time))
    for amplitude, frequency, phase in sines:
        value += amplitude * np.sin(frequency * time + phase)
        rate += amplitude * frequency * np.cos(frequency * time + phase)
    return Wave(value, rate)


def motion(flight: Flight) -> tuple[Array, dict[str, Wave]]:
    """Fine time and the prescribed waves; the phases are the seed's."""
    time = np.arange(0, flight.duration + 1e-9, flight.step / FINE)
    turn = np.random.default_rng(flight.seed + 70_000).uniform(0, 2 * np.pi, 12)
    a, side = flight.activity, 0.0 if flight.longitudinal else flight.activity
    return time, {
        "u": wave(time, 20.0, ((1.5 * a, 0.6, turn[0]), (0.5 * a, 1.7, turn[1]))),
        "v": wave(time, 0.0, ((1.2 * side, 0.9, turn[2]), (0.6 * side, 2.3, turn[3]))),
        "w": wave(time, 1.6, ((1.2 * a, 1.3, turn[4]), (0.6 * a, 2.9, turn[5]))),
        "phi": wave(time, 0.0, ((0.5 * side, 0.8, turn[6]), (0.2 * side, 2.1, turn[7]))),
        "theta": wave(time, 0.1, ((0.15 * a, 0.7, turn[8]), (0.08 * a, 2.4, turn[9]))),
        "psi": wave(time, 0.6 * bool(side), ((0.4 * side, 0.5, turn[10]), (0.1 * side, 1.4, turn[11]))),
    }


def rates(waves: dict[str, Wave]) -> Array:
    """Body rates (N, 3) from the Euler angles'."""
    (phi, phi_dot), (theta, theta_dot), (_, psi_dot) = waves["phi"], waves["theta"], waves["psi"]
    return np.column_stack(
        (
            phi_dot - psi_dot * np.sin(theta),
            theta_dot * np.cos(phi) + psi_dot * np.cos(theta) * np.sin(phi),
            -theta_dot * np.sin(phi) + psi_dot * np.cos(theta) * np.cos(phi),
        )
    )


def truth(flight: Flight) -> tuple[Array, dict[str, Array]]:
    """Time and every channel as faultless sensors at their places would tell it."""
    time, waves = motion(flight)
    omega = rates(waves)
    omega_dot = np.gradient(omega, time, axis=0, edge_order=2)
    velocity = np.column_stack([waves[name].value for name in "uvw"])
    phi, theta, psi = (waves[name].value for name in ("phi", "theta", "psi"))
    gravity = STANDARD_GRAVITY * np.column_stack(
        (-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi))
    )
    force = np.column_stack([waves[name].rate for name in "uvw"]) + np.cross(omega, velocity) - gravity
    arm = np.asarray(flight.places.imu)
    force += np.cross(omega_dot, arm) + np.cross(omega, np.cross(omega, arm))
    told = dict(zip(("p", "q", "r", "a_x", "a_y", "a_z"), np.column_stack((omega, force)).T, strict=True))
    told |= {"phi": phi, "theta": theta, "psi": psi} | flow(flight.places, velocity, omega)
    # The states are those of the IMU's place, and so is the path.
    told |= path(time, velocity + np.cross(omega, arm), phi, theta, psi, flight.wind)
    return time[::FINE], {name: values[::FINE] for name, values in told.items()}


def flow(places: Places, velocity: Array, omega: Array) -> dict[str, Array]:
    """What pitot and vanes would tell."""
    at = {name: velocity + np.cross(omega, np.asarray(place)) for name, place in places._asdict().items()}
    lengths = {name: np.linalg.norm(values, axis=1) for name, values in at.items()}
    alpha = np.arctan2(at["alpha"][:, 2], at["alpha"][:, 0])
    return {"airspeed": lengths["airspeed"], "alpha": alpha, "beta": np.arcsin(at["beta"][:, 1] / lengths["beta"])}


def path(
    time: Array, velocity: Array, phi: Array, theta: Array, psi: Array, wind: tuple[float, float]
) -> dict[str, Array]:
    """Climb rate, altitude, north and east."""
    sunk = velocity[:, 1] * np.sin(phi) + velocity[:, 2] * np.cos(phi)
    across = velocity[:, 1] * np.cos(phi) - velocity[:, 2] * np.sin(phi)
    ahead = velocity[:, 0] * np.cos(theta) + sunk * np.sin(theta)
    climb = velocity[:, 0] * np.sin(theta) - sunk * np.cos(theta)
    north = ahead * np.cos(psi) - across * np.sin(psi) + wind[0]
    east = ahead * np.sin(psi) + across * np.cos(psi) + wind[1]
    places = [cumulative_simpson(each, x=time, initial=0.0) for each in (climb, north, east)]
    return {"climb_rate": climb, "altitude": 100 + places[0], "north": places[1], "east": places[2]}


def measured(flight: Flight, channels: tuple[str, ...] = ()) -> Experiment:
    """What the sensors told, with their errors and noise; ``channels`` beyond the inputs, all where none is named."""
    rng = np.random.default_rng(flight.seed)
    time, told = truth(flight)
    signals = {}
    for name, values in told.items():
        white = rng.normal(size=len(time))
        if name in INPUT_NOISE:
            noise = flight.input_noise * INPUT_NOISE[name] * white
        else:
            gain = np.sqrt(1 - flight.colour**2)
            noise = (
                flight.noise
                * NOISE[name]
                * lfilter([gain], [1, -flight.colour], white, zi=[white[0] * flight.colour])[0]
            )
        with_errors = (1 + flight.errors.get(f"scale_{name}", 0)) * values + flight.errors.get(f"bias_{name}", 0)
        if name in INPUT_NOISE or not channels or name in channels:
            signals[name] = with_errors + noise
    return Experiment(f"flight {flight.seed}", time, signals, {name: UNITS[name] for name in signals})
