"""A board on a serial line and its reference peer over a pseudo terminal: no lockstep, losses, the plug, rest."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.board.board import BoardSilent, Surroundings
from avionics.board.hil import HilBoard, Timeouts
from avionics.link import codec, sensor_codec
from avionics.link.serial_line import SerialLine
from avionics.messages import ActuatorCommand, SensorFrame
from avionics.missions import load_mission
from avionics.vehicles import load_vehicle as load_computer
from sim_bridge.bridge.microcontroller import REST, REST_AFTER, Microcontroller, Pty, SerialPeer
from sim_bridge.flight.at_rest import AtRest
from sim_bridge.flight.world import Scenario
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.topic import Topic

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")

RAVEN = "robo_raven_ii_d"
TICK = 0.005
QUICK = Timeouts(first=2.0, frame=5.0)


def table(duration: float = 1000.0) -> AtRest:
    return AtRest(load_vehicle(RAVEN), Scenario(duration=duration))


class Bad:
    """A stream whose writes are bent by ``bend``."""

    def __init__(self, inner: Pty, bend: Callable[[bytes], bytes]) -> None:
        self._inner, self._bend = inner, bend
        self.name, self.read, self.close = inner.name, inner.read, inner.close

    def write(self, data: bytes) -> bool:
        return self._inner.write(self._bend(data))


class Hardware:
    """A microcontroller and the flight computer's end of its line, in one thread: it ticks before each read."""

    def __init__(self, bend: Callable[[bytes], bytes] = bytes, address: str = "") -> None:
        self.line = Pty()
        self.now = 0.0
        self.reports: list[str] = []
        self.sent: list[SensorFrame] = []
        self.at: dict[int, Callable[[], None]] = {}
        self.turn = 0
        self.burst = 1
        """ticks in one turn"""
        self.bend = bend
        self.controller: Microcontroller | None = Microcontroller(Bad(self.line, bend), table())
        around = Surroundings(lambda severity, text: self.reports.append(text), self.tick)
        self.board = HilBoard(address or f"hil:{self.line.name}", QUICK, clock=lambda: self.now, around=around)

    def tick(self) -> None:
        self.turn += 1
        self.at.get(self.turn, lambda: None)()
        for _ in range(self.burst):
            self.now += TICK if self.controller is not None else 0.1
            if self.controller is not None:
                self.sent.append(sensor_codec.quantized(self.controller.tick()))

    def listen(self, count: int) -> None:
        """Tick until the microcontroller has dealt with ``count`` actuator frames: a line takes its time."""
        for _ in range(60):
            assert self.controller is not None
            tally = self.controller.statistics
            if tally.commands + tally.stale + tally.rejected >= count:
                return
            self.tick()

    def fly(self, count: int, answer: bool = True) -> list[SensorFrame]:
        frames = []
        for number in range(count):
            if number % self.burst == 0:
                self.tick()
            frame = self.board.read()
            assert frame is not None
            frames.append(frame)
            if answer:
                self.board.write(ActuatorCommand(frame.time_us, 0.3, -0.3, 0.5, 0.1, 0.0, 1))
        return frames


def test_what_the_microcontroller_measures_arrives_and_what_it_is_told_is_done() -> None:
    hardware = Hardware()
    frames = hardware.fly(100)
    assert frames == hardware.sent[:100]
    assert [frame.time_us for frame in frames] == [5000 * n for n in range(1, 101)]
    hardware.listen(100)
    assert hardware.controller is not None
    assert hardware.controller.command == codec.quantized_command(
        ActuatorCommand(frames[-1].time_us, 0.3, -0.3, 0.5, 0.1, 0.0, 1)
    )
    tally = hardware.controller.statistics
    assert (tally.commands, tally.stale, tally.rejected, tally.rests, tally.bad_bytes) == (100, 0, 0, 0, 0)
    assert hardware.board.losses == (0, 0, 0, 0) and hardware.reports == []


def test_it_waits_for_nobody_and_an_unanswered_frame_stalls_nothing() -> None:
    hardware = Hardware()
    assert hardware.fly(150, answer=False) == hardware.sent[:150]
    assert hardware.controller is not None and hardware.controller.command == REST


