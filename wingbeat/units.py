"""Units and allowed ranges of numbers that users set."""

from __future__ import annotations

from typing import NamedTuple

INFINITY = float("inf")


class Quantity(NamedTuple):
    """Unit and allowed range of a number in a vehicle file, used as ``Annotated[float, Quantity("m", 0, 2)]``."""

    unit: str
    low: float = -INFINITY
    high: float = INFINITY
    formerly: str = ""
    """earlier key of a renamed field: files may use it, and the MAVLink parameter keeps the name made of it"""
