"""Both ends of the bridge: lockstep, stalls, noise, and a partner that is not ours."""

from __future__ import annotations

import math
import os
import random
import socket
import sys
import threading
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from pymavlink.dialects.v20 import common

from avionics.board import cores
from avionics.board.board import BoardSilent
from avionics.board.cores import idle_pair, pin_to_core, run_before_others
from avionics.board.hil import HilBoard
from avionics.board.hil import Timeouts as BoardTimeouts
from avionics.link import codec, sensor_codec
from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.transport import open_stream
from avionics.messages import (
    BURST_LENGTH,
    ActuatorCommand,
    AdcBurst,
    EncoderSample,
    GpsFix,
    ImuSample,
    PressureSample,
    SensorFrame,
    TorqueSample,
)
from sim_bridge.bridge.pace import Pacer
from sim_bridge.bridge.server import BridgeServer, BridgeStatistics, FlightComputerSilent, Timeouts
from sim_bridge.bridge.truth import encode_truth
from sim_bridge.bridge.world import NEUTRAL, World
from sim_bridge.messages import TruthState
from wingbeat.errors import InputError

SHORT = Timeouts(connect=5.0, hello=5.0, reply=0.4, noise=0.05)


class ToyWorld:
    """A mass on a spring that the elevator pushes: its sensors depend on every command it was given."""

    tick_us = 5000
    origin = (math.radians(48.1), math.radians(11.6), 520.0)

    def __init__(self, ticks: int) -> None:
        self.ticks = ticks
        self.frames: list[SensorFrame] = []
        self.commands: list[ActuatorCommand] = []
        self.x, self.v = 0.1, 0.0

    @property
    def finished(self) -> bool:
        return len(self.frames) >= self.ticks

    def record(self) -> None:
        """Nobody asks what is true here."""

    def step(self, command: ActuatorCommand) -> SensorFrame:
        self.commands.append(command)
        self.v += 0.005 * (command.elevator - 30.0 * self.x)
        self.x += 0.005 * self.v
        tick = len(self.frames) + 1
        time_us = tick * self.tick_us
        burst = tuple((tick * 7 + index) % 4096 for index in range(BURST_LENGTH))
        frame = SensorFrame(
            time_us,
            ImuSample(time_us, self.v, 0.1, -9.81, self.x, 0.0, 0.0, 0.2, 0.0, 0.4),
            EncoderSample(time_us, tick, -tick),
            PressureSample(time_us, 1, 2, 3) if tick % 4 == 0 else None,
            AdcBurst(time_us, burst, burst) if tick % 2 == 0 else None,
            TorqueSample(time_us, 5, -5) if tick % 2 == 0 else None,
            GpsFix(time_us, 0.8, 0.2, 520.0, self.v, 0.0, 0.0, 2.5, 4.0, 3, 9) if tick % 40 == 0 else None,
        )
        self.frames.append(sensor_codec.quantized(frame))
        return self.frames[-1]

    def truth(self) -> TruthState:
        values: dict[str, Any] = dict.fromkeys(TruthState._fields, 0)
        return TruthState(**{**values, "time_us": self.frames[-1].time_us, "quaternion_w": 1.0, "north": 111.0})


def control(frame: SensorFrame) -> ActuatorCommand:
    elevator = -2.0 * frame.imu.accel_x - 1.0 * frame.imu.gyro_x
    return ActuatorCommand(frame.time_us, 0.3, -0.3, 0.5, elevator, 0.0, 1)


class Serving:
    """A world served in a thread; ``result`` gives its tally or raises its error."""

    def __init__(self, world: World, timeouts: Timeouts = SHORT, url: str = "") -> None:
        self.url = url or f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        self.server = BridgeServer(self.url, timeouts=timeouts)
        self._outcome: list[BridgeStatistics | BaseException] = []
        self._thread = threading.Thread(target=self._run, args=(world,))
        self._thread.start()

    def _run(self, world: World) -> None:
        try:
            self._outcome.append(self.server.serve(world))
        except BaseException as error:
            self._outcome.append(error)

    def result(self) -> BridgeStatistics:
        self._thread.join(30.0)
        self.server.close()
        outcome = self._outcome[0]
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome


def fly(board: HilBoard) -> list[SensorFrame]:
    frames = []
    while (frame := board.read()) is not None:
        frames.append(frame)
        board.write(control(frame))
    return frames


UNIX = pytest.param(
    f"unix:wingbeat-test-{os.getpid()}", marks=pytest.mark.skipif(sys.platform != "linux", reason="Linux")
)


