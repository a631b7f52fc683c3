"""A launch by throw: what the IMU measures of it, and the launch detections of ArduPlane and PX4 on it."""

from __future__ import annotations

import math
import socket
from collections import deque
from typing import Any

import numpy as np
import pytest
from foreign_bench import (
    RAVEN,
    RIG,
    Observed,
    PlanePilot,
    ScriptedArduPlane,
    ScriptedPx4,
    Serving,
    Stages,
    euler,
    pulses,
)
from hypothesis import given
from hypothesis import strategies as st
from ports import free_port

from avionics import topics
from groundstation.command.foreign_parameters import push_of
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign import launch
from sim_bridge.bridge.foreign.ardupilot import ArduPilotServer
from sim_bridge.bridge.foreign.launch import ARMED_TIME, Launch
from sim_bridge.bridge.foreign.outputs import Outputs, Pulses
from sim_bridge.bridge.foreign.px4 import Px4Server
from sim_bridge.bridge.foreign.world import Interface
from sim_bridge.flight.world import Scenario
from sim_bridge.vehicles import load_vehicle
from wingbeat.constants import STANDARD_GRAVITY

THROWN_RIG = RIG._replace(launch=Launch.THROW)
PUSH = push_of(load_vehicle(RAVEN))
ARM_AT = 0.3
END = round(ARM_AT + ARMED_TIME + 4.0, 3)
"""s"""
IN_THE_HAND = Scenario(duration=END - 1e-4, launch_time=math.inf, rest_time=1.0)
ARMED = Outputs(armed=1)


class ArduPlaneDetection:
    """ArduPlane's rule at 50 Hz: forward acceleration without gravity, mean of five, then a delay; level enough."""

    PERIOD, WINDOW = 0.02, 5

    def __init__(self, threshold: float, delay: float) -> None:
        self.threshold, self.delay = threshold, delay
        self.detected_at = self.started_at = math.inf
        self._window: deque[float] = deque(maxlen=self.WINDOW)
        self._next = 0.0

    def update(self, time: float, force_x: float, roll: float, pitch: float) -> bool:
        if time >= self._next and self.started_at == math.inf:
            self._next = time + self.PERIOD - 1e-9
            self._window.append(force_x - STANDARD_GRAVITY * math.sin(pitch))
            if self.detected_at == math.inf and sum(self._window) / self.WINDOW >= self.threshold:
                self.detected_at = time
            level = abs(roll) < math.radians(30.0) and math.radians(-30.0) < pitch < math.radians(45.0)
            if level and time - self.detected_at >= self.delay:
                self.started_at = time
        return time >= self.started_at


class Px4Detection:
    """PX4's rule: the specific force along x is above a threshold for some time without a break."""

    def __init__(self, threshold: float, duration: float, of_magnitude: bool = False) -> None:
        self.threshold, self.duration, self.of_magnitude = threshold, duration, of_magnitude
        self.started_at = math.inf
        self._above, self._last = 0.0, 0.0

    def update(self, time: float, force: tuple[float, float, float]) -> bool:
        value = math.hypot(*force) if self.of_magnitude else force[0]
        self._above = self._above + time - self._last if value > self.threshold else 0.0
        self._last = time
        if self.started_at == math.inf and self._above > self.duration:
            self.started_at = time
        return time >= self.started_at


class Flight:
    """What was recorded, in arrays."""

    def __init__(self, stages: Stages, reports: list[str]) -> None:
        log = stages.logs[0].messages
        self.reports = reports
        self.truth = log[truth_topics.STATE.name]
        self.time = np.array([one.time_us for one in self.truth]) * 1e-6
        self.height = -np.array([one.down for one in self.truth])
        flap = log[topics.FLAP.name]
        self.flapping_from = next((one.time_us * 1e-6 for one in flap if one.amplitude > 0.0), math.inf)
        launches = [
            one.time_us * 1e-6 for one in log.get(truth_topics.EVENTS.name, []) if one.text.startswith("launched")
        ]
        self.launched_at = launches[0] if launches else math.inf


def motion_of(time: float, roll: float, pitch: float, rates: Any, altitude: float, climb_rate: float) -> Observed:
    return Observed(time, roll, pitch, rates[0], rates[1], altitude, climb_rate)


def fly_arduplane(launch_by: Launch) -> tuple[Flight, ArduPlaneDetection, list[dict[str, Any]]]:
    """ArduPlane armed in mode TAKEOFF: no throttle before the detection."""
    stages, reports = Stages(IN_THE_HAND), list[str]()
    rig = RIG._replace(launch=launch_by)
    url = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    serving = Serving(ArduPilotServer(Interface(url), rig, Pulses(), reports.append), stages)
    plane, pilot = ScriptedArduPlane(serving.server.port), PlanePilot(6.0, 0.0)
    detection = ArduPlaneDetection(PUSH.threshold, 0.2)
    outputs, states = Outputs(), list[dict[str, Any]]()
    while not states or states[-1]["timestamp"] < END - 1e-6:
        widths = pulses(outputs) if outputs.armed else (1500, 1500, 0, 1500)
        states.append(plane.exchange(widths))
        state = states[-1]
        time, (roll, pitch) = state["timestamp"], euler(*state["quaternion"])
        motion = motion_of(time, roll, pitch, state["imu"]["gyro"], -state["position"][2], -state["velocity"][2])
        outputs = ARMED if time > ARM_AT else Outputs()
        if detection.update(time, state["imu"]["accel_body"][0], roll, pitch):
            outputs = pilot.fly(motion)
    serving.result()
    plane.close()
    return Flight(stages, reports), detection, states


