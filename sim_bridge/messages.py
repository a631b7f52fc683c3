"""What is true: messages of the simulated world, for the log alone. Conventions as in `wingbeat.message`."""

from __future__ import annotations

from typing import NamedTuple

from wingbeat.message import Number, Time


class TruthState(NamedTuple):
    """State of the vehicle's body."""

    time_us: Time
    """us; since boot"""
    north: float
    """m; from the launch place"""
    east: float
    """m; from the launch place"""
    down: float
    """m; from the launch place's ground"""
    v_north: float
    """m/s; velocity of the fuselage's centre of mass"""
    v_east: float
    """m/s"""
    v_down: float
    """m/s"""
    quaternion_w: float
    """-; of r_ned_from_frd"""
    quaternion_x: float
    """-"""
    quaternion_y: float
    """-"""
    quaternion_z: float
    """-"""
    roll_rate: float
    """rad/s; about FRD x"""
    pitch_rate: float
    """rad/s; about FRD y"""
    yaw_rate: float
    """rad/s; about FRD z"""
    wind_north: float
    """m/s; velocity of the air over ground at the vehicle"""
    wind_east: float
    """m/s"""
    wind_down: float
    """m/s"""
    airspeed: float
    """m/s; true"""
    angle_of_attack: float
    """rad; of the fuselage"""
    on_ground: Number
    """-; 1 while a part touches the ground or the launcher holds the vehicle"""


class TruthWing(NamedTuple):
    """State of the wings and their drives; angles and torques are positive with the wing going up."""

    time_us: Time
    """us; since boot"""
    angle_left: float
    """rad; flap angle"""
    angle_right: float
    """rad; flap angle"""
    rate_left: float
    """rad/s; flap rate"""
    rate_right: float
    """rad/s; flap rate"""
    twist_left: float
    """rad; tip twist, leading edge up is positive"""
    twist_right: float
    """rad; tip twist, leading edge up is positive"""
    torque_left: float
    """N m; of the drive on the wing, averaged over the step"""
    torque_right: float
    """N m; of the drive on the wing, averaged over the step"""
    current: float
    """A; drawn by both drives, averaged over the step and the PWM"""
    voltage: float
    """V; at the drives' terminals, averaged over the PWM"""
    electrical_power: float
    """W; averaged over the PWM"""
    elevator: float
    """rad; achieved, positive pitches the nose up"""
    rudder: float
    """rad; achieved, positive yaws the nose right"""


class TruthLoads(NamedTuple):
    """Aerodynamic load of the parts in body axes about the fuselage's centre of mass."""

    time_us: Time
    """us; since boot"""
    wing_force_x: float
    """N; both wings"""
    wing_force_y: float
    """N"""
    wing_force_z: float
    """N"""
    wing_moment_x: float
    """N m; both wings"""
    wing_moment_y: float
    """N m"""
    wing_moment_z: float
    """N m"""
    tail_force_x: float
    """N"""
    tail_force_y: float
    """N"""
    tail_force_z: float
    """N"""
    tail_moment_x: float
    """N m"""
    tail_moment_y: float
    """N m"""
    tail_moment_z: float
    """N m"""
