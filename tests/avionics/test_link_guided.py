"""Setpoint messages, guided waypoints, reposition, orbit and altitude commands: each message and each rejection."""

from __future__ import annotations

import math
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from surrogate import Bird
from surrogate_gains import VEHICLE

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.guidance.setpoint import Path, Setpoint
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.mission_codec import to_degrees
from avionics.link.services.setpoints import REPORT_INTERVAL
from avionics.link.vehicle import PROFILES
from avionics.messages import Command, CommandKind, Mode
from avionics.missions import load_mission
from avionics.view import FlightView

POSITION, VELOCITY, ALTITUDE = 0b1101_1111_1000, 0b1101_1100_0111, 0b1101_1111_1011
YAW = 0b1001_1111_1011
LOCAL, OFFSET, BODY = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED, mavlink.MAV_FRAME_BODY_NED
RELATIVE, SEA = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_FRAME_GLOBAL_INT
LEVEL = [1.0, 0.0, 0.0, 0.0]
TICK = 0.005


def local(mask: int, frame: int = LOCAL, **fields: float) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED."""
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = [fields.get(name, 0.0) for name in names]
    return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values)


def world(mask: int, frame: int, x: float, y: float, z: float) -> Any:
    """SET_POSITION_TARGET_GLOBAL_INT."""
    place = (round(x * 1e7), round(y * 1e7), z)
    return mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, mask, *place, *(0.0,) * 8)


def attitude(mask: int, q: list[float], throttle: float) -> Any:
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, 0.0, throttle)


def waypoint(current: int, x: float, y: float, z: float, command: int = 16) -> Any:
    """The guided waypoint of dronekit's simple_goto."""
    return mavlink.MAVLink_mission_item_message(1, 1, 0, 3, command, current, 0, 0, 0, 0, 0, x, y, z)


