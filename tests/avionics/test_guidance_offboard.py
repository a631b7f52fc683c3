"""OFFBOARD in the flight core: paths, altitude ramp, fence, JSON of commands and snapshots."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from surrogate import Bird
from surrogate_gains import VEHICLE

from avionics import inputs, topics
from avionics.autopilot import Autopilot
from avionics.guidance import offboard
from avionics.guidance.mission import Fence, MissionItem, Zone
from avionics.guidance.navigation import Situation
from avionics.guidance.route import State
from avionics.guidance.setpoint import Path, Setpoint
from avionics.messages import Command, CommandKind, Mode, Stage
from avionics.missions import load_mission
from wingbeat.topic import Topic

GAINS = VEHICLE.gains.navigation
RADIUS = GAINS.loiter_radius
SITUATION = Situation(
    mode=Mode.OFFBOARD, stage=Stage.EN_ROUTE, north=10.0, east=20.0, valid=1, heading=0.0, altitude=40.0,
    stick_pitch=0.0, excitations=0, airspeed=7.5, ground_speed=7.5, ceiling=60.0,
)  # fmt: skip
COURSE = Setpoint(Path.COURSE, course=1.0, climb_rate=0.5)
CIRCLE = Setpoint(Path.CIRCLE_AT, 50.0, 60.0, radius=-30.0, altitude=45.0)
HERE = Setpoint(Path.CIRCLE_HERE, 10.0, 20.0 + RADIUS, RADIUS)


@pytest.mark.parametrize(
    ("last", "new", "resolved"),
    [
        (None, COURSE, COURSE),
        (None, CIRCLE._replace(radius=0.0), CIRCLE._replace(radius=RADIUS)),
        (None, Setpoint(Path.KEEP, altitude=30.0), HERE._replace(altitude=30.0)),
        (COURSE, Setpoint(Path.KEEP, altitude=30.0), COURSE._replace(altitude=30.0, climb_rate=0.0)),
        (CIRCLE, Setpoint(Path.KEEP, climb_rate=1.0), CIRCLE._replace(altitude=None, climb_rate=1.0)),
        (CIRCLE, Setpoint(Path.CIRCLE_HERE), HERE),
        (HERE._replace(north=-5.0), Setpoint(Path.CIRCLE_HERE), HERE._replace(north=-5.0)),
        (Setpoint(Path.ATTITUDE, throttle=0.5), Setpoint(Path.KEEP), HERE),
    ],
)
def test_resolve_keeps_or_lays_a_path(last: Setpoint | None, new: Setpoint, resolved: Setpoint) -> None:
    assert offboard.resolve(GAINS, last, new, SITUATION) == resolved


@pytest.mark.parametrize(("climb_rate", "expected"), [(0.5, 40.5), (-0.5, 39.5), (9.0, 40.0 + GAINS.stick_climb)])
def test_climb_rate_ramps_the_altitude_within_its_limit(climb_rate: float, expected: float) -> None:
    state = State(mode=Mode.OFFBOARD, altitude=40.0)
    for _ in range(20):
        state, target = offboard.fly(GAINS, state, 0.05, COURSE._replace(climb_rate=climb_rate), SITUATION)
    assert target.altitude == pytest.approx(expected) and target.heading == COURSE.course


@pytest.mark.parametrize(("climb_rate", "end"), [(1.0, SITUATION.ceiling), (-1.0, GAINS.return_floor)])
def test_altitude_ramp_ends_at_ceiling_and_floor(climb_rate: float, end: float) -> None:
    state = State(mode=Mode.OFFBOARD, altitude=40.0)
    for _ in range(2000):
        state, target = offboard.fly(GAINS, state, 0.05, COURSE._replace(climb_rate=climb_rate), SITUATION)
    assert target.altitude == pytest.approx(end)


class Flight:
    """The flight computer in flight with the stand-in vehicle."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self.autopilot, self.bird = Autopilot(VEHICLE, load_mission("circuit"), self.publish), Bird()
        self.fly(3.0)
        self.fly(0.5, Command(0, CommandKind.SET_MODE, "AUTO"), Command(0, CommandKind.ARM))
        self.bird.throw()
        self.fly(10.0)

    def publish(self, topic: Topic, message: Any) -> None:
        if topic is topics.EVENTS:
            self.events.append(message.text)

    def fly(self, seconds: float, *commands: Command) -> list[Any]:
        frames = []
        for _ in range(round(seconds / 0.005)):
            frames.append(self.bird.frame())
            self.bird.advance(self.autopilot.step(frames[-1], commands))
            commands = ()
        return frames

    @property
    def mode(self) -> Mode:
        return Mode(self.autopilot.state.modes.mode)


