"""How long ``wingbeat identify`` takes on a flight of ten minutes (``make bench``)."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rows import Row, leave

LIMIT_S = 30.0
FLIGHT_S = 600.0
LEAST_MANOEUVRES = 30
CORNERS = ((-60, 150), (-30, 60), (246, 85), (205, 102))
"""m; north and east, of a round at 40 m"""
DOUBLETS = ((7, 0.12, 1), (6, 0.18, 2), (5, 0.26, 2), (4, 0.40, 1))
"""amplitude in degrees, width in s, repeats, of each round"""
ROUNDS = 16
"""-; more than there is time for"""


def mission() -> str:
    """Rounds with doublets of all widths, until the time is over."""
    corners = [f'[[item]]\nkind = "waypoint"\nnorth = {n}\neast = {e}\naltitude = 40\n' for n, e in CORNERS]
    inputs = [
        f'[[item]]\nkind = "excite"\nchannel = "elevator"\nshape = "doublet"\namplitude_deg = {amplitude}\n'
        f"width = {width}\nsettle = 0.9\nrepeats = {repeats}\n"
        for amplitude, width, repeats in DOUBLETS
    ]
    begin = 'name = "rounds"\ntitle = "Rounds with doublets"\n\n[[item]]\nkind = "takeoff"\naltitude = 40\n'
    return "\n".join((begin, *corners[2:], *inputs, *([*corners, *inputs] * ROUNDS)))


def wingbeat(*words: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "groundstation.command.main", *words, "--json"]
    ran = subprocess.run(command, check=True, capture_output=True, text=True)
    document: dict[str, Any] = json.loads(ran.stdout)
    return document


@pytest.fixture(scope="session")
def ten_minutes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a flight of ten minutes, flown once; that identifies too, which compiles what is not yet."""
    folder = tmp_path_factory.mktemp("ten_minutes")
    plan, log = folder / "rounds.toml", folder / "flight.mcap"
    plan.write_text(mission())
    flown = wingbeat("fly", "--mission", str(plan), "--duration", str(FLIGHT_S), "--speed", "max", "--log", str(log))
    assert flown["speed"] * flown["wall_time"] >= 0.99 * FLIGHT_S
    return log


COMMAND_TO_NUMBERS = 6.0
"""-; times real time, from the command to the identified numbers of the flight of README.md"""


@pytest.mark.bench
def test_command_to_numbers(tmp_path: Path) -> None:
    """The whole of ``wingbeat fly``, which identifies, the second time; beside it the flight alone, which is its
    limit."""
    wingbeat("fly", "--duration", "20", "--log", str(tmp_path / "warm.mcap"))
    begun = time.perf_counter()
    flown = wingbeat("fly", "--log", str(tmp_path / "flight.mcap"))
    spent = time.perf_counter() - begun
    duration, limit = flown["speed"] * flown["wall_time"], flown["speed"]
    requested = f"at least {COMMAND_TO_NUMBERS:g}"
    leave(Row("command to numbers, warm", duration / spent, limit, "times real time", "the flight alone", requested))
    assert flown["identified"]
    assert duration / spent >= COMMAND_TO_NUMBERS


@pytest.mark.bench
def test_all_of_ten_minutes(ten_minutes: Path) -> None:
    """The whole command as a user starts it, the start of Python included."""
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    found = wingbeat("identify", str(ten_minutes), "all")
    spent, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    worked = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    manoeuvres = found["modes"]["manoeuvres"]
    sys.stdout.write(
        f"identify all of ten minutes, {manoeuvres} manoeuvres: {spent:.1f} s (asked: {LIMIT_S:g}), of the processor"
        f" {worked:.1f} s\n"
    )
    leave(Row("identify all of a flight of ten minutes", spent, None, "s", requested=f"at most {LIMIT_S:g}"))
    assert manoeuvres >= LEAST_MANOEUVRES
    # A servo-driven wing beats as fast as it is told, whatever the throttle.
    assert [one["name"] for one in found["missing"]] == ["flapping frequency"]
    assert all(found[name]["estimates"] for name in ("torque", "power", "load"))
    assert sum(method["frequency"] is not None for method in found["modes"]["methods"]) >= 2
    assert spent < LIMIT_S
