"""CPU affinity and scheduling priority: a lockstep pair shares a core or has two."""

from __future__ import annotations

import os
import time
from pathlib import Path

LOOKS, PAUSE = 20, 0.003
"""-, s; samples of the running programs to detect idle cores, and their interval"""
_LOAD, _CORES = Path("/proc/loadavg"), Path("/proc/stat")


def pin_to_core(core: int | None = None) -> int | None:
    """Pin this process to one core; return it, or None if not possible.

    The core is ``core``, or the last available one, which both ends of a pair select.
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
    """Return the two available cores with the longest idle time, None if in demand.

    A lockstep pair with busy polling on separate cores needs three quarters of the time of a tick on a shared core,
    on which each end evicts the caches of the other. The cost is the core of the waiting end.
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
    """Return the idle time of each core in system ticks; empty if unavailable."""
    try:
        rows = [line.split() for line in _CORES.read_text(encoding="ascii").splitlines() if line[:3] == "cpu"]
        return {int(row[0][3:]): int(row[4]) + int(row[5]) for row in rows if row[0] != "cpu"}
    except (OSError, ValueError, IndexError):
        return {}


def _running() -> float:
    """Return the mean number of other running programs during 60 ms.

    If that is unavailable, the result is the load average.
    """
    seen = 0
    for _ in range(LOOKS):
        time.sleep(PAUSE)
        try:
            seen += int(_LOAD.read_text(encoding="ascii").split()[3].partition("/")[0]) - 1
        except (OSError, ValueError, IndexError):
            return os.getloadavg()[0]
    return seen / LOOKS


def run_before_others() -> bool:
    """Request a real-time schedule for this thread and those that it starts.

    It is for a flight in real time, in which a ground station on the same core could delay a tick. Returns whether
    the system has such a schedule and permits it (on Linux: root, or a limit of ``rtprio``).
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
    except OSError:
        return False
    return True
