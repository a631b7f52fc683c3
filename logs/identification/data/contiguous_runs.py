"""Contiguous runs of samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs(mask: NDArray[np.bool_]) -> list[slice]:
    """The contiguous runs in which ``mask`` (N,) is true, in order."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    return [slice(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def longest_run(mask: NDArray[np.bool_]) -> slice:
    """The first of the longest `runs`; an empty slice if there is none."""
    return max(runs(mask), key=lambda run: run.stop - run.start, default=slice(0, 0))
