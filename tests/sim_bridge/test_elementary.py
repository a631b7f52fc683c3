"""Arctangent, sine and cosine of the kernels: beside the C library's, over all angles and sizes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.elementary import STEEP, arctangent, sine_and_cosine

MANY = 20_000


def test_arctangent_is_exact_to_two_units_in_the_last_place() -> None:
    random = np.random.default_rng(1)
    y, x = random.standard_normal((2, MANY)) * 10.0 ** random.uniform(-8.0, 8.0, (2, MANY))
    found = np.array([arctangent(a, b) for a, b in zip(y.tolist(), x.tolist(), strict=True)])
    wanted = np.arctan2(y, x)
    assert np.max(np.abs(found - wanted) / np.spacing(np.abs(wanted))) <= 2.0


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -1.0, 1e-300, STEEP, 5e-324])
@pytest.mark.parametrize("x", [0.0, 1.0, -1.0, 1e300, -STEEP])
def test_arctangent_at_the_corners(y: float, x: float) -> None:
    assert arctangent(y, x) == pytest.approx(math.atan2(y, x), rel=1e-15, abs=0.0)
    assert math.copysign(1.0, arctangent(y, x)) == math.copysign(1.0, y)


def test_sine_and_cosine_are_exact_to_a_unit_in_the_last_place() -> None:
    angles = np.random.default_rng(2).uniform(-2.0, 2.0, MANY)
    sine, cosine = np.array([sine_and_cosine(angle) for angle in angles.tolist()]).T
    assert np.max(np.abs(sine - np.sin(angles)) / np.spacing(np.abs(np.sin(angles)))) <= 1.0
    assert np.max(np.abs(cosine - np.cos(angles)) / np.spacing(np.abs(np.cos(angles)))) <= 1.0


def test_no_number_stays_none() -> None:
    nothing = math.nan
    assert math.isnan(arctangent(nothing, 1.0)) and math.isnan(arctangent(1.0, nothing))
    assert all(map(math.isnan, sine_and_cosine(nothing)))
