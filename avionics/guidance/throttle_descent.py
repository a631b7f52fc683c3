"""Descent by throttle without an elevator: sink-rate integrator and pitch damper.

As in propulsion-controlled flight (Burcham et al. 1998, NASA/TM-1998-206552), the flight path follows the throttle
slowly; quick changes only excite the phugoid. The thrust acts above the center of mass, so that more throttle lowers
the nose. Throttle in proportion to the pitch above its mean therefore damps the phugoid; the usual climb-rate
feedback destabilizes it. Without a rudder, thrust in a bank tightens the spiral: the throttle is then at most
that of level flight.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import clip, low_pass
from wingbeat.units import Quantity

STEEP, STEEPEST = 0.2, 0.5
"""rad; bank at which the maximum throttle starts to fall, and at which it reaches that of level flight"""


class Gains(NamedTuple):
    """Parameters of the throttle descent."""

    sink: Annotated[float, Quantity("m/s", 0.1, 10.0)] = 0.8
    """m/s; sink rate setpoint, positive down, without a flare. Default: less than half of the limit for a belly
    landing"""
    integral: Annotated[float, Quantity("1/m", 0.0, 1.0)] = 0.03
    """1/m; throttle rate per climb-rate error"""
    throttle_rate: Annotated[float, Quantity("1/s", 0.0, 5.0)] = 0.06
    """1/s; slew rate limit of the mean throttle. Default: from full throttle to none in 17 s, four phugoids"""
    throttle_min: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.0
    """-; minimum throttle"""
    pitch: Annotated[float, Quantity("1/rad", 0.0, 10.0)] = 1.0
    """1/rad; throttle per pitch above its mean"""
    pitch_time: Annotated[float, Quantity("s", 0.1, 60.0)] = 4.0
    """s; time constant of the mean pitch. Default: a phugoid"""


class State(NamedTuple):
    """State of the throttle descent."""

    active: int = 0
    """-; 1 once active"""
    throttle: float = 0.0
    """-; mean throttle"""
    pitch: float = 0.0
    """rad; mean pitch"""


class Measured(NamedTuple):
    """Measurements used by the throttle descent."""

    climb_rate: float
    """m/s; positive up"""
    pitch: float
    """rad; stroke-filtered pitch, positive nose up"""


def upper_limit(level: float, most: float, bank: float) -> float:
    """Return the maximum throttle at a ``bank`` (rad), from ``most`` to that of ``level`` flight."""
    share = clip((abs(bank) - STEEP) / (STEEPEST - STEEP), 0.0, 1.0)
    return (1.0 - share) * most + share * level


def step(
    gains: Gains, state: State, dt: float, throttle: float, throttle_max: float, measured: Measured
) -> tuple[State, float]:
    """Return the throttle for the next ``dt`` (s).

    The first step continues from ``throttle``, the value of the previous step. ``throttle_max`` is the upper limit.
    """
    if not state.active:
        state = State(1, throttle, measured.pitch)
    climb_error = -gains.sink - measured.climb_rate
    rate = clip(gains.integral * climb_error, -gains.throttle_rate, gains.throttle_rate)
    mean = clip(state.throttle + rate * dt, gains.throttle_min, throttle_max)
    pitch = low_pass(state.pitch, measured.pitch, gains.pitch_time, dt)
    wanted = mean + gains.pitch * (measured.pitch - pitch)
    return State(1, mean, pitch), clip(wanted, gains.throttle_min, throttle_max)
