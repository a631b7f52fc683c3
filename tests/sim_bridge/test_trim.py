"""The search for a steady flight: where it ends, what it refuses, and how the flight shakes."""

from __future__ import annotations

import math

import pytest
from plant_bench import NAMES, vehicle

from sim_bridge.actuators.linkage import FourBar, Motor
from sim_bridge.aerodynamics.regression import Regression
from sim_bridge.flight_mechanics.excursions import excursions, figures
from sim_bridge.flight_mechanics.free_map import FreeMap
from sim_bridge.flight_mechanics.limits import Control, excesses, running_out
from sim_bridge.flight_mechanics.modes import modes
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import StrokeInputs, StrokeMap
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError

LINKAGE = FourBar(0.012, 0.050, 0.022, 0.030, 0.050, -1.2, False)
MOTOR = Motor(0.004, 0.12, 0.8, 40.0, 0.85, 2e-6)


@pytest.fixture(scope="module", params=NAMES)
def cruising(request: pytest.FixtureRequest) -> tuple[SimulatedVehicle, Orbit]:
    bird = vehicle(request.param)
    return bird, trim(bird, bird.cruise.airspeed, bird.cruise.climb_rate)


@pytest.fixture(scope="module")
def motored() -> SimulatedVehicle:
    """The Arizona ornithopter on a motor with a four-bar linkage."""
    bird = vehicle("arizona_100cm")
    drive = bird.drive._replace(kind="linkage", position_gain=40.0, rate_gain=0.6, nominal_voltage=11.1)
    return bird._replace(drive=drive, linkage=LINKAGE, motor=MOTOR)


@pytest.mark.validate
def test_a_trim_that_newton_does_not_reach_is_followed_from_the_cruise() -> None:
    heard: list[str] = []
    orbit = trim(vehicle("arizona_100cm"), 8.0, -2.0, heard.append)
    assert heard[0].startswith("8 m/s climbing -2") and any(words.startswith("8 m/s climbing -1") for words in heard)
    assert orbit.means.climb_rate == pytest.approx(-2.0, abs=1e-6)
    assert orbit.inputs.frequency < trim(vehicle("arizona_100cm"), 8.0, 0.0).inputs.frequency


@pytest.mark.parametrize(
    ("name", "airspeed", "climb_rate", "reports"),
    [
        (
            "arizona_100cm",
            16.0,
            0.0,
            r"16 m/s climbing 0 m/s: it needs a stroke of 7\.\d+ Hz, the drive has 0 to 7\.25",
        ),
        pytest.param(
            "arizona_100cm",
            2.0,
            0.0,
            r"already at 4(\.\d+)? m/s .* it needs 0\.6\d rad of elevator, the servo has 0\.6$",
            marks=pytest.mark.validate,
        ),
        pytest.param(
            "robo_raven_ii_d",
            2.0,
            0.0,
            r": below 3\.\d+ m/s the tail cannot hold the pitch moment \(elevator at 0\.\d+ of ±0\.6 rad\)",
            marks=pytest.mark.validate,
        ),
        pytest.param(
            "slow_hawk",
            9.2,
            4.0,
            r"beyond 9\.2 m/s climbing 2\.\d+ m/s the motor gives no more \(throttle at 0\.99 of 1\)",
            marks=pytest.mark.validate,
        ),
        (
            "robo_raven_ii_d",
            6.8,
            3.0,
            r"beyond 6\.8 m/s climbing 1\.\d+ m/s a larger stroke gives no more thrust \(commanded half stroke",
        ),
        pytest.param(
            "arizona_100cm",
            40.0,
            0.0,
            r"already at 1\d(\.\d+)? m/s climbing 0 m/s it needs a stroke of",
            marks=pytest.mark.validate,
        ),
        ("robo_raven_ii_d", 2.0, 3.0, r"an airspeed of 2 m/s does not climb 3 m/s"),
    ],
)
def test_a_refusal_tells_what_stands_in_the_way(name: str, airspeed: float, climb_rate: float, reports: str) -> None:
    with pytest.raises(InputError, match=reports):
        trim(vehicle(name), airspeed, climb_rate)


@pytest.mark.parametrize(("rate", "steps"), [(0.1, 2.0), (-0.1, 8.0), (0.0, math.inf)])
def test_a_control_lasts_until_the_end_of_its_range_that_it_goes_to(rate: float, steps: float) -> None:
    assert Control("elevator", 0.3, -0.5, 0.5, "rad", "").left(rate) == pytest.approx(steps)


def test_the_control_that_runs_out_first_is_told_whichever_way_it_goes() -> None:
    bird, now = vehicle("robo_raven_ii_d"), StrokeInputs(4.0, 0.5, -0.4)
    assert "elevator at -0.4 of ±0.6" in running_out(bird, now, StrokeInputs(4.0, 0.55, -0.5))
    assert "half stroke at 0.5 of 0.9" in running_out(bird, now, StrokeInputs(4.0, 0.7, -0.41))