def test_all_messages_fit_the_documented_baud_rate() -> None:
    hardware = Hardware()
    hardware.fly(200)
    assert hardware.controller is not None
    seconds = hardware.controller.statistics.frames * TICK
    assert 460_800 < 10 * hardware.controller.statistics.sent / seconds < 0.75 * 921_600


def test_frames_that_waited_are_read_in_order_and_counted_late() -> None:
    """GIVEN a line that brings seven ticks at once WHEN they are read THEN all come and the old ones are late."""
    hardware = Hardware()
    hardware.fly(20)
    hardware.burst = 7
    frames = hardware.fly(70)
    assert [frame.time_us for frame in frames] == [5000 * n for n in range(21, 91)]
    # Of seven at once five are up to 20 ms old, two older: 25 and 30 ms.
    assert hardware.board.counters.late == 20 and hardware.board.counters.lost == 0


def test_noise_and_lost_bytes_cost_their_messages_which_are_counted_and_said() -> None:
    rng = random.Random(5)

    def bend(data: bytes) -> bytes:
        if rng.random() < 0.1:
            cut = rng.randrange(len(data))
            return rng.choice((b"", b"\xfd\x00", rng.randbytes(30))) + data[:cut] + data[cut + 1 :]
        return data

    hardware = Hardware(bend)
    frames = hardware.fly(400)
    sent = {frame.time_us: frame for frame in hardware.sent}
    assert all(frame.imu == sent[frame.time_us].imu for frame in frames)
    assert 15 < hardware.board.losses.lost < 90 and hardware.board.bad_bytes > 500
    assert hardware.reports[0].startswith(f"board at {hardware.line.name}: ") and "rejected" in hardware.reports[0]
    assert len(hardware.reports) <= 2


def test_a_command_that_is_old_early_or_no_number_is_refused() -> None:
    hardware = Hardware()
    last = hardware.fly(10)[-1].time_us
    told = ActuatorCommand(last, 0.0, 0.0, 0.9, 0.0, 0.0, 1)
    for time_us, throttle in ((last, 0.9), (last - 5000, 0.9), (last + 10**6, 0.9), (last + 1, math.nan)):
        hardware.board.write(told._replace(time_us=time_us, throttle=throttle))
    hardware.listen(14)
    assert hardware.controller is not None
    tally = hardware.controller.statistics
    assert (tally.commands, tally.stale, tally.rejected) == (10, 3, 1)
    assert hardware.controller.command.throttle == 0.5


def test_without_actuator_frames_it_holds_for_a_while_rests_and_obeys_again() -> None:
    hardware = Hardware()
    hardware.fly(10)
    hardware.fly(round(REST_AFTER / TICK) - 2, answer=False)
    assert hardware.controller is not None
    assert hardware.controller.command.throttle == 0.5 and hardware.controller.statistics.rests == 0
    hardware.fly(6, answer=False)
    assert hardware.controller.command == REST and hardware.controller.statistics.rests == 1
    hardware.fly(10)
    assert hardware.controller.command.throttle == 0.5 and hardware.controller.command.armed == 1


def test_a_board_that_falls_silent_is_told_and_given_up_within_its_bound() -> None:
    hardware = Hardware()
    hardware.fly(10)
    hardware.controller = None
    with pytest.raises(BoardSilent, match=r"board at serial:.* sent no sensor frame for 5 s, last at t = 0\."):
        hardware.fly(10)
    assert hardware.now == pytest.approx(10 * TICK + 5.0, abs=0.3)
    assert hardware.reports == [f"board at {hardware.line.name}: no sensor frame for 1 s"]
    silent = Hardware()
    silent.controller = None
    with pytest.raises(BoardSilent, match="for 2 s, none received before"):
        silent.fly(1)


