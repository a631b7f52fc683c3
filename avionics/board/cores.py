"""Which core a process runs on, and before whom: a pair in lockstep shares one or has two."""

from __future__ import annotations

import os
import time
from pathlib import Path

LOOKS, PAUSE = 20, 0.003
"""-, s; at what runs, to tell whether cores are idle"""
_LOAD, _CORES = Path("/proc/loadavg"), Path("/proc/stat")


def pin_to_core(core: int | None = None) -> int | None:
    """Keep this process on one core: ``core``, or the last one it may use, which both ends of a pair agree on.

    Returns the core, or None where the platform cannot do it or does not allow it.
    """
    if not hasattr(os, "sched_setaffinity"):
        return None
    chosen = max(os.sched_getaffinity(0)) if core is None else core
    try:
        os.sched_setaffinity(0, {chosen})
    except OSError:
        return None
    return chosen


def idle_pair() -> tuple[int, int] | None:
    """The two of the cores that this process may use that were idle longest; None where others want them.

    A lockstep pair on cores of their own, neither end of which sleeps, does a tick in three quarters of the time that
    it takes on a shared one, where each finds the caches full of the other's. That costs the waiting end's core.
    """
    if not hasattr(os, "sched_getaffinity"):
        return None
    cores = sorted(os.sched_getaffinity(0))
    before = _idled()
    if len(cores) < 2 or _running() > len(cores) - 1.5:
        return None
    after = _idled()
    *_, second, first = sorted(cores, key=lambda core: (after.get(core, 0) - before.get(core, 0), core))
    return first, second


def _idled() -> dict[int, int]:
    """For how long each core has had nothing to do, in ticks of the system; none where that is not told."""
    try:
        rows = [line.split() for line in _CORES.read_text(encoding="ascii").splitlines() if line[:3] == "cpu"]
        return {int(row[0][3:]): int(row[4]) + int(row[5]) for row in rows if row[0] != "cpu"}
    except (OSError, ValueError, IndexError):
        return {}


def _running() -> float:
    """Mean number of programs that run, this one aside, during the next 60 ms; where that is not told, the load."""
    seen = 0
    for _ in range(LOOKS):
        time.sleep(PAUSE)
        try:
            seen += int(_LOAD.read_text(encoding="ascii").split()[3].partition("/")[0]) - 1
        except (OSError, ValueError, IndexError):
            return os.getloadavg()[0]
    return seen / LOOKS


def run_before_others() -> bool:
    """Let this thread, and those that it starts, run as soon as they can, before programs of no fixed schedule.

    For a flight that keeps the pace of the clock: a tick that waits on its core for a ground station is late.
    Returns whether the system has such a schedule and allows it (on Linux: root, or a limit of ``rtprio``).
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
    except OSError:
        return False
    return True
