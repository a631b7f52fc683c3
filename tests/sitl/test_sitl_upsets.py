"""Air that asks more than the cruise gives: rolling gusts that throw it on its side, a wind as fast as it is."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from simulate import RAVEN, Flight, Underway, simulate

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.missions import load_mission
from sim_bridge.flight.world import Scenario

pytestmark = pytest.mark.validate

BEGUN = 45.0
"""s; in the turns of the circuit, 40 m high"""
ROLLING = 5.0
"""s; for which the air rolls, about the course as it was at their beginning"""
WIND = 6.5
"""m/s; the trim of the cruise is 6.8 m/s"""


@pytest.fixture(scope="module")
def turning() -> Underway:
    underway = Underway(RAVEN, Scenario(seed=1), load_mission("circuit"))
    underway.until(BEGUN)
    return underway


def rolled(underway: Underway, rate: float) -> Flight:
    """The flight on in air that turns at ``rate`` rad/s about its course for a while."""
    twin = copy.deepcopy(underway)
    yaw = float(twin.flight().true_attitude()[2][-1])
    twin.world.inputs.gust[3:] = rate * math.cos(yaw), rate * math.sin(yaw), 0.0
    twin.until(BEGUN + ROLLING)
    twin.world.inputs.gust[:] = 0.0
    twin.until(BEGUN + ROLLING + 8.0)
    return twin.flight()


@pytest.mark.parametrize("rate", [1.2, 1.5])
def test_a_spiral_ends_because_its_thrust_does(turning: Underway, rate: float) -> None:
    """With thrust it went on past 90 degrees and into the ground."""
    flight = rolled(turning, rate)
    time, altitude, bank = flight.truth["time_us"] * 1e-6, flight.altitude(), np.abs(flight.true_attitude()[0])
    upset = time >= BEGUN
    assert math.radians(55.0) < bank[upset].max() < math.radians(80.0), "an upset, and no more than one"
    assert altitude[upset][0] - altitude[upset].min() < 8.0
    assert bank[-1] < math.radians(30.0)
    assert altitude[-1] == pytest.approx(40.0, abs=3.0)


def test_against_a_wind_of_its_cruise_it_flies_faster_and_comes_on() -> None:
    ahead = (MissionItem(ItemKind.TAKEOFF, altitude=15.0), MissionItem(ItemKind.WAYPOINT, north=300.0, altitude=15.0))
    flight = simulate(RAVEN, Scenario(seed=2, wind_speed=WIND, wind_from=0.0, duration=50.0), ahead)
    truth = flight.truth
    last = truth["time_us"] >= 35e6
    assert truth["v_north"][last].mean() > 2.0
    assert truth["airspeed"][last].mean() < 10.0, "within what it has thrust for"
    assert flight.altitude()[last] == pytest.approx(15.0, abs=1.5)
