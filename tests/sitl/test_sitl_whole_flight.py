"""The circuit from the hand to the ground, against what must be reached in still air."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from as_table import as_table, imported
from consistency import Consistency
from identified import INPUTS_OVER, Result, identified
from simulate import ARIZONA, RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import completion_text
from avionics.messages import Stage
from groundstation.command import identify
from logs.reader import open_log
from sim_bridge import topics as truth_topics
from sim_bridge.flight.world import LAUNCH_TIME, Scenario
from sim_bridge.vehicles import load_vehicle

AIR_TIME = {RAVEN: (85.0, 97.0), ARIZONA: (85.0, 115.0)}
"""s; of the circuit in still air: the Arizona's wings cannot beat slowly enough to come down as steeply"""
WITH_A_MODEL = 3
"""-; the first methods: output, equation and filter error. What the others give is as sharp as the record alone"""
FIRST_INPUT = 57.0
"""s; the circuit's doublets begin"""


@pytest.fixture(scope="module")
def raven() -> Flight:
    return simulate(RAVEN, Scenario(seed=1))


def check_altitude_hold(flight: Flight, lasting: float) -> None:
    altitude_hold = flight.altitude_hold()
    assert altitude_hold.duration >= lasting
    assert altitude_hold.altitude_rms < 1.0
    assert math.degrees(altitude_hold.course_rms) < 5.0


def check_sensing(flight: Flight) -> None:
    roll, pitch = flight.attitude_error()
    assert math.degrees(roll) < 2.0
    assert math.degrees(pitch) < 2.0
    assert flight.airspeed_error() < 0.5
    measured, true = flight.energy()
    assert true > 100.0
    assert measured == pytest.approx(true, rel=0.02)


def check_landing(flight: Flight) -> None:
    touchdown = flight.touchdown()
    assert 0.0 < touchdown.sink < 1.0
    assert abs(math.degrees(touchdown.bank)) < 10.0
    assert flight.events()[-1] == "touchdown, disarmed"
    last = flight.of(topics.NAVIGATION)[-1]
    assert (last.stage, last.armed) == (Stage.LANDED, 0)


def check_air_time(flight: Flight, vehicle: str) -> None:
    launch, touchdown = flight.air_time()
    least, most = AIR_TIME[vehicle]
    assert least <= touchdown - launch <= most


def check_wings_at_rest(flight: Flight) -> None:
    end = flight.truth["time_us"][-1]
    wing = flight.columns(truth_topics.WING)
    last_second = wing["time_us"] > end - 1_000_000
    for side in ("left", "right"):
        assert np.abs(wing[f"rate_{side}"][last_second]).max() < 0.1
    assert flight.of(topics.ACTUATORS)[-1].armed == 0


def check_doublets(flight: Flight) -> None:
    """Each doublet of the mission reached the tail, both ways, and none was broken off."""
    inputs = [item.excitation for item in flight.mission if item.excitation]
    asked = [excitation for excitation in inputs for _ in range(excitation.repeats)]
    status, tail = flight.columns(topics.EXCITATION), flight.columns(truth_topics.WING)
    assert not status["aborted"].any()
    active = status["active"] == 1
    assert len(set(status["manoeuvre"][active])) == len(asked)
    for number, excitation in zip(sorted(set(status["manoeuvre"][active])), asked, strict=True):
        begin, end = status["time_us"][active & (status["manoeuvre"] == number)][[0, -1]]
        elevator = tail["elevator"][(tail["time_us"] >= begin) & (tail["time_us"] <= end)]
        trim = np.median(elevator)
        assert elevator.max() - trim > 0.8 * excitation.amplitude
        assert trim - elevator.min() > 0.8 * excitation.amplitude


def test_altitude_and_heading_are_held(raven: Flight) -> None:
    check_altitude_hold(raven, 5.0)


def test_attitude_airspeed_and_energy_are_measured_while_flapping(raven: Flight) -> None:
    check_sensing(raven)


def test_variances_are_honest(raven: Flight) -> None:
    """Twice or half of a sigma would fail; zero, drift and slow error are one draw: see `test_sitl_consistency`."""
    stated = Consistency(raven)
    assert all(0.4 < value < 1.6 for value in stated.innovations().values()), stated.innovations()
    fast = {name: value for name, value in stated.errors().items() if name in ("velocity", "climb")}
    assert all(0.3 < value < 3.0 for value in fast.values()), fast