@pytest.mark.parametrize("url", ["", UNIX], ids=["tcp", "unix"])
def test_a_flight_over_the_bridge_sees_the_numbers_of_a_flight_in_one_process(url: str) -> None:
    alone = ToyWorld(800)
    command = NEUTRAL
    while not alone.finished:
        command = codec.quantized_command(control(alone.step(command)))
    bridged = ToyWorld(800)
    serving = Serving(bridged, url=url)
    board = HilBoard(serving.url)
    seen = fly(board)
    tally = serving.result()
    assert seen == alone.frames == bridged.frames
    assert bridged.commands == alone.commands
    assert (tally.frames, tally.stale, tally.bad_bytes) == (800, 0, 0)
    assert (board.bad_bytes, board.frames) == (0, 800 + 800 + 200 + 400 + 400 + 20 + 1)  # the end is the last
    assert board.read() is None


def test_a_flight_computer_that_stops_answering_is_named_with_the_frame_it_left() -> None:
    serving = Serving(ToyWorld(100))
    board = HilBoard(serving.url)
    for _ in range(3):
        frame = board.read()
        assert frame is not None
        board.write(control(frame))
    with pytest.raises(FlightComputerSilent, match=r"did not respond to the sensor frame of t = 0\.020 s for 0\.4 s"):
        serving.result()
    assert board.read() is not None  # the frame that was left
    assert board.read() is None
    assert board.ended == "simulator timed out waiting for a command"


def test_a_flight_computer_that_hangs_up_ends_the_flight() -> None:
    serving = Serving(ToyWorld(100))
    board = HilBoard(serving.url)
    assert board.read() is not None
    assert board.ended == ""
    board.close()
    assert serving.result().ended == "flight computer disconnected"


def test_nobody_connects_or_nobody_says_hello() -> None:
    with pytest.raises(FlightComputerSilent, match="no flight computer connected"):
        Serving(ToyWorld(1), SHORT._replace(connect=0.05)).result()
    serving = Serving(ToyWorld(1), SHORT._replace(hello=0.1))
    with (
        socket.create_connection(("127.0.0.1", serving.server.port)),
        pytest.raises(FlightComputerSilent, match="sent no HEARTBEAT"),
    ):
        serving.result()


def test_a_stranger_that_makes_noise_and_leaves_is_told() -> None:
    serving = Serving(ToyWorld(1))
    with socket.create_connection(("127.0.0.1", serving.server.port)) as stranger:
        stranger.sendall(bytes(range(256)) * 40)
    with pytest.raises(
        FlightComputerSilent, match=r"disconnected without a HEARTBEAT \(\d+ bytes were not MAVLink\)"
    ):
        serving.result()


def test_a_world_that_is_not_there_or_says_nothing_is_named() -> None:
    port = free_port(socket.SOCK_STREAM)
    with pytest.raises(BoardSilent, match=f"simulator at tcp:127.0.0.1:{port} did not respond for 0.1 s"):
        HilBoard(f"tcp:127.0.0.1:{port}", BoardTimeouts(connect=0.1))
    with socket.create_server(("127.0.0.1", port)) as mute:
        board = HilBoard(f"hil:tcp:127.0.0.1:{port}", BoardTimeouts(first=0.2))
        connected, _ = mute.accept()
        with pytest.raises(BoardSilent, match=r"sent no sensor frame for 0\.2 s, none received before"):
            board.read()
        writer = FrameWriter(1, 200)
        connected.sendall(writer.sensors(ToyWorld(1).step(NEUTRAL)))
        assert board.read() is not None
        board._timeouts = BoardTimeouts(frame=0.1)
        connected.sendall(b"\xfd" * 500)
        with pytest.raises(BoardSilent, match=r"for 0\.1 s, last at t = 0\.005 s"):
            board.read()
        connected.close()
        assert board.read() is None
        assert board.ended == "simulator disconnected"


def test_a_world_that_talks_without_end_and_never_closes_a_tick_is_still_bounded() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        board = HilBoard(f"tcp:127.0.0.1:{server.getsockname()[1]}", BoardTimeouts(first=0.2))
        connected, _ = server.accept()
        stop = threading.Event()

        def talk() -> None:
            writer = FrameWriter(1, 200)
            try:
                while not stop.is_set():
                    connected.sendall(
                        writer.frame(
                            sensor_codec.CODECS["encoder"].message_id,
                            sensor_codec.CODECS["encoder"].encode(EncoderSample(1, 2, 3)),
                        )
                    )
            except OSError:
                stop.set()

        thread = threading.Thread(target=talk)
        thread.start()
        with pytest.raises(BoardSilent, match="no sensor frame"):
            board.read()
        stop.set()
        board.close()
        thread.join()
        connected.close()