class Exchange:
    """One station on a link to a vehicle that applies what it gets; time is the test's."""

    def __init__(self, vehicle: Any, identity: str = "generic") -> None:
        self.vehicle, self.wire, self.station = vehicle, Wire("udpin:127.0.0.1:1"), Voice(255)
        self.link = GroundLink([self.wire], vehicle, PROFILES[identity])
        self.now = 10.0

    def send(self, *messages: Any, station: Voice | None = None, wait: float = 0.05) -> list[Any]:
        """The vehicle's messages after ``messages``."""
        for message in messages:
            self.wire.put((station or self.station).frame(message))
        self.now += wait
        self.vehicle.time_us += round(wait * 1e6)
        self.vehicle.apply(self.link.poll(self.now))
        return [each for each in self.wire.incoming() if each.get_type() not in ("HEARTBEAT", "CURRENT_MODE")]

    def command(self, number: int, *params: float, frame: int | None = None) -> tuple[int, list[str]]:
        """Result and texts of a COMMAND_LONG, or of a COMMAND_INT in ``frame``."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded)
        if frame is not None:
            x, y = (round(1e7 * angle) for angle in padded[4:6])
            message = mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *padded[:4], x, y, padded[6])
        answers = self.send(message)
        (ack,) = [each for each in answers if each.get_type() == "COMMAND_ACK"]
        return ack.result, texts(answers)

    def inputs(self, kind: CommandKind) -> list[Command]:
        return [each for each in self.vehicle.inputs if isinstance(each, Command) and each.kind is kind]


def texts(messages: list[Any]) -> list[str]:
    return [each.text for each in messages if each.get_type() == "STATUSTEXT"]


def sent_setpoint(message: Any, identity: str = "generic") -> Setpoint:
    exchange = Exchange(FakeVehicle(), identity)
    assert not texts(exchange.send(message))
    (command,) = exchange.inputs(CommandKind.SET_SETPOINT)
    return command.payload


PLACE = to_degrees(FakeVehicle().home, 100.0, -50.0)


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (local(POSITION, x=100.0, y=-50.0, z=-30.0), Setpoint(Path.CIRCLE_AT, 100.0, -50.0, altitude=30.0)),
        (local(POSITION, OFFSET, x=10.0, y=5.0, z=-3.0), Setpoint(Path.CIRCLE_AT, 40.0, -15.0, altitude=43.0)),
        (local(POSITION, OFFSET, z=-5.0), Setpoint(Path.KEEP, altitude=45.0)),
        (local(ALTITUDE, z=-30.0), Setpoint(Path.KEEP, altitude=30.0)),
        (local(VELOCITY, vx=0.0, vy=6.0, vz=-1.0), Setpoint(Path.COURSE, course=0.5 * math.pi, climb_rate=1.0)),
        (local(VELOCITY, vz=0.5), Setpoint(Path.CIRCLE_HERE, climb_rate=-0.5)),
        (local(VELOCITY, BODY), Setpoint(Path.CIRCLE_HERE)),
        (local(YAW, z=-30.0, yaw=1.5), Setpoint(Path.COURSE, course=1.5, altitude=30.0)),
        (world(POSITION, RELATIVE, *PLACE, 30.0), Setpoint(Path.CIRCLE_AT, 100.0, -50.0, altitude=30.0)),
        (world(POSITION, SEA, *PLACE, 560.0), Setpoint(Path.CIRCLE_AT, 100.0, -50.0, altitude=40.0)),
        (world(ALTITUDE, SEA, 0.0, 0.0, 560.0), Setpoint(Path.KEEP, altitude=40.0)),
        (attitude(7, [math.cos(0.1), math.sin(0.1), 0.0, 0.0], 0.6), Setpoint(Path.ATTITUDE, roll=0.2, throttle=0.6)),
    ],
)
def test_setpoint_message_decoding(message: Any, expected: Setpoint) -> None:
    setpoint = sent_setpoint(message)
    assert (setpoint.path, setpoint.expires) == (expected.path, 1)
    assert (setpoint.altitude is None) == (expected.altitude is None)
    numbers = [[value or 0.0 for value in each[1:]] for each in (setpoint, expected)]
    assert numbers[0] == pytest.approx(numbers[1], abs=0.02)


@pytest.mark.parametrize(
    ("message", "expires"),
    [
        (local(POSITION, z=-30.0), 0),
        (local(ALTITUDE, z=-30.0), 0),
        (local(VELOCITY, vx=5.0), 1),
        (attitude(7, LEVEL, 0.5), 1),
    ],
)
def test_ardupilot_position_setpoints_do_not_expire(message: Any, expires: int) -> None:
    assert sent_setpoint(message, "ardupilot").expires == expires


@pytest.mark.parametrize(
    ("message", "part"),
    [
        (local(POSITION, mavlink.MAV_FRAME_BODY_FRD, x=5.0), "frame 12"),
        (local(VELOCITY, BODY, vx=5.0), "frame 8"),
        (local(POSITION, 20, x=5.0), "frame 20"),
        (world(POSITION, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT, *PLACE, 30.0), "frame 11"),
        (local(0b1100_0011_1111, afx=1.0), "acceleration"),
        (local(0b1101_1111_1111), "type mask"),
        (world(POSITION, RELATIVE, 0.0, 0.0, 30.0), "100 km"),
        (attitude(7 | 64, LEVEL, 0.5), "throttle"),
        (attitude(128, LEVEL, 0.5), "attitude"),
        (attitude(7, [0.0] * 4, 0.5), "quaternion"),
    ],
)
def test_unsupported_setpoint_is_reported_once(message: Any, part: str) -> None:
    """GIVEN a stream at 20 Hz WHEN it is not supported THEN one STATUSTEXT, another after `REPORT_INTERVAL`."""
    exchange = Exchange(FakeVehicle())
    said = [text for _ in range(40) for text in texts(exchange.send(message))]
    assert len([text for text in said if part in text]) == 1
    assert not exchange.inputs(CommandKind.SET_SETPOINT)
    assert any(part in text for text in texts(exchange.send(message, wait=REPORT_INTERVAL)))


def test_setpoint_denied_by_the_core_is_reported_once() -> None:
    vehicle = FakeVehicle()
    vehicle.refusals[CommandKind.SET_SETPOINT] = "setpoint rejected: outside the fence"
    exchange = Exchange(vehicle)
    said = [text for _ in range(40) for text in texts(exchange.send(local(POSITION, x=900.0, z=-30.0)))]
    assert said == ["setpoint rejected: outside the fence"]
    assert not exchange.inputs(CommandKind.SET_SETPOINT)


def test_setpoints_of_many_senders_are_one_input_per_period() -> None:
    """GIVEN 16 senders at 50 Hz for 1 s WHEN polled at 200 Hz THEN at most 20 inputs, the latest of each period."""
    vehicle = FakeVehicle()
    exchange, senders = Exchange(vehicle), [Voice(200 + number) for number in range(16)]
    for tick in range(200):
        if tick % 4 == 0:
            for number, sender in enumerate(senders):
                exchange.wire.put(sender.frame(local(POSITION, x=float(tick), y=float(number), z=-30.0)), sender)
        exchange.send(wait=TICK)
    setpoints = exchange.inputs(CommandKind.SET_SETPOINT)
    assert 19 <= len(setpoints) <= 20
    assert [each.payload.north for each in setpoints] == sorted(each.payload.north for each in setpoints)
    assert setpoints[-1].payload.north >= 180.0


def test_guided_waypoint_needs_the_mode_and_is_acknowledged() -> None:
    vehicle = FakeVehicle()
    exchange = Exchange(vehicle, "ardupilot")
    vehicle.mode = Mode.LOITER
    answers = exchange.send(waypoint(2, *PLACE, 30.0))
    assert [each.type for each in answers if each.get_type() == "MISSION_ACK"] == [mavlink.MAV_MISSION_DENIED]
    assert "the mode is not GUIDED" in texts(answers)[0]
    vehicle.mode = Mode.OFFBOARD
    answers = exchange.send(waypoint(2, *PLACE, 30.0))
    assert [each.type for each in answers] == [mavlink.MAV_MISSION_ACCEPTED]
    (command,) = exchange.inputs(CommandKind.SET_SETPOINT)
    assert (command.payload.north, command.payload.east) == pytest.approx((100.0, -50.0), abs=0.1)
    assert (command.payload.altitude, command.payload.expires) == (30.0, 0)
    assert [each.type for each in exchange.send(waypoint(3, 0.0, 0.0, 45.0))] == [mavlink.MAV_MISSION_ACCEPTED]
    assert [each.value for each in exchange.inputs(CommandKind.CHANGE_ALTITUDE)] == [45.0]
    answers = exchange.send(waypoint(2, *PLACE, 30.0, command=21))
    assert answers[0].type == mavlink.MAV_MISSION_UNSUPPORTED


def test_guided_waypoint_does_not_disturb_an_upload() -> None:
    vehicle = FakeVehicle()
    exchange = Exchange(vehicle)
    vehicle.mode = Mode.OFFBOARD
    answers = exchange.send(mavlink.MAVLink_mission_count_message(1, 1, 1, 0))
    assert [each.seq for each in answers if each.get_type() == "MISSION_REQUEST_INT"] == [0]
    exchange.send(waypoint(2, *PLACE, 30.0))
    assert vehicle.mission == ()
    exchange.send(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 22, 0, 1, 0, 0, 0, 0, 0, 0, 30.0))
    assert len(vehicle.mission) == 1


@pytest.mark.parametrize(
    ("radius", "yaw", "expected"), [(30.0, math.nan, 30.0), (30.0, 1.0, -30.0), (math.nan, 0.0, 0.0)]
)
def test_reposition_circles_and_notes_the_speed(radius: float, yaw: float, expected: float) -> None:
    exchange = Exchange(FakeVehicle())
    result, said = exchange.command(192, 9.0, 1, radius, yaw, *PLACE, 40.0, frame=RELATIVE)
    assert result == mavlink.MAV_RESULT_ACCEPTED and said == ["reposition: the ground speed is ignored"]
    (command,) = exchange.inputs(CommandKind.LOITER_AT)
    assert command.payload.radius == expected


def test_reposition_without_a_position_changes_the_altitude() -> None:
    """GIVEN no position WHEN QGroundControl repositions to an altitude above the sea THEN LOITER at that altitude."""
    exchange = Exchange(FakeVehicle())
    result, said = exchange.command(192, -1, 1, 0, math.nan, math.nan, math.nan, 575.0)
    assert (result, said) == (mavlink.MAV_RESULT_ACCEPTED, [])
    (command,) = exchange.inputs(CommandKind.CHANGE_ALTITUDE)
    assert (command.name, command.value) == ("LOITER", pytest.approx(55.0))


def test_change_altitude_uses_its_frame() -> None:
    exchange = Exchange(FakeVehicle())
    assert exchange.command(186, 55.0, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert exchange.command(186, 580.0, mavlink.MAV_FRAME_GLOBAL)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert [each.value for each in exchange.inputs(CommandKind.CHANGE_ALTITUDE)] == pytest.approx([55.0, 60.0])
    for altitude, frame in ((55.0, 77.0), (math.nan, 3.0), (55.0, math.nan)):
        result, said = exchange.command(186, altitude, frame)
        assert result == mavlink.MAV_RESULT_DENIED and said


@pytest.mark.parametrize("number", [mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_GUIDED_CHANGE_SPEED])
@pytest.mark.parametrize(
    ("params", "speed", "note"),
    [
        ((0.0, 8.0, -1.0), 8.0, []),
        ((1.0, 7.5, -1.0), 7.5, ["change speed: ground speed taken as airspeed"]),
        ((0.0, -2.0, -1.0), 0.0, []),
    ],
)
def test_change_speed_sets_the_airspeed(
    number: int, params: tuple[float, ...], speed: float, note: list[str]
) -> None:
    exchange = Exchange(FakeVehicle(), "ardupilot")
    assert exchange.command(number, *params) == (mavlink.MAV_RESULT_ACCEPTED, note)
    (command,) = exchange.inputs(CommandKind.CHANGE_SPEED)
    assert command.value == speed


@pytest.mark.parametrize("params", [(2.0, 1.0), (0.0, -1.0), (0.0, math.nan)])
def test_change_of_another_speed_is_denied(params: tuple[float, ...]) -> None:
    exchange = Exchange(FakeVehicle(), "ardupilot")
    assert exchange.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, *params)[0] == mavlink.MAV_RESULT_DENIED
    assert not exchange.inputs(CommandKind.CHANGE_SPEED)


def test_land_start_continues_the_mission_at_its_landing() -> None:
    exchange = Exchange(FakeVehicle(), "ardupilot")
    before = exchange.command(mavlink.MAV_CMD_DO_LAND_START)
    assert before[0] == mavlink.MAV_RESULT_DENIED and "no DO_LAND_START" in before[1][0]
    exchange.vehicle.mission = (
        MissionItem(ItemKind.TAKEOFF, altitude=20.0),
        MissionItem(ItemKind.LAND_START),
        MissionItem(ItemKind.LAND, 50.0, 0.0),
    )
    assert exchange.command(mavlink.MAV_CMD_DO_LAND_START)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert [each.value for each in exchange.inputs(CommandKind.SET_CURRENT_ITEM)] == [1.0]
    assert exchange.inputs(CommandKind.SET_MODE)[0].name == Mode.AUTO.name


def test_orbit_has_radius_direction_and_center() -> None:
    exchange = Exchange(FakeVehicle())
    nan = math.nan
    accepted = mavlink.MAV_RESULT_ACCEPTED
    assert exchange.command(34, -25.0, nan, 0, nan, *PLACE, 570.0, frame=SEA) == (accepted, [])
    assert exchange.command(34, 25.0, 8.0, 0, 0, nan, nan, nan) == (accepted, ["orbit: the speed is ignored"])
    one, other = (each.payload for each in exchange.inputs(CommandKind.LOITER_AT))
    assert (one.north, one.east, one.altitude, one.radius) == pytest.approx((100.0, -50.0, 50.0, -25.0), abs=0.1)
    place = exchange.vehicle.topics[topics.POSITION.name]
    expected = [math.degrees(place.latitude), math.degrees(place.longitude), 40.0, 25.0]
    assert [
        *to_degrees(exchange.vehicle.home, other.north, other.east),
        other.altitude,
        other.radius,
    ] == pytest.approx(expected)
    exchange.vehicle.refusals[CommandKind.LOITER_AT] = "outside the fence"
    result, said = exchange.command(34, 25.0, nan, 0, nan, *PLACE, 570.0, frame=SEA)
    assert (result, said) == (mavlink.MAV_RESULT_DENIED, ["outside the fence"])


def test_position_target_is_sent_on_request() -> None:
    vehicle = FakeVehicle()
    exchange = Exchange(vehicle)
    for destination in ((100.0, -50.0), None):
        vehicle.destination = destination
        request = [
            mavlink.MAVLink_command_long_message(1, 1, 512, 0, number, 0, 0, 0, 0, 0, 0) for number in (87, 85)
        ]
        answers = {each.get_type(): each for each in exchange.send(*request)}
        globe, plane = answers["POSITION_TARGET_GLOBAL_INT"], answers["POSITION_TARGET_LOCAL_NED"]
        assert {globe.type_mask & 3, plane.type_mask & 3} == {0 if destination else 3}
        if destination:
            assert (globe.lat_int * 1e-7, globe.lon_int * 1e-7) == pytest.approx(PLACE, abs=1e-6)
            assert (plane.x, plane.y) == destination


# --- flown by the stand-in vehicle ---------------------------------------------------------------------------


class FlightOnLink:
    """The flight computer in flight with the stand-in vehicle, as the link's vehicle."""

    def __init__(self, identity: str) -> None:
        self.view, self.bird = FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None), Bird()
        self.exchange = Exchange(self, identity)
        self.fly(3.0)
        self.step([Command(0, CommandKind.SET_MODE, "AUTO"), Command(0, CommandKind.ARM)])
        self.fly(0.5)
        self.bird.throw()
        self.fly(12.0)
        assert self.view.armed and self.view.mode is Mode.AUTO

    def __getattr__(self, name: str) -> Any:
        return getattr(self.view, name)

    def step(self, inputs: list[Any]) -> None:
        self.bird.advance(self.view.autopilot.step(self.bird.frame(), inputs))

    def fly(self, seconds: float, *stream: Any, rate: float = 20.0) -> list[Any]:
        """Fly on with ``stream`` sent at ``rate`` (Hz); all messages of the vehicle."""
        ticks, every, answers = round(seconds / TICK), round(1.0 / (rate * TICK)), []
        for tick in range(ticks):
            if tick % every == 0:
                for message in stream:
                    self.exchange.wire.put(self.exchange.station.frame(message))
            self.exchange.now += TICK
            self.step(self.exchange.link.poll(self.exchange.now))
            answers += self.exchange.wire.incoming()
        return answers

    def request(self, message: Any, *stream: Any) -> list[Any]:
        """Answers to one message while ``stream`` goes on."""
        self.exchange.wire.put(self.exchange.station.frame(message))
        return self.fly(0.2, *stream)

    def distance(self, north: float, east: float) -> float:
        return math.hypot(self.bird.north - north, self.bird.east - east)


