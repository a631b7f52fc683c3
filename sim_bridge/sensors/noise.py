"""Seeded random streams: one per sensor, drawn in blocks because single draws cost a microsecond each."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from avionics.quantities import BadInput
from sim_bridge.observation import Vector

BLOCK = 256
"""rows; drawn at once"""


def sensor_seed(seed: int, sensor: int) -> np.random.SeedSequence:
    """Seed of the ``sensor``-th sensor of the flight with ``seed``; independent of how many others there are.

    Raises:
        BadInput: seed negative.
    """
    if seed < 0:
        raise BadInput(f"seed must be a whole number from 0, not {seed}")
    return np.random.SeedSequence(entropy=seed, spawn_key=(sensor,))


def split(seed: np.random.SeedSequence) -> tuple[np.random.Generator, np.random.Generator]:
    """Two generators of one sensor: its unit's fixed errors, and its noise in flight."""
    unit, flight = (np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, part)) for part in (0, 1))
    return np.random.default_rng(unit), np.random.default_rng(flight)


def normal_rows(generator: np.random.Generator, width: int) -> Iterator[list[float]]:
    """Endless rows of ``width`` standard normal numbers."""
    while True:
        yield from generator.standard_normal((BLOCK, width)).tolist()


def normal_arrays(generator: np.random.Generator, width: int) -> Iterator[NDArray[np.float64]]:
    """Endless arrays of ``width`` standard normal numbers."""
    while True:
        yield from generator.standard_normal((BLOCK, width))


def normal_vector(generator: np.random.Generator, sigma: float) -> Vector:
    """Three independent normal numbers of standard deviation ``sigma``."""
    x, y, z = (sigma * generator.standard_normal(3)).tolist()
    return x, y, z


def gauss_markov_step(period: float, time_constant: float) -> tuple[float, float]:
    """Decay and drive of a first-order Gauss-Markov process of unit variance sampled every ``period`` s.

    ``x' = decay x + drive n`` with n standard normal keeps the variance at 1 and the correlation at
    exp(-t / time_constant).
    """
    decay = math.exp(-period / time_constant)
    return decay, math.sqrt(1.0 - decay * decay)
