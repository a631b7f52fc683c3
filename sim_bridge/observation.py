"""What the sensors of the simulated vehicle see of the physics, at one instant."""

from __future__ import annotations

from typing import NamedTuple

Vector = tuple[float, float, float]


class Observation(NamedTuple):
    """The plant's exact state where the sensors sit; produced by the plant, read by the sensor suite."""

    time_us: int
    """us; since the start of the simulation"""
    quaternion: tuple[float, float, float, float]
    """-; of r_ned_from_frd, (w, x, y, z)"""
    omega_frd: Vector
    """rad/s; of the fuselage"""
    specific_force_frd: Vector
    """m/s^2; at the IMU, 9.81 up at rest: (0, 0, -9.81)"""
    position_ned: Vector
    """m; of the fuselage's centre of mass, from the launch place's ground"""
    v_ned: Vector
    """m/s; velocity over ground"""
    v_air_frd: Vector
    """m/s; velocity through the air at the pitot, body axes"""
    static_pressure: float
    """Pa; ambient"""
    temperature: float
    """K; ambient"""
    density: float
    """kg/m^3; ambient"""
    flap_left: float
    """rad; wing up is positive"""
    flap_right: float
    """rad; wing up is positive"""
    torque_left: float
    """N m; of the drive on the wing, averaged over the last tick, positive when it drives the wing up"""
    torque_right: float
    """N m; likewise"""
    current: float
    """A; drawn by both drives, averaged over whole PWM periods since the last ADC burst (two ticks)"""
    open_circuit_voltage: float
    """V; of the battery at its state of charge, without load"""
    battery_resistance: float
    """ohm; of battery and leads: V = open_circuit_voltage - resistance * instantaneous current"""
    pulse_current: float
    """A; drawn by both drives together while the PWM is on; duty = current / pulse_current"""
    pwm_frequency: float
    """Hz; of the current modulation, 0 for a smooth motor current"""
