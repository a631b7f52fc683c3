"""How long commands take before they do anything: processor time, the least of several (``make bench``)."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rows import Row, leave

from logs.campaigns.campaign import load_campaign
from logs.campaigns.run import order_of
from logs.campaigns.single_flight import Recording, fly_one

LOADED = 'load_vehicle("robo_raven_ii_d")'
TIMES = 7
"""-; that each is started: what the machine does beside it only ever adds"""


def started(*words: str) -> float:
    """s; of the processor, for the whole command as a user starts it."""
    return spent_by([sys.executable, "-m", "groundstation.command.main", *words], TIMES)


def spent_by(command: list[str], times: int, environment: dict[str, str] | None = None) -> float:
    """s; least processor time of a program with its children."""
    least = float("inf")
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        least = min(least, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return least


def report(command: str, spent: float, requested: float) -> None:
    alone = spent_by([sys.executable, "-c", "pass"], TIMES)
    leave(Row(f"{command}, processor time", spent, alone, "s", "Python alone", f"at most {requested:g}"))
    assert spent < requested


@pytest.mark.bench
def test_the_list_of_commands() -> None:
    report("wingbeat --help", started("--help"), 0.06)


@pytest.mark.bench
def test_the_import_of_the_package() -> None:
    report("import wingbeat", spent_by([sys.executable, "-c", "import wingbeat"], TIMES), 0.15)


@pytest.mark.bench
def test_the_first_compilation(tmp_path: Path) -> None:
    """The physics by two processes into an empty cache, as before the first flight."""
    code = f"from groundstation.command.compiling import *; from sim_bridge.vehicles import *; load_physics({LOADED})"
    begun = time.perf_counter()
    spent = spent_by([sys.executable, "-c", code], 1, os.environ | {"WINGBEAT_CACHE": str(tmp_path)})
    leave(Row("physics compiled, wall time", time.perf_counter() - begun, None, "s"))
    report("physics compiled", spent, 30.0)


@pytest.mark.bench
def test_a_look_into_a_log(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text("[flight]\nduration = 60.0\n")
    log = tmp_path / "flight.mcap"
    assert not fly_one(order_of(load_campaign(tmp_path / "one.toml"), 1, Recording(log)))["failed"]
    report("wingbeat log info", started("log", "info", str(log)), 0.6)
