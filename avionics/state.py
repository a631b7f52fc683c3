"""Complete memory of the flight computer.

Every field is an immutable value (a NamedTuple of plain numbers), so that a copy of the record is a snapshot.
"""

# The defaults are immutable values, so that all states may share them.
# ruff: noqa: RUF009

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, TypeVar, get_type_hints

from avionics import messages as m
from avionics import snapshot, timebase
from avionics.calibration import procedure as calibration
from avionics.estimation import ahrs, gps_altitude
from avionics.estimation import altitude as altitude_filter
from avionics.estimation import position as position_filter
from avionics.gains import FlightGains
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
    rangefinder,
    tail_check,
    vibration,
    wing_angle,
    wing_check,
)
from avionics.stabilization import pitch, roll
from wingbeat.constants import STANDARD_GRAVITY

T = TypeVar("T")


def zero(message: type[T]) -> T:
    """Return a message with all numbers 0, as the value before the first sample."""
    kinds: dict[str, Any] = get_type_hints(message)
    return message(**{name: kind(0) for name, kind in kinds.items()})


AT_REST: Final = zero(m.ImuSample)._replace(accel_z=-STANDARD_GRAVITY)


@dataclass(slots=True)
class AutopilotState:
    """Gains, mission, the state of each module, and its last message."""

    gains: FlightGains
    """changed in flight by SET_PARAMETER"""
    mission: Mission
    """changed in flight by SET_MISSION"""
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
    rangefinder: rangefinder.State = rangefinder.State()
    air_data: air_data.State = air_data.State()
    altitude_filter: altitude_filter.State = altitude_filter.State()
    gps_altitude: gps_altitude.State = gps_altitude.State()
    position_filter: position_filter.State = position_filter.State()
    stick_inputs: pilot.State = pilot.State()
    """stick positions by source"""
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
    """last setpoint of an external controller"""
    fence: Fence = NO_FENCE
    """changed in flight by SET_FENCE"""
    rally: Rally = ()
    """changed in flight by SET_RALLY"""
    mission_breach: str = ""
    """-; first mission item outside the plan's fence, which denies AUTO and the landing sequence; empty for none"""
    fence_clearance: float = math.inf
    """m; clearance inside the fence at the last step of the navigation, negative outside"""
    fence_state: m.FenceState = zero(m.FenceState)
    """fence status and last breach"""
    frame: m.SensorFrame = m.SensorFrame(0, AT_REST)
    """last frame without rejected samples; its IMU sample is the last valid one"""
    last_fix: m.GpsFix | None = None
    """last accepted GPS fix"""
    pilot: m.PilotInput = zero(m.PilotInput)
    """active stick input, neutral without one"""
    attitude: m.Attitude = zero(m.Attitude)
    wing: m.WingState = zero(m.WingState)._replace(valid_left=1, valid_right=1)
    power_state: m.PowerState = zero(m.PowerState)._replace(battery_remaining=1.0)
    air: m.AirData = zero(m.AirData)
    altitude: m.Altitude = zero(m.Altitude)
    position: m.Position = zero(m.Position)
    target: navigator.Target = navigator.Target(m.Stage.ON_GROUND, 0.0, 0.0)
    """setpoints of the navigation"""
    altitude_loop_status: m.AltitudeStatus = zero(m.AltitudeStatus)
    heading_loop_status: m.HeadingStatus = zero(m.HeadingStatus)
    excitation_requested: m.ExcitationStatus = zero(m.ExcitationStatus)
    """excitation that the navigation requests"""
    excitation_applied: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, -, rad; elevator, throttle and rudder of the excitation after limits"""
    pitch_loop_status: m.PitchStatus = zero(m.PitchStatus)
    roll_loop_status: m.RollStatus = zero(m.RollStatus)
    actuators: m.ActuatorCommand = zero(m.ActuatorCommand)

    @property
    def terrain(self) -> float:
        """Altitude (m) of the ground below the vehicle; that of the launch site without a rangefinder."""
        measured, now = self.rangefinder, self.clock.time_us
        default = self.gains.navigation.launch_height
        return rangefinder.terrain(measured, now) - rangefinder.launch_height(measured, now, default)

    @property
    def height(self) -> float:
        """Height (m) above the ground, used for the flare."""
        return self.altitude.altitude - self.terrain


FORMER_NAMES: Final = {
    "ways_in": "stick_inputs",
    "vertical": "altitude_loop_status",
    "lateral": "heading_loop_status",
    "elevator": "pitch_loop_status",
    "roll_command": "roll_loop_status",
    "excited": "excitation_requested",
    "applied": "excitation_applied",
    "fix": "last_fix",
}
"""keys of snapshots in recordings of version 0.1, to fields of `AutopilotState`"""


def initial_state(gains: FlightGains, mission: Mission) -> AutopilotState:
    """Return the memory at boot.

    The vehicle is disarmed in MANUAL, with the loops at their trim and the wings at their glide angle.
    """
    glide = gains.flapping.glide_angle if gains.flapping.drive == "servo" else 0.0
    return AutopilotState(
        gains,
        mission,
        altitude.initial(gains.altitude),
        pitch.initial(gains.pitch),
        actuators=zero(m.ActuatorCommand)._replace(wing_left=glide, wing_right=glide),
    )


def decode_state(text: str) -> AutopilotState:
    """Decode a snapshot, also one of an earlier version with other field names.

    Raises:
        InputError: not a snapshot of this flight computer.
    """
    return snapshot.decode(AutopilotState, text, FORMER_NAMES)
