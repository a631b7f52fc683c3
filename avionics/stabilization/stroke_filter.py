"""Takes the flapping out of a signal: a notch that follows the measured wing frequency.

A mean over the wing period would remove every harmonic but delays by half a period, too much for the pitch
loop of a bird whose short period is near half its flapping frequency; a notch delays less below its centre.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from wingbeat.records import constructor


class State(NamedTuple):
    """Transposed direct form II memory of the notch."""

    first: float = 0.0
    """unit of the signal"""
    second: float = 0.0
    """unit of the signal"""
    running: int = 0
    """-; 1 once the memory holds a signal"""


Notch = tuple[float, float, float]
"""coefficients b0 = b2, b1 = a1 and a2 over a0"""


def notch(frequency: float, width: float, dt: float) -> Notch | None:
    """The notch at ``frequency`` Hz with damping ratio ``width``, sampled every ``dt`` s.

    A frequency or a width of 0 gives none. Bilinear transform of (s^2 + w^2) / (s^2 + 2 width w s + w^2), its centre
    pre-warped to be exact.
    """
    if frequency * dt < 1e-4 or frequency * dt > 0.45 or width <= 0.0:
        return None
    k = math.tan(math.pi * frequency * dt)
    kk = k * k
    norm = 1.0 / (1.0 + 2.0 * width * k + kk)
    return (1.0 + kk) * norm, 2.0 * (kk - 1.0) * norm, (1.0 - 2.0 * width * k + kk) * norm


_new_state = constructor(State)


def step(state: State, signal: float, coefficients: Notch | None) -> tuple[State, float]:
    """Filter ``signal`` by what `notch` gives; None passes it on."""
    if coefficients is None:
        return State(), signal
    b0, b1, a2 = coefficients
    if not state.running:
        # The memory of a signal that has always had this value: no jump when the wings start.
        state = State(signal * (1.0 - b0), signal * (b0 - a2), 1)
    filtered = b0 * signal + state.first
    first = b1 * (signal - filtered) + state.second
    return _new_state(first, b0 * signal - a2 * filtered, 1), filtered
