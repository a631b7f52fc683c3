"""The calls of MAVROS' plug-ins for ArduPilot and PX4, from connection to landing, with pymavlink's own dialect."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from link_wires import Wire
from pymavlink.dialects.v20 import ardupilotmega as stock
from surrogate import Bird
from surrogate_gains import VEHICLE

from avionics import topics
from avionics.link.ground import Files, GroundLink
from avionics.link.vehicle import PROFILES, Identity
from avionics.messages import Mode, PilotSource, Stage
from avionics.missions import load_mission
from avionics.view import FlightView

SYSTEM, COMPONENT = 1, stock.MAV_COMP_ID_UDP_BRIDGE
"""of MAVROS, which takes the number of its vehicle by default"""
TICK = 0.005
"""s"""
LIMIT = 2.0
"""s; for an answer"""
LOG = random.Random(5).randbytes(700)
POSITION, VELOCITY, ACCELERATION = 0b1101_1111_1000, 0b1101_1100_0111, 0b1100_0011_1111
FAILING = {
    "home_position/set": "home is where the GPS had its first fix",
    "setpoint_accel/accel": "an acceleration is no setpoint of the loops",
    "trajectory/desired": "paths come as missions",
    "obstacle/send": "the vehicle avoids no obstacles",
    "mount_control/command": "the vehicle carries no mount",
    "ftp/write": "files of the vehicle are only read",
}
"""calls that the vehicle does not serve, with the reason"""


class Mavros:
    """A station on a link to the flight computer with the stand-in vehicle; time is the test's."""

    def __init__(self, identity: str, logs: Path) -> None:
        self.identity: Identity = PROFILES[identity]
        self.view, self.bird = FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None), Bird()
        self.wire, self.now = Wire("udpin:127.0.0.1:1"), 10.0
        self.link = GroundLink([self.wire], self.view, self.identity, files=Files(None, None, logs))
        self.writer, self.reader = stock.MAVLink(None, SYSTEM, COMPONENT), stock.MAVLink(None)
        self.reader.robust_parsing = True
        self.received: list[Any] = []

    def fly(self, seconds: float, *stream: Any) -> list[Any]:
        """Messages of the vehicle while ``stream`` is sent at 20 Hz."""
        received: list[Any] = []
        for tick in range(round(seconds / TICK)):
            if tick % 10 == 0:
                self.send(*stream)
            self.now += TICK
            self.bird.advance(self.view.autopilot.step(self.bird.frame(), self.link.poll(self.now)))
            self.link.stream(self.now)
            data = b"".join(each.data for each in self.wire.take())
            received += self.reader.parse_buffer(data) or []
        return received

    def send(self, *messages: Any) -> None:
        for message in messages:
            self.wire.put(message.pack(self.writer))
            self.writer.seq = (self.writer.seq + 1) % 256

    def wait(self, kind: str, *messages: Any, where: Callable[[Any], bool] = lambda message: True) -> Any:
        """The first message of ``kind`` after ``messages``; None if none comes."""
        self.send(*messages)
        for _ in range(round(LIMIT / 0.02)):
            for message in self.fly(0.02):
                if message.get_type() == kind and where(message):
                    return message
        return None

    def command(self, number: int, *params: float) -> bool:
        """Whether a COMMAND_LONG is accepted."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        return self._accepted(number, stock.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def command_int(self, number: int, frame: int, *params: float) -> bool:
        """Whether a COMMAND_INT is accepted; x and y in degrees."""
        place = (round(params[4] * 1e7), round(params[5] * 1e7), params[6])
        message = stock.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *params[:4], *place)
        return self._accepted(number, message)

    def _accepted(self, number: int, message: Any) -> bool:
        ack = self.wait("COMMAND_ACK", message, where=lambda each: each.command == number)
        return ack is not None and ack.result == stock.MAV_RESULT_ACCEPTED

    def requested(self, kind: str) -> bool:
        """Whether a message comes on REQUEST_MESSAGE."""
        number = getattr(stock, f"MAVLINK_MSG_ID_{kind}")
        params = (float(number), *(0.0,) * 6)
        return self.wait(kind, stock.MAVLink_command_long_message(1, 1, 512, 0, *params)) is not None

    def set_mode(self, mode: Mode) -> bool:
        """SET_MODE with a custom mode, then the heartbeat."""
        number = self.identity.numbers(mode).custom_mode
        beat = self.wait(
            "HEARTBEAT", stock.MAVLink_set_mode_message(1, 1, number), where=lambda each: each.custom_mode == number
        )
        return beat is not None

    def push(self, items: Sequence[tuple[Any, ...]], kind: int) -> bool:
        """Upload of a mission, fence or rally points: each item as frame, command, four parameters, x, y, z."""
        message: Any = stock.MAVLink_mission_count_message(1, 1, len(items), kind)
        for number, (frame, command, *params, x, y, z) in enumerate(items):
            request = self.wait("MISSION_REQUEST_INT", message)
            if request is None or request.seq != number:
                return False
            place = (round(x * 1e7), round(y * 1e7), z)
            message = stock.MAVLink_mission_item_int_message(
                1, 1, number, frame, command, int(number == 0), 1, *params, *place, kind
            )
        ack = self.wait("MISSION_ACK", message)
        return ack is not None and ack.type == stock.MAV_MISSION_ACCEPTED

    def pull(self, count: int, kind: int) -> bool:
        """Download of ``count`` items."""
        announced = self.wait("MISSION_COUNT", stock.MAVLink_mission_request_list_message(1, 1, kind))
        if announced is None or announced.count != count:
            return False
        requests = (stock.MAVLink_mission_request_int_message(1, 1, number, kind) for number in range(count))
        items = [self.wait("MISSION_ITEM_INT", request) for request in requests]
        self.send(stock.MAVLink_mission_ack_message(1, 1, stock.MAV_MISSION_ACCEPTED, kind))
        return [None if item is None else item.seq for item in items] == list(range(count))

    def clear(self, kind: int) -> bool:
        ack = self.wait("MISSION_ACK", stock.MAVLink_mission_clear_all_message(1, 1, kind))
        return ack is not None and ack.type == stock.MAV_MISSION_ACCEPTED and self.pull(0, kind)

    def ftp(
        self, opcode: int, data: bytes, session: int = 0, offset: int = 0, size: int | None = None
    ) -> bytes | None:
        """Data of the acknowledgement; None for a denial or silence."""
        self.writer.ftp = getattr(self.writer, "ftp", 0) + 1
        head = struct.pack("<HBBBBBBI", self.writer.ftp, 0, opcode, size or len(data), 0, 0, 0, 0)
        payload = list((head + data).ljust(251, b"\0"))
        answer = self.wait("FILE_TRANSFER_PROTOCOL", stock.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        if answer is None or answer.payload[3] != 128:
            return None
        return bytes(answer.payload[12 : 12 + answer.payload[4]])


Call = Callable[[Mavros], bool]
MISSION, FENCE, RALLY = stock.MAV_MISSION_TYPE_MISSION, stock.MAV_MISSION_TYPE_FENCE, stock.MAV_MISSION_TYPE_RALLY
ABOVE_HOME = stock.MAV_FRAME_GLOBAL_RELATIVE_ALT


def place(mavros: Mavros, north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude (deg) of a position in m from home."""
    home = mavros.view.home
    assert home is not None
    east_scale = 6.378e6 * math.cos(home.latitude)
    return math.degrees(home.latitude + north / 6.378e6), math.degrees(home.longitude + east / east_scale)


