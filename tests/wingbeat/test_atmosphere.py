"""The standard atmosphere against the tables of ISO 2533."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wingbeat.atmosphere import GAS_CONSTANT, isa, pressure_altitude
from wingbeat.constants import STANDARD_GRAVITY


@pytest.mark.parametrize(
    ("altitude", "pressure", "temperature", "density"),
    [
        (-1000.0, 113930.0, 294.65, 1.3470),
        (0.0, 101325.0, 288.15, 1.2250),
        (1000.0, 89874.6, 281.65, 1.1116),
        (5000.0, 54019.9, 255.65, 0.73612),
        (11000.0, 22632.1, 216.65, 0.36392),
        (20000.0, 5474.89, 216.65, 0.088035),
    ],
)
def test_isa_table(altitude: float, pressure: float, temperature: float, density: float) -> None:
    air = isa(altitude)
    assert air.pressure == pytest.approx(pressure, rel=2e-5)
    assert air.temperature == pytest.approx(temperature, abs=1e-9)
    assert air.density == pytest.approx(density, rel=5e-5)


@given(st.floats(-1900.0, 19000.0), st.floats(95e3, 105e3), st.floats(250.0, 310.0))
def test_isa_is_in_hydrostatic_balance(altitude: float, pressure: float, temperature: float) -> None:
    above, here, below = (isa(altitude + step, pressure, temperature) for step in (1.0, 0.0, -1.0))
    assert (below.pressure - above.pressure) / 2.0 == pytest.approx(here.density * STANDARD_GRAVITY, rel=1e-6)
    assert here.pressure == pytest.approx(here.density * GAS_CONSTANT * here.temperature)


def test_a_day_with_low_pressure() -> None:
    assert isa(0.0, 98000.0, 280.0)[:2] == (98000.0, 280.0)


@pytest.mark.parametrize("altitude", [-2001.0, 20001.0, math.nan, math.inf])
def test_isa_rejects_altitudes_out_of_range(altitude: float) -> None:
    with pytest.raises(ValueError, match="standard atmosphere"):
        isa(altitude)


@pytest.mark.parametrize(
    ("altitude", "pressure"), [(-500.0, 107478.0), (0.0, 101325.0), (1000.0, 89874.6), (5000.0, 54019.9)]
)
def test_pressure_altitude_table(altitude: float, pressure: float) -> None:
    assert pressure_altitude(pressure) == pytest.approx(altitude, abs=0.2)
