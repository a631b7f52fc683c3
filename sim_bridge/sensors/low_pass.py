"""First-order low-pass filter of a signal sampled at the ticks."""

from __future__ import annotations

import math
from typing import NamedTuple


class LowPass(NamedTuple):
    """Coefficients of ``y' = keep y + before x + now x'`` (old and new values)."""

    keep: float
    before: float
    now: float


def low_pass(time_constant: float, period: float) -> LowPass:
    """Filter of ``time_constant`` s sampled every ``period`` s; 0 passes the signal.

    Exact for a signal that is a straight line between two ticks (ramp-invariant discretisation). What the
    signal does between the ticks is not seen: content above half the tick rate has already folded down.
    """
    if time_constant <= 0.0:
        return LowPass(0.0, 0.0, 1.0)
    keep = math.exp(-period / time_constant)
    mean = (1.0 - keep) * time_constant / period
    return LowPass(keep, mean - keep, 1.0 - mean)


def corner(bandwidth: float) -> float:
    """Time constant in s of a first-order corner at ``bandwidth`` Hz; 0 Hz means no filter."""
    return 0.0 if bandwidth == 0.0 else 1.0 / (math.tau * bandwidth)