def mission(mavros: Mavros) -> list[tuple[Any, ...]]:
    home = (stock.MAV_FRAME_GLOBAL, 16, 0, 0, 0, 0, *place(mavros, 0, 0), 300.0)
    flown = [
        (ABOVE_HOME, 22, 0, 0, 0, math.nan, *place(mavros, 0, 0), 20.0),
        (ABOVE_HOME, 16, 0, 0, 0, math.nan, *place(mavros, 90, 0), 25.0),
        (ABOVE_HOME, 17, 0, 0, 0, math.nan, *place(mavros, 90, 60), 25.0),
    ]
    return [home] * mavros.identity.first_item + flown


def fence(mavros: Mavros) -> list[tuple[Any, ...]]:
    corners = ((-400, -400), (-400, 400), (400, 400), (400, -400))
    return [(ABOVE_HOME, 5001, 4, 0, 0, 0, *place(mavros, *corner), 0.0) for corner in corners]


def rally(mavros: Mavros) -> list[tuple[Any, ...]]:
    return [(ABOVE_HOME, 5100, 0, 0, 0, 0, *place(mavros, 30, 0), 30.0)]


def has(kind: str, **fields: Any) -> Call:
    """Streamed within `LIMIT`, with these values."""
    check = lambda message: all(getattr(message, name) == value for name, value in fields.items())  # noqa: E731
    return lambda mavros: mavros.wait(kind, where=check) is not None


