"""Seeded random streams, one per sensor, drawn in blocks for speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim_bridge.observation import Vector
from wingbeat.errors import InputError

Row = TypeVar("Row")
BLOCK = 256
"""rows; drawn at once"""


class SensorSeed(NamedTuple):
    """Seed of the random numbers of one sensor."""

    sequence: np.random.SeedSequence
    corner: float = 0.0
    """-; 0: the unit's fixed errors are normal numbers; else each is this many standard deviations, either way"""


class Corner:
    """Generator stand-in whose normal numbers have one magnitude and a random sign."""

    def __init__(self, generator: np.random.Generator, size: float) -> None:
        self._generator = generator
        self._size = size

    def standard_normal(self, size: int) -> NDArray[np.float64]:
        """``size`` numbers of the magnitude with random signs."""
        return self._size * np.copysign(1.0, self._generator.standard_normal(size))


UnitErrors = np.random.Generator | Corner
"""what a unit's fixed errors are drawn from"""


def sensor_seed(seed: int, sensor: int, corner: float = 0.0) -> SensorSeed:
    """Seed of the ``sensor``-th sensor of the flight with ``seed``; independent of the number of sensors.

    Raises:
        InputError: seed negative.
    """
    if seed < 0:
        raise InputError(f"seed must be a whole number from 0, not {seed}")
    return SensorSeed(np.random.SeedSequence(entropy=seed, spawn_key=(sensor,)), corner)


def split(seed: SensorSeed) -> tuple[UnitErrors, np.random.Generator]:
    """Return the generators of a unit's constant errors and of its noise."""
    whole, corner = seed
    unit, flight = (
        np.random.default_rng(np.random.SeedSequence(whole.entropy, spawn_key=(*whole.spawn_key, part)))
        for part in (0, 1)
    )
    return Corner(unit, corner) if corner > 0.0 else unit, flight


class _Endless(Generic[Row]):
    """Rows drawn in blocks. Not a generator, so that a flight can be copied as it stands (`copy.deepcopy`)."""

    def __init__(self, draw: Callable[[], Iterable[Row]]) -> None:
        self._draw = draw
        self._rows: Iterator[Row] = iter(())

    def __iter__(self) -> Iterator[Row]:
        return self

    def __next__(self) -> Row:
        for row in self._rows:
            return row
        self._rows = iter(self._draw())
        return next(self._rows)


class NormalRows:
    """Standard normal numbers for a kernel, in blocks of rows (`BLOCK`, ...) that are drawn when used up."""

    def __init__(self, generator: np.random.Generator, *shape: int) -> None:
        """Prepare rows of a ``shape``."""
        self.rows = np.zeros((BLOCK, *shape))
        self._generator, self._next = generator, BLOCK

    def draw(self) -> None:
        """Draw the next block."""
        self._generator.standard_normal(out=self.rows)

    def next_row(self) -> int:
        """Return the index of the next unused row."""
        row = self._next
        if row == BLOCK:
            self.draw()
            row = 0
        self._next = row + 1
        return row


class CommonRows:
    """Normal numbers of sensors that are sampled together: one index for the rows of all."""

    def __init__(self, *parts: NormalRows) -> None:
        self._parts, self._next = parts, BLOCK

    def next_row(self) -> int:
        """Return the index of the next unused row of each part."""
        row = self._next
        if row == BLOCK:
            for part in self._parts:
                part.draw()
            row = 0
        self._next = row + 1
        return row


def _rows(generator: np.random.Generator, width: int) -> list[list[float]]:
    rows: list[list[float]] = generator.standard_normal((BLOCK, width)).tolist()
    return rows


def normal_rows(generator: np.random.Generator, width: int) -> Iterator[list[float]]:
    """Yield rows of ``width`` standard normal numbers without end."""
    return _Endless(partial(_rows, generator, width))


def normal_vector(generator: UnitErrors, sigma: float) -> Vector:
    """Three independent normal numbers of standard deviation ``sigma``."""
    x, y, z = (sigma * generator.standard_normal(3)).tolist()
    return x, y, z


def gauss_markov_step(period: float, time_constant: float) -> tuple[float, float]:
    """Decay and input gain of a first-order Gauss-Markov process of unit variance, sampled every ``period`` s.

    ``x' = decay x + drive n`` with n standard normal keeps the variance at 1 and the correlation at
    exp(-t / time_constant).
    """
    decay = math.exp(-period / time_constant)
    return decay, math.sqrt(1.0 - decay * decay)
