"""A scripted MAVLink vehicle on a link that loses, and a clock that costs no time."""

from __future__ import annotations

import contextlib
import math
import random
import socket
import threading
from collections.abc import Iterator
from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from groundstation.link.exchange import Exchange
from groundstation.link.missions import Item

STEP = 0.05
LEADS_TO = {
    mavlink.MAV_CMD_NAV_TAKEOFF: 4 << 16 | 4 << 24,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: 4 << 16 | 5 << 24,
    mavlink.MAV_CMD_NAV_LAND: 4 << 16 | 6 << 24,
    mavlink.MAV_CMD_DO_REPOSITION: 4 << 16 | 3 << 24,
}
"""custom modes that orders lead to, with our own vehicle"""


class LossyVehicle:
    """Answers as the MAVLink services ask for; every message is lost with probability ``loss``, both ways."""

    def __init__(self, loss: float = 0.0, seed: int = 1) -> None:
        self.loss = loss
        self.random = random.Random(seed)
        self.values = {f"GAIN_{number}": float(number) for number in range(40)}
        self.mission: list[Item] = []
        self.custom_mode = 65536
        self.armed = False
        self.leads_to = dict(LEADS_TO)
        self.results: dict[int, int] = {}
        self.reports: list[str] = []
        self.requests: list[str] = []
        self.limits: dict[str, float] = {}
        self.expected_items = 0
        self.incoming: list[Item] = []

    def lost(self) -> bool:
        return self.random.random() < self.loss

    def answers(self, message: Any) -> list[Any]:
        kind = message.get_type()
        self.requests.append(kind)
        answer = getattr(self, f"_{kind.lower()}", None)
        return [] if answer is None else answer(message)

    def _command_long(self, message: Any) -> list[Any]:
        said = [mavlink.MAVLink_statustext_message(4, text.encode()) for text in self.reports]
        result = self.results.get(message.command, mavlink.MAV_RESULT_ACCEPTED)
        if message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and result == mavlink.MAV_RESULT_ACCEPTED:
            self.armed = bool(message.param1)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            self.custom_mode = self.leads_to.get(message.command, self.custom_mode)
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            result = mavlink.MAV_RESULT_UNSUPPORTED
        if message.command == mavlink.MAV_CMD_DO_SET_MODE and result == mavlink.MAV_RESULT_ACCEPTED:
            self.custom_mode = int(message.param2) << 16 | int(message.param3) << 24
        return [mavlink.MAVLink_command_ack_message(message.command, result), *said]

    def _command_int(self, message: Any) -> list[Any]:
        return self._command_long(message)

    def _value(self, name: str) -> Any:
        index = list(self.values).index(name)
        return mavlink.MAVLink_param_value_message(name.encode(), self.values[name], 9, len(self.values), index)

    def _param_request_list(self, message: Any) -> list[Any]:
        return [self._value(name) for name in self.values]

    def _param_request_read(self, message: Any) -> list[Any]:
        name = message.param_id.decode() if isinstance(message.param_id, bytes) else message.param_id
        if message.param_index >= 0:
            name = list(self.values)[message.param_index]
        if name not in self.values:
            return [mavlink.MAVLink_param_error_message(255, 190, name.encode(), -1, 1)]
        return [self._value(name)]

    def _param_set(self, message: Any) -> list[Any]:
        name = message.param_id.decode() if isinstance(message.param_id, bytes) else message.param_id
        self.values[name] = min(message.param_value, self.limits.get(name, message.param_value))
        return [self._value(name)]

    def _mission_request_list(self, message: Any) -> list[Any]:
        return [mavlink.MAVLink_mission_count_message(255, 190, len(self.mission))]

    def _mission_request_int(self, message: Any) -> list[Any]:
        item = self.mission[message.seq]
        head = (255, 190, message.seq, item.frame, item.command, 0, 1)
        return [mavlink.MAVLink_mission_item_int_message(*head, *item.parameters, item.x, item.y, item.z)]

    def _mission_count(self, message: Any) -> list[Any]:
        self.expected_items, self.incoming = message.count, []
        return [mavlink.MAVLink_mission_request_int_message(255, 190, 0)]

    def _mission_item_int(self, message: Any) -> list[Any]:
        if message.seq == len(self.incoming):
            parameters = (message.param1, message.param2, message.param3, message.param4)
            place = (message.x, message.y, message.z)
            self.incoming.append(Item(message.frame, message.command, parameters, *place))
        return self.repeat_request()

    def repeat_request(self) -> list[Any]:
        """What a vehicle repeats by itself while an upload is under way."""
        if not self.expected_items:
            return []
        if len(self.incoming) == self.expected_items:
            self.mission = self.incoming
            return [mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED)]
        return [mavlink.MAVLink_mission_request_int_message(255, 190, len(self.incoming))]

    def heartbeat(self) -> Any:
        return mavlink.MAVLink_heartbeat_message(16, 0, 1 | 128 * self.armed, self.custom_mode, 4, 3)


