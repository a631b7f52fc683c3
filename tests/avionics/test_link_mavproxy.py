"""MAVProxy, headless, as a person uses it: over UDP, with the mode map that is shipped."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from link_station import free_port, running
from link_vehicle import FakeVehicle

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.ground import GroundLink
from avionics.link.vehicle import PX4_STYLE
from avionics.messages import Mode

MODE_MAP = Path(importlib.util.find_spec("avionics.link").submodule_search_locations[0]) / "custom_mode_map.json"
PATIENCE = 60.0


class MavProxy:
    """MAVProxy's terminal: `say` a line, `see` what it prints after what was seen before."""

    def __init__(self, port: int, home: Path) -> None:
        settings = home / ".pymavlink"
        settings.mkdir()
        shutil.copy(MODE_MAP, settings)
        arguments = [f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={home}", "--nowait"]
        self._console = subprocess.Popen(
            [sys.executable, "-u", str(Path(sys.executable).with_name("mavproxy.py")), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=home,
            env={**os.environ, "HOME": str(home), "USERPROFILE": str(home), "TERM": "dumb"},
        )
        self._printed = ""
        self._seen = 0
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._console.stdout is not None
        while data := os.read(self._console.stdout.fileno(), 4096):
            with self._news:
                self._printed += data.decode(errors="replace")
                self._news.notify_all()

    def say(self, line: str) -> None:
        assert self._console.stdin is not None
        self._console.stdin.write(line.encode() + b"\n")
        self._console.stdin.flush()

    def ask(self, line: str, pattern: str) -> re.Match[str]:
        """Say a line until the answer shows: MAVProxy answers from what has reached it so far."""
        deadline = time.monotonic() + PATIENCE
        while True:
            self.say(line)
            try:
                return self.see(pattern, 1.0)
            except AssertionError:
                if time.monotonic() >= deadline:
                    raise

    def see(self, pattern: str, patience: float = PATIENCE) -> re.Match[str]:
        deadline = time.monotonic() + patience
        with self._news:
            while (found := re.search(pattern, self._printed[self._seen :])) is None:
                left = deadline - time.monotonic()
                if left <= 0 or not self._news.wait(left):
                    raise AssertionError(f"MAVProxy never printed {pattern!r}:\n{self._printed}")
            self._seen += found.end()
            return found

    @property
    def printed(self) -> str:
        return self._printed

    def close(self) -> None:
        self._console.kill()  # it has nothing to save, and a terminal it would wait for
        self._console.wait(PATIENCE)
        self._reader.join()


@pytest.fixture
def station(tmp_path: Path) -> Iterator[tuple[MavProxy, FakeVehicle]]:
    if importlib.util.find_spec("MAVProxy") is None:
        pytest.skip("MAVProxy is not installed: pip install 'wingbeat[mavproxy]'")
    port = free_port()
    vehicle = FakeVehicle()
    vehicle.mission = (MissionItem(ItemKind.TAKEOFF, altitude=40.0), MissionItem(ItemKind.RETURN))
    console = MavProxy(port, tmp_path)
    try:
        with running(GroundLink([f"udpout:127.0.0.1:{port}"], vehicle), vehicle):
            yield console, vehicle
    finally:
        console.close()


def test_mavproxy_shows_the_vehicle_and_changes_its_mode(station: tuple[MavProxy, FakeVehicle]) -> None:
    console, vehicle = station
    console.see("Detected vehicle 1:1")
    console.see("Mode MANUAL")
    console.see(f"Received {len(vehicle.parameters)} parameters")
    console.ask("status HEARTBEAT", r"HEARTBEAT \{type : 16, autopilot : 0, base_mode : 65, custom_mode : 65536")
    assert float(console.ask("status ATTITUDE", r"ATTITUDE \{.*?pitch : ([-0-9.]+)")[1]) == pytest.approx(0.2)
    console.say("param set PITCH_P 1.5")
    console.ask("param show PITCH_P", r"PITCH_P +1\.5")
    assert vehicle.parameters[0].value == 1.5
    for mode in (Mode.AUTO, Mode.RETURN, Mode.STABILIZED):
        console.say(f"mode {mode.name}")
        console.see(f"Mode {mode.name}")
        assert vehicle.mode is mode
    console.say("wp list")
    console.see(r"Saved 2 waypoints|Requesting 2 waypoints")
    console.say("arm throttle")
    console.see("ARMED")
    assert vehicle.armed
    assert "fence breach" not in console.printed


def test_the_mode_map_that_is_shipped_says_what_the_vehicle_says() -> None:
    shipped = json.loads(MODE_MAP.read_text())
    assert shipped == {"16": {str(entry.custom_mode): entry.mode.name for entry in PX4_STYLE}}
    assert {entry.mode for entry in PX4_STYLE} == set(Mode)


def test_mavproxy_sets_a_key_and_goes_on_signed(station: tuple[MavProxy, FakeVehicle]) -> None:
    """The key is sent once, in the clear, to a vehicle on the same computer."""
    console, vehicle = station
    console.see(f"Received {len(vehicle.parameters)} parameters")
    console.say("signing setup the goose is loose")
    console.see("signing: on, until the next start")
    console.say("param set PITCH_P 1.25")
    console.ask("param show PITCH_P", r"PITCH_P +1\.25")
    assert vehicle.parameters[0].value == 1.25
    console.say("signing disable")
    console.say("arm throttle")
    console.see("unsigned frames are refused")
    assert not vehicle.armed
