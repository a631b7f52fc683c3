"""``wingbeat sim --px4`` and ``--ardupilot`` as a user meets them."""

from __future__ import annotations

import math
import socket
import threading
import time
from pathlib import Path

import pytest
from foreign_bench import RAVEN, PlanePilot, ScriptedArduPlane, ScriptedPx4
from ports import free_port

from avionics import topics
from groundstation.command.foreign import REST_TIME, default_url, unhurried
from groundstation.command.main import main
from logs.reader import open_log
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign.outputs import Outputs
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """The physics is ready before anybody waits for it."""
    Plant(load_vehicle(RAVEN)).compile()


class Command:
    """The command in a thread, until it has its port."""

    def __init__(self, *words: str) -> None:
        self.code: list[int] = []
        self._thread = threading.Thread(target=lambda: self.code.append(main(["sim", *words])), daemon=True)
        self._thread.start()

    def result(self) -> int:
        self._thread.join(120.0)
        return self.code[0]


@pytest.mark.parametrize(
    ("words", "error_text"),
    [
        (["--px4", "--ardupilot"], "not allowed with"),
        (["--px4", "--pwm", "1000:2000"], "--pwm is for --ardupilot"),
        (["--channels", "aileron=0"], "are for --px4 and --ardupilot"),
        (["--ardupilot", "--channels", "flaps=1"], "flaps is not one of"),
        (["--ardupilot", "--listen", "tcp:127.0.0.1:9002"], "udpin:HOST:PORT"),
        (["--px4", "--listen", "udpin:127.0.0.1:4560"], "tcp:HOST:PORT"),
        (["--px4", "--instance", "300"], "instance must be 0 to 255"),
        (["--px4", "--vehicle", "hawkmoth"], "unknown vehicle 'hawkmoth'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    words: list[str], error_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", *words]) == 2
    captured = capsys.readouterr()
    assert error_text in captured.err and captured.err.count("\n") == 1 and captured.out == ""


def test_a_landing_leaves_time_to_disarm_and_a_mission_has_the_whole_duration() -> None:
    """Not the end of the flight: the launch of another autopilot, and a landing of less than `REST_TIME`."""
    scenario = unhurried(Scenario(duration=60.0))
    assert scenario.launch_time == math.inf and scenario.duration == 60.0
    world = SimulatedWorld(load_vehicle(RAVEN), scenario)
    for _ in range(200):
        world.advance(NEUTRAL, 0.005)
    world.release()
    landed = math.inf
    while not world.finished:
        world.advance(NEUTRAL, 0.005)
        if landed == math.inf and world.launched and world.plant.touching:
            landed = world.time_us * 1e-6
    assert REST_TIME <= world.time_us * 1e-6 - landed < REST_TIME + 5.0


def test_each_instance_has_the_port_at_which_it_looks_for_its_simulator() -> None:
    assert default_url(True, 0) == "tcp:127.0.0.1:4560" and default_url(True, 3) == "tcp:127.0.0.1:4563"
    assert default_url(False, 0) == "udpin:127.0.0.1:9002" and default_url(False, 3) == "udpin:127.0.0.1:9032"


def test_the_help_says_how_to_make_them_fly(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--help"]) == 0
    text = capsys.readouterr().out
    for word in ("--write-parameters raven.parm", "--launch throw", "docs/sitl.md", "TKOFF_ALT", "aileron=7"):
        assert word in text


def test_an_arduplane_that_starts_over_gets_a_new_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port, log = free_port(socket.SOCK_DGRAM), tmp_path / "flight.mcap"
    command = Command("--ardupilot", "--listen", f"udpin:127.0.0.1:{port}", "--duration", "1", "--log", str(log))
    first = ScriptedArduPlane(port)
    reach(first)
    first.fly(PlanePilot(5.0), 0.2)
    second = ScriptedArduPlane(port)
    second.fly(PlanePilot(5.0), 1.0)
    assert command.result() == 0
    said = capsys.readouterr().err
    assert "--model JSON on udpin:" in said and "starts over" in said and "flights 2" in said
    for path in (log, tmp_path / "flight-2.mcap"):
        with open_log(path) as recorded:
            names = set(recorded.topics)
            assert {topics.IMU.name, topics.ACTUATORS.name, truth_topics.STATE.name} <= names
    first.close()
    second.close()


def reach(plane: ScriptedArduPlane) -> None:
    """Send the first frame again until somebody answers, as ArduPilot does."""
    plane.socket.settimeout(0.1)
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        plane.frame_count = 0
        try:
            plane.exchange((1500, 1500, 1100, 1500))
        except OSError:
            continue
        plane.socket.settimeout(10.0)
        return
    raise AssertionError("nobody answered for two minutes")


def test_a_px4_is_waited_for_flown_and_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port, log = free_port(socket.SOCK_STREAM), tmp_path / "flight.mcap"
    command = Command("--px4", "--listen", f"tcp:127.0.0.1:{port}", "--duration", "0.4", "--log", str(log))
    px4 = connected(port)
    px4.stream.settimeout(120.0)
    px4.greet()
    while fresh := px4.receive():
        for message in fresh:
            if message.get_type() == "HIL_SENSOR":
                px4.answer(message.time_usec, Outputs(throttle=0.5, armed=1))
    assert command.result() == 0
    said = capsys.readouterr().err
    assert (
        "simulator_mavlink on tcp:" in said
        and "armed" in said
        and "the simulation finished: flights 1, frames 10" in said
    )
    with open_log(log) as recorded:
        assert topics.GPS.name in set(recorded.topics)


def connected(port: int) -> ScriptedPx4:
    """Connect as soon as the port is there, as PX4 does."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        try:
            return ScriptedPx4(port)
        except OSError:
            continue
    raise AssertionError("nobody listened")
