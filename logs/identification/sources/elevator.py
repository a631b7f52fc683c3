"""The elevator's angle made of another field: a pulse width, a stick, a share of its throw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from avionics import topics
from logs.reader import Log
from wingbeat.errors import InputError
from wingbeat.topic import Topic


class MadeElevator(NamedTuple):
    """A log whose elevator command is ``field`` of ``topic`` times ``scale``; as `flight.ColumnSource`.

    Where its zero lies does not matter: inputs are changes of the angle.
    """

    log: Log
    topic: str
    field: str
    scale: float
    """rad per unit of the field; positive pitches the nose up"""

    @property
    def note(self) -> str:
        """What the report says of it."""
        return f"elevator: {self.topic}.{self.field} at {self.scale:g} rad per unit"

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: the log has no such topic, or what the elevator is made of is no number.
        """
        if topic != topics.ACTUATORS:
            return self.log.columns(topic)
        columns = self.log.columns(self.topic)
        values = columns.fields.get(self.field)
        if values is None or values.ndim != 1 or values.dtype.kind not in "fiu":
            numbers = [name for name, each in columns.items() if each.ndim == 1 and each.dtype.kind in "fiu"]
            raise InputError(f"{self.topic} has no number {self.field}; it has: {', '.join(numbers)}")
        return {"time_us": np.rint(columns.time * 1e6), "elevator": values * self.scale}