def test_pulled_out_and_plugged_in_again_it_is_said_and_flies_on(tmp_path: Path) -> None:
    device = tmp_path / "board"
    first = Pty()
    device.symlink_to(first.device)
    hardware = Hardware(address=f"hil:serial:{device},921600")
    hardware.controller = Microcontroller(first, world := table())
    before = hardware.fly(50)

    def pull() -> None:
        first.close()
        device.unlink()

    def put_back() -> None:
        second = Pty()
        device.symlink_to(second.device)
        hardware.controller = Microcontroller(second, world)

    hardware.at[60], hardware.at[90] = pull, put_back
    after = hardware.fly(100)
    assert after[-1].time_us - before[-1].time_us == pytest.approx(0.65e6, abs=0.05e6)  # its clock went on
    name = f"board at serial:{device},921600"
    assert hardware.reports[:2] == [f"{name} disconnected: check the cable", f"{name} reconnected"]
    assert hardware.controller is not None and hardware.controller.statistics.commands > 50
    assert hardware.board.counters.restarts == 0


def test_a_board_that_restarts_is_told_and_the_flight_computer_follows_its_clock() -> None:
    """GIVEN a microcontroller that browns out WHEN its clock begins anew THEN attitude goes on after 20 frames."""
    hardware = Hardware()
    reports: list[str] = []

    def publish(topic: Topic, message: Any) -> None:
        if topic is topics.EVENTS:
            reports.append(message.text)

    pilot = Autopilot(load_computer(RAVEN), load_mission("circuit"), publish)

    def restart() -> None:
        hardware.controller = Microcontroller(hardware.line, table())

    hardware.at[300] = restart
    for _ in range(600):
        frame = hardware.fly(1, answer=False)[0]
        command = pilot.step(frame)
        assert command.time_us == frame.time_us
        hardware.board.write(command)
    assert hardware.board.counters.restarts == 1 and hardware.board.losses.lost == 0
    assert hardware.reports == [f"board at {hardware.line.name} restarted"]
    assert any("new time base accepted" in text for text in reports)
    assert pilot.memory.attitude.time_us > 2_900_000 - 22 * 5000
    assert hardware.controller is not None and hardware.controller.statistics.commands > 250


def test_a_write_that_nobody_reads_is_dropped_and_never_waits() -> None:
    """A full buffer of a pseudo terminal takes nothing: were a write to wait for room, this would not end."""
    line = Pty()
    board = SerialLine(line.device, 921_600)
    # The kernel moves what it holds on as it finds time: room for a line may come back once after the first refusal.
    taken = [board.write(bytes(100)) for _ in range(3000)]
    assert taken[0] and False in taken and board.dropped == taken.count(False)
    board.close()
    line.close()


def test_the_peer_serves_a_world_to_its_end_and_says_so() -> None:
    peer = SerialPeer("pty", speed=1000.0)
    board = HilBoard(f"hil:{peer.address}")
    tally = peer.serve(table(duration=0.05))
    frames = []
    while (frame := board.read()) is not None:
        frames.append(frame.time_us)
    assert frames == [5000 * n for n in range(1, 11)] and tally.frames == 10
    assert board.ended == "simulation ended"
    peer.close()


def test_a_peer_needs_a_serial_address() -> None:
    with pytest.raises(InputError, match="a microcontroller is on serial:DEVICE,BAUD"):
        SerialPeer("tcp:127.0.0.1:4560")
    with pytest.raises(InputError, match="cannot open serial device /dev/no-such-device"):
        SerialPeer("serial:/dev/no-such-device,921600")


def test_at_rest_the_sensors_say_level_and_still() -> None:
    world = table()
    frames = [world.step(REST) for _ in range(400)]
    assert sum(frame.imu.accel_z for frame in frames) / 400 == pytest.approx(-9.81, abs=0.5)
    assert abs(sum(frame.imu.gyro_x for frame in frames) / 400) < 0.05
    assert len({frame.imu[1:7] for frame in frames}) == 400, "noise does not repeat"
    assert {frame.encoder[1:3] for frame in frames if frame.encoder} == {frames[0].encoder[1:3]}  # type: ignore[index]
    assert [sum(getattr(frame, name) is not None for frame in frames) for name in ("pressures", "adc")] == [100, 200]
    assert world.truth().on_ground == 1 and not world.finished
