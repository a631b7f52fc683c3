"""Pitch loop: pitch setpoint -> elevator (Malladi 2007, section IV.A: inner pitch attitude loop).

Proportional, integral, and damping on the pitch rate, both measurements freed of the flapping by a notch.
"""

from __future__ import annotations

from math import cos
from typing import Annotated, NamedTuple

from avionics.limits import clip, fade_out, low_pass
from avionics.messages import PitchStatus
from avionics.stabilization import stroke_filter
from avionics.stabilization.dynamic_pressure import share
from wingbeat.records import constructor
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """What the pitch loop is tuned with."""

    proportional: Annotated[float, Quantity("-", 0.0, 10.0)]
    """-; elevator per pitch error"""
    integral: Annotated[float, Quantity("1/s", 0.0, 10.0)]
    """1/s; elevator per second and pitch error"""
    damping: Annotated[float, Quantity("s", 0.0, 3.0)]
    """s; elevator taken off per pitch rate"""
    integral_max: Annotated[float, Quantity("rad", 0.0, 1.0)]
    """rad; greatest share of the integral in the elevator"""
    elevator_trim: Annotated[float, Quantity("rad", -1.0, 1.0)]
    """rad; elevator of level flight"""
    elevator_min: Annotated[float, Quantity("rad", -1.5, 0.0)]
    """rad; most nose-down elevator the loop asks for"""
    elevator_max: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """rad; most nose-up elevator the loop asks for"""
    notch_width: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.3
    """-; damping ratio of the notch at the wing frequency, 0 for none. Default: a quarter of the lag of a mean over
    the stroke at the short period"""
    rate_lag: Annotated[float, Quantity("s", 0.0, 1.0)] = 0.0
    """s; time constant of a low-pass on the pitch rate, 0 for none. Default: the notch suffices"""
    trim_time: Annotated[float, Quantity("s", 0.05, 60.0)] = 1.0
    """s; time constant of the mean elevator that a frozen loop holds. Default: four strokes"""
    stick_pitch: Annotated[float, Quantity("rad", 0.0, 1.2)] = 0.3
    """rad; change of the pitch setpoint at full stick (stabilized). Default: a third of a rad at full stick"""
    release_time: Annotated[float, Quantity("s", 0.0, 10.0)] = 0.15
    """s; time constant with which the elevator of a frozen loop gives way to the loop's. Default: no step of the
    tail, and the loop back before the attitude has moved on"""
    airspeed: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; at which the gains hold; they go with the dynamic pressure, 0 for the same gains at any airspeed"""
    law: Annotated[str, Label()] = "pid"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """What the pitch loop remembers."""

    integral: float = 0.0
    """rad; of elevator"""
    elevator_mean: float = 0.0
    """rad; low-passed elevator"""
    rate: float = 0.0
    """rad/s; filtered pitch rate"""
    pitch: float = 0.0
    """rad; filtered pitch"""
    pitch_notch: stroke_filter.State = stroke_filter.State()
    rate_notch: stroke_filter.State = stroke_filter.State()
    bridge: float = 0.0
    """rad; of elevator: what a frozen loop held beyond what the loop asks, fading out"""
    setpoint: float = 0.0
    """rad; filtered setpoint of the law `i_pd`"""


class Measured(NamedTuple):
    """What the loop looks at."""

    pitch: float
    """rad; nose up is positive"""
    pitch_rate: float
    """rad/s"""
    wing_frequency: float
    """Hz; 0 when not flapping"""
    roll: float = 0.0
    """rad; of what is asked of the pitch the tail can do the cosine's share, and nothing beyond a right angle"""
    airspeed: float = 0.0
    """m/s; 0 while unknown"""


def initial(gains: Gains) -> State:
    """State at the trim elevator."""
    return State(elevator_mean=gains.elevator_trim)


_new_state = constructor(State)
_new_pitch_status = constructor(PitchStatus)


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """One step; ``dt`` in s, ``setpoint`` in rad. The integral rests while it would push further into a limit."""
    state = _observe(gains, state, dt, measured)
    error = (setpoint - state.pitch) * max(0.0, cos(measured.roll))
    strength = share(gains.airspeed, measured.airspeed)
    proportional, damping = strength * gains.proportional * error, -strength * gains.damping * state.rate
    grown = clip(state.integral + strength * gains.integral * error * dt, -gains.integral_max, gains.integral_max)
    wanted = gains.elevator_trim + proportional + grown + damping
    saturated = not gains.elevator_min <= wanted <= gains.elevator_max
    if saturated and (wanted > gains.elevator_max) == (error > 0.0):
        grown = state.integral
    bridge = fade_out(state.bridge, gains.release_time, dt) if state.bridge else 0.0
    elevator = clip(
        gains.elevator_trim + proportional + grown + damping + bridge, gains.elevator_min, gains.elevator_max
    )
    mean = low_pass(state.elevator_mean, elevator, gains.trim_time, dt)
    status = _new_pitch_status(
        time_us, setpoint, error, proportional, grown, damping, elevator, 1 if saturated else 0
    )
    _, _, rate, pitch, pitch_notch, rate_notch, _, filtered = state
    return _new_state(grown, mean, rate, pitch, pitch_notch, rate_notch, bridge, filtered), status


def hold_trim(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Frozen for an excitation: the mean elevator; the filters go on, the integral is kept.

    What the loop would ask meanwhile is remembered as a difference, so that it takes over without a jump.
    """
    state = _observe(gains, state, dt, measured)
    error = setpoint - state.pitch
    elevator = clip(state.elevator_mean, gains.elevator_min, gains.elevator_max)
    strength = share(gains.airspeed, measured.airspeed)
    turning = strength * (gains.proportional * error - gains.damping * state.rate)
    bridge = elevator - (gains.elevator_trim + turning + state.integral)
    status = PitchStatus(time_us, setpoint, error, 0.0, state.integral, 0.0, elevator, 0)
    return state._replace(bridge=bridge), status


def follow(
    gains: Gains, state: State, time_us: int, dt: float, elevator: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """The pilot's elevator (rad), so that the loop takes over from its trim."""
    state = _observe(gains, state, dt, measured)._replace(integral=0.0, elevator_mean=gains.elevator_trim, bridge=0.0)
    limited = clip(elevator, gains.elevator_min, gains.elevator_max)
    return state, PitchStatus(time_us, state.pitch, 0.0, 0.0, 0.0, 0.0, limited, 0)


def _observe(gains: Gains, state: State, dt: float, measured: Measured) -> State:
    notch = stroke_filter.notch(measured.wing_frequency, gains.notch_width, dt)
    integral, elevator_mean, last_rate, _, pitch_notch, rate_notch, bridge, filtered = state
    pitch_notch, pitch = stroke_filter.step(pitch_notch, measured.pitch, notch)
    rate_notch, rate = stroke_filter.step(rate_notch, measured.pitch_rate, notch)
    if gains.rate_lag > 0.0:
        rate = low_pass(last_rate, rate, gains.rate_lag, dt)
    return _new_state(integral, elevator_mean, rate, pitch, pitch_notch, rate_notch, bridge, filtered)
