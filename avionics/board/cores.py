"""Which core a process runs on, and before whom: a lockstep pair shares one, real time waits for nobody."""

from __future__ import annotations

import os


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