class Link:
    """Messages under way: each is lost, doubled and delayed as a bad radio does it."""

    def __init__(self, vehicle: LossyVehicle, doubled: float = 0.0, delay: float = 0.0) -> None:
        self._vehicle, self._doubled, self._delay = vehicle, doubled, delay
        self._under_way: list[tuple[float, Any]] = []

    def send(self, now: float, messages: list[Any]) -> None:
        for message in messages:
            copies = 1 + (self._vehicle.random.random() < self._doubled)
            arrivals = [(now + self._delay, message) for _ in range(copies) if not self._vehicle.lost()]
            self._under_way += arrivals

    def arrived(self, now: float) -> list[Any]:
        here = [message for at, message in self._under_way if at <= now]
        self._under_way = [entry for entry in self._under_way if entry[0] > now]
        return here


def converse(
    exchange: Any, vehicle: LossyVehicle, limit: float = 60.0, doubled: float = 0.0, delay: float = 0.0
) -> Any:
    """Play ``exchange`` against ``vehicle`` until it ends, on a clock of our own; fails after ``limit`` s of it."""
    now = 0.0
    down, up = Link(vehicle, doubled, delay), Link(vehicle, doubled, delay)
    running: Exchange = exchange
    while not running.finished:
        now += STEP
        if round(now / STEP) % 20 == 0:
            down.send(now - STEP, [vehicle.heartbeat(), *vehicle.repeat_request()])
        for message in [*down.arrived(now), None]:
            running, sent = running.step(now, message)
            up.send(now, list(sent))
        for message in up.arrived(now):
            down.send(now, vehicle.answers(message))
        assert now < limit, f"still running after {limit} s: {running.progress()}"
    return running


@contextlib.contextmanager
def on_the_air(vehicle: LossyVehicle) -> Iterator[str]:
    """The vehicle on a UDP port of the loopback interface; yields the address for a ground station."""
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    port.bind(("127.0.0.1", 0))
    port.settimeout(0.02)
    over = threading.Event()
    thread = threading.Thread(target=_serve, args=(vehicle, port, over))
    thread.start()
    try:
        yield f"udpout:127.0.0.1:{port.getsockname()[1]}"
    finally:
        over.set()
        thread.join()
        port.close()


def _serve(vehicle: LossyVehicle, port: socket.socket, over: threading.Event) -> None:
    packer = mavlink.MAVLink(None, 1, 1)
    reader = FrameReader()
    while not over.is_set():
        with contextlib.suppress(TimeoutError):
            data, station = port.recvfrom(65536)
            answers = [answer for frame in reader.feed(data) for answer in vehicle.answers(decode(frame))]
            for message in (vehicle.heartbeat(), *answers):
                port.sendto(message.pack(packer), station)
                packer.seq = (packer.seq + 1) % 256


class VibratingVehicle(LossyVehicle):
    """Sends HIGHRES_IMU at 100 Hz by its clock while asked: 4 Hz of 2 m/s^2 on z, 25 Hz of 0.5 m/s^2 on x."""

    def __init__(self) -> None:
        super().__init__()
        self.intervals: list[float] = []
        self.sent = 0

    def answers(self, message: Any) -> list[Any]:
        command = getattr(message, "command", None)
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and message.param1 == mavlink.MAVLINK_MSG_ID_HIGHRES_IMU:
            self.intervals.append(message.param2)
        samples = 100 if self.intervals and self.intervals[-1] > 0 else 0
        return [*super().answers(message), *(self._sample() for _ in range(samples))]

    def _sample(self) -> Any:
        self.sent += 1
        time = 0.01 * self.sent
        accel = (0.5 * math.sin(math.tau * 25.0 * time), 0.0, 2.0 * math.sin(math.tau * 4.0 * time) - 9.8)
        return mavlink.MAVLink_highres_imu_message(10_000 * self.sent, *accel, *[0.0] * 10, 0x1FF)
