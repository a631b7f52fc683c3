"""Sections of a vehicle file that describe the vibration of the airframe."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity


class VibrationSpec(NamedTuple):
    """Optional ``[vibration]``: what excites the structural modes, and how the inertial sensors respond.

    Every level holds at ``reference_rate`` and grows with the square of the stroke rate, so that it dies with the
    wings; ``airspeed_buffet`` is what remains in a glide.
    """

    reference_rate: Annotated[float, Quantity("rad/s", 0.1, 1000.0)]
    """RMS flap rate at which the levels of the modes hold"""
    kick_phases: Annotated[tuple[float, ...], Quantity("-", 0.0, 1.0)] = ()
    """stroke periods from the upper reversal to each impact of the drive: closed backlash, end stop"""
    kick_jitter: Annotated[float, Quantity("-", 0.0, 0.2)] = 0.0
    """stroke periods; standard deviation of an impact's phase"""
    stroke_scatter: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.0
    """standard deviation of the logarithm of a stroke's impacts and buffeting"""
    airspeed_buffet: Annotated[float, Quantity("s^2/m^2", 0.0, 0.1)] = 0.0
    """buffeting by the square of the true airspeed, over that at the reference rate"""
    mesh_orders: Annotated[tuple[float, ...], Quantity("-", 0.0, 10000.0)] = ()
    """cycles per stroke of periodic forces: gear mesh, motor shaft"""
    isolator_frequency: Annotated[float, Quantity("Hz", 0.0, 2000.0)] = 0.0
    """natural frequency of the IMU on its soft mount; 0: hard mounted"""
    isolator_damping: Annotated[float, Quantity("-", 0.01, 2.0)] = 0.2
    """damping ratio of the soft mount"""
    rectification: Annotated[float, Quantity("ug/g^2", -10000.0, 10000.0)] = 0.0
    """offset of the accelerometer by its mean square of vibration, all axes"""
    g_sensitivity: Annotated[float, Quantity("deg/s/g", 0.0, 5.0)] = 0.0
    """standard deviation of the gyroscope's response to specific force, each axis to each"""
    magnetic_field: Annotated[tuple[float, float, float], Quantity("uT/A", -100.0, 100.0)] = (0.0, 0.0, 0.0)
    """field of the drive current at the magnetometer, body axes"""
    washout_difference: Annotated[float, Quantity("rad", -0.5, 0.5)] = 0.0
    """built-in twist of the right wing tip less that of the left"""
    membrane_difference: Annotated[float, Quantity("-", -0.8, 0.8)] = 0.0
    """relative difference of the membranes' mass and twist stiffness, right less left"""
    stroke_difference: Annotated[float, Quantity("-", -0.5, 0.5)] = 0.0
    """relative difference of the stroke amplitudes, right less left"""
    current_ripple: Annotated[float, Quantity("-", 0.0, 0.5)] = 0.0
    """standard deviation of the drive current by the motor's commutation, over the current"""


class ModeSpec(NamedTuple):
    """``[modes.NAME]``: one structural mode with coordinate q in m, ``q'' + 2 zeta w q' + w^2 q = force``."""

    frequency: Annotated[float, Quantity("Hz", 1.0, 1500.0)]
    damping: Annotated[float, Quantity("-", 0.001, 0.9)]
    """damping ratio zeta"""
    translation: Annotated[tuple[float, float, float], Quantity("-", -10.0, 10.0)]
    """mode shape: displacement of the IMU over q, body axes"""
    rotation: Annotated[tuple[float, float, float], Quantity("rad/m", -1000.0, 1000.0)]
    """mode shape: rotation of the IMU over q, body axes"""
    buffet: Annotated[float, Quantity("m/s^2", 0.0, 1000.0)] = 0.0
    """RMS acceleration of q by broadband forces of the air and the drive"""
    kick: Annotated[float, Quantity("m/s", -10.0, 10.0)] = 0.0
    """change of the velocity of q in an impact"""
    mesh: Annotated[float, Quantity("m/s^2", 0.0, 1000.0)] = 0.0
    """amplitude of each periodic force over the modal mass"""
