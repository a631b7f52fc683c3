"""Kernels that round as Python does, and kernels that are called by their entry point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.compiled import Bound, bound_values, entry_point, exact, kernel
from sim_bridge.environment import dryden
from sim_bridge.sensors.low_pass import low_pass
from sim_bridge.sensors.triad import Conversion, Triad, draw_errors
from sim_bridge.vectors import Floats
from wingbeat import atmosphere, quaternions

air_at, frd_from_ned = exact(atmosphere.air_at), exact(quaternions.frd_from_ned)
finite = st.floats(-2.0, 2.0)


@given(st.floats(-2000.0, 20000.0))
def test_exact_atmosphere_has_the_bits_of_python(altitude: float) -> None:
    assert air_at(altitude, 101325.0, 288.15) == atmosphere.air_at(altitude, 101325.0, 288.15)


@given(st.tuples(st.floats(0.1, 1.0), finite, finite, finite), st.tuples(finite, finite, finite))
def test_exact_rotation_has_the_bits_of_python(
    quaternion: tuple[float, float, float, float], vector: tuple[float, float, float]
) -> None:
    assert frd_from_ned(quaternion, vector) == quaternions.frd_from_ned(quaternion, vector)


def test_triad_has_the_bits_of_its_equation() -> None:
    """GIVEN scale, rotation, offset, noise WHEN a vector is read THEN each axis is its row, rounded, in Python."""
    errors = draw_errors(np.random.default_rng(1), 0.01, 0.02, 0.03)
    triad = Triad(Conversion(26.1, -4096, 4095, (1.0, 1.1, 1.6)), errors, low_pass(0.002, 0.005), _generator())
    normals = _generator().standard_normal((256, 3)).tolist()
    rows = triad.unit.rows.tolist()
    for row, normal in zip(np.random.default_rng(2).normal(0.0, 9.0, (200, 3)).tolist(), normals, strict=False):
        x, y, z = triad.read(tuple(row), (0.1, 0.2, 0.3))
        felt = triad.unit.memory[1].tolist()
        expected = []
        for (a, b, c, d), noise, normal_axis, drift in zip(
            rows, (1.0, 1.1, 1.6), normal, (0.1, 0.2, 0.3), strict=True
        ):
            signal = a * felt[0] + b * felt[1] + c * felt[2] + d + 26.1 * drift + noise * normal_axis
            expected.append(min(max(round(signal), -4096), 4095) * (1.0 / 26.1))
        assert [x, y, z] == expected


def _generator() -> np.random.Generator:
    return np.random.default_rng(7)


@kernel
def shifted_sum(bound: Bound, shift: float) -> float:
    (column,) = bound_values(bound)
    return float(column.sum() + shift)


def test_entry_point_is_the_kernel() -> None:
    bound = Bound((np.arange(4.0),))
    call = entry_point(shifted_sum, bound, 0.0)
    assert call(bound, 0.5) == shifted_sum(bound, 0.5) == 6.5
    assert call(Bound((np.arange(3.0),)), 1) == 4.0
    with pytest.raises(TypeError):
        call(bound, "text")


def test_gust_of_the_world_is_that_of_the_model() -> None:
    """GIVEN a vehicle in gusts WHEN its air is stepped THEN the gusts are those of `dryden.step`, bit for bit."""
    from sim_bridge.bridge.world import NEUTRAL
    from sim_bridge.flight.inputs import PlantInputs
    from sim_bridge.plant import Plant
    from sim_bridge.vehicles import load_vehicle

    vehicle = load_vehicle("robo_raven_ii_d")
    turbulence = dryden.turbulence("moderate", 2.0 * vehicle.wing.semispan, 3)
    plant, generator = Plant(vehicle), np.random.default_rng(5)
    inputs, state = PlantInputs(plant, turbulence, (-2.0, 0.5, 0.0), 0.3, 20.0), dryden.initial(turbulence, 0.3)
    for height in 10.0 ** generator.uniform(0.0, 4.0, 700):
        v: Floats = generator.normal(0.0, 5.0, 3)
        plant.y[2], plant.observed[13:16] = -height, v
        inputs.step(NEUTRAL, 0.005)
        flight = (v.item(0) + 2.0, v.item(1) - 0.5, v.item(2))
        state, gust = dryden.step(turbulence, state, height, flight, 0.005)
        assert inputs.gust.tolist() == [*gust.velocity, *gust.omega]
        assert math.isfinite(gust.velocity[0])
