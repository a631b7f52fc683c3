"""Gerdes 2017: power and lift balances of Table 4, and one set of values for stream and flight."""

from __future__ import annotations

import math

import pytest

from sim_bridge.flight_mechanics.wing_fit import as_measured
from sim_bridge.validation.gerdes_flight import (
    ONE_SET,
    bench_stroke,
    flight,
    ideal_stroke,
    least_power,
    needed_thrust,
    plate_loads,
    propulsive_efficiency,
    with_set,
)
from sim_bridge.validation.gerdes_tables import WINGS
from sim_bridge.validation.gerdes_wings import vehicles


@pytest.mark.parametrize("name", WINGS)
def test_printed_incidence_contradicts_the_measured_power(name: str) -> None:
    wing = WINGS[name]
    lift, drag = plate_loads(wing)
    assert lift > 1.3 * wing.weight * 9.81 and drag * wing.airspeed > 1.2 * wing.power
    assert math.atan2(drag, lift) == pytest.approx(wing.angle_of_attack)


@pytest.mark.parametrize("name", WINGS)
def test_measured_power_exceeds_the_lower_bound_of_momentum_theory(name: str) -> None:
    wing = WINGS[name]
    assert 0.09 * wing.power < least_power(wing) < 0.22 * wing.power
    heavier = wing._replace(weight=2.0 * wing.weight, climb_rate=0.0)
    assert least_power(heavier) == pytest.approx(4.0 * least_power(wing._replace(climb_rate=0.0)))


@pytest.mark.parametrize("name", WINGS)
def test_one_set_meets_power_speed_stroke_and_thrust_in_the_stream(name: str) -> None:
    wing, found = WINGS[name], bench_stroke(name, with_set(vehicles()[name]))
    assert found.positive_power == pytest.approx(wing.power, rel=0.10)
    assert found.plunge_speed == pytest.approx(wing.plunge_speed, rel=0.04)
    assert found.amplitude == pytest.approx(wing.amplitude, rel=0.15)
    assert found.thrust == pytest.approx(needed_thrust(wing, ONE_SET.drag_area), abs=0.15)
    assert 0.14 < propulsive_efficiency(name, found) < 0.25


@pytest.mark.parametrize("name", WINGS)
def test_efficiency_of_the_two_shipped_sets_brackets_the_needed_one(name: str) -> None:
    """GIVEN the measured stroke WHEN ideal drives move the wings THEN one set has too much thrust, one too little."""
    wing, vehicle = WINGS[name], vehicles()[name]
    flown, measured = ideal_stroke(name, vehicle), ideal_stroke(name, as_measured(vehicle))
    assert 0.5 < propulsive_efficiency(name, flown) < 0.7
    assert flown.thrust - needed_thrust(wing, 0.0) > 1.9
    assert propulsive_efficiency(name, measured) < 0.05
    assert needed_thrust(wing, 0.003) * wing.airspeed / wing.power > 0.12
    assert needed_thrust(wing, 0.010) * wing.airspeed / wing.power < 0.28


@pytest.mark.parametrize("name", ["B", "C", "D"])
def test_one_set_flies_with_more_of_the_measured_stroke_and_power(name: str) -> None:
    vehicle, wing = vehicles()[name], WINGS[name]
    shipped, one = flight(name, vehicle), flight(name, with_set(vehicle))
    assert shipped is not None and one is not None
    assert 2.0 * shipped.flap_amplitude < 0.6 * wing.amplitude < 0.79 * wing.amplitude < 2.0 * one.flap_amplitude
    assert shipped.mechanical_power < 0.56 * wing.power < 0.65 * wing.power < one.mechanical_power
