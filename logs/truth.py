"""True values of a simulated flight from its log."""

from __future__ import annotations

import numpy as np

from avionics import topics
from logs.attached import simulated_vehicle
from logs.identification.estimators.flapping_frequency import FrequencyResult, frequency_truth
from logs.reader import Log
from sim_bridge import topics as truth
from sim_bridge.flight_mechanics.averaged import short_period_of, stroke_averaged_model
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError


def known_truths(log: Log, modes: bool = True) -> dict[str, float]:
    """Return the true values by the name of their estimate; empty for a flight that was not simulated.

    ``K_tau`` (N m/A) and ``K_tau0`` (N m) of Gerdes Eq. 11; ``short_period_frequency`` (rad/s) and
    ``short_period_damping`` (-) of the stroke-averaged model, linearized about the mean true airspeed and climb of
    the identification inputs in the log, or about the vehicle's cruise without inputs. The mode takes seconds to
    compute; ``modes=False`` omits it.

    Raises:
        InputError: a part of the file is damaged, or the vehicle file cannot be used.
    """
    vehicle = simulated_vehicle(log)
    if vehicle is None:
        return {}
    drive = vehicle.drive
    truths = {"K_tau": drive.torque_constant, "K_tau0": drive.torque_offset} if drive.kind == "servo" else {}
    if not modes:
        return truths
    try:
        mode = short_period_of(stroke_averaged_model(vehicle, trim(vehicle, *_operating_point(log, vehicle))))
    except InputError:
        return truths  # no steady flight at that speed: there is no mode to compare with
    return truths | {"short_period_frequency": mode.natural_frequency, "short_period_damping": mode.damping}


def throttle_truths(log: Log, model: FrequencyResult) -> dict[str, float]:
    """Return the truth for ``model``, fitted to the true frequencies of a vehicle with throttle-driven motor.

    Empty for any other vehicle, and for a flight that was not simulated.

    Raises:
        InputError: a part of the file is damaged, or the vehicle file cannot be used.
    """
    vehicle = simulated_vehicle(log)
    if vehicle is None or vehicle.drive.kind != "crank":
        return {}
    frequencies = np.array(vehicle.drive.frequencies, dtype=float)
    return frequency_truth(model, np.linspace(0.0, 1.0, len(frequencies)), frequencies)


def _operating_point(log: Log, vehicle: SimulatedVehicle) -> tuple[float, float]:
    """Return airspeed and climb rate in m/s to linearize about."""
    cruise = vehicle.cruise.airspeed, vehicle.cruise.climb_rate
    if not all(topic.name in log.topics for topic in (topics.EXCITATION, truth.STATE)):
        return cruise
    tables = log.tables([topics.EXCITATION, truth.STATE])
    excitation, state = tables[topics.EXCITATION.name], tables[truth.STATE.name]
    if not len(excitation.time) or not len(state.time):
        return cruise
    last = np.searchsorted(excitation.time, state.time, side="right") - 1
    active = (last >= 0) & (excitation["active"][np.maximum(last, 0)] == 1)
    if not active.any():
        return cruise
    return float(np.mean(state["airspeed"][active])), -float(np.mean(state["v_down"][active]))
