"""Units and allowed ranges of numbers that users set."""

from __future__ import annotations

import math
from typing import NamedTuple

INFINITY = math.inf
ABOVE_ZERO = math.ulp(0.0)
"""-; lower limit of a quantity that must be positive"""


class Quantity(NamedTuple):
    """Unit and allowed range of a number in a vehicle file, used as ``Annotated[float, Quantity("m", 0, 2)]``."""

    unit: str
    low: float = -INFINITY
    high: float = INFINITY
    formerly: str = ""
    """earlier key of a renamed field: files may use it, and the MAVLink parameter keeps the name made of it"""

    @property
    def is_bounded(self) -> bool:
        """Whether there is a lower or an upper limit."""
        return math.isfinite(self.low) or math.isfinite(self.high)

    def range_text(self) -> str:
        """Return the allowed range with its unit: ``0 to 2 m``, ``above 0 m``, ``0 m or more``."""
        unit = "" if self.unit in ("", "-") else f" {self.unit}"
        if self.low == ABOVE_ZERO and math.isinf(self.high):
            return f"above 0{unit}"
        if math.isinf(self.high):
            return f"{self.low:g}{unit} or more"
        return f"{self.low:g} to {self.high:g}{unit}"

    def violation_text(self) -> str:
        """Return what is wrong with a number outside the range."""
        return f"is outside {self.range_text()}" if math.isfinite(self.high) else f"must be {self.range_text()}"
