"""Descent by throttle alone, without an elevator: a slow sink-rate integrator and a pitch damper on the throttle.

As in propulsion-controlled flight (Burcham et al. 1998, NASA/TM-1998-206552), the flight path follows the throttle
slowly; quick changes only excite the phugoid. Flapping pushes above the center of mass, so more throttle lowers the
nose. Throttle added in proportion to the pitch above its mean therefore damps the phugoid; the usual climb-rate
feedback drives it.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import clip, low_pass
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """How throttle replaces the elevator."""

    sink: Annotated[float, Quantity("m/s", 0.1, 10.0)] = 0.8
    """m/s; sink rate to fly, positive down: there is no flare. Default: less than half of what a belly landing is
    promised"""
    integral: Annotated[float, Quantity("1/m", 0.0, 1.0)] = 0.03
    """1/m; throttle per second and climb-rate error"""
    throttle_rate: Annotated[float, Quantity("1/s", 0.0, 5.0)] = 0.06
    """1/s; how fast the mean throttle may change. Default: from full throttle to none in 17 s, four phugoids"""
    throttle_min: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.0
    """-; least throttle"""
    pitch: Annotated[float, Quantity("1/rad", 0.0, 10.0)] = 1.0
    """1/rad; throttle per pitch above its mean"""
    pitch_time: Annotated[float, Quantity("s", 0.1, 60.0)] = 4.0
    """s; time constant of the mean pitch. Default: a phugoid"""


class State(NamedTuple):
    """Memory of the descent."""

    active: int = 0
    """-; 1 once begun"""
    throttle: float = 0.0
    """-; mean throttle"""
    pitch: float = 0.0
    """rad; mean pitch"""


class Measured(NamedTuple):
    """Measurements that the descent uses."""

    climb_rate: float
    """m/s; positive up"""
    pitch: float
    """rad; without the flapping, nose up is positive"""


def step(gains: Gains, state: State, dt: float, throttle: float, measured: Measured) -> tuple[State, float]:
    """Return the throttle of the next ``dt`` s; the first step continues from ``throttle``, the last one flown."""
    if not state.active:
        state = State(1, throttle, measured.pitch)
    climb_error = -gains.sink - measured.climb_rate
    rate = clip(gains.integral * climb_error, -gains.throttle_rate, gains.throttle_rate)
    mean = clip(state.throttle + rate * dt, gains.throttle_min, 1.0)
    pitch = low_pass(state.pitch, measured.pitch, gains.pitch_time, dt)
    wanted = mean + gains.pitch * (measured.pitch - pitch)
    return State(1, mean, pitch), clip(wanted, gains.throttle_min, 1.0)
