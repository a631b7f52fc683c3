"""Pitch loop: pitch setpoint to elevator.

Inner pitch attitude loop of Malladi 2007, section IV.A: proportional, integral, and damping on the pitch rate. A
notch removes the flapping from both measurements.
"""

from __future__ import annotations

from math import cos
from typing import Annotated, Final, NamedTuple

from avionics.limits import clip, fade_out, low_pass
from avionics.messages import PitchStatus
from avionics.stabilization import stroke_filter
from avionics.stabilization.dynamic_pressure import share
from wingbeat.records import constructor
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label


class Gains(NamedTuple):
    """Parameters of the pitch loop."""

    proportional: Annotated[float, Quantity("-", 0.0, 10.0)]
    """-; elevator per pitch error"""
    integral: Annotated[float, Quantity("1/s", 0.0, 10.0)]
    """1/s; elevator rate per pitch error"""
    damping: Annotated[float, Quantity("s", 0.0, 3.0)]
    """s; elevator decrease per pitch rate"""
    integral_max: Annotated[float, Quantity("rad", 0.0, 1.0)]
    """rad; limit of the elevator integrator"""
    elevator_trim: Annotated[float, Quantity("rad", -1.0, 1.0)]
    """rad; elevator in level flight"""
    elevator_min: Annotated[float, Quantity("rad", -1.5, 0.0)]
    """rad; minimum (nose-down) output of the loop"""
    elevator_max: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """rad; maximum (nose-up) output of the loop"""
    notch_width: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.3
    """-; damping ratio of the notch at the wing frequency, 0 for none. Default: a quarter of the lag of a stroke mean
    at the short period"""
    rate_lag: Annotated[float, Quantity("s", 0.0, 1.0)] = 0.0
    """s; time constant of a low-pass filter of the pitch rate, 0 for none. Default: the notch suffices"""
    trim_time: Annotated[float, Quantity("s", 0.05, 60.0)] = 1.0
    """s; time constant of the mean elevator that is applied while the loop is frozen. Default: four strokes"""
    stick_pitch: Annotated[float, Quantity("rad", 0.0, 1.2)] = 0.3
    """rad; change of the pitch setpoint at full stick (stabilized). Default: a third of a rad at full stick"""
    release_time: Annotated[float, Quantity("s", 0.0, 10.0)] = 0.15
    """s; time constant of the transition from a frozen loop to the active loop. Default: no step of the tail, and an
    active loop before the attitude changes"""
    airspeed: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 0.0
    """m/s; reference airspeed of the gains, which scale with the dynamic pressure; 0 for constant gains"""
    law: Annotated[str, Label()] = "pid"
    """-; control law of the loop, a name of the table in `avionics.control_laws`"""


class State(NamedTuple):
    """State of the pitch loop."""

    integral: float = 0.0
    """rad; integrator of the elevator"""
    elevator_mean: float = 0.0
    """rad; low-passed elevator"""
    rate: float = 0.0
    """rad/s; filtered pitch rate"""
    pitch: float = 0.0
    """rad; filtered pitch"""
    pitch_notch: stroke_filter.State = stroke_filter.State()
    rate_notch: stroke_filter.State = stroke_filter.State()
    bridge: float = 0.0
    """rad; elevator offset that decays after the loop resumes"""
    setpoint: float = 0.0
    """rad; filtered setpoint of the law `i_pd`"""


class Measured(NamedTuple):
    """Measurements used by the pitch loop."""

    pitch: float
    """rad; positive nose up"""
    pitch_rate: float
    """rad/s"""
    wing_frequency: float
    """Hz; 0 without flapping"""
    roll: float = 0.0
    """rad; the effect of the tail on pitch is scaled by the cosine of the roll, and is 0 beyond a right angle"""
    airspeed: float = 0.0
    """m/s; 0 if unknown"""


def initial(gains: Gains) -> State:
    """Return the state at the trim elevator."""
    return State(elevator_mean=gains.elevator_trim)


_new_state: Final = constructor(State)
_new_pitch_status: Final = constructor(PitchStatus)


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Advance the pitch loop by ``dt`` (s) toward ``setpoint`` (rad).

    Integration stops while it would drive the output further into saturation (conditional anti-windup).
    """
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
    """Return the mean elevator while an excitation is active.

    The filters keep running; the integrator is frozen. The difference from the output of the loop is stored for a
    bumpless transfer.
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
    """Track the pilot's elevator (rad) so that the transfer to the loop is bumpless."""
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
