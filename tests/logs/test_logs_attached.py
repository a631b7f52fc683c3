"""Vehicle files and parameters that a log carries."""

from __future__ import annotations

from pathlib import Path

import pytest

from avionics import parameters
from avionics.sensing import inertial
from avionics.vehicles import load_vehicle
from groundstation.command.identify import identified
from logs.attached import aircraft_of, flight_vehicle
from logs.identification.data.flight import ImuCalibration
from logs.names import FLIGHT_VEHICLE, PARAMETERS
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.recording_notes import note_inputs
from wingbeat.errors import InputError

RAVEN = load_vehicle("robo_raven_ii_d")


def calibrated(path: Path) -> inertial.Gains:
    """A log of a vehicle whose accelerometer was calibrated before this flight; what was noted."""
    gains, table = RAVEN.gains, parameters.parameter_table(RAVEN.gains)
    for name, value in (("IMU_ACCEL_OFS_1", 0.25), ("IMU_ACCE_SCALE_3", 1.03125)):
        gains = parameters.set_value(gains, table, name, value).gains
    recorder = McapRecorder(path)
    note_inputs(recorder, RAVEN._replace(gains=gains), ())
    recorder.close()
    return gains.imu


def test_the_calibration_of_the_flight_is_that_of_its_log(tmp_path: Path) -> None:
    """GIVEN a calibration kept from before THEN identification corrects the samples as the flight did."""
    imu = calibrated(tmp_path / "flight.mcap")
    with open_log(tmp_path / "flight.mcap") as log:
        vehicle, aircraft = flight_vehicle(log), aircraft_of(log)
    assert vehicle is not None
    assert imu.accel_offset == (0.25, 0.0, 0.0)
    assert imu.accel_scale == (1.0, 1.0, 1.03125)
    assert vehicle.gains.imu == imu
    assert aircraft.imu == ImuCalibration(imu.accel_offset, imu.accel_scale)
    assert vehicle.gains._replace(imu=RAVEN.gains.imu) == RAVEN.gains


def test_a_noted_parameter_that_is_no_number_is_one_line(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "flight.mcap")
    recorder.attach(FLIGHT_VEHICLE, "application/toml", RAVEN.file.text.encode())
    recorder.note(PARAMETERS, {"PITCH_P": "fast"})
    recorder.close()
    with (
        open_log(tmp_path / "flight.mcap") as log,
        pytest.raises(InputError, match="PITCH_P is not a number: 'fast'"),
    ):
        aircraft_of(log)


def test_a_log_without_a_vehicle_tells_nothing_of_it(tmp_path: Path) -> None:
    McapRecorder(tmp_path / "flight.mcap").close()
    with open_log(tmp_path / "flight.mcap") as log:
        assert flight_vehicle(log) is None
        assert aircraft_of(log).imu == ImuCalibration()


def test_another_vehicle_is_not_taken_for_the_one_that_flew(tmp_path: Path) -> None:
    calibrated(tmp_path / "flight.mcap")
    with (
        open_log(tmp_path / "flight.mcap") as log,
        pytest.raises(InputError, match="carries the file of its vehicle"),
    ):
        identified(log, "modes", "arizona_100cm")
