"""Common parts of three-axis sensors: low pass, misalignment, scale, offset, noise, quantization, saturation."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import LowPass
from sim_bridge.sensors.noise import NormalRows, UnitErrors, normal_vector
from sim_bridge.vectors import Floats

ZERO: Vector = (0.0, 0.0, 0.0)


class TriadErrors(NamedTuple):
    """Constant errors of one unit."""

    offset: Vector
    """SI; added to the reading"""
    scale: Vector
    """-; relative error of the sensitivity"""
    misalignment: Vector
    """rad; small rotation of the sensor's axes to the body's"""


class Conversion(NamedTuple):
    """Conversion of SI to counts."""

    sensitivity: float
    """counts per SI unit by the data sheet"""
    lowest: int
    """counts; where it saturates"""
    highest: int
    """counts; where it saturates"""
    noise: Vector
    """counts; standard deviation of each axis"""


def draw_errors(
    generator: UnitErrors, offset_sigma: float, scale_sigma: float, misalignment_sigma: float
) -> TriadErrors:
    """Draw the errors of a unit from standard deviations in SI, - and rad."""
    return TriadErrors(
        normal_vector(generator, offset_sigma),
        normal_vector(generator, scale_sigma),
        normal_vector(generator, misalignment_sigma),
    )


class Unit(NamedTuple):
    """Kernel arguments of one three-axis sensor."""

    rows: Floats
    """(3, 4) counts; from SI in body axes: scale, small rotation, offset"""
    noise: Floats
    """(3,) counts; standard deviation of each axis"""
    low_pass: LowPass
    conversion: Floats
    """(3,); counts per SI unit, and the counts where it saturates"""
    normals: Floats
    """(n, 3); standard normal numbers drawn ahead"""
    memory: Floats
    """(2, 3) SI; last input and last output of the low pass"""
    initialized: Floats
    """(1,); 1 when there was an input"""


class Triad:
    """One three-axis sensor; the driver divides its counts by the data sheet's sensitivity."""

    def __init__(
        self, conversion: Conversion, errors: TriadErrors, low_pass: LowPass, generator: np.random.Generator
    ) -> None:
        self.normals = NormalRows(generator, 3)
        self.unit = Unit(
            np.array(_counts_from_body(conversion.sensitivity, errors)),
            np.array(conversion.noise),
            low_pass,
            np.array((conversion.sensitivity, conversion.lowest, conversion.highest), dtype=np.float64),
            self.normals.rows,
            np.zeros((2, 3)),
            np.zeros(1),
        )
        """arguments of `read_axes`"""

    def read(self, value: Vector, drift: Vector = ZERO) -> Vector:
        """Return the measured SI value of the true ``value`` in body axes; ``drift`` in SI adds to the offset."""
        out = np.zeros(3)
        read_triad(value, drift, self.normals.next_row(), self._bound, out)
        x, y, z = out.tolist()
        return x, y, z

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.unit)


@exact
def read_triad(value: Vector, drift: Vector, at: int, bound: Bound, out: Floats) -> None:
    """`read_axes` of one sensor alone."""
    read_axes(value, drift, at, bound_values(bound), out)


@exact_inlined
def read_axes(value: Vector, drift: Vector, at: int, unit: Unit, out: Floats) -> None:
    """Compute `Triad.read` with the row ``at`` of the noise, ``out`` (3,): in whole counts within the range."""
    x, y, z = _filtered(value, unit.low_pass, unit.memory, unit.initialized)
    sensitivity, lowest, highest = unit.conversion[0], unit.conversion[1], unit.conversion[2]
    for axis in range(3):
        row, noise = unit.rows[axis], unit.noise[axis] * unit.normals[at, axis]
        signal = row[0] * x + row[1] * y + row[2] * z + row[3] + sensitivity * drift[axis] + noise
        counts = np.rint(signal) + 0.0  # a count has no negative zero
        out[axis] = min(max(counts, lowest), highest) * (1.0 / sensitivity)


@exact_inlined
def _filtered(value: Vector, low_pass: LowPass, memory: Floats, initialized: Floats) -> Vector:
    keep, before, now = low_pass
    if keep == 0.0:
        return value
    x, y, z = value
    last, out = memory[0], memory[1]
    if initialized[0] == 0.0:
        initialized[0] = 1.0
        out[0], out[1], out[2] = x, y, z
    else:
        out[0] = keep * out[0] + before * last[0] + now * x
        out[1] = keep * out[1] + before * last[1] + now * y
        out[2] = keep * out[2] + before * last[2] + now * z
    last[0], last[1], last[2] = x, y, z
    return out[0], out[1], out[2]


Row = tuple[float, float, float, float]


def _counts_from_body(sensitivity: float, errors: TriadErrors) -> tuple[Row, Row, Row]:
    """Rows of the affine map from SI in body axes to counts: scale, small rotation, offset."""
    rx, ry, rz = errors.misalignment
    gains = [sensitivity * (1.0 + error) for error in errors.scale]
    offsets = [sensitivity * offset for offset in errors.offset]
    return (
        (gains[0], gains[0] * rz, -gains[0] * ry, offsets[0]),
        (-gains[1] * rz, gains[1], gains[1] * rx, offsets[1]),
        (gains[2] * ry, -gains[2] * rx, gains[2], offsets[2]),
    )
