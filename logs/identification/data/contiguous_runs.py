"""Runs of samples: the stretches on which something holds, such as that a signal was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs(mask: NDArray[np.bool_]) -> list[slice]:
    """The stretches on which ``mask`` (N,) holds, in order, each as long as it goes."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    return [slice(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def longest_run(mask: NDArray[np.bool_]) -> slice:
    """The longest of the `runs`, of those as long as each other the first; an empty slice where there is none."""
    return max(runs(mask), key=lambda run: run.stop - run.start, default=slice(0, 0))
