"""``wingbeat gcs`` on a real terminal: tmux is one that can be read."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lossy_vehicle import LossyVehicle, on_the_air

TMUX = shutil.which("tmux")
pytestmark = pytest.mark.skipif(TMUX is None, reason="tmux is not installed: there is no terminal to read")
ROOT = Path(__file__).parents[2]
PATIENCE = 40.0
"""s; that a terminal may take on a loaded machine"""


class Terminal:
    """A terminal of 100 by 30 with a shell in it."""

    def __init__(self, folder: Path) -> None:
        self._socket = str(folder / "tmux")
        self._folder = folder
        self._run("-f", "/dev/null", "new-session", "-d", "-x", "100", "-y", "30", "-s", "test", "/bin/sh")

    def _run(self, *words: str) -> str:
        assert TMUX is not None
        environment = {
            **os.environ,
            "TERM": "xterm-256color",
            "LC_ALL": "C.UTF-8",
            "PYTHONPATH": str(ROOT),
            "PS1": "$ ",
        }
        command = [TMUX, "-S", self._socket, "-u", *words]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=self._folder, check=True)
        return done.stdout

    def type(self, *keys: str) -> None:
        self._run("send-keys", "-t", "test", *keys)

    def screen(self) -> str:
        return self._run("capture-pane", "-p", "-t", "test")

    def until(self, true: Callable[[str], bool]) -> str:
        """What is on the screen once something is true of it."""
        deadline = time.monotonic() + PATIENCE
        while not true(text := self.screen()):
            assert time.monotonic() < deadline, f"never came:\n{text}"
            # Each look is a process and work for the terminal; without a pause they starve the program under test.
            time.sleep(0.1)
        return text

    def close(self) -> None:
        self._run("kill-server")


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    opened = Terminal(tmp_path)
    yield opened
    opened.close()


def test_the_screen_comes_takes_keys_and_leaves_the_terminal_and_a_recording(
    terminal: Terminal, tmp_path: Path
) -> None:
    with on_the_air(LossyVehicle()) as url:
        terminal.type(f"{sys.executable} -m groundstation.command.main gcs {url}; echo left with $?", "Enter")
        terminal.until(lambda text: "flapping wing 1" in text and "disarmed" in text)
        terminal.until(lambda text: "● " in text and ".mcap" in text)
        terminal.type("2")
        terminal.until(lambda text: "HEARTBEAT" in text and "field" in text)
        terminal.type("K")
        terminal.until(lambda text: "In flight it falls." in text)
        terminal.type("n")
        terminal.type("q")
        text = terminal.until(lambda text: "left with 0" in text.replace("left with $?", ""))
    assert "recorded in recordings/gcs-flapping_wing-1-" in text
    assert "Traceback" not in text and "HEARTBEAT" not in text
    assert len(list((tmp_path / "recordings").glob("gcs-flapping_wing-1-*.mcap"))) == 1


def test_without_a_terminal_it_speaks_in_lines(terminal: Terminal) -> None:
    with on_the_air(LossyVehicle()) as url:
        terminal.type(f"{sys.executable} -m groundstation.command.main gcs {url} --no-record | head -n 1", "Enter")
        terminal.until(lambda text: "MANUAL" in text and "altitude" in text)