class Noisy:
    """A stream with noise before and inside of what is written."""

    def __init__(self, inner: Any, seed: int) -> None:
        self._inner = inner
        self._random = random.Random(seed)
        self.name = inner.name
        self.read = inner.read
        self.close = inner.close

    def write(self, data: bytes) -> bool:
        noise = self._random.choice(
            (b"", b"\xfd", b"\xfd\x51\x00\x00\x01\x01\x01\x5d\x00\x00", self._random.randbytes(40))
        )
        return bool(self._inner.write(noise + data + self._random.choice((b"", b"\xfd", b"\x00\xfe"))))


def test_noise_on_the_wire_costs_no_frame() -> None:
    world = ToyWorld(40)
    serving = Serving(world)
    board = HilBoard(serving.url, connect=lambda url, timeouts: Noisy(open_stream(url, timeouts), 3))
    assert fly(board) == world.frames
    tally = serving.result()
    assert tally.frames == 40 and tally.bad_bytes > 100


def _partner(serving: Serving, autopilot: int) -> tuple[socket.socket, Callable[[], list[Any]], FrameWriter]:
    """A hand-made flight computer: its socket, a reader of what has arrived, and its voice."""
    stream = socket.create_connection(("127.0.0.1", serving.server.port))
    stream.settimeout(10.0)
    writer, reader = FrameWriter(1, 1), FrameReader()
    hello = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FLAPPING_WING, autopilot, 0, 0, 0, 3)
    stream.sendall(writer.pack(hello))

    def receive() -> list[Any]:
        return [decode(frame) for frame in reader.feed(stream.recv(65536))]

    return stream, receive, writer


def _receive_until(receive: Callable[[], list[Any]], kind: str) -> list[Any]:
    heard: list[Any] = []
    while not any(message.get_type() == kind for message in heard):
        heard += receive()
    return heard


def test_answers_of_another_time_or_not_finite_are_dropped_and_counted() -> None:
    world = ToyWorld(2)
    serving = Serving(world)
    stream, receive, writer = _partner(serving, mavlink.MAV_AUTOPILOT_GENERIC)
    for tick in (1, 2):
        _receive_until(receive, "HIL_SENSOR")
        good = control(world.frames[tick - 1])
        stream.sendall(writer.actuators(good._replace(time_us=good.time_us - 5000, elevator=1.0)))
        stream.sendall(writer.actuators(good._replace(elevator=math.nan)))
        stream.sendall(writer.actuators(good))
    _receive_until(receive, "WINGBEAT_END")
    tally = serving.result()
    assert (tally.stale, tally.rejected) == (2, 2)
    assert world.commands[1] == codec.quantized_command(control(world.frames[0]))
    stream.close()


def test_px4_is_told_in_one_line_to_come_to_its_own_interface() -> None:
    """Given the ordinary port, which is where PX4 looks, the world is not begun for it."""
    world = ToyWorld(60)
    serving = Serving(world)
    stream, _, _ = _partner(serving, mavlink.MAV_AUTOPILOT_PX4)
    with pytest.raises(InputError, match=r"^PX4 connected from .*: it is served by wingbeat sim --px4$"):
        serving.result()
    assert not world.frames and stream.recv(1) == b""
    stream.close()


def test_truth_is_served_at_the_interval_asked_for() -> None:
    world = ToyWorld(41)
    serving = Serving(world)
    stream, receive, writer = _partner(serving, mavlink.MAV_AUTOPILOT_GENERIC)
    for number, interval in ((115, 20_000.0), (999, 1.0)):
        ask = mavlink.MAVLink_command_long_message(
            1, 200, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, interval, 0, 0, 0, 0, 0
        )
        stream.sendall(writer.pack(ask))
    heard: list[Any] = []
    while not heard or heard[-1].get_type() != "WINGBEAT_END":
        fresh = receive()
        heard += fresh
        for message in fresh:
            if message.get_type() == "HIL_SENSOR":
                stream.sendall(writer.actuators(NEUTRAL._replace(time_us=message.time_usec)))
    serving.result()
    acks = [message.result for message in heard if message.get_type() == "COMMAND_ACK"]
    assert acks == [mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_UNSUPPORTED]
    truths = [message for message in heard if message.get_type() == "HIL_STATE_QUATERNION"]
    assert 9 <= len(truths) <= 11
    assert {after.time_usec - before.time_usec for before, after in pairwise(truths)} == {20_000}
    stream.close()


