"""Scripted PX4 and ArduPlane that fly a simple attitude and altitude loop, and what they fly on."""

from __future__ import annotations

import json
import math
import socket
import struct
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common

from avionics.messages import ActuatorCommand, ImuSample, SensorFrame
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.bridge.foreign.flight import Rig
from sim_bridge.bridge.foreign.outputs import Outputs
from sim_bridge.bridge.foreign.world import Stage
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.messages import TruthState, TruthWing
from sim_bridge.observation import Observation
from sim_bridge.vehicles import load_vehicle
from wingbeat.topic import Topic

RAVEN = "robo_raven_ii_d"
RIG = Rig(load_flight_vehicle(RAVEN))
IN_THE_HAND = Scenario(duration=60.0, launch_time=math.inf, rest_time=1.0)
METRES_PER_DEGREE = math.radians(1.0) * 6_378_137.0


class Log:
    """Everything that was published, by topic."""

    def __init__(self) -> None:
        self.messages: dict[str, list[Any]] = {}

    def publish(self, topic: Topic, message: Any) -> None:
        self.messages.setdefault(topic.name, []).append(message)


class Stages:
    """Hands out flights of the real world, and keeps what they recorded."""

    def __init__(self, scenario: Scenario = IN_THE_HAND, rate: float = 200.0) -> None:
        self.scenario, self.rate = scenario, rate
        self.worlds: list[SimulatedWorld] = []
        self.logs: list[Log] = []

    def __call__(self) -> Stage:
        log = Log()
        world = SimulatedWorld(load_vehicle(RAVEN), self.scenario, log.publish, self.rate)
        self.worlds.append(world)
        self.logs.append(log)
        return Stage(world, log.publish)


class ToyWorld:
    """A clock with a bird of marble: what was asked of it is all that it remembers."""

    origin = (math.radians(48.1), math.radians(11.6), 520.0)

    def __init__(self, duration: float, frame: Callable[[int], SensorFrame] | None = None) -> None:
        self.duration, self.time_us, self.launched = duration, 0, False
        self.requested: list[tuple[ActuatorCommand, float]] = []
        self._frame = frame

    @property
    def finished(self) -> bool:
        return self.time_us * 1e-6 >= self.duration - 1e-9

    def release(self) -> None:
        self.launched = True

    def advance(self, command: ActuatorCommand, duration: float) -> Observation:
        self.requested.append((command, duration))
        self.time_us = round(sum(length for _, length in self.requested) * 1e6)
        still = (0.0, 0.0, 0.0)
        return Observation(
            self.time_us, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, -9.81), (1.0, 2.0, -3.0), still,
            (7.0, 0.0, 1.0), 95_000.0, 288.0, 1.2, *([0.0] * 9),
        )  # fmt: skip

    def record(self) -> None:
        """Nobody asks what is true here."""

    def sample(self, observation: Observation) -> SensorFrame:
        if self._frame is None:
            return SensorFrame(self.time_us, ImuSample(self.time_us, *([0.0] * 9)))
        return self._frame(self.time_us)

    def truth(self) -> TruthState:
        values: dict[str, Any] = dict.fromkeys(TruthState._fields, 0.0)
        return TruthState(
            **{**values, "time_us": self.time_us, "quaternion_w": 1.0, "wind_north": -3.0, "on_ground": 1}
        )

    def truth_wing(self) -> TruthWing:
        values: dict[str, Any] = dict.fromkeys(TruthWing._fields, 0.0)
        return TruthWing(**{**values, "time_us": self.time_us, "voltage": 8.1, "current": 2.5})


class Observed(NamedTuple):
    """What a scripted autopilot knows of the vehicle."""

    time: float
    roll: float
    pitch: float
    roll_rate: float
    pitch_rate: float
    altitude: float
    climb_rate: float


