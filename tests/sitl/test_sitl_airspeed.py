"""Airspeed setpoints of the ground and of a mission, in still air."""

import numpy as np
import pytest
from simulate import ARIZONA, RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.messages import Command, CommandKind, Mode
from avionics.vehicles import load_vehicle
from sim_bridge import topics as truth_topics
from sim_bridge.flight.world import Scenario

TAKEOFF = MissionItem(ItemKind.TAKEOFF, altitude=20.0)
CIRCLE = MissionItem(ItemKind.LOITER, 0.0, 0.0, 20.0)
CHANGE, SETTLED, END = 22.0, 42.0, 52.0
"""s; since boot"""
TOLERANCE = 0.5
"""m/s; error of the true airspeed"""


def speed(flight: Flight, begin: float, end: float) -> float:
    """Mean true airspeed (m/s) from ``begin`` to ``end`` (s)."""
    truth = flight.columns(truth_topics.STATE)
    time = truth["time_us"] * 1e-6
    return float(np.mean(truth["airspeed"][(time >= begin) & (time <= end)]))


def altitude_error(flight: Flight, begin: float) -> float:
    """Greatest altitude error (m) of the loop after ``begin`` (s)."""
    loop = flight.columns(topics.ALTITUDE_LOOP)
    return float(np.abs(loop["altitude_error"][loop["time_us"] >= begin * 1e6]).max())


def change(time: float, airspeed: float) -> Command:
    return Command(round(time * 1e6), CommandKind.CHANGE_SPEED, "", airspeed, None, "test")


@pytest.mark.parametrize(
    ("vehicle", "fraction"),
    [
        pytest.param(RAVEN, 1.0, marks=pytest.mark.validate),
        *(pytest.param(RAVEN, each, marks=pytest.mark.validate) for each in (0.0, 0.5)),
        *(pytest.param(ARIZONA, each, marks=pytest.mark.validate) for each in (0.0, 0.5, 1.0)),
    ],
)
def test_airspeed_setpoint_is_reached_over_the_range(vehicle: str, fraction: float) -> None:
    """GIVEN a circle in still air WHEN an airspeed is commanded THEN it is flown, and the altitude is kept."""
    gains = load_vehicle(vehicle).gains.altitude
    setpoint = gains.speed_min + fraction * (gains.speed_max - gains.speed_min)
    flight = simulate(vehicle, Scenario(seed=1, duration=END), (TAKEOFF, CIRCLE), [change(CHANGE, setpoint)])
    assert speed(flight, SETTLED, END) == pytest.approx(setpoint, abs=TOLERANCE)
    assert altitude_error(flight, CHANGE) < 1.5


def test_airspeed_setpoint_is_limited_and_ends_with_the_mode() -> None:
    """GIVEN a mission's airspeed above the range WHEN the mode changes THEN the vehicle's own airspeed returns."""
    fast = MissionItem(ItemKind.SPEED, airspeed=20.0)
    mode = Command(36_000_000, CommandKind.SET_MODE, Mode.LOITER.name, source="test")
    flight = simulate(RAVEN, Scenario(seed=1, duration=55.0), (TAKEOFF, fast, CIRCLE), [mode])
    most = load_vehicle(RAVEN).gains.altitude.speed_max
    assert speed(flight, 30.0, 36.0) == pytest.approx(most, abs=TOLERANCE)
    assert speed(flight, 48.0, 55.0) == pytest.approx(6.8, abs=TOLERANCE)
    assert f"airspeed: {most:g} m/s, 20 m/s is outside its range" in flight.events()
    assert "airspeed setpoint cleared" in flight.events()
