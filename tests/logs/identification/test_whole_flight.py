"""A log's topics become one experiment on the IMU's time base, and nothing that was not recorded."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from avionics import topics
from logs.identification.data.flight import NEUTRAL
from logs.identification.data.maneuvers import excited
from logs.identification.results import Array
from logs.identification.sources.topic_table import whole_flight
from wingbeat.errors import InputError
from wingbeat.topic import Topic


class Recorded:
    """Topics as columns."""

    def __init__(self, tables: dict[Topic, dict[str, Array]]) -> None:
        self._tables = {topic.name: table for topic, table in tables.items()}

    def columns(self, topic: Topic) -> Mapping[str, Array]:
        return self._tables.get(topic.name, {})


def table(rate: float, begin: float = 0.0, **fields: object) -> dict[str, Array]:
    """Ten seconds of a topic; a field is a function of time in s, or a constant."""
    time = np.arange(begin, 10, 1 / rate)
    made = {name: f(time) if callable(f) else np.full(len(time), f) for name, f in fields.items()}
    return {"time_us": np.round(time * 1e6), **made}


def log() -> dict[Topic, dict[str, Array]]:
    imu = {"gyro_x": 0.1, "gyro_y": np.sin, "gyro_z": 0.0, "accel_x": 1.0, "accel_y": 0.0, "accel_z": -9.8}
    return {
        topics.IMU: table(200, **imu),
        topics.ATTITUDE: table(200, roll=0.0, pitch=0.2, yaw=lambda t: np.mod(t + 2, 2 * np.pi) - np.pi),
        topics.AIR_DATA: table(50, 0.5, airspeed=lambda t: 7 + 0.1 * t),
        topics.ACTUATORS: table(20, elevator=np.floor),
        topics.WING: table(200, phase=lambda t: np.mod(8 * np.pi * t, 2 * np.pi)),
        topics.EXCITATION: table(
            100,
            active=lambda t: ((t > 2) & (t < 4)).astype(float),
            manoeuvre=lambda t: (t > 2).astype(float),
            aborted=0.0,
            elevator=0.1,
            rudder=0.0,
            throttle=0.0,
        ),
    }


def test_topics_of_several_rates_become_one_experiment() -> None:
    flight = whole_flight(Recorded(log()), "flight 1")
    assert flight.step == pytest.approx(0.005)
    np.testing.assert_allclose(flight.signals["q"], np.sin(flight.time), atol=1e-12)
    np.testing.assert_allclose(np.diff(flight.signals["psi"]), 0.005, atol=1e-9)
    known = np.isfinite(flight.signals["airspeed"])
    assert flight.time[known][[0, -1]] == pytest.approx([0.5, 9.98], abs=0.006)
    assert known.sum() == pytest.approx(1897, abs=2)
    np.testing.assert_allclose(flight.signals["airspeed"][known], 7 + 0.1 * flight.time[known])
    np.testing.assert_allclose(np.diff(flight.signals["strokes"]).sum(), 4 * flight.time[-1], atol=1e-6)
    assert flight.units["a_z"] == "m/s^2"
    assert "altitude" not in flight.signals
    assert "north" not in flight.units


def test_commands_are_held() -> None:
    flight = whole_flight(Recorded(log()), "flight 1")
    np.testing.assert_array_equal(flight.signals["elevator"], np.floor(flight.time + 1e-6))


def test_its_manoeuvres_are_cut() -> None:
    found = excited(whole_flight(Recorded(log()), "flight 1"))
    assert [e.name for e in found] == ["flight 1, maneuver 1"]
    assert found[0].time[[0, -1]] == pytest.approx([2.01, 3.995], abs=0.011)


def test_the_accelerometer_is_corrected_by_its_calibration() -> None:
    calibration = NEUTRAL._replace(accel_offset=(0.5, 0.0, 0.2), accel_scale=(1.0, 1.0, 1.1))
    flight = whole_flight(Recorded(log()), "flight 1", calibration)
    np.testing.assert_allclose(flight.signals["a_x"], 0.5)
    np.testing.assert_allclose(flight.signals["a_z"], -11.0)


def test_a_gap_stays_a_gap_and_a_log_without_an_imu_is_refused() -> None:
    tables = log()
    kept = (tables[topics.AIR_DATA]["time_us"] < 3e6) | (tables[topics.AIR_DATA]["time_us"] > 4e6)
    tables[topics.AIR_DATA] = {name: values[kept] for name, values in tables[topics.AIR_DATA].items()}
    flight = whole_flight(Recorded(tables), "flight 1")
    assert np.all(np.isnan(flight.signals["airspeed"][(flight.time > 3.0) & (flight.time < 4.0)]))
    del tables[topics.IMU]
    with pytest.raises(InputError, match="has no topic /sensors/imu"):
        whole_flight(Recorded(tables), "flight 1")
