"""A command that is ended from outside: its file is whole, and its exit code says by what."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest
from lossy_vehicle import LossyVehicle, on_the_air

from groundstation.command import ending
from groundstation.command.gcs_monitor import run_screen
from groundstation.command.main import main

Capture = pytest.CaptureFixture[str]
WINGBEAT = [sys.executable, "-m", "groundstation.command.main"]


def started(*words: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen([*WINGBEAT, *words], stdin=pipe, stdout=pipe, stderr=pipe, text=True)


def assert_whole(file: Path, capsys: Capture) -> None:
    """The file opens, and has its end."""
    assert main(["log", "info", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damage"] == []


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), pytest.param(signal.SIGHUP, 129, marks=pytest.mark.validate)]
)
def test_a_signal_finishes_what_a_ground_station_records(
    number: int, code: int, tmp_path: Path, capsys: Capture
) -> None:
    with on_the_air(LossyVehicle()) as url:
        child = started("gcs", url, "--record-to", str(tmp_path), "watch", "HEARTBEAT.type")
        assert child.stdout is not None and "HEARTBEAT.type" in child.stdout.readline()
        child.send_signal(number)
        _, errors = child.communicate(timeout=20)
    assert (child.returncode, errors) == (code, "")
    (file,) = tmp_path.iterdir()
    assert_whole(file, capsys)


def test_a_signal_ends_a_recording_as_ctrl_c_does_but_for_the_exit_code(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "a.mcap"
    with on_the_air(LossyVehicle()) as url:
        child = started("gcs", url, "record", str(file))
        assert child.stderr is not None and "recording" in child.stderr.readline()
        child.send_signal(signal.SIGTERM)
        said, _ = child.communicate(timeout=20)
    assert child.returncode == 143 and str(file) in said
    assert_whole(file, capsys)


def test_a_signal_finishes_the_log_of_a_flight_computer(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "a.mcap"
    board = ("--board", "hil:tcp:127.0.0.1:9", "--vehicle", "robo_raven_ii_d")
    child = started("avionics", *board, "--parameters", "none", "--log", str(file))
    assert child.stderr is not None
    while "waiting for the board" not in child.stderr.readline():
        assert child.poll() is None
    child.send_signal(signal.SIGTERM)
    child.communicate(timeout=20)
    assert child.returncode == 143
    assert_whole(file, capsys)


DROPPED = """
import importlib, os, signal, sys
from groundstation.command import main

class Callback:
    def __del__(self):  # Python drops what is raised in here
        os.kill(os.getpid(), signal.SIGINT)
        sum(range(1000))

def import_module(name):
    Callback()
    return importlib.__import__(name, fromlist=["run"])

main.importlib = type("Importing", (), {"import_module": staticmethod(import_module)})
sys.exit(main.main(["vehicles"]))
"""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_is_not_dropped_while_a_command_is_imported(name: str, code: int) -> None:
    words = [sys.executable, "-c", DROPPED.replace("SIGINT", name)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


def test_an_import_leaves_a_handler_of_the_caller() -> None:
    received: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: received.append(number))
    try:
        with ending.heeded(), ending.importing():
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert received == [signal.SIGTERM]


LOADED = """
import signal
import llvmlite.binding as llvm
from groundstation.command import ending

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()
calls, later = [], []

class Timer:
    def __init__(self, interval, function, args):
        later.append((function, args))

    def start(self):
        pass

ending.threading.Timer = Timer

def engine(callback):
    machine = llvm.Target.from_default_triple().create_target_machine()
    module = llvm.parse_assembly("define i32 @one() { ret i32 1 }")
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.set_object_cache(None, callback)
    return engine

def interrupted(module):
    signal.raise_signal(signal.SIGINT)
    calls.append("answered")

with ending.heeded():
    try:
        engine(interrupted).finalize_object()
        calls.append("loaded")
        ((function, args),) = later
        function(*args)
        sum(range(1000))
    except KeyboardInterrupt:
        calls.append("interrupted")
print(*calls)
"""


def test_ctrl_c_while_a_kernel_is_loaded_comes_after_it() -> None:
    """LLVM crashes without the answer of its callback, in which Python drops a KeyboardInterrupt."""
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "answered loaded interrupted\n", "")


class StubScreen:
    """Screen that is interrupted while it runs."""

    return_code: int | None = None

    def run(self) -> None:
        signal.raise_signal(signal.SIGINT)

    def exit(self, return_code: int) -> None:
        self.return_code = return_code


def test_a_signal_closes_a_screen() -> None:
    with ending.heeded():
        before = signal.getsignal(signal.SIGINT)
        assert run_screen(cast(Any, StubScreen())) == 130
        assert signal.getsignal(signal.SIGINT) == before
