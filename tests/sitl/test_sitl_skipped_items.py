"""Mission items that are passed over do not change the path."""

import numpy as np
import pytest
from simulate import RAVEN, simulate

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from sim_bridge.flight.world import Scenario

SKIPPED = MissionItem(ItemKind.SKIP, skipped=(2.0, 178.0, 0.0, 8.0, -1.0, 0.0, 0.0, 0.0, 0.0))
TAKEOFF = MissionItem(ItemKind.TAKEOFF, altitude=12.0)
PATH = (MissionItem(ItemKind.WAYPOINT, 45.0, 0.0, 12.0), MissionItem(ItemKind.WAYPOINT, 45.0, 45.0, 12.0))
JUMP = MissionItem(ItemKind.JUMP, jump_to=1, repeats=1)


@pytest.mark.validate
def test_items_that_are_passed_over_do_not_change_the_path() -> None:
    """GIVEN a mission with and without such items, one of them the aim of a jump THEN both paths are the same."""
    scenario = Scenario(seed=4, duration=42.0)
    plain = simulate(RAVEN, scenario, (TAKEOFF, *PATH, JUMP))
    crowded = simulate(RAVEN, scenario, (TAKEOFF, SKIPPED, PATH[0], SKIPPED, SKIPPED, PATH[1], JUMP, SKIPPED))
    assert len(plain.truth["north"]) == len(crowded.truth["north"])
    for axis in ("north", "east", "down"):
        np.testing.assert_array_equal(plain.truth[axis], crowded.truth[axis])
    assert set(np.unique(crowded.columns(topics.NAVIGATION)["item"])) >= {0, 2, 5}
