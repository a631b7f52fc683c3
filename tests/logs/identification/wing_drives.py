"""Wing drives with known torque constants, flown in the tests with gauges, encoders and current bursts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from logs.identification.data.flight import DriveData
from logs.identification.results import Array

K_TAU, K_TAU0, IDLE = 0.249, 0.346, 0.08
"""N m/A of the total current, N m, A of one servo"""
WINDOW = 0.010
CENTRE = (-0.9, -8.0)
"""A and V; C_D and C_E of a drive with a power law"""


class Drives(NamedTuple):
    """How a test flight's drives differ from the standard ones."""

    seed: int = 0
    duration: float = 60.0
    noise: float = 1.0
    resistance: float = 0.12
    """ohm; of the battery"""
    wander: float = 0.0
    """V; of the open-circuit voltage, on its own"""
    throttle: float = 0.3
    """-; relative slow variation of the stroke's load"""
    law: tuple[float, ...] = ()
    """W and so on; C_A, C_B, C_C, C_F, C_G and C_H of Gerdes Eq. 12 about `CENTRE`, which every stroke then obeys"""
    course: bool = False
    """-; the seed draws the course of the load and of the two sides' shares too, else it is always the same"""


class Truth(NamedTuple):
    """Torques, rates, current and voltage at 2 kHz."""

    time: Array
    strokes: Array
    torque: Array
    rate: Array
    current: Array
    voltage: Array


def simulate(drives: Drives) -> Truth:
    """Both drives: torque with harmonics that crosses zero, a current that is affine in its size above a floor."""
    rng = np.random.default_rng(drives.seed)
    time = np.arange(0, drives.duration, 0.0005)
    when = np.random.default_rng(drives.seed + 2).uniform(0, 2 * np.pi, 3) * drives.course
    slow = 1 + drives.throttle * np.sin(2 * np.pi * time / 23 + when[0]) * np.cos(2 * np.pi * time / 7 + when[1])
    strokes = 0.1 + np.cumsum(4.0 * (0.6 + 0.4 * slow)) * 0.0005
    phase = 2 * np.pi * strokes
    skew = 1 + 0.15 * np.sin(2 * np.pi * time / 11 + when[2])
    torque, rate = [], []
    for side, share in ((0.0, skew), (0.1, 2 - skew)):
        torque.append(share * slow * (1.0 * np.cos(phase + 0.4 + side) + 0.2 * np.cos(3 * phase) + 0.1))
        rate.append(share * slow * 14.0 * np.cos(phase))
    current = sum(np.maximum((np.abs(t) - K_TAU0) / (2 * K_TAU), IDLE) for t in torque)
    knots = np.arange(0, drives.duration + 5, 5.0)
    wander = drives.wander * np.interp(time, knots, rng.normal(size=len(knots)))
    voltage = 8.2 + wander - drives.resistance * current - 1e-4 * time
    truth = Truth(time, strokes, np.array(torque), np.array(rate), current, voltage)
    return truth._replace(rate=truth.rate * _lawful(truth, drives.law)) if drives.law else truth


def law(coefficients: tuple[float, ...], current: Array, voltage: Array) -> Array:
    """Gerdes Eq. 12 about `CENTRE`: power (W) of a servo at its current (A) and voltage (V)."""
    c_a, c_b, c_c, c_f, c_g, c_h = coefficients
    i, v = current + CENTRE[0], voltage + CENTRE[1]
    return c_a + c_b * current + c_c * voltage + c_f * i * v + c_g * i * i + c_h * v * v


def _lawful(truth: Truth, coefficients: tuple[float, ...]) -> Array:
    """By what the rates of each stroke must be multiplied for its mean power to obey the law: (2 kHz samples,)."""
    turn = np.floor(truth.strokes).astype(int)
    count = np.bincount(turn)
    power, current, voltage = (
        np.bincount(turn, values) / np.maximum(count, 1) / servos
        for values, servos in (
            ((truth.torque * truth.rate).sum(axis=0), 2), (truth.current, 2), (truth.voltage, 1)
        )
    )  # fmt: skip
    factor = law(coefficients, current, voltage) / power
    return np.asarray(factor[turn])


def measure(truth: Truth, drives: Drives) -> DriveData:
    """Sampled as the flight computer does: torque and burst means at 100 Hz, rates at 200 Hz, with noise."""
    rng = np.random.default_rng(drives.seed + 1)
    every, burst = 20, int(WINDOW / 0.0005)
    total = cumulative_trapezoid([truth.current, truth.voltage], initial=0.0, axis=1)
    ends = np.arange(burst, len(truth.time), every)
    means = (total[:, ends] - total[:, ends - burst]) / burst
    noise = drives.noise
    fast, slow = slice(None, None, 10), slice(None, None, every)
    torque = truth.torque[:, slow] + noise * 0.01 * rng.normal(size=truth.torque[:, slow].shape)
    rate = truth.rate[:, fast] + noise * 0.05 * rng.normal(size=truth.rate[:, fast].shape)
    return DriveData(
        truth.time[ends],
        means[0] + noise * 0.02 * rng.normal(size=len(ends)),
        means[1] + noise * 0.01 * rng.normal(size=len(ends)),
        WINDOW,
        truth.time[slow], torque[0], torque[1],
        truth.time[fast], rate[0], rate[1], truth.strokes[fast],
    )  # fmt: skip


def exact(truth: Truth) -> DriveData:
    """The truth at 200 Hz, as the simulated world logs it."""
    fast = slice(None, None, 10)
    time, torque, rate = truth.time[fast], truth.torque[:, fast], truth.rate[:, fast]
    return DriveData(
        time, truth.current[fast], truth.voltage[fast], 0.0, time, *torque, time, *rate, truth.strokes[fast]
    )
