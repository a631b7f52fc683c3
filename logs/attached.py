"""Vehicle files attached to a log."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from avionics import parameters
from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.identification.data.flight import Aircraft, GaugeErrors, ImuCalibration
from logs.names import AERODYNAMICS, FLIGHT_VEHICLE, WORLD, WORLD_VEHICLE
from logs.reader import Log
from logs.settings import initial_parameters
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, with_model

Loaded = TypeVar("Loaded")


def simulated_vehicle(log: Log) -> SimulatedVehicle | None:
    """Return the simulated vehicle of ``log`` with the aerodynamic model of the flight.

    None for a flight that was not simulated.

    Raises:
        InputError: the attached vehicle file cannot be used, or the model is unknown.
    """
    vehicle = _load(log, WORLD_VEHICLE, lambda path: load_vehicle(str(path)))
    model = log.metadata.get(WORLD, {}).get(AERODYNAMICS)
    return with_model(vehicle, model) if vehicle and model else vehicle


def flight_vehicle(log: Log) -> FlightVehicle | None:
    """Return the vehicle as configured in the flight computer of ``log`` at boot.

    None if the log does not contain it. Stored parameters and calibrations override those of the attached file.

    Raises:
        InputError: the attached vehicle file or a noted parameter cannot be used.
    """
    vehicle = _load(log, FLIGHT_VEHICLE, load_flight_vehicle)
    if vehicle is None:
        return None
    gains, table = vehicle.gains, parameters.parameter_table(vehicle.gains)
    for name, value in initial_parameters(log).items():
        # A parameter that this version does not have changes nothing here.
        if name in table and value != parameters.get(gains, table[name]):
            gains = parameters.set_value(gains, table, name, value).gains
    return vehicle._replace(gains=gains)


def aircraft_of(log: Log) -> Aircraft:
    """Return IMU position and calibration, tail lag, gauge accuracy and span.

    Without a vehicle file they are unknown.

    Raises:
        InputError: the attached vehicle file cannot be used.
    """
    vehicle = flight_vehicle(log)
    if vehicle is None:
        return Aircraft()
    known = vehicle.airframe
    world = simulated_vehicle(log)
    imu = vehicle.gains.imu
    calibration = ImuCalibration(imu.accel_offset, imu.accel_scale)
    aircraft = Aircraft(known.imu_x, known.imu_z, known.tail_time_constant, imu=calibration)
    return aircraft._replace(gauges=gauges_of(world), span=span_of(world))


def span_of(vehicle: SimulatedVehicle | None) -> float | None:
    """Return the span from wing tip to wing tip in m; None without a vehicle."""
    return None if vehicle is None else 2.0 * vehicle.wing.semispan


def gauges_of(vehicle: SimulatedVehicle | None) -> GaugeErrors:
    """Return the accuracy of the drive sensors of a vehicle; unknown without a vehicle or without sensors."""
    if vehicle is None or not {"torque_cell", "power_sensor"} <= set(vehicle.sections):
        return GaugeErrors()
    cell, power = vehicle.sections["torque_cell"], vehicle.sections["power_sensor"]
    return GaugeErrors(
        cell.zero_sigma, cell.scale_sigma, power.current_zero_sigma, power.current_scale_sigma, power.divider_sigma
    )


def airframe_of(vehicle: FlightVehicle, world: SimulatedVehicle | None) -> Aircraft:
    """Return IMU position and tail lag of a vehicle, and the span of its ``world``, for a log without vehicle files.

    The samples of the log are not calibrated again: another program calibrated them.
    """
    known = vehicle.airframe
    return Aircraft(known.imu_x, known.imu_z, known.tail_time_constant, span=span_of(world))


def _load(log: Log, name: str, load: Callable[[Path], Loaded]) -> Loaded | None:
    if all(attachment.name != name for attachment in log.attachments):
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(log.attachment(name))
        return load(path)
