"""Fewer runs of Python's garbage collector while numba compiles."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

THRESHOLDS = (100_000, 50, 100)
"""of the collector: a compilation creates millions of objects that stay until its end, and each run visits them"""


@contextmanager
def fewer_collections() -> Iterator[None]:
    """Use `THRESHOLDS` during the block, which may be nested; a sixth of the compilation's time."""
    before = gc.get_threshold()
    if before[0] > 0:
        gc.set_threshold(*THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)
