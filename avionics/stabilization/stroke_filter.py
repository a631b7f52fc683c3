"""Notch filter at the measured wing frequency, to remove flapping from a signal.

A mean over the wing period would remove every harmonic, but with a delay of half a period. This delay is too long for
the pitch loop of a vehicle with a short period near half its flapping frequency. A notch has a smaller delay below
its center frequency.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from wingbeat.records import constructor


class State(NamedTuple):
    """State of the notch in transposed direct form II."""

    first: float = 0.0
    """unit of the signal"""
    second: float = 0.0
    """unit of the signal"""
    running: int = 0
    """-; 1 once the state is initialized"""


Notch = tuple[float, float, float]
"""coefficients b0 = b2, b1 = a1 and a2, normalized by a0"""


def notch(frequency: float, width: float, dt: float) -> Notch | None:
    """Return the notch at ``frequency`` (Hz) with damping ratio ``width``.

    The sample interval is ``dt`` (s). The result is None for a frequency or a width of 0. The notch is the bilinear
    transform of (s^2 + w^2) / (s^2 + 2 width w s + w^2), with its center pre-warped to be exact.
    """
    if frequency * dt < 1e-4 or frequency * dt > 0.45 or width <= 0.0:
        return None
    k = math.tan(math.pi * frequency * dt)
    kk = k * k
    norm = 1.0 / (1.0 + 2.0 * width * k + kk)
    return (1.0 + kk) * norm, 2.0 * (kk - 1.0) * norm, (1.0 - 2.0 * width * k + kk) * norm


_new_state: Final = constructor(State)


def step(state: State, signal: float, coefficients: Notch | None) -> tuple[State, float]:
    """Filter ``signal`` with the coefficients of `notch`; None passes it unchanged."""
    if coefficients is None:
        return State(), signal
    b0, b1, a2 = coefficients
    if not state.running:
        # Steady state of a constant signal: no transient when the wings start.
        state = State(signal * (1.0 - b0), signal * (b0 - a2), 1)
    filtered = b0 * signal + state.first
    first = b1 * (signal - filtered) + state.second
    return _new_state(first, b0 * signal - a2 * filtered, 1), filtered
