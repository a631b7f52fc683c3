"""Encoders on the wing shafts: optical with counters and index pulses, or magnetic."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from sim_bridge.sensors.noise import SensorSeed, normal_rows, split
from wingbeat.units import Quantity


class EncoderSpec(NamedTuple):
    """E2-500 (US Digital): 500 cycles a turn, four edges a cycle: 2000 counts, 0.18 deg (Gerdes Table 1).

    A count is a place, not a measurement: without noise, the counter holds the last edge passed. The
    counters are set when the vehicle is powered up in its jig, so the zeros are known to within that jig. The
    third channel is high during one state of the quadrature a turn, the same from either side. A magnetic encoder
    (AS5600) has noise, and no index: its index angle is beyond the travel of the wing.
    """

    counts_per_turn: Annotated[int, Quantity("counts", 4, 1000000)]
    """of the wing's shaft, all four edges"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """of the left encoder with its wing level"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """of the right encoder with its wing level"""
    index_left: Annotated[float, Quantity("rad", -3.2, 3.2)]
    """angle of the left wing at its encoder's index"""
    index_right: Annotated[float, Quantity("rad", -3.2, 3.2)]
    """angle of the right wing at its encoder's index"""
    noise: Annotated[float, Quantity("counts", 0.0, 1000.0)] = 0.0
    """standard deviation of one reading; 0 for an optical encoder"""


class Counter:
    """Counter of one wing and the register that latches it at an index pulse."""

    def __init__(self, counts_per_turn: int, zero: float, index: float) -> None:
        self._turn = counts_per_turn
        self._counts_per_rad = counts_per_turn / math.tau
        self._zero = zero
        self._index = math.floor(index * self._counts_per_rad + zero)
        self._place: int | None = None
        self._lost = 0
        self._latched = 0
        self._pulses = 0

    def lose(self, counts: int) -> None:
        """Lose ``counts`` edges on the way up (negative: on the way down)."""
        self._lost += counts

    def read(self, flap: float, noise: float = 0.0) -> tuple[int, int, int]:
        """Count at a flap angle in rad, count at the last index pulse, and the number of pulses so far.

        ``noise`` in counts adds to the angle.

        The index is passed at most once from reading to reading (of a wing slower than a turn a tick).
        """
        place = math.floor(flap * self._counts_per_rad + self._zero + noise)
        if self._place is not None and place != self._place:
            self._watch_index(self._place, place)
        self._place = place
        return place - self._lost, self._latched, self._pulses

    def _watch_index(self, before: int, place: int) -> None:
        """A pulse begins where the state of the index is entered, from below or from above."""
        rising = place > before
        edge = self._index if rising else self._index + 1
        passed = (place - edge) // self._turn
        if passed == (before - edge) // self._turn:
            return
        self._latched = self._index + self._turn * (passed if rising else passed + 1) - self._lost
        self._pulses += 1


class Encoder:
    """Encoders of both wings."""

    def __init__(self, spec: EncoderSpec, seed: SensorSeed) -> None:
        self.left = Counter(spec.counts_per_turn, spec.zero_left, spec.index_left)
        self.right = Counter(spec.counts_per_turn, spec.zero_right, spec.index_right)
        self._noise = spec.noise
        self._normals = normal_rows(split(seed)[1], 2)

    def read(self, flap_left: float, flap_right: float) -> tuple[int, int, int, int, int, int]:
        """What follows the time in a `EncoderSample`, at these flap angles in rad, positive with the wing up."""
        noise_left, noise_right = next(self._normals) if self._noise > 0.0 else (0.0, 0.0)
        left, left_index, left_pulses = self.left.read(flap_left, self._noise * noise_left)
        right, right_index, right_pulses = self.right.read(flap_right, self._noise * noise_right)
        return left, right, left_index, right_index, left_pulses, right_pulses
