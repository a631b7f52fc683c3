"""Airspeed, altitude, climb, place, velocity and wind are off by what they say (``make validate``)."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from consistency import Consistency
from simulate import ARIZONA, RAVEN, simulate

from sim_bridge.flight.world import Scenario

pytestmark = pytest.mark.validate

AIR = ((0.0, "none"), (3.0, "none"), (3.0, "small_uav_light"), (3.0, "small_uav_moderate"), (2.0, "moderate"))
"""m/s of wind, and its gusts"""
DURATION = 60.0
"""s"""


@cache
def flight(vehicle: str, number: int) -> Consistency:
    """Each in its own air with its own sensors."""
    wind, turbulence = AIR[number]
    seed = 20 + number + (len(AIR) if vehicle == ARIZONA else 0)
    scenario = Scenario(seed, wind, wind_from=1.3 * number, turbulence=turbulence, duration=DURATION)
    return Consistency(simulate(vehicle, scenario))


@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("number", range(len(AIR)))
def test_innovations_have_the_size_that_is_expected_in_every_air(vehicle: str, number: int) -> None:
    found = flight(vehicle, number).innovations()
    print(vehicle, AIR[number], {name: round(value, 2) for name, value in found.items()})  # noqa: T201
    assert found.keys() == {"airspeed", "altitude", "position", "velocity"}
    assert all(0.4 < value < 1.6 for value in found.values()), found


def test_errors_have_the_size_that_is_told() -> None:
    """GIVEN ten flights in all airs, zeros, drifts and slow errors drawn for each THEN half or twice would fail."""
    flights = [flight(vehicle, number).errors() for vehicle in (RAVEN, ARIZONA) for number in range(len(AIR))]
    means = {name: float(np.mean([each[name] for each in flights])) for name in flights[0]}
    print({name: round(value, 2) for name, value in means.items()})  # noqa: T201
    assert means.keys() == {"airspeed", "altitude", "climb", "position", "velocity", "wind"}
    assert all(0.5 < value < 2.0 for value in means.values()), means
