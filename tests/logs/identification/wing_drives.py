"""Wing drives with known torque constants, flown in the tests with gauges, encoders and current bursts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data import DriveData
from logs.identification.results import Array

K_TAU, K_TAU0, IDLE = 0.249, 0.346, 0.08
"""N m/A of the total current, N m, A of one servo"""
WINDOW = 0.010


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
    slow = 1 + drives.throttle * np.sin(2 * np.pi * time / 23) * np.cos(2 * np.pi * time / 7)
    strokes = 0.1 + np.cumsum(4.0 * (0.6 + 0.4 * slow)) * 0.0005
    phase = 2 * np.pi * strokes
    skew = 1 + 0.15 * np.sin(2 * np.pi * time / 11)
    torque, rate = [], []
    for side, share in ((0.0, skew), (0.1, 2 - skew)):
        torque.append(share * slow * (1.0 * np.cos(phase + 0.4 + side) + 0.2 * np.cos(3 * phase) + 0.1))
        rate.append(share * slow * 14.0 * np.cos(phase))
    current = sum(np.maximum((np.abs(t) - K_TAU0) / (2 * K_TAU), IDLE) for t in torque)
    knots = np.arange(0, drives.duration + 5, 5.0)
    wander = drives.wander * np.interp(time, knots, rng.normal(size=len(knots)))
    voltage = 8.2 + wander - drives.resistance * current - 1e-4 * time
    return Truth(time, strokes, np.array(torque), np.array(rate), current, voltage)


def measure(truth: Truth, drives: Drives) -> DriveData:
    """Sampled as the flight computer does: torque and burst means at 100 Hz, rates at 200 Hz, with noise."""
    rng = np.random.default_rng(drives.seed + 1)
    every, burst = 20, int(WINDOW / 0.0005)
    total = np.concatenate((np.zeros((2, 1)), np.cumsum([truth.current, truth.voltage], axis=1)), axis=1)
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
