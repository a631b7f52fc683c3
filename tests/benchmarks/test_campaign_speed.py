"""How a campaign grows with its workers, and whether its memory does with its flights (``make bench``)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rows import Row, leave

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "gusts.toml"
FASTER = 1.8
"""-; asked of two workers against one"""
MANY = "flights = 500\n[flight]\nduration = 3.0\n[draw]\n'wind.speed' = { uniform = [0.0, 3.0] }\n"
SETTLED = 100
"""-; flights, after which nothing is new to a process any more"""
GROWTH = 0.05
"""-; of the memory from there on to the end, that allocators may make"""
WINGBEAT = (sys.executable, "-m", "groundstation.command.main", "campaign")


def send(line: str) -> None:
    sys.stdout.write(line + "\n")


def simulate(folder: Path, workers: int) -> tuple[float, dict[str, Any], bytes]:
    """s of wall time, what was told, and the table."""
    table = folder / f"{workers}.parquet"
    command = [*WINGBEAT, str(EXAMPLE), "--workers", str(workers), "--out", str(table), "--json"]
    begun = time.perf_counter()
    ran = subprocess.run(command, check=True, capture_output=True, text=True)
    return time.perf_counter() - begun, json.loads(ran.stdout), table.read_bytes()


@pytest.mark.bench
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two cores")
def test_two_workers_against_one(tmp_path: Path) -> None:
    """Whole commands, starting the workers included."""
    alone, told, table = simulate(tmp_path, 1)
    together, _, same = simulate(tmp_path, 2)
    flights = told["flights"]
    speed = 60 * flights / alone
    send(f"campaign, 1 worker       {alone:6.1f} s for {flights} flights of 60 s, {speed:.1f} times real time")
    send(f"campaign, 2 workers      {together:6.1f} s, {alone / together:.2f} times faster (asked: {FASTER:g})")
    requested = f"at least {FASTER:g}"
    leave(Row("campaign of 60 flights, two workers", alone / together, None, "times one worker", requested=requested))
    assert same == table
    assert alone / together >= FASTER


def tree(pid: int) -> list[int]:
    """A process and those that it has started."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    found = [pid]
    for parent in found:
        found += [child for child, above in parents.items() if above == parent]
    return found


def memory(pid: int) -> float:
    """MB; resident, of a process and those that it has started."""
    total = 0
    for one in tree(pid):
        try:
            total += int(Path(f"/proc/{one}/statm").read_text().split()[1])
        except OSError:
            continue
    return total * os.sysconf("SC_PAGE_SIZE") * 1e-6


@pytest.mark.bench
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads /proc")
def test_memory_over_five_hundred_flights(tmp_path: Path) -> None:
    (tmp_path / "many.toml").write_text(MANY)
    journal = tmp_path / "recordings" / "many.parquet.flights"
    process = subprocess.Popen([*WINGBEAT, "many.toml", "--workers", "1"], cwd=tmp_path, stderr=subprocess.DEVNULL)
    seen: list[tuple[int, float]] = []

    def watch() -> None:
        while process.poll() is None:
            if journal.exists():
                seen.append((len(journal.read_bytes().splitlines()) - 1, memory(process.pid)))
            time.sleep(0.5)

    watcher = threading.Thread(target=watch)
    watcher.start()
    assert process.wait() == 0
    watcher.join()
    flights, used = np.array([(done, size) for done, size in seen if done >= SETTLED and size > 0]).T
    early, late = used[flights < SETTLED + 50], used[flights > flights.max() - 50]
    send(f"campaign, memory         {np.median(early):6.0f} MB after 100 flights, {np.median(late):.0f} MB after 500")
    growth = float(np.median(late) / np.median(early))
    requested = f"at most {1.0 + GROWTH:g}"
    leave(Row("campaign, memory after 500 flights", growth, None, "times after 100", requested=requested))
    assert np.median(late) < (1.0 + GROWTH) * np.median(early)
