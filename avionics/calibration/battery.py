"""Battery calibration: voltage divider and current zero, with the drives at rest."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.calibration.result import Result, Setting, Took
from avionics.messages import AdcBurst
from avionics.sensing.power import Gains, averages

AT_REST = 100
"""bursts; duration of the measurement: one second"""
MOST_SCATTER = 0.2
"""A; maximum standard deviation of the current at rest: more indicates a running drive"""
GREATEST_CURRENT = 2.0
"""A; maximum current at rest; more indicates a running drive or a defect"""
RATIOS = (0.7, 1.4)
"""-; range of the ratio of given to measured voltage"""


class State(NamedTuple):
    """Collected samples."""

    samples: int = 0
    """-; bursts"""
    voltage: float = 0.0
    """V; sum"""
    current: float = 0.0
    """A; sum"""
    current_square: float = 0.0
    """A^2; sum"""


def step(gains: Gains, state: State, burst: AdcBurst) -> tuple[State, Took]:
    """Add a burst at rest."""
    voltage, current, _ = averages(gains, burst)
    state = State(
        state.samples + 1,
        state.voltage + voltage,
        state.current + current,
        state.current_square + current * current,
    )
    return state, Took(complete=state.samples >= AT_REST)


def progress(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    return state.samples / AT_REST


def finish(state: State, gains: Gains, given: float) -> tuple[Result, str]:
    """Return divider and current zero, and an error text (empty on success).

    The divider is that of the ``given`` voltage (V; 0 keeps it).
    """
    voltage, current = state.voltage / state.samples, state.current / state.samples
    scatter = math.sqrt(max(0.0, state.current_square / state.samples - current * current))
    # With power on the drives draw a small current at rest, which is not part of the zero.
    zero = gains.current_zero + (current - gains.rest_current) * gains.current_sensitivity
    settings: tuple[Setting, ...] = (Setting("power", "current_zero", -1, zero),)
    result = Result(settings, scatter, "A", state.samples)
    if scatter > MOST_SCATTER or abs(current) > GREATEST_CURRENT:
        return result, "current not zero: keep the drives at rest"
    if given == 0.0:
        return result, ""
    ratio = (voltage - gains.voltage_offset) / (given - gains.voltage_offset)
    if not RATIOS[0] <= ratio <= RATIOS[1]:
        return result, f"given {given:.2f} V differs from measured {voltage:.2f} V"
    divider = Setting("power", "divider", -1, gains.divider * ratio)
    return result._replace(settings=(*settings, divider)), ""
