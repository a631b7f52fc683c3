"""The wings' coefficients from a log's topics, as measured and as they truly were."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from avionics import topics
from logs.identification.report import Identification, document, identify, rows
from logs.identification.sources.motion import identify_aero
from sim_bridge import topics as truth
from tests.logs.identification import slow_hawk_flight as hawk
from tests.logs.identification.test_aero_structure import EXPECTED, TRUTH, structure
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions
from wingbeat.topic import Topic

GRAVITY = 9.80665


class Recorded:
    """A log of a flight as arrays."""

    def __init__(self, noise: float) -> None:
        flight, random = hawk.fly(4.0, 2), np.random.default_rng(8)
        y, rates = flight.states, flight.rates
        time = {"time_us": np.round(flight.time * 1e6)}
        to_ned = dcms_from_quaternions(y[:, 3:7])
        v_ned = np.einsum("nij,nj->ni", to_ned, y[:, 7:10])
        felt = rates[:, :3] + np.cross(y[:, 10:13], y[:, 7:10]) - GRAVITY * to_ned[:, 2, :]
        felt = felt + 10 * noise * random.normal(size=felt.shape)
        gyro = y[:, 10:13] + noise * random.normal(size=felt.shape)
        quaternion = {f"quaternion_{axis}": y[:, 3 + i] for i, axis in enumerate("wxyz")}
        turning = {f"{axis}_rate": gyro[:, i] for i, axis in enumerate(("roll", "pitch", "yaw"))}
        flap = {"angle_right": y[:, 13] + 0.1 * noise * random.normal(size=len(y)), "angle_left": y[:, 14]}
        nothing, ones = np.zeros(len(y)), np.ones(len(y))
        wind = {f"wind_{axis}": nothing for axis in ("north", "east", "down")}
        speed = {f"v_{axis}": v_ned[:, i] for i, axis in enumerate(("north", "east", "down"))}
        true = {f"{axis}_rate": y[:, 10 + i] for i, axis in enumerate(("roll", "pitch", "yaw"))}
        tail = {"elevator": y[:, 15], "rudder": y[:, 16]}
        self.by_topic: dict[str, dict[str, Any]] = {
            topics.IMU.name: time | {f"accel_{axis}": felt[:, i] for i, axis in enumerate("xyz")},
            topics.ATTITUDE.name: time | quaternion | turning,
            topics.WING.name: time | flap | {"flapping": ones},
            topics.ACTUATORS.name: time | {"elevator": _led(y[:, 15]), "rudder": y[:, 16]},
            topics.POSITION.name: time | speed | wind,
            topics.ALTITUDE.name: time | {"climb_rate": -v_ned[:, 2]},
            topics.AIR_DATA.name: time | {"density": 1.225 * ones},
            truth.STATE.name: time | speed | quaternion | true | wind | {"on_ground": nothing},
            truth.WING.name: time | flap | tail | {"twist_left": nothing, "twist_right": nothing},
        }

    def columns(self, topic: Topic) -> dict[str, Any]:
        return self.by_topic[topic.name]


def _led(angle: np.ndarray) -> np.ndarray:
    """A command whose first-order lag is ``angle``."""
    constant = hawk.vehicle().tail_servo.time_constant
    return angle + constant * np.gradient(angle, hawk.STEP)


@cache
def identified() -> Identification:
    return identify(Recorded(0.005), "aero", bodies=hawk.vehicle())


@pytest.mark.parametrize("by_truth", [True, False])
def test_structure_and_coefficients_come_from_the_topics_of_a_log(by_truth: bool) -> None:
    result = identify_aero(Recorded(0.0), hawk.vehicle(), by_truth=True) if by_truth else identified().aero
    assert result is not None
    assert structure(result) == EXPECTED
    found = [one for model in result.models for one in model.estimates]
    for one in found:
        assert one.value == pytest.approx(TRUTH[one.name], rel=0.05, abs=4 * one.standard_error)
    assert result.records == ("0.0 s to 4.0 s",)
    assert ("tail: its commands behind the servo's lag" in result.notes) is not by_truth


def test_the_report_has_them_row_by_row_and_as_a_document() -> None:
    found = identified()
    names = {row.name for row in rows(found) if row.estimate}
    assert set(TRUTH) <= names
    assert sum("of its variance" in row.note for row in rows(found)) == 3
    told = document(found)["aero"]
    assert [model["name"] for model in told["models"]] == ["C_L", "C_T", "C_m"]
    assert told["models"][0]["steps"][0]["action"] == "start"


def test_they_are_among_all_where_the_vehicle_is_known() -> None:
    found = identify(Recorded(0.005), "all", bodies=hawk.vehicle())
    assert found.aero == identified().aero
    with pytest.raises(InputError, match="no topic"):
        identify(Recorded(0.005), "all")
    still = Recorded(0.005)
    still.by_topic[topics.WING.name]["flapping"] = np.zeros(2000)
    with pytest.raises(InputError, match="of flapping flight"):
        identify(still, "all", bodies=hawk.vehicle())


def test_without_the_vehicle_or_a_flight_the_reason_is_told() -> None:
    with pytest.raises(InputError, match="no file of it"):
        identify(Recorded(0.005), "aero")
    still = Recorded(0.005)
    still.by_topic[topics.WING.name]["flapping"] = np.zeros(2000)
    with pytest.raises(InputError, match="of flapping flight"):
        identify(still, "aero", bodies=hawk.vehicle())
    del still.by_topic[topics.IMU.name]
    with pytest.raises(InputError, match="no topic /sensors/imu"):
        identify(still, "aero", bodies=hawk.vehicle())
