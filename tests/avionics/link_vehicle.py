"""A vehicle for tests of the link: it applies what the link hands over, as the flight core does at its next tick."""

from __future__ import annotations

import math
from typing import Any

from avionics import messages as m
from avionics import topics as t
from avionics.guidance.mission import NO_FENCE, Fence, Mission, Rally
from avionics.link.vehicle import Home, Parameter
from wingbeat.message import Event
from wingbeat.samples import RangeSample
from wingbeat.topic import Topic

HOME = Home(math.radians(48.1), math.radians(11.6), 520.0)


class FakeVehicle:
    """Holds what a `VehicleView` shows; `apply` takes inputs."""

    def __init__(self) -> None:
        self.time_us = 12_345_678
        self.mode = m.Mode.MANUAL
        self.armed = False
        self.mission: Mission = ()
        self.fence: Fence = NO_FENCE
        self.rally: Rally = ()
        self.home: Home | None = HOME
        self.destination: tuple[float, float] | None = None
        self.parameters = [
            Parameter("PITCH_P", 0.8, 0.0, 5.0, "rad/s"),
            Parameter("CLIMB_P", 0.1, 0.0, 2.0),
            *(Parameter(f"SPARE_{number}", float(number), -1e6, 1e6) for number in range(60)),
        ]
        self.refusals: dict[m.CommandKind, str] = {}
        self.reported: list[Event] = []
        self.inputs: list[m.Input] = []
        self.topics: dict[str, Any] = {}
        for topic, message in _messages(self.time_us).items():
            self.topics[topic.name] = message

    def latest(self, topic: Topic) -> Any:
        return self.topics.get(topic.name)

    def events(self, after: int) -> list[Event]:
        return self.reported[after:]

    def refusal(self, command: m.Command) -> str:
        return self.refusals.get(command.kind, "")

    def apply(self, inputs: list[m.Input]) -> None:
        self.inputs += inputs
        for command in inputs:
            if isinstance(command, m.Command):
                self._apply(command)

    def _apply(self, command: m.Command) -> None:
        if command.kind in (m.CommandKind.ARM, m.CommandKind.DISARM):
            self.armed = command.kind is m.CommandKind.ARM
        elif command.kind is m.CommandKind.SET_MODE:
            self.mode = m.Mode[command.name]
        elif command.kind is m.CommandKind.LOITER_AT:
            self.mode = m.Mode.LOITER
        elif command.kind is m.CommandKind.SET_MISSION:
            self.mission = command.payload
        elif command.kind is m.CommandKind.SET_FENCE:
            self.fence = command.payload
        elif command.kind is m.CommandKind.SET_RALLY:
            self.rally = command.payload
        elif command.kind is m.CommandKind.SET_PARAMETER:
            names = [parameter.name for parameter in self.parameters]
            index = names.index(command.name)
            self.parameters[index] = self.parameters[index]._replace(value=command.value)


def _filled(kind: Any, time_us: int, **values: Any) -> Any:
    empty = dict.fromkeys(kind._fields, 0)
    return kind(**{**empty, "time_us": time_us, **values})


def _messages(time_us: int) -> dict[Topic, Any]:
    return {
        t.ATTITUDE: _filled(m.Attitude, time_us, roll=0.1, pitch=0.2, yaw=-0.5, pitch_rate=0.3, quaternion_w=1.0),
        t.POWER: _filled(m.PowerState, time_us, voltage=7.4, current=2.5, power=18.0, charge=360.0, energy=2500.0,
                         battery_remaining=0.8),
        t.WING: _filled(m.WingState, time_us, angle_left=0.4, angle_right=0.41, frequency=4.2,
                     strokes=17, flapping=1),
        t.AIR_DATA: _filled(m.AirData, time_us, airspeed=7.5),
        t.ALTITUDE: _filled(m.Altitude, time_us, altitude=40.0, climb_rate=0.5),
        t.POSITION: _filled(m.Position, time_us, north=30.0, east=-20.0, v_north=6.0, v_east=2.0,
                            latitude=math.radians(48.1003), longitude=math.radians(11.5997), valid=1,
                            wind_north=3.0, wind_east=-1.0, wind_variance=0.25),
        t.GPS: m.GpsFix(time_us, math.radians(48.1003), math.radians(11.5997), 560.0, 6.0, 2.0, -0.5, 2.5, 4.0, 3, 9),
        t.NAVIGATION: _filled(m.NavigationStatus, time_us, mode=m.Mode.AUTO, stage=m.Stage.EN_ROUTE, distance=55.0),
        t.ALTITUDE_LOOP: _filled(m.AltitudeStatus, time_us, throttle=0.6, pitch_setpoint=0.1),
        t.HEADING_LOOP: _filled(m.HeadingStatus, time_us, roll_setpoint=0.2),
        t.EXCITATION: _filled(m.ExcitationStatus, time_us, active=1, manoeuvre=2, elevator=0.1),
        t.ACTUATORS: m.ActuatorCommand(time_us, 0.5, 0.5, 0.0, 0.1, -0.1, 1),
        t.IMU: _filled(m.ImuSample, time_us, accel_z=-9.81),
        t.RECEIVER: m.ReceiverSample(time_us, (1500, 1400, 1000, 1500, 1000, 2000, 1000, 1500), 0, 200),
        t.FENCE: m.FenceState(time_us, 1, 2, m.Breach.CEILING, 11.5),
        t.HEALTH: _filled(m.Health, time_us, ticks=100),
        t.VIBRATION: m.VibrationStatus(time_us, 1.0, 2.0, 3.0, 4),
        t.RANGE: RangeSample(time_us, 3.5, 0.1, 12.0, 100),
    }  # fmt: skip
