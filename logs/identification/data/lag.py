"""Delay and first-order lag of an actuator.

``u'_a = (u(t - delay) - u_a) / T``, with the exact solution for an input under a zero-order hold, or linear between
samples. Before the record the input has its first value, in equilibrium.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from logs.identification.results import Array

SHORTEST_LAG = 1e-3
"""-; of a sampling interval: a shorter lag is zero"""


def behind(values: Array, step: float, delay: float, lag: float, *, held: bool) -> Array:
    """``values`` (N,), ``step`` s apart, after a ``delay`` (s) and a time constant ``lag`` (s).

    With ``held`` they are constant from each sample to the next, as commands are, else linear between samples; a
    delay of a fraction of a step is interpolated linearly. After a negative delay, a lead, the last value
    remains.
    """
    if not len(values):
        return values.copy()
    places = np.arange(len(values), dtype=np.float64)
    late: Array = np.interp(places - delay / step, places, values)
    if lag <= SHORTEST_LAG * step:
        return late
    pole = np.exp(-step / lag)
    old = 1.0 if held else (1.0 - pole) * lag / step
    followed: Array = lfilter([1.0 - old, old - pole], [1.0, -pole], late, zi=[old * late[0]])[0]
    return followed