def heartbeat(mavros: Mavros) -> bool:
    """1 Hz, while MAVROS sends its own."""
    onboard = stock.MAVLink_heartbeat_message(stock.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3)
    beats = [each for _ in range(5) for each in mavros.fly(1.0, onboard) if each.get_type() == "HEARTBEAT"]
    return 5 <= len(beats) <= 6 and {each.autopilot for each in beats} == {mavros.identity.autopilot}


def timesync(mavros: Mavros) -> bool:
    answer = mavros.wait("TIMESYNC", stock.MAVLink_timesync_message(0, 123_456_789))
    return answer is not None and answer.ts1 == 123_456_789 and answer.tc1 > 0


def stream_rate(mavros: Mavros) -> bool:
    mavros.send(stock.MAVLink_request_data_stream_message(1, 1, stock.MAV_DATA_STREAM_EXTRA1, 25, 1))
    mavros.fly(0.2)
    return 20 <= sum(each.get_type() == "ATTITUDE" for each in mavros.fly(1.0)) <= 30


def message_interval(mavros: Mavros) -> bool:
    accepted = mavros.command(511, stock.MAVLINK_MSG_ID_HIGHRES_IMU, 20_000)
    mavros.fly(0.2)
    return accepted and 40 <= sum(each.get_type() == "HIGHRES_IMU" for each in mavros.fly(1.0)) <= 60


def param_pull(mavros: Mavros) -> bool:
    mavros.send(stock.MAVLink_param_request_list_message(1, 1))
    values = {each.param_index: each for each in mavros.fly(4.0) if each.get_type() == "PARAM_VALUE"}
    return len(values) == len(mavros.view.parameters) == next(iter(values.values())).param_count


def param_get(mavros: Mavros) -> bool:
    value = mavros.wait("PARAM_VALUE", stock.MAVLink_param_request_read_message(1, 1, b"PITCH_P", -1))
    return value is not None and value.param_id == "PITCH_P"


def param_set(mavros: Mavros) -> bool:
    float_type = stock.MAV_PARAM_TYPE_REAL32
    value = mavros.wait("PARAM_VALUE", stock.MAVLink_param_set_message(1, 1, b"NAV_LOITER_TIME", 40.0, float_type))
    return value is not None and value.param_value == 40.0


def logs(mavros: Mavros) -> bool:
    entry = mavros.wait("LOG_ENTRY", stock.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    if entry is None or entry.size != len(LOG):
        return False
    mavros.send(stock.MAVLink_log_request_data_message(1, 1, entry.id, 0, 0xFFFFFFFF))
    parts = {each.ofs: bytes(each.data[: each.count]) for each in mavros.fly(1.0) if each.get_type() == "LOG_DATA"}
    return b"".join(parts[offset] for offset in sorted(parts)) == LOG


def ftp_list(mavros: Mavros) -> bool:
    return b"flight.mcap" in (mavros.ftp(3, b"/logs") or b"")


def ftp_read(mavros: Mavros) -> bool:
    opened = mavros.ftp(4, b"/logs/flight.mcap")
    if opened is None or struct.unpack("<I", opened) != (len(LOG),):
        return False
    same = mavros.ftp(5, b"", size=200) == LOG[:200]
    return same and len(mavros.ftp(14, b"/logs/flight.mcap") or b"") == 4


def mode_change(mode: Mode) -> Call:
    return lambda mavros: mavros.set_mode(mode) and mavros.view.mode is mode


def setpoint(message: Callable[[Mavros], Any], reached: Callable[[Mavros], bool]) -> Call:
    """A stream of setpoints flown in OFFBOARD or GUIDED for 25 s."""

    def call(mavros: Mavros) -> bool:
        stream = message(mavros)
        mavros.fly(0.3, stream)
        entered = mavros.set_mode(Mode.OFFBOARD)
        mavros.fly(25.0, stream)
        return entered and mavros.view.mode is Mode.OFFBOARD and reached(mavros)

    return call


def local(mask: int, *values: float) -> Any:
    frame = stock.MAV_FRAME_LOCAL_NED
    return stock.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values, 0.0, 0.0)


