"""The stroke-averaged model against flights of the vehicle it was linearised from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.flight_mechanics.averaged import AveragedModel, short_period_of, stroke_averaged_model
from sim_bridge.flight_mechanics.modes import modes, short_period
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.vehicles import load_vehicle

VEHICLES = ("robo_raven_ii_d", "arizona_100cm")


@pytest.fixture(scope="module", params=[VEHICLES[0], pytest.param(VEHICLES[1], marks=pytest.mark.validate)])
def linearised(request: pytest.FixtureRequest) -> tuple[str, Orbit, AveragedModel]:
    vehicle = load_vehicle(request.param)
    orbit = trim(vehicle, vehicle.cruise.airspeed, vehicle.cruise.climb_rate)
    return request.param, orbit, stroke_averaged_model(vehicle, orbit)


def test_four_states_explain_the_averaged_response(linearised: tuple[str, Orbit, AveragedModel]) -> None:
    assert np.all(linearised[2].unexplained < 2e-3)


def test_pitch_is_the_integral_of_its_rate_and_turns_gravity(linearised: tuple[str, Orbit, AveragedModel]) -> None:
    _, orbit, model = linearised
    assert model.a[3].tolist() == [0.0, 0.0, 1.0, 0.0]
    assert model.a[0, 3] == pytest.approx(-9.80665 * math.cos(orbit.means.pitch))
    assert model.b[3] == 0.0


def test_the_elevator_pitches_up_and_heave_and_pitch_are_damped(linearised: tuple[str, Orbit, AveragedModel]) -> None:
    model = linearised[2]
    assert model.b[2] > 0.0
    assert model.a[1, 1] < 0.0
    assert model.a[2, 2] < 0.0
    assert model.a[2, 1] < 0.0


def test_the_short_period_oscillates_near_the_floquet_exponent(linearised: tuple[str, Orbit, AveragedModel]) -> None:
    """The membrane's twisting mode, which four states cannot hold, moves it, but not far."""
    name, orbit, model = linearised
    averaged, exact = short_period_of(model), short_period(modes(load_vehicle(name), orbit))
    assert 0.3 < averaged.damping < 0.9
    assert averaged.natural_frequency == pytest.approx(exact.natural_frequency, rel=0.1)
    assert averaged.damping == pytest.approx(exact.damping, abs=0.05)
    damped = averaged.natural_frequency * math.sqrt(1.0 - averaged.damping**2)
    assert damped < math.pi * orbit.inputs.frequency
