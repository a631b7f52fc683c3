from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from plant_bench import NAMES, vehicle

from sim_bridge.flight_mechanics.free_map import BODY, LATERAL, LONGITUDINAL, ROLL, FreeMap, P, Q, V, W
from sim_bridge.flight_mechanics.modes import (
    DUTCH_ROLL,
    PHUGOID,
    ROLL_SUBSIDENCE,
    SHORT_PERIOD,
    SPIRAL,
    Mode,
    aliases,
    modes,
    short_period,
)
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import StrokeInputs, StrokeMap, throttle_for
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError


class Trimmed(NamedTuple):
    vehicle: SimulatedVehicle
    orbit: Orbit
    result: list[Mode]


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
    mode = short_period(trimmed.result)
    assert 0.1 < mode.damping < 0.95
    assert mode.eigenvalue.imag > 1.0
    assert mode.natural_frequency < math.pi * trimmed.orbit.inputs.frequency


def test_every_mode_but_the_spiral_dies_away(trimmed: Trimmed) -> None:
    assert all(mode.eigenvalue.real < 0.0 for mode in trimmed.result if mode.name != SPIRAL)
    assert trimmed.result == sorted(trimmed.result, key=lambda mode: mode.natural_frequency)


@pytest.mark.parametrize("index", [W, Q, V, P, ROLL])
def test_a_disturbed_flight_is_what_the_jacobian_foretells(trimmed: Trimmed, index: int) -> None:
    free = FreeMap(trimmed.vehicle, trimmed.orbit)
    start = np.zeros_like(free.state)
    start[index] = 0.01
    disturbed, calm = free.state + start, free.state
    for _ in range(3):
        disturbed, calm = free(disturbed), free(calm)
    foretold = np.linalg.matrix_power(free.jacobian(), 3) @ start
    flown = disturbed - calm
    assert np.linalg.norm((flown - foretold)[:BODY]) < 0.03 * np.linalg.norm(foretold[:BODY])


def test_the_map_of_free_flight_is_the_stroke_map_in_the_plane_of_symmetry(trimmed: Trimmed) -> None:
    orbit, stroke = trimmed.orbit, StrokeMap(trimmed.vehicle)
    moved = orbit.state.copy()
    moved[:4] += (0.1, 0.05, 0.02, 0.01)
    free = FreeMap(trimmed.vehicle, orbit)
    start = free.state.copy()
    start[list(LONGITUDINAL)] += (0.1, 0.05, 0.02, 0.01)
    assert free(start)[list(LONGITUDINAL)] == pytest.approx(stroke(moved, orbit.inputs)[:4], abs=1e-9)


def test_what_happens_across_the_plane_of_symmetry_leaves_the_plane_alone(trimmed: Trimmed) -> None:
    slope = FreeMap(trimmed.vehicle, trimmed.orbit).jacobian()
    along, across = np.ix_(LONGITUDINAL, LONGITUDINAL), np.ix_(LATERAL, LATERAL)
    for mixed in (np.ix_(LONGITUDINAL, LATERAL), np.ix_(LATERAL, LONGITUDINAL)):
        assert np.max(np.abs(slope[mixed])) < 1e-6 * min(np.max(np.abs(slope[along])), np.max(np.abs(slope[across])))
    assert all(min(mode.lateral_share, 1.0 - mode.lateral_share) < 1e-3 for mode in trimmed.result if mode.name)


def test_the_five_modes_of_flight_are_named_once(trimmed: Trimmed) -> None:
    names = sorted(mode.name for mode in trimmed.result if mode.name)
    assert names == sorted((PHUGOID, SHORT_PERIOD, DUTCH_ROLL, SPIRAL, ROLL_SUBSIDENCE))
    by_name = {mode.name: mode for mode in trimmed.result}
    assert by_name[PHUGOID].natural_frequency < 0.5 * by_name[SHORT_PERIOD].natural_frequency
    assert abs(by_name[SPIRAL].eigenvalue.real) < abs(by_name[ROLL_SUBSIDENCE].eigenvalue.real)
    # Lanchester's phugoid of a glider without drag, sqrt(2) g / V, is the order of it.
    lanchester = math.sqrt(2.0) * 9.80665 / trimmed.orbit.means.airspeed
    assert by_name[PHUGOID].natural_frequency == pytest.approx(lanchester, rel=0.45)


def test_period_and_halving_of_a_mode() -> None:
    swinging, growing = Mode(-2.0 + 4.0j, 1.0, 1.0), Mode(0.1 + 0j, 1.0, 0.0)
    assert swinging.period == pytest.approx(math.pi / 2.0)
    assert math.exp(-2.0 * swinging.time_to_half) == pytest.approx(0.5)
    assert math.exp(0.1 * -growing.time_to_half) == pytest.approx(2.0)
    assert math.isinf(growing.period) and growing.damping == -1.0


def test_a_mode_that_swings_faster_than_half_the_flapping_may_alias() -> None:
    assert aliases(Mode(-3.0 + 12.5j, 1.0, 1.0), 4.0)
    assert not aliases(Mode(-3.0 + 12.0j, 1.0, 1.0), 4.0)
    assert not aliases(Mode(-50.0 + 0j, 1.0, 1.0), 4.0)


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


@pytest.mark.validate
def test_a_trim_that_does_not_exist_says_what_was_asked() -> None:
    bird = vehicle("robo_raven_ii_d")
    coarse = bird._replace(wing=bird.wing._replace(strips=4))
    with pytest.raises(InputError, match=r"robo_raven_ii_d: no trim at 40 m/s climbing 0 m/s"):
        trim(coarse, 40.0, 0.0)


def test_no_short_period_among_modes_of_the_wings() -> None:
    wings = [Mode(-11.0 + 0j, 0.0, 0.0), Mode(-13.0 + 6.0j, 0.0002, 0.88)]
    with pytest.raises(InputError, match="no short-period"):
        short_period(wings)


def test_throttle_of_a_frequency() -> None:
    arizona = vehicle("arizona_100cm")
    assert throttle_for(4.75, arizona) == pytest.approx(0.5)
    assert throttle_for(0.0, arizona) == 0.0
    assert throttle_for(4.0, vehicle("robo_raven_ii_d")) == 0.0
