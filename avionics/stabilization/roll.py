"""Roll loop: roll setpoint to roll command.

Inner bank angle loop of Malladi 2007, section IV.A.
"""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.limits import clip, fade_out
from avionics.messages import RollStatus
from avionics.stabilization.dynamic_pressure import share
from wingbeat.records import constructor
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """Parameters of the roll loop."""

    proportional: Annotated[float, Quantity("1/rad", 0.0, 20.0)]
    """1/rad; roll command per roll error"""
    integral: Annotated[float, Quantity("1/(rad s)", 0.0, 20.0)]
    """1/(rad s); roll command rate per roll error"""
    damping: Annotated[float, Quantity("s/rad", 0.0, 5.0)]
    """s/rad; roll command decrease per roll rate"""
    integral_max: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.3
    """-; limit of the integrator. Default: leaves control authority to the proportional term"""
    stick_roll: Annotated[float, Quantity("rad", 0.0, 1.2)] = 0.6
    """rad; roll setpoint at full stick (stabilized, altitude hold). Default: slightly above the maximum bank"""
    release_time: Annotated[float, Quantity("s", 0.0, 10.0)] = 0.15
    """s; time constant of the transition from a frozen loop to the active loop. Default: no step of the tail, and an
    active loop before the attitude changes"""
    airspeed: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; reference airspeed of the gains, which scale with the dynamic pressure; 0 for constant gains"""
    law: Annotated[str, Label()] = "pid"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """State of the roll loop."""

    integral: float = 0.0
    """-; integrator of the roll command"""
    bridge: float = 0.0
    """-; roll command offset that decays after the loop resumes"""


class Measured(NamedTuple):
    """Measurements used by the roll loop."""

    roll: float
    """rad; positive right wing down"""
    roll_rate: float
    """rad/s"""
    airspeed: float = 0.0
    """m/s; 0 if unknown"""


_new_state: Final = constructor(State)
_new_roll_status: Final = constructor(RollStatus)


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, RollStatus]:
    """Advance the roll loop by ``dt`` (s) toward ``setpoint`` (rad)."""
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
    """Return the trim of the integrator during an excitation of the rudder.

    The difference from the output of the loop is stored for a bumpless transfer.
    """
    roll, roll_rate, airspeed = measured
    error, strength = setpoint - roll, share(gains.airspeed, airspeed)
    asked = strength * (gains.proportional * error - gains.damping * roll_rate) + state.integral
    status = RollStatus(time_us, setpoint, error, 0.0, state.integral, 0.0, state.integral, 0)
    return state._replace(bridge=state.integral - asked), status


def follow(time_us: int, stick: float) -> tuple[State, RollStatus]:
    """Track the pilot's roll command (-1 to 1); the integrator is reset."""
    return State(), RollStatus(time_us, 0.0, 0.0, 0.0, 0.0, 0.0, clip(stick, -1.0, 1.0), 0)
