"""What the sensors of the simulated vehicle measure of the physics, at one instant.

The plant's kernel fills an array (`SIZE`,), the sensors' kernel reads it. `Observation` is the same with names, for
everything that is not compiled.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]

# Where the fields of an `Observation` without its time begin in the array.
QUATERNION, OMEGA, FORCE, POSITION, V_NED, V_AIR = 0, 4, 7, 10, 13, 16
STATIC_PRESSURE, TEMPERATURE, DENSITY, FLAP_LEFT, FLAP_RIGHT, TORQUE_LEFT, TORQUE_RIGHT = 19, 20, 21, 22, 23, 24, 25
CURRENT, OPEN_CIRCUIT_VOLTAGE, BATTERY_RESISTANCE, PULSE_CURRENT, PWM_FREQUENCY = 26, 27, 28, 29, 30
SIZE = 31
_ARRAY = struct.Struct(f"<{SIZE}d")


class Observation(NamedTuple):
    """The plant's exact state at the sensors."""

    time_us: int
    """us; since the start of the simulation"""
    quaternion: tuple[float, float, float, float]
    """-; of r_ned_from_frd, (w, x, y, z)"""
    omega_frd: Vector
    """rad/s; of the fuselage"""
    specific_force_frd: Vector
    """m/s^2; at the IMU, 9.81 up at rest: (0, 0, -9.81)"""
    position_ned: Vector
    """m; of the fuselage's center of mass, from the launch place's ground"""
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

    @classmethod
    def from_array(cls, time_us: int, array: NDArray[np.float64]) -> Observation:
        """Return the observation that the plant left in ``array`` (`SIZE`,) at ``time_us``."""
        a: Any = _ARRAY.unpack_from(array.data)  # its slices are tuples
        return cls._make((time_us, a[:4], a[4:7], a[7:10], a[10:13], a[13:16], a[16:19], *a[19:]))

    def fill(self, array: NDArray[np.float64]) -> None:
        """Write all but the time to ``array`` (`SIZE`,)."""
        _, q, omega, force, position, v_ned, v_air, *scalars = self
        _ARRAY.pack_into(array.data, 0, *q, *omega, *force, *position, *v_ned, *v_air, *scalars)
