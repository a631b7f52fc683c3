"""Mission item on the wire, and its rejection.

Both are shared by the codecs of missions and inputs.
"""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.dialect import mavlink


class WireItem(NamedTuple):
    """Mission item of MISSION_ITEM or MISSION_ITEM_INT."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    """degrees (global frames), m (local frame), or the fifth parameter"""
    y: float
    """degrees (global frames), m (local frame), or the sixth parameter"""
    z: float
    """m, or the seventh parameter"""


class ItemRefused(ValueError):
    """Rejected item; ``result`` is its MAV_MISSION_RESULT and the text the reason."""

    def __init__(self, result: int, text: str) -> None:
        super().__init__(text)
        self.result = result


class HomeUnknown(ItemRefused):
    """Global position or altitude above mean sea level before home is known."""

    def __init__(self) -> None:
        super().__init__(mavlink.MAV_MISSION_DENIED, "home is not known yet: wait for the GPS")
