"""What the three-axis sensors share: low pass, misalignment, scale, offset, noise, quantisation, saturation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import LowPass
from sim_bridge.sensors.noise import UnitErrors, normal_rows, normal_vector

ZERO: Vector = (0.0, 0.0, 0.0)


class TriadErrors(NamedTuple):
    """What this one unit has wrong for the whole flight."""

    offset: Vector
    """SI; added to the reading"""
    scale: Vector
    """-; relative error of the sensitivity"""
    misalignment: Vector
    """rad; small rotation of the sensor's axes to the body's"""


class Conversion(NamedTuple):
    """How a triad turns SI into counts."""

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
    """Errors of one unit by their standard deviations in SI, - and rad."""
    return TriadErrors(
        normal_vector(generator, offset_sigma),
        normal_vector(generator, scale_sigma),
        normal_vector(generator, misalignment_sigma),
    )


class Triad:
    """One three-axis sensor; the driver divides its counts by the data sheet's sensitivity."""

    def __init__(
        self, conversion: Conversion, errors: TriadErrors, low_pass: LowPass, generator: np.random.Generator
    ) -> None:
        self._lowest, self._highest = conversion.lowest, conversion.highest
        self._sensitivity = conversion.sensitivity
        self._resolution = 1.0 / conversion.sensitivity
        self._noise = conversion.noise
        self._rows = _counts_from_body(conversion.sensitivity, errors)
        self._low_pass = low_pass
        self._normals = normal_rows(generator, 3)
        self._input: Vector | None = None
        self._filtered: Vector = ZERO

    def read(self, value: Vector, drift: Vector = ZERO) -> Vector:
        """Reading in SI of the true ``value`` in body axes; ``drift`` in SI is added to the sensor's offset."""
        x, y, z = self._filter(value)
        nx, ny, nz = next(self._normals)
        sx, sy, sz = self._noise
        s = self._sensitivity
        (a, b, c, ox), (d, e, f, oy), (g, h, i, oz) = self._rows
        return (
            self._quantise(a * x + b * y + c * z + ox + s * drift[0] + sx * nx),
            self._quantise(d * x + e * y + f * z + oy + s * drift[1] + sy * ny),
            self._quantise(g * x + h * y + i * z + oz + s * drift[2] + sz * nz),
        )

    def _filter(self, value: Vector) -> Vector:
        keep, before, now = self._low_pass
        if self._input is None:
            self._filtered = value
        elif keep == 0.0:
            return value
        else:
            (x, y, z), (px, py, pz), (fx, fy, fz) = value, self._input, self._filtered
            self._filtered = (
                keep * fx + before * px + now * x,
                keep * fy + before * py + now * y,
                keep * fz + before * pz + now * z,
            )
        self._input = value
        return self._filtered

    def _quantise(self, signal: float) -> float:
        counts = round(signal)
        if counts < self._lowest:
            counts = self._lowest
        elif counts > self._highest:
            counts = self._highest
        return counts * self._resolution


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
