"""Roll loop: roll setpoint -> roll command (Malladi 2007, section IV.A: inner bank angle loop)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import clip, fade_out
from avionics.messages import RollStatus
from avionics.stabilization.dynamic_pressure import share
from wingbeat.records import constructor
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """What the roll loop is tuned with."""

    proportional: Annotated[float, Quantity("1/rad", 0.0, 20.0)]
    """1/rad; roll command per roll error"""
    integral: Annotated[float, Quantity("1/(rad s)", 0.0, 20.0)]
    """1/(rad s); roll command per second and roll error"""
    damping: Annotated[float, Quantity("s/rad", 0.0, 5.0)]
    """s/rad; roll command taken off per roll rate"""
    integral_max: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.3
    """-; greatest share of the integral in the roll command. Default: leaves the loop its authority"""
    stick_roll: Annotated[float, Quantity("rad", 0.0, 1.2)] = 0.6
    """rad; roll setpoint at full stick (stabilized, altitude hold). Default: the greatest bank and a little more"""
    release_time: Annotated[float, Quantity("s", 0.0, 10.0)] = 0.15
    """s; time constant with which the command of a frozen loop gives way to the loop's. Default: no step of the
    tail, and the loop back before the attitude has moved on"""
    airspeed: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; at which the gains hold; they go with the dynamic pressure, 0 for the same gains at any airspeed"""
    law: Annotated[str, Label()] = "pid"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """What the roll loop remembers."""

    integral: float = 0.0
    """-; of roll command"""
    bridge: float = 0.0
    """-; of roll command: what a frozen loop held beyond what the loop asks, fading out"""


class Measured(NamedTuple):
    """What the loop looks at."""

    roll: float
    """rad; right wing down is positive"""
    roll_rate: float
    """rad/s"""
    airspeed: float = 0.0
    """m/s; 0 while unknown"""


_new_state = constructor(State)
_new_roll_status = constructor(RollStatus)


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, RollStatus]:
    """One step; ``setpoint`` in rad."""
    roll, roll_rate, airspeed = measured
    error, strength = setpoint - roll, share(gains.airspeed, airspeed)
    proportional, damping = strength * gains.proportional * error, -strength * gains.damping * roll_rate
    grown = clip(state.integral + strength * gains.integral * error * dt, -gains.integral_max, gains.integral_max)
    wanted = proportional + grown + damping
    saturated = abs(wanted) > 1.0
    if saturated and wanted * error > 0.0:
        grown = state.integral
    bridge = fade_out(state.bridge, gains.release_time, dt) if state.bridge else 0.0
    command = clip(proportional + grown + damping + bridge, -1.0, 1.0)
    status = _new_roll_status(time_us, setpoint, error, proportional, grown, damping, command, 1 if saturated else 0)
    return _new_state(grown, bridge), status


def hold_trim(
    gains: Gains, state: State, time_us: int, setpoint: float, measured: Measured
) -> tuple[State, RollStatus]:
    """Frozen for an excitation of the rudder: the integral, which is the trim, and nothing else.

    What the loop would ask meanwhile is remembered as a difference, so that it takes over without a jump.
    """
    roll, roll_rate, airspeed = measured
    error, strength = setpoint - roll, share(gains.airspeed, airspeed)
    asked = strength * (gains.proportional * error - gains.damping * roll_rate) + state.integral
    status = RollStatus(time_us, setpoint, error, 0.0, state.integral, 0.0, state.integral, 0)
    return state._replace(bridge=state.integral - asked), status


def follow(time_us: int, stick: float) -> tuple[State, RollStatus]:
    """The pilot's roll command (-1 to 1), so that the loop takes over without a stored integral."""
    return State(), RollStatus(time_us, 0.0, 0.0, 0.0, 0.0, 0.0, clip(stick, -1.0, 1.0), 0)
