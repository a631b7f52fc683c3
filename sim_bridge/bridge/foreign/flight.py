"""One flight of a foreign autopilot: mixing of its outputs, advance of the simulation, recording and reports."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from avionics import topics
from avionics.isolation import Isolation, fault_events
from avionics.messages import FlapCommand, SensorFrame
from avionics.sensors import publish_samples
from avionics.vehicles.loader import FlightVehicle
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign import launch, mixer
from sim_bridge.bridge.foreign.launch import Launch
from sim_bridge.bridge.foreign.observer import Observer
from sim_bridge.bridge.foreign.outputs import Channels, Outputs
from sim_bridge.bridge.foreign.world import ForeignWorld, Stage, Tell
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.observation import Observation
from wingbeat.message import Event, Severity

LONGEST_STEP = 0.005
"""s; maximum step: a stroke of 4 Hz has 50 of them"""
RECORD_PERIOD_US = 4000
"""us; minimum recording period of commands, independent of the step"""


class Reported(Enum):
    """Flight stage last reported on the terminal."""

    IN_HAND = 0
    LAUNCHED = 1
    FLYING = 2
    LANDED = 3


class Rig(NamedTuple):
    """Wiring of an airplane autopilot to the vehicle."""

    vehicle: FlightVehicle
    channels: Channels = Channels()
    launch: Launch = Launch.THROTTLE


class ForeignFlight:
    """Flight from the launcher to the end of the simulation, or to a restart of the autopilot."""

    def __init__(self, stage: Stage, rig: Rig, report: Tell) -> None:
        self.world: ForeignWorld = stage.world
        self._publish = stage.publish
        self._report = report
        self._gains = mixer.gains_of(rig.vehicle)
        self._by_throw = rig.launch is Launch.THROW
        self._launch = launch.gains_of(rig.launch, rig.vehicle.gains.altitude.throttle_trim)
        self._mixed = mixer.State()
        self._ready = launch.State()
        self._reported = Reported.IN_HAND
        self._next_record_us = 0
        self._flap, self._command = FlapCommand(0, 0.0, 0.0, 0.0, 0.0, 0.0), NEUTRAL
        self._isolation = Isolation()
        self._guard = self._isolation.guard("observer")
        self._observer = Observer(rig.vehicle, stage.publish)

    def advance(self, outputs: Outputs, duration: float) -> Observation:
        """Advance ``duration`` s with constant ``outputs``, in steps short enough for the stroke.

        Raises:
            SimulationSilent: from the start of that fault.
        """
        steps = max(1, math.ceil(duration / LONGEST_STEP - 1e-9))
        for _ in range(steps):
            observation = self._step(outputs, duration / steps)
        self._watch_flight(outputs)
        return observation

    def sample(self, observation: Observation) -> SensorFrame:
        """Read and record the sensors."""
        frame = self.world.sample(observation)
        publish_samples(self._publish, frame)
        self._observe(frame)
        return frame

    def _observe(self, frame: SensorFrame) -> None:
        """Estimate the motion for the recording; an error is recorded and does not end the flight."""
        self._isolation.advance(frame.time_us * 1e-6)
        self._guard.run(self._observer.update, frame, self._flap, self._command, self.world.launched)
        for fault in self._isolation.take_faults():
            for event in fault_events(fault, frame.time_us):
                self._publish(truth_topics.EVENTS, event)

    def report_stage(self, text: str, severity: Severity = Severity.INFO) -> None:
        """Report a stage on the terminal and in the recording."""
        self._publish(truth_topics.EVENTS, Event(self.world.time_us, severity, "world", text))
        self._report(f"{self.world.time_us * 1e-6:7.1f} s  {text}")

    def _step(self, outputs: Outputs, dt: float) -> Observation:
        start_us = self.world.time_us
        self._mixed, flap, command = mixer.step(self._gains, self._mixed, start_us, dt, outputs)
        waited = self._ready.ready
        self._ready, ready = launch.step(self._launch, self._ready, dt, outputs)
        if self._by_throw and not self.world.launched and (waited > 0.0) != (self._ready.ready > 0.0):
            self.report_stage(f"armed: launch in {self._launch.time:g} s" if waited <= 0.0 else "disarmed: no launch")
        if ready:
            self.world.release()
        self._flap, self._command = flap, command
        observation = self.world.advance(command, dt)
        self.world.record()
        if observation.time_us >= self._next_record_us:
            self._next_record_us = observation.time_us + RECORD_PERIOD_US
            self._publish(topics.FLAP, flap)
            self._publish(topics.ACTUATORS, command)
        return observation

    def _watch_flight(self, outputs: Outputs) -> None:
        if self._reported is Reported.IN_HAND and self.world.launched:
            self._reported = Reported.LAUNCHED
            self.report_stage(f"launched, throttle {100.0 * outputs.throttle:.0f} %")
        elif self._reported is Reported.LAUNCHED and not self.world.truth().on_ground:
            self._reported = Reported.FLYING
        elif self._reported is Reported.FLYING and self.world.truth().on_ground:
            self._reported = Reported.LANDED
            self.report_stage("on the ground")
