"""Roll loop: roll setpoint -> roll command (Malladi 2007, section IV.A: inner bank angle loop)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import clip
from avionics.messages import RollStatus
from avionics.quantities import Quantity


class Gains(NamedTuple):
    """What the roll loop is tuned with."""

    proportional: Annotated[float, Quantity("1/rad", 0.0, 20.0)]
    """1/rad; roll command per roll error"""
    integral: Annotated[float, Quantity("1/(rad s)", 0.0, 20.0)]
    """1/(rad s); roll command per second and roll error"""
    damping: Annotated[float, Quantity("s/rad", 0.0, 5.0)]
    """s/rad; roll command taken off per roll rate"""
    integral_max: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; greatest share of the integral in the roll command"""
    stick_roll: Annotated[float, Quantity("rad", 0.0, 1.2)]
    """rad; roll setpoint at full stick (stabilized, altitude hold)"""


class State(NamedTuple):
    """What the roll loop remembers."""

    integral: float = 0.0
    """-; of roll command"""


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: tuple[float, float]
) -> tuple[State, RollStatus]:
    """One step; ``setpoint`` in rad, ``measured`` is (roll in rad, roll rate in rad/s)."""
    roll, roll_rate = measured
    error = setpoint - roll
    proportional, damping = gains.proportional * error, -gains.damping * roll_rate
    grown = clip(state.integral + gains.integral * error * dt, -gains.integral_max, gains.integral_max)
    wanted = proportional + grown + damping
    saturated = abs(wanted) > 1.0
    if saturated and wanted * error > 0.0:
        grown = state.integral
    command = clip(proportional + grown + damping, -1.0, 1.0)
    status = RollStatus(time_us, setpoint, error, proportional, grown, damping, command, int(saturated))
    return State(grown), status


def follow(time_us: int, stick: float) -> tuple[State, RollStatus]:
    """The pilot's roll command (-1 to 1), so that the loop takes over without a stored integral."""
    return State(), RollStatus(time_us, 0.0, 0.0, 0.0, 0.0, 0.0, clip(stick, -1.0, 1.0), 0)