def test_an_insects_flight_is_followed_to_a_speed_that_newton_does_not_reach() -> None:
    orbit = trim(vehicle("hawkmoth"), 2.9, 0.0)
    assert orbit.means.airspeed == pytest.approx(2.9, abs=1e-6) and orbit.residual < 1e-6


def test_an_airspeed_at_which_the_aerodynamic_model_does_not_hold_is_refused() -> None:
    bird = vehicle("arizona_100cm")
    sections = bird.sections | {"regression": Regression("time", 0.3, 0.25)}
    flown = bird._replace(sections=sections, aerodynamics=bird.aerodynamics._replace(model="regression"))
    with pytest.raises(InputError, match=r"regression holds from 8\.7 to 9\.7 m/s"):
        trim(flown, 8.0, 0.0)


@pytest.mark.parametrize(
    ("name", "inputs", "reports"),
    [
        ("robo_raven_ii_d", StrokeInputs(4.0, 0.5, 0.9), "0.9 rad of elevator, the servo has 0.6"),
        ("robo_raven_ii_d", StrokeInputs(4.0, 1.0, 0.0), "the wings at 1.2 rad, the servos stop at 1.1"),
        ("robo_raven_ii_d", StrokeInputs(4.0, -0.1, 0.0), "wings that take power out of the air"),
        ("arizona_100cm", StrokeInputs(9.0, 0.6, 0.0), "a stroke of 9 Hz, the drive has 0 to 7.25"),
    ],
)
def test_what_a_vehicle_has_not_is_told(name: str, inputs: StrokeInputs, reports: str) -> None:
    assert excesses(vehicle(name), inputs) == [reports]
    assert excesses(vehicle(name), StrokeInputs(4.0, 0.5, 0.3)) == []


def test_a_motor_beyond_full_throttle_is_told(motored: SimulatedVehicle) -> None:
    assert excesses(motored, StrokeInputs(4.0, 0.5, 0.0, 0.9)) == []
    assert excesses(motored, StrokeInputs(4.0, 0.5, 0.0, 1.2)) == ["a throttle of 1.2, of 0 to 1"]


def test_a_motor_on_a_linkage_repeats_its_stroke_at_a_steady_throttle(motored: SimulatedVehicle) -> None:
    orbit = trim(motored, 8.0, 0.0)
    flown = StrokeMap(motored).fly(orbit.state, orbit.inputs)
    assert flown.end == pytest.approx(orbit.state, abs=1e-6)
    assert abs(flown.phase_error) < 1e-6
    assert 0.0 < orbit.inputs.throttle < 1.0
    faster = trim(motored, 9.5, 0.0)
    assert faster.inputs.throttle > orbit.inputs.throttle and faster.inputs.frequency > orbit.inputs.frequency


def test_a_cranks_disturbed_speed_dies_away(motored: SimulatedVehicle) -> None:
    free = FreeMap(motored, trim(motored, 8.0, 0.0))
    assert abs(free.jacobian()[-1, -1]) < 0.9
    assert free(free.state) == pytest.approx(free.state, abs=1e-6)


def test_the_body_goes_up_and_down_as_its_speed_and_acceleration_say(
    cruising: tuple[SimulatedVehicle, Orbit],
) -> None:
    moved, frequency = excursions(*cruising), cruising[1].inputs.frequency
    low, high = moved.vertical_acceleration
    assert low < 0.0 < high
    # Of a sine at the flapping frequency; higher harmonics shake more than they lift.
    assert moved.altitude < (high - low) / (2.0 * math.pi * frequency) ** 2 * 1.05
    assert moved.pitch[0] < cruising[1].means.pitch < moved.pitch[1]
    assert moved.pitch_rate[0] < 0.0 < moved.pitch_rate[1]


def test_a_charge_lasts_as_long_as_its_current(cruising: tuple[SimulatedVehicle, Orbit]) -> None:
    bird, orbit = cruising
    found = figures(bird, orbit)
    assert found.endurance * orbit.means.current == pytest.approx(bird.battery.capacity)
    assert found.range == pytest.approx(found.endurance * orbit.means.airspeed)
    still = orbit._replace(means=orbit.means._replace(current=0.0))
    assert math.isinf(figures(bird, still).endurance)


@pytest.mark.parametrize("name", ["hawkmoth", "entomopter"])
def test_an_insects_growing_swing_is_one_of_the_body_and_no_short_period(name: str) -> None:
    bird = vehicle(name)
    found = modes(bird, trim(bird, bird.cruise.airspeed, bird.cruise.climb_rate))
    (swing,) = [mode for mode in found if mode.eigenvalue.real > 0.0 and mode.eigenvalue.imag > 0.0]
    assert swing.name == "pitch oscillation" and swing.body_share > 0.99
    names = {mode.name for mode in found if not mode.lateral}
    assert names == {"pitch oscillation", "pitch subsidence", "heave subsidence"}


def test_a_motor_and_its_flight_have_modes(motored: SimulatedVehicle) -> None:
    found = modes(motored, trim(motored, 8.0, 0.0))
    assert {"phugoid", "short period", "dutch roll", "spiral"} <= {mode.name for mode in found}