def test_truth_in_the_standards_units() -> None:
    values: dict[str, Any] = dict.fromkeys(TruthState._fields, 0.0)
    truth = TruthState(
        **{**values, "time_us": 7, "quaternion_w": 1.0, "north": 100.0, "east": -50.0, "down": -40.0,
           "v_down": -1.5, "airspeed": 7.25, "on_ground": 0}
    )  # fmt: skip
    frame = FrameWriter(1, 200).frame(115, encode_truth(truth, (math.radians(45.0), math.radians(10.0), 500.0)))
    got = common.MAVLink(None).parse_buffer(frame)[0]
    metres = math.radians(1.0) * 6_378_137.0
    assert (got.lat * 1e-7 - 45.0) * metres == pytest.approx(100.0, abs=0.02)
    assert (got.lon * 1e-7 - 10.0) * metres * math.cos(math.radians(45.0)) == pytest.approx(-50.0, abs=0.02)
    assert (got.alt, got.vz, got.true_airspeed, got.time_usec) == (540_000, -150, 725, 7)


def test_a_port_in_use_is_bad_input() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port}"):
            BridgeServer(f"tcp:127.0.0.1:{port}")
    with pytest.raises(InputError, match="tcp:HOST:PORT"):
        BridgeServer("udpin:127.0.0.1:4560")


def test_the_pacer_holds_a_simulation_to_its_speed_and_forgives_a_long_stop() -> None:
    wall = [100.0]
    waits: list[float] = []

    def sleep(duration: float) -> None:
        waits.append(duration)
        wall[0] += duration

    pacer = Pacer(2.0, lambda: wall[0], sleep)
    for tick in range(201):
        pacer.wait(tick * 5000)
    assert wall[0] == pytest.approx(100.5)
    wall[0] += 10.0
    pacer.wait(201 * 5000)
    pacer.wait(202 * 5000)
    assert waits[-1] == pytest.approx(0.0025)
    Pacer(None, lambda: 0.0, sleep).wait(10**9)
    assert wall[0] < 111.0


def test_pinning_keeps_this_process_on_one_core() -> None:
    if not hasattr(os, "sched_getaffinity"):
        assert pin_to_core() is None
        return
    before = os.sched_getaffinity(0)
    try:
        core = pin_to_core()
        assert core == max(before) and os.sched_getaffinity(0) == {core}
    finally:
        os.sched_setaffinity(0, before)


@pytest.mark.parametrize(("running", "separation"), [(0.0, True), (0.4, True), (1.0, False), (3.0, False)])
def test_a_pair_has_two_cores_where_nobody_else_wants_them(
    running: float, separation: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5}, raising=False)
    monkeypatch.setattr(cores, "_running", lambda: running)
    monkeypatch.setattr(cores, "_CORES", Path("nowhere"))
    assert idle_pair() == ((5, 3) if separation else None)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
    assert idle_pair() is None


def test_a_pair_takes_the_cores_that_were_idle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN four cores, the two highest of which another pair has THEN ours takes the two lowest."""
    told = tmp_path / "stat"

    def runs() -> float:
        told.write_text("cpu 1 0 0 9 0\ncpu0 1 0 0 17 0\ncpu1 1 0 0 15 1\ncpu2 6 0 0 10 0\ncpu3 6 0 0 11 0\nintr 7\n")
        return 2.0

    told.write_text("cpu 1 0 0 8 0\ncpu0 1 0 0 10 0\ncpu1 1 0 0 10 0\ncpu2 1 0 0 10 0\ncpu3 1 0 0 10 0\nintr 6\n")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3}, raising=False)
    monkeypatch.setattr(cores, "_CORES", told)
    monkeypatch.setattr(cores, "_running", runs)
    assert idle_pair() == (0, 1)
    told.unlink()
    monkeypatch.setattr(cores, "_running", lambda: 2.0)
    assert idle_pair() == (3, 2)


def test_where_nobody_tells_what_runs_the_load_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = tmp_path / "loadavg"
    told.write_text("0.10 0.20 0.30 2/345 678\n")
    monkeypatch.setattr(cores, "_LOAD", told)
    assert cores._running() == 1.0
    monkeypatch.setattr(cores, "_LOAD", tmp_path / "none")
    monkeypatch.setattr(os, "getloadavg", lambda: (1.25, 0.0, 0.0))
    assert cores._running() == 1.25


def test_a_flight_in_real_time_runs_before_others_where_that_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a system that allows it, or not THEN the schedule is the one of fixed priority, or unchanged."""
    if not hasattr(os, "sched_setscheduler"):
        assert not run_before_others()
        return
    before = os.sched_getscheduler(0)
    try:
        asked = run_before_others()
        assert os.sched_getscheduler(0) == (os.SCHED_FIFO if asked else before)
    finally:
        os.sched_setscheduler(0, before, os.sched_param(0))

    def refused(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    assert not run_before_others()
