"""What identification must know of the aircraft, from the flight computer's vehicle file in the log."""

from __future__ import annotations

import tempfile
from pathlib import Path

from avionics.vehicles import FlightVehicle, load_vehicle
from logs.identification.data import Aircraft
from logs.reader import Log

FLIGHT_VEHICLE = "avionics_vehicle.toml"
"""Name of the attachment in which the flight computer leaves its vehicle file."""


def flight_vehicle(log: Log) -> FlightVehicle | None:
    """The vehicle as the flight computer of ``log`` believed it to be; None where the log does not say.

    Raises:
        BadInput: the attached vehicle file cannot be used.
    """
    if all(attachment.name != FLIGHT_VEHICLE for attachment in log.attachments):
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / FLIGHT_VEHICLE
        path.write_bytes(log.attachment(FLIGHT_VEHICLE))
        return load_vehicle(path)


def aircraft_of(log: Log) -> Aircraft:
    """Place of the IMU and lag of the tail as known from the bench; not known where the log has no vehicle file.

    Raises:
        BadInput: the attached vehicle file cannot be used.
    """
    vehicle = flight_vehicle(log)
    if vehicle is None:
        return Aircraft()
    known = vehicle.airframe
    return Aircraft(known.imu_x, known.imu_z, known.tail_time_constant)
