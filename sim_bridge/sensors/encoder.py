"""Encoders on the wing shafts: optical with counters and index pulses, or magnetic."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.sensors.noise import NormalRows, SensorSeed, split
from sim_bridge.vectors import Floats, Integers
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


# Numbers of a counter: counts per turn, count of the index, last count, edges lost, count at the last index pulse,
# number of pulses, whether there was a reading.
TURN, INDEX, PLACE, LOST, LATCHED, PULSES, STARTED, NUMBERS = 0, 1, 2, 3, 4, 5, 6, 7


class CounterArrays(NamedTuple):
    """Kernel arguments of the counter of one wing."""

    numbers: Integers
    """(NUMBERS,)"""
    scale: Floats
    """(2,) counts/rad and counts; of the flap angle, with the wing level"""


class Counter:
    """Counter of one wing and the register that latches it at an index pulse."""

    def __init__(self, counts_per_turn: int, zero: float, index: float) -> None:
        counts_per_rad = counts_per_turn / math.tau
        numbers = np.zeros(NUMBERS, dtype=np.int64)
        numbers[TURN], numbers[INDEX] = counts_per_turn, math.floor(index * counts_per_rad + zero)
        self.arrays = CounterArrays(numbers, np.array((counts_per_rad, zero)))
        """arguments of `count_edges`"""

    def lose(self, counts: int) -> None:
        """Lose ``counts`` edges on the way up (negative: on the way down)."""
        self.arrays.numbers[LOST] += counts

    def read(self, flap: float, noise: float = 0.0) -> tuple[int, int, int]:
        """Count at a flap angle in rad, count at the last index pulse, and the number of pulses so far.

        ``noise`` in counts adds to the angle.

        The index is passed at most once from reading to reading (of a wing slower than a turn a tick).
        """
        return count_alone(flap, noise, self._bound)

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.arrays)


@exact
def count_alone(flap: float, noise: float, bound: Bound) -> tuple[int, int, int]:
    """`count_edges` of one counter alone."""
    return count_edges(flap, noise, bound_values(bound))


@exact_inlined
def count_edges(flap: float, noise: float, counter: CounterArrays) -> tuple[int, int, int]:
    """Compute `Counter.read`."""
    n, scale = counter.numbers, counter.scale
    place = math.floor(flap * scale[0] + scale[1] + noise)
    if n[STARTED] != 0 and place != n[PLACE]:
        _detect_index(n[PLACE], place, n)
    n[STARTED], n[PLACE] = 1, place
    return place - n[LOST], n[LATCHED], n[PULSES]


@exact_inlined
def _detect_index(before: int, place: int, n: Integers) -> None:
    """A pulse begins where the state of the index is entered, from below or from above."""
    rising = place > before
    edge = n[INDEX] if rising else n[INDEX] + 1
    passed = (place - edge) // n[TURN]
    if passed == (before - edge) // n[TURN]:
        return
    n[LATCHED] = n[INDEX] + n[TURN] * (passed if rising else passed + 1) - n[LOST]
    n[PULSES] += 1


class Encoder:
    """Encoders of both wings."""

    def __init__(self, spec: EncoderSpec, seed: SensorSeed) -> None:
        self.left = Counter(spec.counts_per_turn, spec.zero_left, spec.index_left)
        self.right = Counter(spec.counts_per_turn, spec.zero_right, spec.index_right)
        self.noise = spec.noise
        """counts; standard deviation"""
        self.normals = NormalRows(split(seed)[1], 2)

    def next_row(self) -> int:
        """Return the index of the next row of noise; without noise no numbers are drawn."""
        return self.normals.next_row() if self.noise > 0.0 else 0

    def read(self, flap_left: float, flap_right: float) -> tuple[int, int, int, int, int, int]:
        """What follows the time in a `EncoderSample`, at these flap angles in rad, positive with the wing up."""
        noise_left, noise_right = self.normals.rows[self.next_row()].tolist()
        left, right = (
            self.left.read(flap_left, self.noise * noise_left),
            self.right.read(flap_right, self.noise * noise_right),
        )
        return left[0], right[0], left[1], right[1], left[2], right[2]
