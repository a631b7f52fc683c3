"""Inverse dynamics: loads that were flown come back, and the coefficients of the regression with them."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.models.inverse_dynamics import WingMotion, coefficients
from logs.identification.models.multibody import MovedVehicle, wing_air
from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle, with_model
from tests.logs.identification import slow_hawk_flight as hawk
from wingbeat.errors import InputError


def launched(name: str, model: str, density: float, seed: int) -> tuple[Plant, MovedVehicle]:
    """A vehicle in a random state with its accelerations."""
    plant = Plant(with_model(load_vehicle(name), model))
    random, c = np.random.default_rng(seed), len(plant.layout.coordinates)
    y = plant.y
    y[2], y[3:7] = -50.0, random.normal(size=4)
    y[3:7] /= np.linalg.norm(y[3:7])
    y[7:13] = (9.2, 0.0, 0.3, 0.5, -0.4, 0.2)
    y[13 : 13 + c], y[13 + c : 13 + 2 * c] = 0.2 * random.normal(size=c), 4.0 * random.normal(size=c)
    controls = k.Controls(0.1, 0.1, 0.1, 0.1, 0.5, 0.05, 0.0, 0.005, 1.0)
    plant.evaluate(controls, k.Surroundings(1.0, 0.5, 0.2, density, k.FREE, 0.0, 0.0, 0.0))
    speeds = np.concatenate([y[7:13], y[13 + c : 13 + 2 * c]])
    rows = y[3:7], speeds, y[13 : 13 + c], plant.scratch.accelerations, np.array([1.0, 0.5, 0.2])
    return plant, MovedVehicle(*(np.array(row)[None] for row in rows))


@pytest.mark.parametrize("seed", range(3))
def test_the_load_is_the_one_that_moved_the_vehicle(seed: int) -> None:
    plant, moved = launched("slow_hawk", "regression", 1.225, seed)
    air = wing_air(plant.vehicle, moved, 1.225)
    assert air.load[0] == pytest.approx(plant.air_load(), abs=1e-9)


@pytest.mark.parametrize("name", ["slow_hawk", "robo_raven_ii_d"])
def test_without_air_nothing_acts_on_the_wings_whatever_drives_them(name: str) -> None:
    plant, moved = launched(name, "strip_theory", 1e-9, 4)
    assert np.abs(moved.rates).max() > 10.0
    assert np.abs(wing_air(plant.vehicle, moved, 1e-9).load).max() < 1e-6


def test_the_fuselage_s_drag_is_taken_off_where_asked_for() -> None:
    plant, moved = launched("robo_raven_ii_d", "strip_theory", 1.225, 5)
    left, off = (wing_air(plant.vehicle, moved, 1.225, with_drag=drag).load[0] for drag in (True, False))
    assert plant.scratch.body_load[:3] == pytest.approx((left - off)[:3])


def test_coefficients_of_the_true_motion_are_those_flown() -> None:
    flight = hawk.fly(3.0, 1)
    found = coefficients(hawk.vehicle(), WingMotion("flight", flight.time, hawk.moved(flight), 1.225))
    assert found.load == pytest.approx(flight.wing_loads, abs=1e-9)
    signals = found.experiment.signals
    for name, terms in hawk.TRUTH.items():
        expected = hawk.ZEROS[name] + sum(value * signals[term] for term, value in terms.items())
        assert signals[name] == pytest.approx(expected, abs=1e-9)


def test_a_low_pass_leaves_the_relation_as_it_is() -> None:
    flight = hawk.fly(3.0, 1)
    motion = WingMotion("flight", flight.time, hawk.moved(flight), 1.225)
    signals = coefficients(hawk.vehicle(), motion, cutoff=15.0).experiment.signals
    expected = hawk.ZEROS["C_T"] + sum(value * signals[term] for term, value in hawk.TRUTH["C_T"].items())
    assert signals["C_T"] == pytest.approx(expected, abs=1e-9)


def test_motions_that_tell_nothing_are_refused() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 200)
    moved = hawk.moved(flight)
    with pytest.raises(InputError, match="coordinates"):
        wing_air(hawk.vehicle(), moved._replace(coordinates=moved.coordinates[:, :2]), 1.225)
    holed = moved.rates.copy()
    holed[50] = np.nan
    with pytest.raises(InputError, match="every sample"):
        coefficients(hawk.vehicle(), WingMotion("holed", flight.time, moved._replace(rates=holed), 1.225))
    still = moved._replace(speeds=np.zeros_like(moved.speeds))
    with pytest.raises(InputError, match="falls to zero"):
        coefficients(hawk.vehicle(), WingMotion("still", flight.time, still, 1.225))
    with pytest.raises(InputError, match="needs"):
        coefficients(hawk.vehicle(), WingMotion("short", flight.time, moved, 1.225), cutoff=2.0)