def world(mavros: Mavros) -> Any:
    x, y = (round(angle * 1e7) for angle in place(mavros, 60.0, -20.0))
    frame = stock.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return stock.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, POSITION, x, y, 30.0, *(0.0,) * 8)


def circles(north: float, east: float) -> Callable[[Mavros], bool]:
    radius = VEHICLE.gains.navigation.loiter_radius
    return lambda mavros: abs(math.hypot(mavros.bird.north - north, mavros.bird.east - east) - radius) < 12.0


def attitude(mavros: Mavros) -> Any:
    half = 0.5 * math.radians(15.0)
    quaternion = [math.cos(half), math.sin(half), 0.0, 0.0]
    return stock.MAVLink_set_attitude_target_message(0, 1, 1, 7, quaternion, 0.0, 0.0, 0.0, 0.5)


def acceleration(mavros: Mavros) -> bool:
    """Whether a setpoint of an acceleration is taken."""
    text = mavros.wait("STATUSTEXT", local(ACCELERATION, 0, 0, 0, 0, 0, 0, 1.0, 0.0, 0.0))
    return text is None


def sticks(mavros: Mavros) -> bool:
    mavros.fly(0.5, stock.MAVLink_manual_control_message(1, 300, -200, 500, 0, 0))
    pilot = mavros.view.latest(topics.PILOT)
    return pilot.source is PilotSource.MANUAL_CONTROL and pilot.pitch == pytest.approx(-0.3, abs=0.05)


def override(mavros: Mavros) -> bool:
    channels = stock.MAVLink_rc_channels_override_message(1, 1, 1700, 1500, 1600, 1500, 0, 0, 0, 0)
    mavros.fly(0.5, channels)
    used = mavros.view.latest(topics.PILOT).source is PilotSource.OVERRIDE
    mavros.send(stock.MAVLink_rc_channels_override_message(1, 1, *(0,) * 8))
    mavros.fly(0.2)
    return used


def trajectory(mavros: Mavros) -> bool:
    """Whether a path of a planner is flown."""
    five = [0.0] * 5
    path = stock.MAVLink_trajectory_representation_waypoints_message(0, 1, *(five,) * 11, [16] * 5)
    return mavros.wait("TRAJECTORY_REPRESENTATION_WAYPOINTS", path) is not None


def obstacles(mavros: Mavros) -> bool:
    """Whether the vehicle reports what it avoids."""
    distances = stock.MAVLink_obstacle_distance_message(0, 0, [500] * 72, 5, 20, 1000)
    return mavros.wait("OBSTACLE_DISTANCE", distances) is not None


def throw(mavros: Mavros) -> bool:
    """In the air after a takeoff command."""
    waits = mavros.command(22, 0, 0, 0, math.nan, math.nan, math.nan, math.nan)
    mavros.bird.throw()
    mavros.fly(20.0)
    return waits and mavros.view.latest(topics.NAVIGATION).stage == Stage.EN_ROUTE


def reached(mavros: Mavros) -> bool:
    chosen = mavros.identity.first_item + 1
    set_current = stock.MAVLink_mission_set_current_message(1, 1, chosen)
    if mavros.wait("MISSION_CURRENT", set_current, where=lambda each: each.seq == chosen) is None:
        return False
    return any(each.get_type() == "MISSION_ITEM_REACHED" and each.seq == chosen for each in mavros.fly(40.0))


def reposition(mavros: Mavros) -> bool:
    where = place(mavros, 60.0, 0.0)
    return mavros.command_int(192, ABOVE_HOME, -1, 1, 0, math.nan, *where, 30.0) and mavros.view.mode is Mode.LOITER


