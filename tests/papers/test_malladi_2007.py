"""Malladi, Krashanitsa, Silin, Shkarayev 2007: the Arizona 100 cm ornithopter."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.mechanism import wing_strips
from sim_bridge.plant_kernel import crank_frequency
from sim_bridge.vehicles import load_vehicle


def test_the_elliptic_planform_has_the_published_area() -> None:
    strips, _ = wing_strips(load_vehicle("arizona_100cm").wing)
    assert float(strips.chord @ strips.width) == pytest.approx(0.1571, rel=2e-3)


@pytest.mark.parametrize(
    ("throttle", "low", "high"), [(0.25, 2.0, 2.5), (0.5, 4.5, 5.0), (0.75, 5.5, 6.0), (1.0, 7.0, 7.5)]
)
def test_flapping_frequency_of_table_2(throttle: float, low: float, high: float) -> None:
    table = np.array(load_vehicle("arizona_100cm").drive.frequencies)
    assert low <= crank_frequency(throttle, table) <= high


def test_the_frequency_between_and_beyond_the_table() -> None:
    table = np.array(load_vehicle("arizona_100cm").drive.frequencies)
    assert crank_frequency(0.625, table) == pytest.approx(5.25)
    assert crank_frequency(-1.0, table) == 0.0
    assert crank_frequency(3.0, table) == 7.25