def set_mode(custom: int) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, custom, 0, 0, 0, 0, 0)


def result(answers: list[Any]) -> int:
    return next(each.result for each in answers if each.get_type() == "COMMAND_ACK")


OFFBOARD = 6 << 16
RADIUS = VEHICLE.gains.navigation.loiter_radius


@pytest.mark.validate
def test_px4_offboard_exchange() -> None:
    """GIVEN MAVSDK's order: setpoint, start, stream at 20 Hz, no more THEN denied, OFFBOARD, circle, LOITER."""
    flight, there = FlightOnLink("generic"), local(POSITION, x=80.0, y=60.0, z=-40.0)
    answers = flight.request(set_mode(OFFBOARD))
    assert result(answers) == mavlink.MAV_RESULT_DENIED and "no recent setpoint" in texts(answers)[0]
    flight.exchange.wire.put(flight.exchange.station.frame(there))
    assert result(flight.request(set_mode(OFFBOARD))) == mavlink.MAV_RESULT_ACCEPTED
    answers = flight.fly(30.0, there)
    shown = [each.custom_mode for each in answers if each.get_type() == "CURRENT_MODE"]
    assert set(shown) == {OFFBOARD}
    assert flight.distance(80.0, 60.0) == pytest.approx(RADIUS, abs=5.0)
    assert flight.bird.altitude - 1.6 == pytest.approx(40.0, abs=3.0)
    answers = flight.fly(1.5)
    assert flight.view.mode is Mode.LOITER
    assert "offboard: setpoints timed out, LOITER" in texts(answers)


