"""How long commands take before they do anything: processor time, the least of several (``make bench``)."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest
from rows import Row, leave

from logs.campaigns.campaign import load_campaign
from logs.campaigns.run import order_of
from logs.campaigns.single_flight import Recording, fly_one

TIMES = 7
"""-; that each is started: what the machine does beside it only ever adds"""


def started(*words: str) -> float:
    """s; of the processor, for the whole command as a user starts it."""
    return python("-m", "groundstation.command.main", *words)


def python(*words: str) -> float:
    """s; of the processor, for a Python process with these arguments."""
    least = float("inf")
    for _ in range(TIMES):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        least = min(least, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return least


def report(command: str, spent: float, requested: float) -> None:
    row = Row(
        f"{command}, processor time", spent, python("-c", "pass"), "s", "Python alone", f"at most {requested:g}"
    )
    leave(row)
    assert spent < requested


@pytest.mark.bench
def test_import_of_package() -> None:
    report("import wingbeat", python("-c", "import wingbeat"), 0.15)


@pytest.mark.bench
def test_the_list_of_commands() -> None:
    report("wingbeat --help", started("--help"), 0.06)


@pytest.mark.bench
def test_a_look_into_a_log(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text("[flight]\nduration = 60.0\n")
    log = tmp_path / "flight.mcap"
    assert not fly_one(order_of(load_campaign(tmp_path / "one.toml"), 1, Recording(log)))["failed"]
    report("wingbeat log info", started("log", "info", str(log)), 0.6)
