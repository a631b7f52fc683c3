"""How late an input acts: a pure delay, then a first-order lag, as actuators have them.

``u'_a = (u(t - delay) - u_a) / T``, solved exactly for an input that is held from each sample to the next, or that is
linear between samples. Before the record the input rests at its first value, and what follows it with it.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from logs.identification.results import Array

SHORTEST_LAG = 1e-3
"""-; of a sampling interval: a shorter lag is none"""


def behind(values: Array, step: float, delay: float, lag: float, *, held: bool) -> Array:
    """``values`` (N,), ``step`` s apart, behind a ``delay`` (s) and a time constant ``lag`` (s), in their unit.

    They are ``held`` from each sample to the next, as commands are, or else linear between samples; a delay of parts
    of a step is linear between samples in either case. A negative delay is a lead: the last value then stays.
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
