"""Both processes of a lockstep pair on one core: they never run at once, and share its cache."""

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
