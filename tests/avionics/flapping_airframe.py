"""Sensors of an airframe shaken by its wings: exact kinematics, then gyro bias, noise and rounding.

Heave of several g along body z and a pitch oscillation of the flapping frequency on top of a level flight or a
coordinated turn; numbers from Grauer et al. 2011 (Slow Hawk) and Gerdes et al. 2017 (Robo Raven II).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.messages import ImuSample

GRAVITY = 9.80665
FIELD_NED = np.array([0.2, 0.0, 0.42])
"""gauss; a magnetic field of middle latitudes, declination 0"""

Array = NDArray[np.float64]


class Airframe(NamedTuple):
    """What shakes, how much, and along which path."""

    frequency: float = 5.91
    """Hz; flapping"""
    heave: float = 4.0 * GRAVITY
    """m/s^2; amplitude of the acceleration along body z"""
    pitch_rate: float = 1.5
    """rad/s; amplitude"""
    phase: float = 0.0
    """rad; of the pitch rate against the heave"""
    second_harmonic: float = 0.3
    """-; share of the heave at twice the frequency"""
    pitch: float = 0.15
    """rad; mean"""
    bank: float = 0.0
    """rad; of a coordinated turn"""
    airspeed: float = 9.2
    """m/s"""
    bias_deg: float = 0.5
    """deg/s; gyro bias on every axis"""
    gyro_noise: float = 0.007
    """rad/s; one sigma a sample (ITG-3200: 0.38 deg/s RMS)"""
    accel_noise: float = 0.06
    """m/s^2; one sigma a sample"""
    rate: float = 200.0
    """Hz; sampling"""


SLOW_HAWK = Airframe()
ROBO_RAVEN = Airframe(frequency=4.0, heave=2.5 * GRAVITY, pitch_rate=1.2, airspeed=6.7, pitch=0.3)


class Motion(NamedTuple):
    """Sampled truth and sensors."""

    time: Array
    """s; shape (n,)"""
    euler: Array
    """rad; roll, pitch, yaw, shape (n, 3)"""
    accel_down: Array
    """m/s^2; true acceleration along NED z, shape (n,)"""
    airspeed: Array
    """m/s; true, shape (n,)"""
    v_ned: Array
    """m/s; true velocity over ground in still air, shape (n, 3)"""
    samples: list[ImuSample]


def rotation_matrices(euler: Array) -> Array:
    """r_ned_from_frd of roll, pitch, yaw, shape (n, 3, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(euler.T), np.cos(euler.T)
    rows = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def body_rates(euler: Array, euler_rate: Array) -> Array:
    """Rates about FRD axes of an Euler angle history, shape (n, 3)."""
    (sr, sp, _), (cr, cp, _) = np.sin(euler.T), np.cos(euler.T)
    roll, pitch, yaw = euler_rate.T
    return np.stack([roll - yaw * sp, pitch * cr + yaw * cp * sr, -pitch * sr + yaw * cp * cr], axis=1)


def fly(airframe: Airframe, duration: float, stationary: float = 0.0, seed: int = 1) -> Motion:
    """Motion of ``duration`` seconds: ``stationary`` at rest, then a throw of 0.4 s and, 2 s later, the turn.

    With ``stationary`` = 0 the record begins in the middle of the flight, wings beating, in the turn.
    """
    time = np.arange(round(duration * airframe.rate)) / airframe.rate
    speed = airframe.airspeed * _ramp(time, stationary, 0.4 if stationary else 0.0)
    shaking = _ramp(time, stationary, 0.4 if stationary else 0.0)
    bank = airframe.bank * _ramp(time, stationary + 2.0, 1.5 if stationary else 0.0)
    turn = GRAVITY * np.tan(bank) / airframe.airspeed
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (turn[1:] + turn[:-1]))]) / airframe.rate
    omega = 2.0 * np.pi * airframe.frequency
    wing = omega * (time - stationary)
    swing = shaking * airframe.pitch_rate / omega
    pitch = airframe.pitch + swing * np.sin(wing + airframe.phase)
    euler = np.stack([bank, pitch, yaw], axis=1)
    r = rotation_matrices(euler)
    heave = airframe.heave * (np.cos(wing) + airframe.second_harmonic * np.sin(2.0 * wing))
    shake = r[:, :, 2] * (shaking * heave)[:, None]
    course = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=1)
    # A periodic velocity has no mean acceleration: what pitch and heave rectify in the course's frame goes.
    beat = shaking == 1.0
    mean_ahead, mean_down = (float(np.mean(heave[beat] * f(pitch[beat]))) for f in (np.sin, np.cos))
    share = (shaking * np.cos(bank))[:, None]
    shake -= share * (mean_ahead * course + np.array([0.0, 0.0, mean_down]))
    velocity = course * speed[:, None]
    accel_ned = shake + np.gradient(velocity, 1.0 / airframe.rate, axis=0)
    force = np.einsum("nji,nj->ni", r, accel_ned - np.array([0.0, 0.0, GRAVITY]))
    field = np.einsum("nji,j->ni", r, FIELD_NED)
    rng = np.random.default_rng(seed)
    euler_rate = np.gradient(euler, 1.0 / airframe.rate, axis=0)
    euler_rate[:, 1] = shaking * airframe.pitch_rate * np.cos(wing + airframe.phase)
    gyro = body_rates(euler, euler_rate) + np.radians(airframe.bias_deg)
    gyro += rng.normal(0.0, airframe.gyro_noise, gyro.shape)
    force += rng.normal(0.0, airframe.accel_noise, force.shape)
    field += rng.normal(0.0, 0.003, field.shape)
    samples = [
        ImuSample(round(t * 1e6), *f, *g, *m)
        for t, f, g, m in zip(time, force.tolist(), gyro.tolist(), field.tolist(), strict=True)
    ]
    moved = np.cumsum(0.5 * (accel_ned[1:] + accel_ned[:-1]), axis=0) / airframe.rate
    v_ned = velocity[0] + np.concatenate([np.zeros((1, 3)), moved])
    return Motion(time, euler, accel_ned[:, 2], speed, v_ned, samples)


def _ramp(time: Array, start: float, length: float) -> Array:
    """Smooth step from 0 to 1; a step of no length has been taken before the record began."""
    if length == 0.0:
        return np.ones_like(time)
    share = np.clip((time - start) / length, 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))


def inclination_error_deg(euler: Array, quaternion: Array) -> Array:
    """Angle between true and estimated down in degrees, shape (n,); quaternions (w, x, y, z) of r_ned_from_frd."""
    w, x, y, z = quaternion.T
    down = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)
    true = rotation_matrices(euler)[:, 2, :]
    return np.asarray(np.degrees(np.arccos(np.clip(np.sum(down * true, axis=1), -1.0, 1.0))))