def test_it_lands_softly_disarms_and_stops_its_wings(raven: Flight) -> None:
    check_landing(raven)
    check_wings_at_rest(raven)


def test_it_is_in_the_air_for_about_ninety_seconds(raven: Flight) -> None:
    check_air_time(raven, RAVEN)


def test_the_doublets_reach_the_tail(raven: Flight) -> None:
    check_doublets(raven)


def test_the_loops_are_frozen_while_an_input_lasts(raven: Flight) -> None:
    status, navigation = raven.columns(topics.EXCITATION), raven.columns(topics.NAVIGATION)
    active = np.interp(navigation["time_us"], status["time_us"], status["active"]) == 1.0
    assert active.sum() > 100
    assert navigation["frozen"][active].mean() > 0.9
    assert not navigation["frozen"][navigation["stage"] != Stage.EN_ROUTE].any()


def test_every_item_is_flown_in_its_order(raven: Flight) -> None:
    done = [event for event in raven.events() if event.startswith("waypoint ")]
    assert done == [completion_text(number, item) for number, item in enumerate(raven.mission[:-1])]


def test_the_wings_are_still_in_the_hand(raven: Flight) -> None:
    wing = raven.columns(truth_topics.WING)
    armed_and_held = (wing["time_us"] > 4_000_000) & (wing["time_us"] < LAUNCH_TIME * 1e6)
    assert np.abs(wing["rate_left"][armed_and_held]).max() < 0.05


@pytest.fixture(scope="module")
def result(raven: Flight) -> Result:
    return identified(RAVEN, raven.log.until(INPUTS_OVER))


@pytest.mark.validate
def test_the_circuits_doublets_give_the_short_period_and_the_torque_constants(result: Result) -> None:
    """Methods with a physical model must give numbers, and sharp ones; every number given must hold the truth."""
    assert all(mode.short_period is not None for mode in result.modes[:WITH_A_MODEL])
    for mode in (mode for mode in result.modes if mode.short_period is not None):
        assert mode.frequency.contains(result.true.natural_frequency)
        assert mode.damping.contains(result.true.damping)
    for mode in result.modes[:WITH_A_MODEL]:
        assert mode.frequency.high - mode.frequency.low <= 0.4 * mode.frequency.value
        assert mode.damping.value == pytest.approx(result.true.damping, abs=0.08)
    assert result.agree
    drive = load_vehicle(RAVEN).drive
    for name, true in (("K_tau", drive.torque_constant), ("K_tau0", drive.torque_offset)):
        _, low, high = result.torque[name]
        assert low <= true <= high


@pytest.mark.validate
def test_the_flight_as_a_table_without_its_excitation_gives_the_same_short_period(
    raven: Flight, result: Result, tmp_path: Path
) -> None:
    """GIVEN columns of CSV and the vehicle's name THEN each method's value lies in the flown log's interval."""
    table = as_table(raven.log.until(INPUTS_OVER), FIRST_INPUT - 5.0, tmp_path / "flight.csv")
    with open_log(imported(table)) as log:
        found = identify.identified(log, "modes", RAVEN).modes
    assert found is not None and found.agree and [note.partition(":")[0] for note in found.notes] == ["manoeuvres"]
    for mode, flown_mode in zip(found.modes[:2], result.modes[:2], strict=True):
        for one, other in ((mode.frequency, flown_mode.frequency), (mode.damping, flown_mode.damping)):
            assert one is not None and other is not None
            assert other.contains(one.value) and one.contains(other.value)


@pytest.mark.validate
def test_the_crank_driven_ornithopter_is_launched_climbs_and_holds() -> None:
    flight = simulate(ARIZONA, Scenario(seed=1, duration=45.0))
    check_altitude_hold(flight, 5.0)
    check_sensing(flight)


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize(("seed", "wind"), [(1, 0.0), (2, 0.0), (3, 0.0), (4, 3.0)])
def test_both_vehicles_fly_the_circuit_from_the_hand_to_the_ground(vehicle: str, seed: int, wind: float) -> None:
    flight = simulate(vehicle, Scenario(seed=seed, wind_speed=wind))
    check_altitude_hold(flight, 5.0)
    check_sensing(flight)
    check_doublets(flight)
    check_landing(flight)
    check_wings_at_rest(flight)
    if not wind:
        check_air_time(flight, vehicle)
