"""Heading loop: course or heading error -> roll setpoint (Malladi 2007, section IV.A: proportional)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.limits import clip, slew, wrap
from avionics.messages import HeadingStatus
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """What the heading loop is tuned with."""

    proportional: Annotated[float, Quantity("-", 0.0, 5.0)]
    """-; roll setpoint per heading error"""
    integral: Annotated[float, Quantity("1/s", 0.0, 2.0)] = 0.0
    """1/s; roll setpoint per second and heading error. Default: the course is steered, and the wind is in it"""
    integral_max: Annotated[float, Quantity("rad", 0.0, 0.5)] = 0.1
    """rad; greatest share of the integral. Default: leaves the loop its authority"""
    roll_max: Annotated[float, Quantity("rad", 0.05, 1.2)] = 0.5
    """rad; greatest bank asked for. Default: a load factor of 1.14"""
    roll_rate: Annotated[float, Quantity("rad/s", 0.05, 10.0)] = 0.8
    """rad/s; how fast the roll setpoint may change. Default: slower than the roll loop"""
    course_speed: Annotated[float, Quantity("m/s", 0.0, 20.0)] = 2.5
    """m/s; ground speed from which the course over ground is steered instead of the yaw. Default: the course is
    known to 0.2 rad from there"""
    law: Annotated[str, Label()] = "pi"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """What the heading loop remembers."""

    integral: float = 0.0
    """rad; of roll setpoint"""
    roll_setpoint: float = 0.0
    """rad; last"""


class Measured(NamedTuple):
    """What the loop looks at."""

    yaw: float
    """rad; of the nose"""
    v_north: float
    """m/s; over ground"""
    v_east: float
    """m/s; over ground"""
    valid: int
    """-; 1 when the ground velocity can be trusted"""
    bank: float = 0.0
    """rad; that the curve of the path flown asks for by itself"""
    drift: float = 1.0
    """-; ground speed in units of the airspeed, from 1"""


def course(gains: Gains, measured: Measured) -> float:
    """What is steered (rad): the course over ground, or the yaw while slow or without a position."""
    fast = math.hypot(measured.v_north, measured.v_east) >= gains.course_speed
    return math.atan2(measured.v_east, measured.v_north) if measured.valid and fast else measured.yaw


def step(
    gains: Gains, state: State, time_us: int, dt: float, heading_setpoint: float, measured: Measured
) -> tuple[State, HeadingStatus]:
    """One step; ``dt`` in s, ``heading_setpoint`` in rad. The integral rests while the bank is limited.

    A course turns by g tan(bank) / V over ground: before the wind the same turn needs more bank.
    """
    heading = course(gains, measured)
    error = wrap(heading_setpoint - heading)
    grown = clip(state.integral + gains.integral * error * dt, -gains.integral_max, gains.integral_max)
    wanted = gains.proportional * measured.drift * error + grown + measured.bank
    saturated = abs(wanted) > gains.roll_max
    integral = state.integral if saturated and wanted * error > 0.0 else grown
    limited = clip(wanted, -gains.roll_max, gains.roll_max)
    roll_setpoint = slew(state.roll_setpoint, limited, gains.roll_rate, dt)
    status = HeadingStatus(time_us, heading, error, roll_setpoint, int(saturated))
    return State(integral, roll_setpoint), status


def follow(
    gains: Gains, state: State, time_us: int, dt: float, commanded_roll: float, measured: Measured
) -> tuple[State, HeadingStatus]:
    """Pass on a bank (rad) from the stick or from the flare, at the loop's own rate."""
    roll_setpoint = slew(state.roll_setpoint, commanded_roll, gains.roll_rate, dt)
    return State(0.0, roll_setpoint), HeadingStatus(time_us, course(gains, measured), 0.0, roll_setpoint, 0)
