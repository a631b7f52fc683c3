from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from plant_bench import NAMES, vehicle

from avionics.quantities import BadInput
from sim_bridge.flight_mechanics.modes import Mode, jacobian, modes, short_period
from sim_bridge.flight_mechanics.orbit import Orbit, StrokeInputs, StrokeMap, throttle_for, trim
from sim_bridge.vehicles import SimulatedVehicle


class Trimmed(NamedTuple):
    vehicle: SimulatedVehicle
    orbit: Orbit
    found: list[Mode]


@pytest.fixture(scope="module", params=NAMES)
def trimmed(request: pytest.FixtureRequest) -> Trimmed:
    bird = vehicle(request.param)
    orbit = trim(bird, bird.cruise.airspeed, bird.cruise.climb_rate)
    return Trimmed(bird, orbit, modes(bird, orbit))


def test_the_stroke_repeats_itself_at_the_speed_and_climb_asked_for(trimmed: Trimmed) -> None:
    orbit, cruise = trimmed.orbit, trimmed.vehicle.cruise
    assert orbit.residual < 1e-6
    stroke = StrokeMap(trimmed.vehicle)
    assert stroke(orbit.state, orbit.inputs) == pytest.approx(orbit.state, abs=1e-6)
    assert orbit.means.airspeed == pytest.approx(cruise.airspeed, abs=1e-6)
    assert orbit.means.climb_rate == pytest.approx(cruise.climb_rate, abs=1e-6)


def test_the_trim_is_within_what_the_vehicle_can_do(trimmed: Trimmed) -> None:
    orbit, bird = trimmed.orbit, trimmed.vehicle
    assert abs(orbit.inputs.elevator) < bird.tail_servo.travel
    assert abs(bird.cruise.stroke_mean) + orbit.inputs.amplitude < bird.drive.travel
    assert 0.0 < orbit.means.mechanical_power < orbit.means.electrical_power
    assert orbit.means.pitch == pytest.approx(orbit.means.angle_of_attack, abs=0.01)


def test_the_short_period_swings_slower_than_half_the_flapping(trimmed: Trimmed) -> None:
    mode = short_period(trimmed.found)
    assert 0.1 < mode.damping < 0.95
    assert mode.eigenvalue.imag > 1.0
    assert mode.natural_frequency < math.pi * trimmed.orbit.inputs.frequency


def test_every_mode_dies_away(trimmed: Trimmed) -> None:
    assert all(mode.eigenvalue.real < 0.0 for mode in trimmed.found)
    assert trimmed.found == sorted(trimmed.found, key=lambda mode: mode.natural_frequency)


@pytest.mark.parametrize(("index", "size"), [(2, 0.01), (1, 0.01)])
def test_a_disturbed_flight_is_what_the_jacobian_foretells(trimmed: Trimmed, index: int, size: float) -> None:
    orbit, stroke = trimmed.orbit, StrokeMap(trimmed.vehicle)
    disturbed, calm = orbit.state.copy(), orbit.state.copy()
    disturbed[index] += size
    for _ in range(3):
        disturbed, calm = stroke(disturbed, orbit.inputs), stroke(calm, orbit.inputs)
    start = np.zeros(stroke.size)
    start[index] = size
    foretold = np.linalg.matrix_power(jacobian(trimmed.vehicle, orbit), 3) @ start
    flown = disturbed - calm
    assert np.linalg.norm((flown - foretold)[:4]) < 0.03 * np.linalg.norm(foretold[:4])


def test_settled_wings_leave_the_body_where_it_was() -> None:
    stroke = StrokeMap(vehicle("robo_raven_ii_d"))
    cruise = vehicle("robo_raven_ii_d").cruise
    z = np.zeros(stroke.size)
    z[0], z[1], z[3] = 6.8, 0.7, 0.1
    inputs = StrokeInputs(cruise.frequency, cruise.stroke_amplitude, 0.0)
    settled = stroke.settle_wings(z, inputs, 6)
    again = stroke.settle_wings(settled, inputs, 1)
    assert settled[:4] == pytest.approx(z[:4])
    assert again[4:8] == pytest.approx(settled[4:8], abs=1e-2)


def test_a_trim_that_does_not_exist_says_what_was_asked() -> None:
    bird = vehicle("robo_raven_ii_d")
    coarse = bird._replace(wing=bird.wing._replace(strips=4))
    with pytest.raises(BadInput, match=r"robo_raven_ii_d: no trim at 40 m/s climbing 0 m/s"):
        trim(coarse, 40.0, 0.0)


def test_no_short_period_among_modes_of_the_wings() -> None:
    wings = [Mode(-11.0 + 0j, 0.0, 0.0), Mode(-13.0 + 6.0j, 0.0002, 0.88)]
    with pytest.raises(BadInput, match="no short-period"):
        short_period(wings)


def test_throttle_of_a_frequency() -> None:
    arizona = vehicle("arizona_100cm")
    assert throttle_for(4.75, arizona) == pytest.approx(0.5)
    assert throttle_for(0.0, arizona) == 0.0
    assert throttle_for(4.0, vehicle("robo_raven_ii_d")) == 0.0