def setpoint(new: Setpoint) -> Command:
    return Command(0, CommandKind.SET_SETPOINT, payload=new, source="test")


OFFBOARD = Command(0, CommandKind.SET_MODE, "OFFBOARD", source="test")


def test_commands_with_setpoints_survive_json() -> None:
    for command in (setpoint(CIRCLE), setpoint(COURSE), OFFBOARD, OFFBOARD._replace(payload=HERE)):
        decoded = inputs.decode_command(inputs.encode_command(command))
        assert decoded == command and type(decoded.payload) is type(command.payload)


def test_snapshot_in_offboard_continues_bit_for_bit() -> None:
    flight = Flight()
    flight.fly(0.5, setpoint(COURSE), OFFBOARD)
    text = flight.autopilot.snapshot()
    other = Autopilot(VEHICLE, (), lambda topic, message: None)
    other.restore(text)
    frames = flight.fly(2.0)
    for frame in frames:
        other.step(frame)
    assert other.state == flight.autopilot.state and flight.mode is Mode.LOITER


def test_snapshot_of_an_older_recording_takes_defaults() -> None:
    flight = Flight()
    document = json.loads(flight.autopilot.snapshot())
    del document["offboard"]
    names = list(VEHICLE.gains._fields)
    del document["gains"][names.index("navigation")][-1]
    other = Autopilot(VEHICLE, (), lambda topic, message: None)
    other.restore(json.dumps(document))
    assert other.state == flight.autopilot.state


def test_setpoints_outside_the_fence_are_denied() -> None:
    flight = Flight()
    zone = Zone(0, ((0.0, 80.0),), 30.0)
    flight.fly(0.1, Command(0, CommandKind.SET_FENCE, payload=Fence((zone,), 0.0, 50.0)))
    ceiling = "above the fence's ceiling of 50 m"
    cases = {
        setpoint(CIRCLE._replace(north=5.0, east=85.0)): "outside the fence",
        setpoint(CIRCLE._replace(north=9000.0)): "outside the fence",
        setpoint(CIRCLE._replace(altitude=60.0)): ceiling,
        setpoint(COURSE._replace(altitude=60.0)): ceiling,
        setpoint(COURSE._replace(course=math.nan)): "not a number",
        Command(0, CommandKind.CHANGE_ALTITUDE, "LOITER", 60.0): ceiling,
        Command(0, CommandKind.CHANGE_ALTITUDE, "", 40.0): "neither LOITER nor OFFBOARD",
        Command(0, CommandKind.LOITER_AT, payload=MissionItem(17, 5.0, 85.0, 40.0)): "outside the fence",
    }
    state = flight.autopilot.state
    for command, reason in cases.items():
        assert reason in inputs.refusal(state, command)
    assert inputs.refusal(state, setpoint(CIRCLE)) == ""
    assert inputs.refusal(state, Command(0, CommandKind.CHANGE_ALTITUDE, "LOITER", 40.0)) == ""


def test_denied_mode_keeps_the_last_setpoint() -> None:
    """GIVEN a setpoint WHEN a SET_MODE with another one is denied THEN the first is kept."""
    flight = Flight()
    flight.fly(0.1, setpoint(COURSE))
    before = flight.autopilot.state.offboard
    flight.fly(0.1, OFFBOARD._replace(payload=CIRCLE._replace(north=9000.0)))
    assert flight.autopilot.state.offboard == before and flight.mode is Mode.AUTO
    assert flight.events[-1] == "setpoint rejected: outside the fence"


def test_offboard_set_again_keeps_its_setpoint() -> None:
    flight = Flight()
    flight.fly(0.1, OFFBOARD._replace(payload=CIRCLE._replace(expires=0)))
    before = flight.autopilot.state.offboard
    flight.fly(0.1, OFFBOARD._replace(payload=HERE))
    assert flight.mode is Mode.OFFBOARD and flight.autopilot.state.offboard == before


def test_change_altitude_enters_loiter_and_holds() -> None:
    flight = Flight()
    flight.fly(30.0, Command(0, CommandKind.CHANGE_ALTITUDE, "LOITER", 30.0))
    assert flight.mode is Mode.LOITER
    assert flight.autopilot.state.altitude.altitude == pytest.approx(30.0, abs=2.0)
    assert flight.autopilot.state.navigation.altitude == 30.0
