"""Tail mixer: elevator and roll command to tail servos and stroke asymmetry."""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.limits import clip, slew
from wingbeat.records import constructor
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Mixing gains and limits of the tail."""

    rudder_share: Annotated[float, Quantity("rad", -1.5, 1.5)]
    """rad; rudder at full roll command"""
    yaw_share: Annotated[float, Quantity("rad", -1.5, 1.5)]
    """rad; rudder at full yaw stick"""
    asymmetry_share: Annotated[float, Quantity("-", -0.5, 0.5)]
    """-; stroke asymmetry at full roll command (servo drives)"""
    elevator_min: Annotated[float, Quantity("rad", -1.5, 0.0)]
    """rad; maximum nose-down travel"""
    elevator_max: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """rad; maximum nose-up travel"""
    rudder_max: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """rad; maximum travel to each side"""
    servo_rate: Annotated[float, Quantity("rad/s", 0.5, 100.0)]
    """rad/s; rate limit of the tail servo commands"""


class State(NamedTuple):
    """State of the tail mixer."""

    elevator: float = 0.0
    """rad; last command"""
    rudder: float = 0.0
    """rad; last command"""


class TailCommand(NamedTuple):
    """Inputs of the tail mixer from the loops, the pilot and the excitation."""

    elevator: float
    """rad; output of the pitch loop"""
    roll_command: float
    """-; from -1 to 1, positive rolls right"""
    yaw_stick: float
    """-; from -1 to 1, positive yaws right"""
    added_elevator: float
    """rad; excitation"""
    added_rudder: float
    """rad; excitation"""
    exciting: int
    """-; 1 while an excitation is active"""


class Tail(NamedTuple):
    """Outputs of the tail mixer, and the applied excitation."""

    elevator: float
    """rad; positive pitches the nose up"""
    rudder: float
    """rad; positive yaws the nose right"""
    asymmetry: float
    """-; relative increase of the left stroke"""
    applied_elevator: float
    """rad; excitation after limits and rate"""
    applied_rudder: float
    """rad; excitation after limits and rate"""


_new_state: Final = constructor(State)
_new_tail: Final = constructor(Tail)


def step(gains: Gains, state: State, dt: float, command: TailCommand) -> tuple[State, Tail]:
    """Advance the tail mixer by ``dt`` (s)."""
    rudder_alone = gains.rudder_share * command.roll_command + gains.yaw_share * command.yaw_stick
    wanted_elevator = clip(command.elevator + command.added_elevator, gains.elevator_min, gains.elevator_max)
    wanted_rudder = clip(rudder_alone + command.added_rudder, -gains.rudder_max, gains.rudder_max)
    elevator = slew(state.elevator, wanted_elevator, gains.servo_rate, dt)
    rudder = slew(state.rudder, wanted_rudder, gains.servo_rate, dt)
    applied_elevator = elevator - command.elevator if command.exciting else 0.0
    applied_rudder = rudder - rudder_alone if command.added_rudder else 0.0
    asymmetry = gains.asymmetry_share * command.roll_command
    tail = _new_tail(elevator, rudder, asymmetry, applied_elevator, applied_rudder)
    return _new_state(elevator, rudder), tail
