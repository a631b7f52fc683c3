"""Minimum and maximum of groups of samples for plots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GAP_PERIODS = 4.0
"""Gap threshold in median periods: no line is drawn across a gap."""


class Envelope(NamedTuple):
    """Decimated columns on one time base; a row of NaN marks a gap."""

    time: Array
    """s"""
    low: Mapping[str, Array]
    high: Mapping[str, Array] | None
    """None if every sample was kept and equals ``low``"""


def thinned(time: Array, fields: Mapping[str, Array], limit: int) -> Envelope:
    """Decimate columns at ``time`` (s, nondecreasing) to ``limit`` rows, plus those of gaps."""
    count = -(-len(time) // limit)
    starts = np.arange(0, len(time), count)
    middle = np.minimum(starts + count // 2, len(time) - 1)
    rows = np.searchsorted(_breaks(time[starts]), np.arange(len(starts)), side="left") + np.arange(len(starts))
    low = {name: _spread(np.fmin.reduceat(values, starts), rows) for name, values in fields.items()}
    high = {name: _spread(np.fmax.reduceat(values, starts), rows) for name, values in fields.items()}
    return Envelope(_filled(_spread(time[middle], rows)), low, high if count > 1 else None)


def _breaks(time: Array) -> NDArray[np.int64]:
    """Rows after which there is a gap."""
    periods = np.diff(time)
    usual = float(np.median(periods)) if len(periods) else 0.0
    return np.flatnonzero(periods > GAP_PERIODS * usual) if usual > 0.0 else np.empty(0, np.int64)


def _spread(values: Array, rows: NDArray[np.int64]) -> Array:
    """``values`` at ``rows``, NaN in the rows between."""
    out = np.full(int(rows[-1]) + 1, np.nan)
    out[rows] = values
    return out


def _filled(time: Array) -> Array:
    """A gap begins with its last sample."""
    missing = np.flatnonzero(np.isnan(time))
    time[missing] = time[missing - 1]
    return time
