"""The compiled part of the sensor suite: all that is sampled at every tick, and the bursts of the power sensor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.sensors.barometer import BarometerArrays, read_pressure
from sim_bridge.sensors.encoder import CounterArrays, count_edges
from sim_bridge.sensors.gyroscope import Walk, step_walk
from sim_bridge.sensors.pitot import PitotArrays, read_impact, sense_impact
from sim_bridge.sensors.power_sensor import Burst, sample_burst
from sim_bridge.sensors.torque_cell import CellArrays, read_torques
from sim_bridge.sensors.triad import ZERO, Unit, read_axes
from sim_bridge.vectors import Floats, Integers
from wingbeat import quaternions

LARGEST = 1e6
"""SI; no value of an observation is larger while the simulation makes sense"""

_frd_from_ned = exact_inlined(quaternions.frd_from_ned)


class SuiteArrays(NamedTuple):
    """Kernel arguments of the sensors of one vehicle."""

    observed: Floats
    """(`observation.SIZE`,)"""
    accelerometer: Unit
    gyroscope: Unit
    walk: Walk
    magnetometer: Unit
    earth_field: Floats
    """(3,) gauss; NED"""
    field_per_ampere: Floats
    """(3,) gauss/A; body axes"""
    pitot: PitotArrays
    barometer: BarometerArrays
    left: CounterArrays
    right: CounterArrays
    encoder_noise: float
    """counts"""
    encoder_normals: Floats
    """(n, 2); standard normal numbers drawn ahead"""
    burst: Burst
    cells: CellArrays
    imu: Floats
    """(9,) out; values of an `ImuSample` without its time, rounded to 32 bits as MAVLink carries them"""
    encoder: Integers
    """(6,) out; values of an `EncoderSample` without its time"""
    pressures: Integers
    """(3,) out; values of a `PressureSample` without its time"""
    torques: Integers
    """(2,) out; values of a `TorqueSample` without its time"""


@exact
def sense(
    time_us: int, at: int, field_at: int, pressures_at: int, burst_at: int, torques_at: int, bound: Bound
) -> bool:
    """Sample the sensors of one tick; return whether the observation is finite and plausible.

    Each ``at`` is a row of normal numbers: of the sensors that are sampled at every tick, of the magnetometer, of
    barometer and pitot, of the power sensor, of the torque cells; -1 for sensors without a sample in this tick.
    """
    a = bound_values(bound)
    for value in a.observed:
        if not -LARGEST < value < LARGEST:
            return False
    v = a.observed
    sense_impact(v[o.V_AIR], v[o.V_AIR + 2], v[o.DENSITY], a.pitot)
    if field_at >= 0:
        _sense_field(field_at, a)
    force = (v[o.FORCE], v[o.FORCE + 1], v[o.FORCE + 2])
    read_axes(force, ZERO, at, a.accelerometer, a.imu[0:3])
    omega = (v[o.OMEGA], v[o.OMEGA + 1], v[o.OMEGA + 2])
    read_axes(omega, step_walk(at, a.walk), at, a.gyroscope, a.imu[3:6])
    for i in range(9):
        a.imu[i] = np.float32(a.imu[i])
    noise = a.encoder_noise
    left = count_edges(v[o.FLAP_LEFT], noise * a.encoder_normals[at, 0], a.left)
    right = count_edges(v[o.FLAP_RIGHT], noise * a.encoder_normals[at, 1], a.right)
    for i in range(3):
        a.encoder[2 * i] = left[i]
        a.encoder[2 * i + 1] = right[i]
    if pressures_at >= 0:
        static, warm = read_pressure(v[o.STATIC_PRESSURE], v[o.TEMPERATURE], pressures_at, a.barometer)
        a.pressures[0], a.pressures[1], a.pressures[2] = static, read_impact(pressures_at, a.pitot), warm
    if burst_at >= 0:
        sample_burst(time_us, v, burst_at, a.burst)
    if torques_at >= 0:
        counts = read_torques(v[o.TORQUE_LEFT], v[o.TORQUE_RIGHT], torques_at, a.cells)
        a.torques[0], a.torques[1] = counts
    return True


@exact_inlined
def _sense_field(row: int, a: SuiteArrays) -> None:
    v, q, field, current = a.observed, o.QUATERNION, a.earth_field, a.observed[o.CURRENT]
    drive = (a.field_per_ampere[0] * current, a.field_per_ampere[1] * current, a.field_per_ampere[2] * current)
    body = _frd_from_ned((v[q], v[q + 1], v[q + 2], v[q + 3]), (field[0], field[1], field[2]))
    read_axes(body, drive, row, a.magnetometer, a.imu[6:9])
