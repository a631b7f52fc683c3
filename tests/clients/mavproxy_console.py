"""MAVProxy's terminal, headless, as a person uses it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymavlink import mavwp
from simulated_vehicle import PATIENCE, PlanItem

import avionics.link

MODE_MAP = Path(avionics.link.__path__[0]) / "custom_mode_map.json"

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed: pip install -e '.[clients]'")


class Console:
    """`send` a line, `wait_for` what is printed after what was seen before."""

    def __init__(self, options: Sequence[str], home: Path) -> None:
        """Start it; it is a person's ``~`` that it finds the mode map and leaves its files in."""
        settings = home / ".pymavlink"
        settings.mkdir()
        shutil.copy(MODE_MAP, settings)
        program = str(Path(sys.executable).with_name("mavproxy.py"))
        self._process = subprocess.Popen(
            [sys.executable, "-u", program, *options, f"--state-basedir={home}", "--nowait"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=home,
            env={**os.environ, "HOME": str(home), "USERPROFILE": str(home), "TERM": "dumb"},
        )
        self._printed = ""
        self._observed = 0
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while data := os.read(self._process.stdout.fileno(), 4096):
            with self._news:
                self._printed += data.decode(errors="replace")
                self._news.notify_all()

    def send(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def request(self, line: str, pattern: str) -> re.Match[str]:
        """Say a line until the answer shows: MAVProxy answers from what has reached it so far."""
        deadline = time.monotonic() + PATIENCE
        while True:
            self.send(line)
            try:
                return self.wait_for(pattern, 1.0)
            except AssertionError:
                if time.monotonic() >= deadline:
                    raise

    def wait_for(self, pattern: str, timeout: float = PATIENCE) -> re.Match[str]:
        """The next match of a pattern."""
        deadline = time.monotonic() + timeout
        with self._news:
            while (found := re.search(pattern, self._printed[self._observed :])) is None:
                left = deadline - time.monotonic()
                if left <= 0 or not self._news.wait(left):
                    raise AssertionError(f"MAVProxy never printed {pattern!r}:\n{self._printed}")
            self._observed += found.end()
            return found

    @property
    def printed(self) -> str:
        return self._printed

    def close(self) -> None:
        self._process.kill()  # it has nothing to save, and a terminal it would wait for
        self._process.wait(PATIENCE)
        self._reader.join()


@contextmanager
def console(options: Sequence[str], home: Path) -> Iterator[Console]:
    """MAVProxy, ended when left."""
    home.mkdir()
    started = Console(options, home)
    try:
        yield started
    finally:
        started.close()


def write_plan(items: Sequence[PlanItem], path: Path) -> None:
    """As a file that ``wp load`` reads."""
    lines = ["QGC WPL 110"]
    for number, item in enumerate(items):
        place = (item.x * 1e-7, item.y * 1e-7, item.z)
        numbers = (number, int(number == 0), item.frame, item.command, *item.params, *place, 1)
        lines.append("\t".join(repr(value) for value in numbers))
    path.write_text("\n".join(lines) + "\n")


def read_plan(path: Path) -> list[PlanItem]:
    """A file that ``wp save`` has written."""
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    return [
        PlanItem(
            w.frame, w.command, (w.param1, w.param2, w.param3, w.param4), round(w.x * 1e7), round(w.y * 1e7), w.z
        )
        for w in loader.wpoints
    ]
