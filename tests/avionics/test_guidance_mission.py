"""Descriptions of mission items in events."""

from __future__ import annotations

import math

import pytest

from avionics.guidance.mission import (
    Channel,
    Excitation,
    ItemKind,
    MissionItem,
    Shape,
    completion_text,
)

INPUT = Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.1, 0.5, 2.0, 1, other_amplitudes=(0.0, 0.1, 0.0))


@pytest.mark.parametrize(
    ("item", "text"),
    [
        (MissionItem(ItemKind.HOLD, heading=math.radians(60.0), altitude=40.0), "reached (hold 60 deg, 40 m)"),
        (MissionItem(ItemKind.HOLD, heading=math.radians(-90.0), altitude=40.0), "reached (hold 270 deg, 40 m)"),
        (MissionItem(ItemKind.WAYPOINT, 120.0, -40.0, 35.0), "reached (120 m N, -40 m E, 35 m)"),
        (MissionItem(ItemKind.WAYPOINT, altitude=35.0, here=1), "reached (35 m)"),
        (MissionItem(ItemKind.TAKEOFF, altitude=40.0), "reached (takeoff 40 m)"),
        (MissionItem(ItemKind.CIRCLE, 10.0, 20.0, 30.0), "completed (circle 10 m N, 20 m E, 30 m)"),
        (MissionItem(ItemKind.EXCITE, excitation=INPUT), "completed (elevator and throttle input)"),
        (MissionItem(ItemKind.SKIP, skipped=(3.0, 183.0)), "skipped (command 183)"),
        (MissionItem(ItemKind.RETURN), "reached (return to launch)"),
    ],
)
def test_completion_text_describes_item(item: MissionItem, text: str) -> None:
    assert completion_text(3, item) == f"waypoint 3 {text}"
    assert len(completion_text(3, item)) <= 50
