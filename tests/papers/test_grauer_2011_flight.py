"""Grauer, Ulrich, Hubbard, Pines, Humbert 2011: the Slow Hawk's mass distribution and its flight of V.A.

Most of these figures the vehicle was fitted to: such a test guards the fit and validates nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.flight_mechanics.excursions import Excursions, excursions
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.prescribed import SLOW_HAWK_STROKE
from sim_bridge.flight_mechanics.stroke_map import StrokeInputs, StrokeMap
from sim_bridge.mechanism import all_parts, build_mechanism, total_mass
from sim_bridge.validation.row import FITTED, WITHIN
from sim_bridge.validation.slow_hawk import (
    ACCELERATION,
    ALTITUDE,
    HEAVE,
    MASSES,
    PITCH_RATE,
    SPEED,
    TRAVEL,
    VARIATION,
    VEHICLE,
    center_travel,
    inertia_variations,
    mass_properties,
    mass_rows,
    mass_shares,
    simulated_stroke,
    towed,
    trimmed,
)
from sim_bridge.vehicles import load_vehicle, with_model
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

HAWK = load_vehicle(VEHICLE)
PITCH = 1
"""index of the moment of inertia about the body's y axis"""


@pytest.fixture(scope="module")
def orbit() -> Orbit:
    return trimmed()[1]


@pytest.fixture(scope="module")
def moved(orbit: Orbit) -> Excursions:
    return excursions(HAWK, orbit)


def test_five_bodies_with_the_tail_in_two_joints_in_a_row() -> None:
    parts = all_parts(HAWK)
    assert len(parts) == 5
    assert parts["rudder"].parent == "elevator" and parts["elevator"].parent == "fuselage"
    assert build_mechanism(HAWK).layout.coordinates[:4] == ("right_wing", "left_wing", "elevator", "rudder")


def test_masses_and_planform_are_the_printed_ones() -> None:
    assert total_mass(HAWK) == pytest.approx(0.45, abs=1e-9)
    assert mass_shares(HAWK) == pytest.approx(MASSES, abs=1e-9)
    assert sum(MASSES.values()) == pytest.approx(1.0)
    assert {row.outcome for row in mass_rows()} == {WITHIN, FITTED}


def test_the_center_of_mass_moves_and_the_inertia_varies_as_in_fig_2() -> None:
    assert center_travel(HAWK) == pytest.approx(TRAVEL, rel=0.1)
    variations = inertia_variations(HAWK)
    assert variations.argmax() == PITCH
    assert variations.max() == pytest.approx(VARIATION, rel=0.1)


def test_the_center_of_mass_rises_with_the_wings_by_their_share_of_the_mass() -> None:
    up, level = (mass_properties(HAWK, flap) for flap in (0.6, 0.0))
    part, wing = all_parts(HAWK)["right_wing"], HAWK.wing
    membrane = 4.0 / (3.0 * np.pi) * wing.semispan * wing.membrane_mass
    moment = 2.0 * (part.mass * part.center[1] + membrane)
    tilt = np.cos(part.rotation[1])
    assert level.center[2] - up.center[2] == pytest.approx(moment * np.sin(0.6) * tilt / 0.45, rel=2e-3)
    assert up.mass == pytest.approx(level.mass)


def test_the_inertia_is_the_composite_one_of_the_compiled_tree() -> None:
    stroke, flap = StrokeMap(HAWK), 0.4
    stroke.plant.y[:] = 0.0
    stroke.plant.y[3] = 1.0
    stroke.plant.y[list(stroke.plant.layout.flap)] = flap
    airless = stroke.around._replace(density=1e-9)
    stroke.plant.evaluate(stroke.controls(0, StrokeInputs(5.91, 0.5, 0.0)), airless)
    composite = stroke.plant.scratch.tree.inertia[0]
    mass, center, inertia = mass_properties(HAWK, flap)
    about_origin = inertia + mass * (center @ center * np.eye(3) - np.outer(center, center))
    assert composite[3, 3] == pytest.approx(mass, rel=1e-6)
    assert composite[:3, :3] == pytest.approx(about_origin, rel=1e-6, abs=1e-9)


