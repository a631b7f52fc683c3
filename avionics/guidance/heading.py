"""Heading loop: course or heading error to roll setpoint.

The control is proportional as in Malladi 2007, section IV.A.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.limits import clip, slew, wrap
from avionics.messages import HeadingStatus
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """Parameters of the heading loop."""

    proportional: Annotated[float, Quantity("-", 0.0, 5.0)]
    """-; roll setpoint per heading error"""
    integral: Annotated[float, Quantity("1/s", 0.0, 2.0)] = 0.0
    """1/s; roll setpoint rate per heading error. Default: the course is controlled, which includes the effect of wind
    """
    integral_max: Annotated[float, Quantity("rad", 0.0, 0.5)] = 0.1
    """rad; limit of the integrator. Default: leaves control authority to the proportional term"""
    roll_max: Annotated[float, Quantity("rad", 0.05, 1.2)] = 0.5
    """rad; maximum roll setpoint. Default: a load factor of 1.14"""
    roll_rate: Annotated[float, Quantity("rad/s", 0.05, 10.0)] = 0.8
    """rad/s; slew rate limit of the roll setpoint. Default: slower than the roll loop"""
    course_speed: Annotated[float, Quantity("m/s", 0.0, 20.0)] = 2.5
    """m/s; ground speed above which the course over ground is controlled instead of the yaw. Default: the error of
    the course is 0.2 rad at this speed"""
    law: Annotated[str, Label()] = "pi"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """State of the heading loop."""

    integral: float = 0.0
    """rad; integrator of the roll setpoint"""
    roll_setpoint: float = 0.0
    """rad; roll setpoint of the previous step"""


class Measured(NamedTuple):
    """Measurements used by the heading loop."""

    yaw: float
    """rad; yaw"""
    v_north: float
    """m/s; north ground velocity"""
    v_east: float
    """m/s; east ground velocity"""
    valid: int
    """-; 1 if the ground velocity is valid"""
    bank: float = 0.0
    """rad; feed-forward bank for the curvature of the path"""
    drift: float = 1.0
    """-; ratio of ground speed to airspeed, at least 1"""


def course(gains: Gains, measured: Measured) -> float:
    """Return the controlled angle (rad): course over ground or yaw.

    The yaw is used at low ground speed or without a position.
    """
    fast = math.hypot(measured.v_north, measured.v_east) >= gains.course_speed
    return math.atan2(measured.v_east, measured.v_north) if measured.valid and fast else measured.yaw


def step(
    gains: Gains, state: State, time_us: int, dt: float, heading_setpoint: float, measured: Measured
) -> tuple[State, HeadingStatus]:
    """Advance the heading loop by ``dt`` (s) toward ``heading_setpoint`` (rad).

    Integration stops while the bank is saturated. The course rate is g tan(bank) / V with the ground speed V, so that
    a turn with a tailwind needs more bank.
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
    """Track a bank command (rad) of the stick or the flare.

    The slew rate is that of the loop.
    """
    roll_setpoint = slew(state.roll_setpoint, commanded_roll, gains.roll_rate, dt)
    return State(0.0, roll_setpoint), HeadingStatus(time_us, course(gains, measured), 0.0, roll_setpoint, 0)