def fly_px4(of_magnitude: bool) -> tuple[Flight, Px4Detection]:
    """PX4 armed in mode TAKEOFF: no throttle before the detection, on the noisy IMU of HIL_SENSOR."""
    stages, reports = Stages(IN_THE_HAND, 250.0), list[str]()
    url = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    serving = Serving(Px4Server(Interface(url, 1000.0), THROWN_RIG, reports.append), stages)
    px4, pilot = ScriptedPx4(serving.server.port), PlanePilot(6.0, 0.0)
    px4.greet()
    detection = Px4Detection(PUSH.threshold, 0.05, of_magnitude)
    truth: Any = None
    while messages := px4.receive():
        for message in messages:
            if message.get_type() == "HIL_STATE_QUATERNION":
                truth = message
            if message.get_type() != "HIL_SENSOR":
                continue
            time = message.time_usec * 1e-6
            outputs = ARMED if time > ARM_AT else Outputs()
            if detection.update(time, (message.xacc, message.yacc, message.zacc)) and truth is not None:
                attitude, rates = euler(*truth.attitude_quaternion), (message.xgyro, message.ygyro)
                outputs = pilot.fly(motion_of(time, *attitude, rates, truth.alt * 1e-3 - 20.0, -truth.vz * 1e-2))
            px4.answer(message.time_usec, outputs)
    serving.result()
    return Flight(stages, reports), detection


@pytest.fixture(scope="module")
def arduplane() -> tuple[Flight, ArduPlaneDetection, list[dict[str, Any]]]:
    return fly_arduplane(Launch.THROW)


def check_takeoff(flight: Flight, detected_at: float) -> None:
    """Thrown some seconds after arming, detected in the hand, flapping after the detection, and a climb."""
    assert flight.launched_at == pytest.approx(ARM_AT + ARMED_TIME, abs=0.05)
    assert flight.launched_at < detected_at <= flight.launched_at + PUSH.duration
    assert detected_at <= flight.flapping_from < flight.launched_at + PUSH.duration + 0.1
    in_the_air = flight.height[flight.time > flight.launched_at]
    assert in_the_air.min() > 1.0 and 3.5 < in_the_air[-1] < 7.5
    assert any("armed: launch in 5 s" in line for line in flight.reports)


def test_arduplanes_detection_starts_the_wings(
    arduplane: tuple[Flight, ArduPlaneDetection, list[dict[str, Any]]],
) -> None:
    flight, detection, _ = arduplane
    check_takeoff(flight, detection.detected_at)


@pytest.mark.parametrize("of_magnitude", [pytest.param(False, marks=pytest.mark.validate), True])
def test_px4s_detection_starts_the_wings(of_magnitude: bool) -> None:
    """By the specific force along x, as of older versions, and by its magnitude."""
    flight, detection = fly_px4(of_magnitude)
    check_takeoff(flight, detection.started_at)


def test_the_specific_force_of_the_throw_adds_up_to_the_launch_speed(
    arduplane: tuple[Flight, ArduPlaneDetection, list[dict[str, Any]]],
) -> None:
    """In the hand the IMU measures minus gravity; in the throw, the acceleration along x as well."""
    flight, _, states = arduplane
    vehicle = load_vehicle(RAVEN)
    pitch = vehicle.launch.pitch
    rest = np.mean(
        [one["imu"]["accel_body"] for one in states if one["timestamp"] < flight.launched_at - 0.1], axis=0
    )
    assert rest == pytest.approx([9.81 * math.sin(pitch), 0.0, -9.81 * math.cos(pitch)], abs=0.02)
    release = flight.launched_at + PUSH.duration
    throw = [one for one in states if flight.launched_at < one["timestamp"] <= release + 1e-6]
    forward = np.array([one["imu"]["accel_body"][0] for one in throw]) - rest[0]
    assert np.median(forward) == pytest.approx(PUSH.acceleration, rel=0.02)
    assert forward.sum() / 400.0 == pytest.approx(vehicle.launch.speed, rel=0.03)
    assert math.hypot(*throw[-1]["velocity"]) == pytest.approx(vehicle.launch.speed, rel=0.05)


@pytest.mark.validate
def test_a_launch_on_throttle_and_a_detection_wait_for_each_other() -> None:
    flight, detection, _ = fly_arduplane(Launch.THROTTLE)
    assert detection.detected_at == flight.launched_at == flight.flapping_from == math.inf


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 1.0)), min_size=1, max_size=40))
def test_a_throw_comes_after_the_armed_time_without_a_break(steps: list[tuple[bool, float]]) -> None:
    gains, state, since = launch.gains_of(Launch.THROW, 0.28), launch.State(), 0.0
    for armed, throttle in steps:
        since = since + 0.5 if armed else 0.0
        state, ready = launch.step(gains, state, 0.5, Outputs(throttle=throttle, armed=int(armed)))
        assert ready == (since >= ARMED_TIME)
