"""The whole memory of the flight computer.

Every field is an immutable value (a NamedTuple of plain numbers), so a copy of the record is a snapshot.
"""

# The defaults are immutable values, so that all states may share them.
# ruff: noqa: RUF009

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeVar, get_type_hints

from avionics import messages as m
from avionics import timebase
from avionics.calibration import procedure as calibration
from avionics.constants import STANDARD_GRAVITY
from avionics.estimation import ahrs, gps_altitude
from avionics.estimation import altitude as altitude_filter
from avionics.estimation import position as position_filter
from avionics.guidance import altitude, excitation, heading, modes, throttle_descent
from avionics.guidance import navigation as navigator
from avionics.guidance.mission import NO_FENCE, Fence, Mission, Rally
from avionics.guidance.setpoint import Received
from avionics.mixing import flapping, tail
from avionics.sensing import (
    air_data,
    airspeed_check,
    encoders,
    pilot,
    plausibility,
    power,
    preflight,
    tail_check,
    vibration,
    wing_angle,
    wing_check,
)
from avionics.stabilization import pitch, roll
from avionics.vehicles.gains import FlightGains

T = TypeVar("T")


def zero(message: type[T]) -> T:
    """A message whose every number is 0: what is believed before the first sample."""
    kinds: dict[str, Any] = get_type_hints(message)
    return message(**{name: kind(0) for name, kind in kinds.items()})


AT_REST = zero(m.ImuSample)._replace(accel_z=-STANDARD_GRAVITY)


@dataclass(slots=True)
class AutopilotState:
    """Gains, mission, the State of each module, and the last message of each."""

    gains: FlightGains
    """may be changed in flight by SET_PARAMETER"""
    mission: Mission
    """may be changed in flight by SET_MISSION"""
    altitude_loop: altitude.State
    pitch_loop: pitch.State

    clock: timebase.Clock = timebase.Clock()
    plausibility: plausibility.State = plausibility.State()
    ahrs: ahrs.AhrsState | None = None
    """None before the first IMU sample"""
    preflight: preflight.State = preflight.State()
    encoders: encoders.State = encoders.State()
    wing_angle: wing_angle.State = wing_angle.State()
    vibration: vibration.State = vibration.State()
    power: power.State = power.State()
    air_data: air_data.State = air_data.State()
    altitude_filter: altitude_filter.State = altitude_filter.State()
    gps_altitude: gps_altitude.State = gps_altitude.State()
    position_filter: position_filter.State = position_filter.State()
    ways_in: pilot.State = pilot.State()
    """the pilot's sticks by their source"""
    airspeed_check: airspeed_check.State = airspeed_check.State()
    wing_check: wing_check.State = wing_check.State()
    tail_check: tail_check.State = tail_check.State()
    modes: modes.State = modes.State()
    navigation: navigator.State = navigator.State()
    heading_loop: heading.State = heading.State()
    excitation: excitation.State = excitation.State()
    roll_loop: roll.State = roll.State()
    flapping: flapping.State = flapping.State()
    tail: tail.State = tail.State()
    throttle_descent: throttle_descent.State = throttle_descent.State()
    calibration: calibration.State = calibration.State()

    offboard: Received = Received()
    """the last setpoint of an external controller"""
    fence: Fence = NO_FENCE
    """may be changed in flight by SET_FENCE"""
    rally: Rally = ()
    """may be changed in flight by SET_RALLY"""
    fence_clearance: float = math.inf
    """m; inside of the fence at the last step of the navigation, negative outside"""
    fence_state: m.FenceState = zero(m.FenceState)
    """whether it is outside, and the last breach"""
    frame: m.SensorFrame = m.SensorFrame(0, AT_REST)
    """the last frame, without what was refused; its IMU sample is the last good one"""
    fix: m.GpsFix | None = None
    """the last good fix"""
    pilot: m.PilotInput = zero(m.PilotInput)
    """the sticks that are flown, neutral while there are none"""
    attitude: m.Attitude = zero(m.Attitude)
    wing: m.WingState = zero(m.WingState)._replace(valid_left=1, valid_right=1)
    power_state: m.PowerState = zero(m.PowerState)._replace(battery_remaining=1.0)
    air: m.AirData = zero(m.AirData)
    altitude: m.Altitude = zero(m.Altitude)
    position: m.Position = zero(m.Position)
    target: navigator.Target = navigator.Target(m.Stage.ON_GROUND, 0.0, 0.0)
    """what the navigation asks for"""
    vertical: m.AltitudeStatus = zero(m.AltitudeStatus)
    lateral: m.HeadingStatus = zero(m.HeadingStatus)
    excited: m.ExcitationStatus = zero(m.ExcitationStatus)
    """the identification input as wished"""
    applied: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, -, rad; elevator, throttle and rudder of the identification input as applied"""
    elevator: m.PitchStatus = zero(m.PitchStatus)
    roll_command: m.RollStatus = zero(m.RollStatus)
    actuators: m.ActuatorCommand = zero(m.ActuatorCommand)


def initial_state(gains: FlightGains, mission: Mission) -> AutopilotState:
    """Memory at boot: disarmed, in MANUAL, the loops at their trim, the wings at their glide angle."""
    glide = gains.flapping.glide_angle if gains.flapping.drive == "servo" else 0.0
    return AutopilotState(
        gains,
        mission,
        altitude.initial(gains.altitude),
        pitch.initial(gains.pitch),
        actuators=zero(m.ActuatorCommand)._replace(wing_left=glide, wing_right=glide),
    )