CALLS: dict[str, Call] = {
    "sys_status/heartbeat": heartbeat,
    "sys_status/version": lambda mavros: mavros.command(520, 1) and mavros.requested("AUTOPILOT_VERSION"),
    "sys_status/status": has("SYS_STATUS"),
    "sys_status/battery and state": lambda mavros: (
        has("BATTERY_STATUS")(mavros) and has("EXTENDED_SYS_STATE")(mavros)
    ),
    "sys_status/stream rate": stream_rate,
    "sys_status/message interval": message_interval,
    "sys_time/timesync": timesync,
    "sys_time/reference": lambda mavros: mavros.requested("SYSTEM_TIME"),
    "param/pull": param_pull,
    "param/get": param_get,
    "param/set": param_set,
    "gps_status/raw": has("GPS_RAW_INT", fix_type=3),
    "global_position/global": lambda mavros: (
        has("GLOBAL_POSITION_INT")(mavros) and mavros.requested("GPS_GLOBAL_ORIGIN")
    ),
    "home_position/get": lambda mavros: mavros.command(410) and has("HOME_POSITION")(mavros),
    "home_position/set": lambda mavros: mavros.command(179, 1),
    "mission/push": lambda mavros: mavros.push(mission(mavros), MISSION),
    "mission/pull": lambda mavros: mavros.pull(len(mission(mavros)), MISSION),
    "geofence/push": lambda mavros: mavros.push(fence(mavros), FENCE),
    "geofence/pull": lambda mavros: mavros.pull(4, FENCE),
    "geofence/clear": lambda mavros: mavros.clear(FENCE),
    "rallypoint/push": lambda mavros: mavros.push(
        [(ABOVE_HOME, 5100, 0, 0, 0, 0, *place(mavros, 30, 0), 30.0)], RALLY
    ),
    "rallypoint/pull": lambda mavros: mavros.pull(1, RALLY),
    "rallypoint/clear": lambda mavros: mavros.clear(RALLY),
    "ftp/list": ftp_list,
    "ftp/read": ftp_read,
    "ftp/write": lambda mavros: mavros.ftp(6, b"/logs/new.txt") is not None,
    "log_transfer/list and data": logs,
    "mount_control/command": lambda mavros: mavros.command(205, -30),
    "command/arming": lambda mavros: mavros.command(400, 1) and has("HEARTBEAT")(mavros) and mavros.view.armed,
    "command/takeoff": throw,
    "imu/attitude": lambda mavros: has("ATTITUDE")(mavros) and mavros.requested("ATTITUDE_QUATERNION"),
    "imu/pressure": has("SCALED_PRESSURE"),
    "local_position/pose": has("LOCAL_POSITION_NED"),
    "vfr_hud/hud": has("VFR_HUD"),
    "altitude/altitude": lambda mavros: mavros.requested("ALTITUDE"),
    "wind_estimation/wind": has("WIND_COV"),
    "rc_io/out": has("SERVO_OUTPUT_RAW"),
    "mission/set current and reached": reached,
    "command/long and int": reposition,
    "manual_control/send": sticks,
    "rc_io/override": override,
    "setpoint_position/local": setpoint(
        lambda mavros: local(POSITION, 80.0, 60.0, -30.0, 0, 0, 0, 0, 0, 0), circles(80.0, 60.0)
    ),
    "setpoint_raw/global": setpoint(world, circles(60.0, -20.0)),
    "setpoint_velocity/velocity": setpoint(
        lambda mavros: local(VELOCITY, 0, 0, 0, 0.0, 7.0, 0.0, 0, 0, 0),
        lambda mavros: abs(math.atan2(*reversed(mavros.bird.velocity()[:2])) - 0.5 * math.pi) < 0.2,
    ),
    "setpoint_attitude/attitude": setpoint(
        attitude, lambda mavros: mavros.bird.roll == pytest.approx(math.radians(15.0), abs=0.08)
    ),
    "setpoint_accel/accel": acceleration,
    "trajectory/desired": trajectory,
    "obstacle/send": obstacles,
    "set_mode/AUTO and RTL": lambda mavros: mode_change(Mode.AUTO)(mavros) and mode_change(Mode.RETURN)(mavros),
    "command/land": lambda mavros: mavros.command(21) and mavros.view.mode is Mode.LAND,
    "mission/clear": lambda mavros: mavros.clear(MISSION),
}
"""by plug-in and topic or service, in the order of a flight"""


@pytest.mark.validate
@pytest.mark.parametrize("identity", ["ardupilot", "px4"])
def test_mavros_calls(identity: str, tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").write_bytes(LOG)
    mavros = Mavros(identity, tmp_path)
    mavros.fly(3.0)
    results = {name: call(mavros) for name, call in CALLS.items()}
    failed = {name for name, passed in results.items() if not passed}
    assert failed == set(FAILING)
    assert (len(CALLS), len(CALLS) - len(failed)) == (51, 45)