def test_ardupilot_guided_exchange() -> None:
    """GIVEN GUIDED in flight WHEN one position is sent THEN it is circled from then on, and altitudes follow."""
    flight = FlightOnLink("ardupilot")
    assert result(flight.request(set_mode(15))) == mavlink.MAV_RESULT_ACCEPTED
    answers = flight.fly(5.0)
    assert {each.custom_mode for each in answers if each.get_type() == "HEARTBEAT"} == {15}
    flight.request(world(POSITION, RELATIVE, *to_degrees(flight.view.home, 80.0, 60.0), 40.0))
    flight.fly(30.0)
    assert flight.view.mode is Mode.OFFBOARD
    assert flight.distance(80.0, 60.0) == pytest.approx(RADIUS, abs=5.0)
    flight.request(local(POSITION, OFFSET, z=-10.0))
    flight.fly(18.0)
    assert flight.distance(80.0, 60.0) == pytest.approx(RADIUS, abs=5.0)
    assert flight.bird.altitude - 1.6 == pytest.approx(50.0, abs=4.0)
    assert flight.view.destination == pytest.approx((80.0, 60.0), abs=0.1)


@pytest.mark.validate
def test_dronekit_simple_goto_exchange() -> None:
    """GIVEN dronekit's simple_goto: SET_MODE, MISSION_ITEM with current 2 WHEN it flies THEN it circles there."""
    flight = FlightOnLink("ardupilot")
    flight.request(mavlink.MAVLink_set_mode_message(1, 1, 15))
    answers = flight.request(waypoint(2, *to_degrees(flight.view.home, 80.0, 60.0), 40.0))
    assert [each.type for each in answers if each.get_type() == "MISSION_ACK"] == [mavlink.MAV_MISSION_ACCEPTED]
    flight.fly(30.0)
    assert flight.distance(80.0, 60.0) == pytest.approx(RADIUS, abs=5.0)
    answers = flight.request(waypoint(2, *to_degrees(flight.view.home, 9000.0, 60.0), 40.0))
    assert [each.type for each in answers if each.get_type() == "MISSION_ACK"] == [mavlink.MAV_MISSION_DENIED]
    assert "outside the fence" in texts(answers)[0]


def test_offboard_on_the_ground_is_denied() -> None:
    view, bird = FlightView(VEHICLE, (MissionItem(22, altitude=30.0),), lambda topic, message: None), Bird()
    for _ in range(600):
        bird.advance(
            view.autopilot.step(bird.frame(), [Command(0, CommandKind.SET_SETPOINT, payload=Setpoint(Path.KEEP))])
        )
    assert view.refusal(Command(0, CommandKind.SET_MODE, "OFFBOARD")) == "mode OFFBOARD denied: not in flight"
