"""RETURN in wind: where the touchdown is, of both vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulate import ARIZONA, RAVEN, simulate

from avionics.guidance.mission import ItemKind, MissionItem
from sim_bridge.flight.world import Scenario

OUT_AND_BACK = (
    MissionItem(ItemKind.TAKEOFF, altitude=15.0),
    MissionItem(ItemKind.WAYPOINT, north=60.0, east=30.0, altitude=25.0),
    MissionItem(ItemKind.RETURN),
)
LIMIT = 60.0
"""m; from home to the touchdown"""
SINK, BANK = 2.0, math.radians(30.0)
"""m/s, rad; of the touchdown"""
DIRECTIONS = tuple(45.0 * k for k in range(8))
"""deg; the wind is from; each with a seed of its own"""


def check_return(vehicle: str, wind: float, wind_from_deg: float, seed: int) -> None:
    gusts = "small_uav_light" if wind else "none"
    scenario = Scenario(seed=seed, wind_speed=wind, wind_from=math.radians(wind_from_deg), turbulence=gusts)
    flight = simulate(vehicle, scenario, OUT_AND_BACK)
    truth, touchdown = flight.truth, flight.touchdown()
    last = int(np.flatnonzero(truth["time_us"] * 1e-6 == flight.air_time()[1])[0])
    assert math.hypot(truth["north"][last], truth["east"][last]) < LIMIT
    assert touchdown.sink < SINK
    assert abs(touchdown.bank) < BANK


@pytest.mark.validate
def test_return_in_wind_ends_at_home() -> None:
    """GIVEN 3 m/s of wind with light gusts WHEN it returns THEN it lands within 60 m of home."""
    check_return(RAVEN, 3.0, 57.0, 11)


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("wind", [0.0, 1.0, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("direction", range(len(DIRECTIONS)))
def test_return_ends_at_home_in_winds_from_all_sides(vehicle: str, wind: float, direction: int) -> None:
    check_return(vehicle, wind, DIRECTIONS[direction], 21 + direction)
