"""Parameters of all modules, by section of the vehicle file."""

from __future__ import annotations

from typing import NamedTuple

from avionics.estimation import ahrs
from avionics.estimation import altitude as altitude_filter
from avionics.estimation import position as position_filter
from avionics.guidance import altitude, excitation, heading, modes, navigation, throttle_descent
from avionics.mixing import flapping, tail
from avionics.sensing import (
    air_data,
    airspeed_check,
    drive_torque,
    encoders,
    inertial,
    plausibility,
    power,
    preflight,
    receiver,
    tail_check,
    wing_angle,
    wing_check,
)
from avionics.stabilization import pitch, roll


class FlightGains(NamedTuple):
    """Parameters of the flight computer; each field is a section of the vehicle file."""

    plausibility: plausibility.Gains
    imu: inertial.Gains
    ahrs: ahrs.AhrsGains
    encoders: encoders.Gains
    wing_angle: wing_angle.Gains
    power: power.Gains
    air_data: air_data.Gains
    torque: drive_torque.Gains
    altitude_filter: altitude_filter.Gains
    position_filter: position_filter.Gains
    receiver: receiver.Gains
    airspeed_check: airspeed_check.Gains
    wing_check: wing_check.Gains
    tail_check: tail_check.Gains
    modes: modes.Gains
    navigation: navigation.Gains
    altitude: altitude.Gains
    heading: heading.Gains
    excitation: excitation.Gains
    pitch: pitch.Gains
    roll: roll.Gains
    flapping: flapping.Gains
    tail: tail.Gains
    preflight: preflight.Gains = preflight.Gains()
    throttle_descent: throttle_descent.Gains = throttle_descent.Gains()