def test_motor_and_linkage_make_the_printed_stroke_in_flight(orbit: Orbit) -> None:
    flown = simulated_stroke(HAWK, orbit)
    assert flown.highest == pytest.approx(SLOW_HAWK_STROKE.highest, abs=0.02)
    assert flown.lowest == pytest.approx(SLOW_HAWK_STROKE.lowest, abs=0.02)
    assert flown.down_from == pytest.approx(SLOW_HAWK_STROKE.down_from, abs=0.025)
    assert flown.down_to == pytest.approx(SLOW_HAWK_STROKE.down_to, abs=0.025)
    assert flown.frequency == pytest.approx(SLOW_HAWK_STROKE.frequency, rel=0.005)
    assert orbit.inputs.throttle == pytest.approx(0.77, abs=0.005)


def test_the_flight_repeats_itself_level_at_the_printed_speed(orbit: Orbit) -> None:
    again = StrokeMap(HAWK).fly(orbit.state, orbit.inputs)
    assert again.end == pytest.approx(orbit.state, abs=1e-6)
    assert again.means.airspeed == pytest.approx(SPEED, abs=1e-6)
    assert again.means.climb_rate == pytest.approx(0.0, abs=1e-6)
    assert abs(orbit.inputs.elevator) < HAWK.tail_servo.travel


def test_the_fitted_excursions_stay_near_the_printed_ones(moved: Excursions) -> None:
    assert np.ptp(moved.heave_speed) == pytest.approx(HEAVE, rel=0.2)
    assert np.ptp(moved.pitch_rate) == pytest.approx(PITCH_RATE, rel=0.2)
    assert np.ptp(moved.vertical_acceleration) / STANDARD_GRAVITY == pytest.approx(ACCELERATION, rel=0.2)
    assert moved.altitude == pytest.approx(ALTITUDE, rel=0.35)


def test_a_sinusoid_of_the_printed_heave_speed_has_not_the_printed_altitude() -> None:
    sinusoid = HEAVE / (2.0 * np.pi * SLOW_HAWK_STROKE.frequency)
    assert sinusoid == pytest.approx(0.054, abs=5e-4)
    assert sinusoid < 0.7 * ALTITUDE


def test_the_vehicle_file_names_what_was_fitted() -> None:
    fitted = {"wing.twist_stiffness", "fuselage.drag_area", "motor.torque_constant", "bodies.fuselage.inertia"}
    assert fitted <= set(HAWK.fitted)
    assert all("Grauer" in figure for figure in HAWK.fitted.values())


def test_table_1_flies_level_by_its_time_domain_column_if_it_is_towed() -> None:
    orbit, tow = towed(HAWK, "time")
    assert orbit.inputs.frequency == pytest.approx(SLOW_HAWK_STROKE.frequency, rel=1e-3)
    assert orbit.means.climb_rate == pytest.approx(0.0, abs=1e-6)
    assert abs(orbit.inputs.elevator) < HAWK.tail_servo.travel
    assert tow == pytest.approx(4.8, abs=0.2)


def test_table_1_does_not_fly_by_its_frequency_domain_column() -> None:
    with pytest.raises(
        InputError, match=r"^regression, column frequency: C_L = 0\.28\d at 9\.2 m/s needs .* outside"
    ) as said:
        towed(HAWK, "frequency")
    assert "\n" not in str(said.value)


def test_without_a_tow_table_1_does_not_fly() -> None:
    said_why = r"slow_hawk: no trim at 9\.2 m/s .*regression is a drag: its flight needs a tow"
    with pytest.raises(InputError, match=said_why) as said:
        trim(with_model(HAWK, "regression"), SPEED, 0.0)
    assert "\n" not in str(said.value)
