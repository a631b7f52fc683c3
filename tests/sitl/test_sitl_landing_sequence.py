"""RETURN with a landing sequence in the mission."""

import math
from functools import cache

import numpy as np
import pytest
from simulate import RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import Fence, ItemKind, MissionItem, Zone
from avionics.messages import Command, CommandKind, Mode, Stage
from sim_bridge.flight.world import Scenario

PLACE = (-40.0, 150.0)
"""m; north and east of the landing place"""
MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.LOITER, 0.0, 60.0, 40.0),
    MissionItem(ItemKind.LAND_START),
    MissionItem(ItemKind.WAYPOINT, 180.0, 150.0, 40.0),
    MissionItem(ItemKind.LAND, *PLACE, heading=math.pi),
)


def command(time: float, kind: CommandKind, name: str, value: float = 0.0) -> Command:
    return Command(round(time * 1e6), kind, name, value, None, "test")


@cache
def returned(return_type: int) -> Flight:
    commands = [
        command(1.0, CommandKind.SET_PARAMETER, "NAV_RETURN_TYPE", float(return_type)),
        command(1.1, CommandKind.SET_PARAMETER, "NAV_LOITER_TIME", 8.0),
        command(30.0, CommandKind.SET_MODE, Mode.RETURN.name),
    ]
    return simulate(RAVEN, Scenario(seed=2, duration=150.0), MISSION, commands)


def landed_at(flight: Flight) -> tuple[float, float]:
    return float(flight.truth["north"][-1]), float(flight.truth["east"][-1])


def nearest_home(flight: Flight) -> float:
    """Least true distance (m) to home after RETURN."""
    truth = flight.truth
    return float(np.hypot(truth["north"], truth["east"])[truth["time_us"] > 30e6].min())


@pytest.mark.parametrize(
    ("return_type", "place", "over_home"),
    [
        pytest.param(0, (0.0, 0.0), True, marks=pytest.mark.validate),
        pytest.param(1, PLACE, True, marks=pytest.mark.validate),
        pytest.param(2, PLACE, False, marks=pytest.mark.validate),
    ],
)
def test_return_lands_as_its_type_says(return_type: int, place: tuple[float, float], over_home: bool) -> None:
    flight = returned(return_type)
    navigation = flight.columns(topics.NAVIGATION)
    assert navigation["stage"][-1] == Stage.LANDED and navigation["mode"][-1] == Mode.RETURN
    assert math.dist(landed_at(flight), place) < 40.0
    assert (nearest_home(flight) < 30.0) == over_home
    later = [event.text for event in flight.of(topics.EVENTS) if event.time_us > 30e6]
    assert later.count("landing sequence started at item 2") == (return_type != 0)
    assert not any(text.startswith(("waypoint 0", "waypoint 1")) for text in later)


@pytest.mark.validate
def test_return_after_the_end_of_the_mission_lands_by_its_sequence() -> None:
    """GIVEN a mission that is at its end WHEN RETURN starts its landing sequence THEN the flight goes on."""
    commands = [
        command(1.0, CommandKind.SET_PARAMETER, "NAV_RETURN_TYPE", 2.0),
        command(60.0, CommandKind.SET_MODE, Mode.RETURN.name),
    ]
    mission = (
        MISSION[0],
        MissionItem(ItemKind.JUMP, jump_to=5, repeats=1),
        *MISSION[2:],
        MissionItem(ItemKind.WAYPOINT, 60.0, 0.0, 40.0),
    )
    flight = simulate(RAVEN, Scenario(seed=2, duration=63.0), mission, commands)
    navigation = flight.columns(topics.NAVIGATION)
    assert len(mission) in navigation["item"][navigation["time_us"] < 60e6], "the mission has not ended"
    assert "landing sequence started at item 2" in flight.events()


def test_return_does_not_fly_a_sequence_outside_the_fence() -> None:
    """GIVEN a mission with an item outside the fence WHEN RETURN begins THEN it lands at home."""
    fence = Fence((Zone(1, ((0.0, 0.0),), 120.0),))
    commands = [
        command(1.0, CommandKind.SET_PARAMETER, "NAV_RETURN_TYPE", 2.0),
        command(22.0, CommandKind.SET_FENCE, "")._replace(payload=fence),
        command(23.0, CommandKind.SET_MODE, Mode.RETURN.name),
    ]
    flight = simulate(RAVEN, Scenario(seed=2, duration=26.0), MISSION, commands)
    assert not any("landing sequence started" in text for text in flight.events())
