"""`wingbeat identify flight.ulg`: a flight in the topics of PX4, in one command."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import wingbeat
from groundstation.command.main import dispatch

sys.path.insert(0, str(Path(__file__).parents[1] / "logs" / "importing"))

from foreign_logs import ulog

TRUE_FREQUENCY = (7.0, 8.8)
"""rad/s; of the Arizona at the speeds of this flight"""


@pytest.mark.validate
def test_modes_of_a_px4_log_in_one_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a flight as PX4 logs it WHEN identified THEN modes near the truth, and what was assumed."""
    log = wingbeat.fly("arizona_100cm", log=tmp_path / "flight.mcap").log

    def rows(columns: object, *names: str) -> np.ndarray:
        return np.column_stack([columns[name] for name in names])  # type: ignore[index]

    def stamps(columns: object) -> np.ndarray:
        return np.asarray(columns["time_us"])  # type: ignore[index]

    imu, attitude, air = log["/sensors/imu"], log["/attitude/ahrs"], log["/main/air_data"]
    position, altitude, actuators = log["/main/position"], log["/main/altitude"], log["/mixing/actuators"]
    inputs = log["/guidance/excitation"]
    axes = [f"{name}_{axis}" for name in ("gyro", "accel") for axis in "xyz"]
    pitch = np.zeros((len(actuators.time), 3))
    pitch[:, 1] = actuators["elevator"] / 0.5
    count = len(position.time)
    topics = {
        "sensor_combined": (
            stamps(imu), {"gyro_rad": rows(imu, *axes[:3]), "accelerometer_m_s2": rows(imu, *axes[3:])}
        ),
        "vehicle_attitude": (
            stamps(attitude), {"q": rows(attitude, *(f"quaternion_{axis}" for axis in "wxyz"))}
        ),
        "airspeed": (stamps(air), {"true_airspeed_m_s": air["airspeed"]}),
        "vehicle_local_position": (
            stamps(position),
            {
                "x": position["north"], "y": position["east"], "z": -altitude["altitude"][:count],
                "vx": position["v_north"], "vy": position["v_east"], "vz": -altitude["climb_rate"][:count],
            },
        ),
        "vehicle_torque_setpoint": (stamps(actuators), {"xyz": pitch}),
        "excitation": (stamps(inputs)[::4], {"pitch": inputs["elevator"][::4] / 0.5}),
    }  # fmt: skip
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog(topics))
    assert dispatch(["identify", str(path), "modes", "--vehicle", "arizona_100cm", "--json"]) == 0
    modes = json.loads(capsys.readouterr().out)["modes"]
    given = [one["frequency"] for one in modes["methods"] if one["frequency"] is not None]
    assert len(given) >= 2
    held = [one["low"] <= TRUE_FREQUENCY[1] and one["high"] >= TRUE_FREQUENCY[0] for one in given]
    assert sum(held) >= len(held) - 1
    assert any("vehicle_torque_setpoint" in note and "assumed" in note for note in modes["notes"])
    assert sorted(one.name for one in tmp_path.iterdir()) == ["flight.mcap", "flight.ulg"]