def euler(w: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Rad; roll and pitch."""
    sine = min(max(2.0 * (w * y - z * x), -1.0), 1.0)
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)), math.asin(sine)


class PlanePilot:
    """Level wings, an altitude and a climb rate: proportional loops, as any plane's autopilot begins with."""

    def __init__(self, altitude: float, arm_at: float = 0.3) -> None:
        self.altitude, self.arm_at = altitude, arm_at

    def fly(self, observed: Observed) -> Outputs:
        if observed.time < self.arm_at:
            return Outputs()
        climb = min(max(0.8 * (self.altitude - observed.altitude), -1.5), 1.5)
        pitch = 0.1 + 0.12 * climb
        elevator = (1.67 * (pitch - observed.pitch) - 0.1 * observed.pitch_rate) / 0.6
        aileron = -1.2 * observed.roll - 0.2 * observed.roll_rate
        throttle = 0.35 + 0.2 * climb + 0.3 * (climb - observed.climb_rate)
        clipped = (min(max(value, low), 1.0) for value, low in ((aileron, -1.0), (elevator, -1.0), (throttle, 0.3)))
        return Outputs(*clipped, 0.0, 1)


class ToyStages:
    """Hands out toy worlds, and keeps them."""

    def __init__(self, duration: float, frame: Callable[[int], SensorFrame] | None = None) -> None:
        self._make = lambda: ToyWorld(duration, frame)
        self.worlds: list[ToyWorld] = []
        self.log = Log()

    def __call__(self) -> Stage:
        self.worlds.append(self._make())
        return Stage(self.worlds[-1], self.log.publish)


class Serving:
    """A server in a thread; `result` gives its tally or raises its error."""

    def __init__(self, server: Any, stages: Callable[[], Stage]) -> None:
        self.server = server
        self._outcome: list[Any] = []
        self._thread = threading.Thread(target=self._run, args=(stages,), daemon=True)
        self._thread.start()

    def _run(self, stages: Callable[[], Stage]) -> None:
        try:
            self._outcome.append(self.server.serve(stages))
        except BaseException as error:
            self._outcome.append(error)

    def result(self) -> Any:
        self._thread.join(60.0)
        assert self._outcome, "the server did not end"
        self.server.close()
        if isinstance(self._outcome[0], BaseException):
            raise self._outcome[0]
        return self._outcome[0]


class ScriptedPx4:
    """PX4's end of its simulator interface, spoken with the stock MAVLink dialect."""

    AETR = (0, 1, 2, 3)

    def __init__(self, port: int, clock_at_boot: bool = True) -> None:
        """``clock_at_boot``: its time begins with its first sensor frame, as newer versions' does."""
        self.stream = socket.create_connection(("127.0.0.1", port))
        self.stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.stream.settimeout(10.0)
        self.mav = common.MAVLink(None, 1, 1)
        self.mav.robust_parsing = True
        self.received: list[Any] = []
        self._clock_at_boot = clock_at_boot
        self._boot_us: int | None = None

    def greet(self, autopilot: int = common.MAV_AUTOPILOT_PX4) -> None:
        self.send_text(common.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000.0, 0, 0, 0, 0, 0))
        self.send_text(common.MAVLink_heartbeat_message(0, autopilot, 0, 0, 0, 3))

    def send_text(self, message: Any) -> None:
        self.stream.sendall(message.pack(self.mav))

    def receive(self) -> list[Any]:
        """Messages that have come; empty when the world hung up."""
        data = self.stream.recv(65536)
        fresh = list(self.mav.parse_buffer(data) or []) if data else []
        self.received += fresh
        return fresh

    def answer(self, time_us: int, outputs: Outputs, flags: int = 1) -> None:
        """HIL_ACTUATOR_CONTROLS in the order aileron, elevator, throttle, rudder; zeros while disarmed."""
        if self._boot_us is None:
            self._boot_us = time_us if self._clock_at_boot else 0
        controls = [0.0] * 16
        if outputs.armed:
            controls[:4] = [outputs.aileron, outputs.elevator, outputs.throttle, outputs.rudder]
        mode = 1 | (128 if outputs.armed else 0)
        self.send_text(common.MAVLink_hil_actuator_controls_message(time_us - self._boot_us, controls, mode, flags))

    def fly(self, pilot: PlanePilot, until: float) -> list[Observed]:
        """Fly until that simulated time, or until the world hangs up."""
        flown: list[Observed] = []
        truth: Any = None
        while fresh := self.receive():
            for message in fresh:
                kind = message.get_type()
                if kind == "HIL_STATE_QUATERNION":
                    truth = message
                elif kind == "HIL_SENSOR" and truth is not None:
                    flown.append(self._observed(message, truth))
                    self.answer(message.time_usec, pilot.fly(flown[-1]))
            if flown and flown[-1].time >= until:
                break
        return flown

    @staticmethod
    def _observed(sensors: Any, truth: Any) -> Observed:
        roll, pitch = euler(*truth.attitude_quaternion)
        rates = (sensors.xgyro, sensors.ygyro)
        return Observed(sensors.time_usec * 1e-6, roll, pitch, *rates, truth.alt * 1e-3 - 20.0, -truth.vz * 1e-2)


