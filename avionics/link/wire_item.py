"""A mission item as the wire has it, and the refusal of one: what the codecs of missions and inputs share."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.dialect import mavlink


class WireItem(NamedTuple):
    """A mission item as MAVLink writes it, of either MISSION_ITEM or MISSION_ITEM_INT."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    """degrees (global frames), m (local frame), or the plain fifth parameter"""
    y: float
    """degrees (global frames), m (local frame), or the plain sixth parameter"""
    z: float
    """m, or the seventh parameter"""


class ItemRefused(ValueError):
    """An item cannot be flown; ``result`` is its MAV_MISSION_RESULT and the text says why."""

    def __init__(self, result: int, text: str) -> None:
        super().__init__(text)
        self.result = result


class HomeUnknown(ItemRefused):
    """A place on the globe or an altitude above the sea, and the vehicle has no home yet."""

    def __init__(self) -> None:
        super().__init__(mavlink.MAV_MISSION_DENIED, "home is not known yet: wait for the GPS")
