"""What current the drive servos of Gerdes 2017 need for a stroke: by energy, by the dynamometer, by the motor's laws.

Three physical readings beside Eq. 11, none with a value fitted to the currents but the efficiency. Eq. 12 multiplied
out is a motor's law, P = 0.92 I V - 1.27 I^2 - ..., whose 1.27 W/A^2 is the resistance in Ohm that the drive's own
line from stall torque to no-load speed requires (1.23).
"""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.flight_mechanics.wind_tunnel import Measures, Record
from sim_bridge.validation.gerdes_tables import WingFigures
from sim_bridge.vectors import Floats
from sim_bridge.vehicles.sections import Drive

EFFICIENCY = 0.671
"""-; Table 7's power over Table 4's current at 8.0 V: 0.669, 0.662, 0.678, 0.675"""
C_A, C_B, C_C, C_D, C_E, C_F, C_G, C_H = -4.688, 4.646, 0.677, -0.936, -6.877, 0.919, -1.270, -0.070
"""W, W/A, W/V, A, V, -, W/A^2, W/V^2; Table 2"""


def servo_power(current: float, voltage: float) -> float:
    """Compute the output power in W of a servo at a current in A and a voltage in V: Eq. 12, bracket closed."""
    i, v = current + C_D, voltage + C_E
    return C_A + C_B * current + C_C * voltage + C_F * i * v + C_G * i * i + C_H * v * v


def servo_current(power: Floats, voltage: float) -> Floats:
    """Compute the current in A (n,) of one servo for a power (n,) in W: Eq. 12 inverted, its rising branch.

    Negative power counts as zero; power beyond the maximum of Eq. 12 counts as the maximum.
    """
    v = voltage + C_E
    linear = C_B + C_F * v - 2.0 * C_G * -C_D
    constant = servo_power(0.0, voltage)
    wanted = np.maximum(power, 0.0)
    inside = linear**2 - 4.0 * C_G * (constant - wanted)
    return np.asarray((-linear + np.sqrt(np.maximum(inside, 0.0))) / (2.0 * C_G))


def motor_current(torque: Floats, rate: Floats, drive: Drive, voltage: float) -> Floats:
    """Compute the supply current in A (n,) of a servo motor with back-EMF and resistance after a chopper.

    V I = torque rate + R (torque / k)^2, with k = V / no-load speed and R = k V / stall torque for the line from
    stall torque (N m) to no-load speed (rad/s). Torque (n,) in N m, rate (n,) in rad/s; there is no regeneration.
    """
    constant = voltage / drive.no_load_speed
    resistance = constant * voltage / drive.stall_torque
    return np.asarray(np.maximum(torque * rate + resistance * (torque / constant) ** 2, 0.0) / voltage)


def by_energy(measured: Measures, voltage: float) -> float:
    """Compute the mean current in A of both drives at the constant efficiency `EFFICIENCY`."""
    return measured.positive_power / (EFFICIENCY * voltage)


def by_dynamometer(record: Record, voltage: float) -> float:
    """Compute the mean current in A of both drives by Eq. 12 at each instant."""
    return 2.0 * float(np.mean(servo_current(record.power, voltage)))


def by_motor(record: Record, drive: Drive, voltage: float) -> float:
    """Compute the mean current in A of both drives by `motor_current`."""
    rate = (record.flap - np.roll(record.flap, 1)) * len(record.flap) / record.period
    return 2.0 * float(np.mean(motor_current(record.torque, rate, drive, voltage)))


def steady_power(wing: WingFigures, frequency: float) -> float:
    """Compute the least mean power in W of one drive from Table 5's torque constant at Table 4's stroke.

    Amplitude and frequency determine the mean speed of a stroke, whose square is the lower limit of its mean square.
    """
    speed = 2.0 * wing.amplitude * frequency
    return wing.torque_constant * math.pow(speed, 2)