class ScriptedArduPlane:
    """ArduPlane's end of its JSON interface; its reader takes names and numbers as ArduPilot's does."""

    def __init__(self, port: int, frame_rate: int = 400, channels: int = 16) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(10.0)
        self.frame_rate, self.channels, self.frame_count = frame_rate, channels, 0

    def packet(self, widths: Sequence[int], frame_count: int | None = None) -> bytes:
        filled = [*widths, *([1500] * (self.channels - len(widths)))]
        count = self.frame_count if frame_count is None else frame_count
        magic = 18458 if self.channels == 16 else 29569
        return struct.pack(f"<HHI{self.channels}H", magic, self.frame_rate, count, *filled)

    def exchange(self, widths: Sequence[int]) -> dict[str, Any]:
        """One step: a packet out, the state back."""
        self.socket.send(self.packet(widths))
        self.frame_count += 1
        return read_state(self.socket.recv(65536))

    def fly(self, pilot: PlanePilot, until: float) -> list[Observed]:
        flown: list[Observed] = []
        outputs = Outputs()
        while not flown or flown[-1].time < until:
            state = self.exchange(pulses(outputs))
            roll, pitch = euler(*state["quaternion"])
            gyro, velocity = state["imu"]["gyro"], state["velocity"]
            flown.append(
                Observed(state["timestamp"], roll, pitch, gyro[0], gyro[1], -state["position"][2], -velocity[2])
            )
            outputs = pilot.fly(flown[-1])
        return flown

    def close(self) -> None:
        self.socket.close()


def pulses(outputs: Outputs) -> tuple[int, int, int, int]:
    """Us; aileron, elevator, throttle, rudder between 1100 and 1900."""
    return (
        round(1500 + 400 * outputs.aileron),
        round(1500 + 400 * outputs.elevator),
        round(1100 + 800 * outputs.throttle),
        round(1500 + 400 * outputs.rudder),
    )


VECTORS = ("gyro", "accel_body", "position", "velocity", "quaternion", "velocity_wind")


def read_state(data: bytes) -> dict[str, Any]:
    """A line of JSON, after reading it as ArduPilot does: the first place of a name, its number right behind."""
    assert data[:1] == b"\n" and data[-1:] == b"\n" and data.count(b"\n") == 2
    text = data.decode()
    state: dict[str, Any] = json.loads(text)
    for name in VECTORS:
        if f'"{name}"' in text:
            start = text.index(name) + len(name) + 2
            wanted = state["imu"].get(name, state.get(name))
            assert text[start] == "[" and json.loads(text[start : text.index("]", start) + 1]) == wanted
    return state
