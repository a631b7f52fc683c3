"""Columns of a flight that its metrics need, kept in memory."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np

from avionics import topics
from logs.columns import Columns
from sim_bridge import topics as truth_topics
from sim_bridge.flight.world import publish_nothing
from wingbeat.topic import Publish, Topic

KEPT: dict[Topic[Any], tuple[str, ...]] = {
    topics.ATTITUDE: ("roll", "pitch", "yaw"),
    topics.POWER: ("power", "energy"),
    topics.WING: ("frequency", "flapping"),
    topics.AIR_DATA: ("airspeed",),
    topics.ALTITUDE: ("altitude",),
    topics.POSITION: ("north", "east"),
    topics.NAVIGATION: ("stage", "mode", "frozen", "item", "altitude_setpoint", "heading_setpoint"),
    topics.HEADING_LOOP: ("heading",),
    topics.EXCITATION: ("active", "manoeuvre"),
    truth_topics.STATE: (
        "north", "east", "down", "v_north", "v_east", "v_down", "airspeed", "on_ground",
        "quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z",
    ),
}  # fmt: skip
"""stored fields by topic, besides the time: those that `logs.summary.summary_of` and the metrics use"""


class _Kept:
    """Numbers of one topic, message by message."""

    def __init__(self, topic: Topic[Any], fields: tuple[str, ...]) -> None:
        self.topic = topic
        self.fields = ("time_us", *fields)
        self.numbers = array("d")
        self.chosen: Callable[[Any], tuple[Any, ...]] = itemgetter(*map(topic.message._fields.index, self.fields))

    def columns(self) -> Columns:
        """Return the columns in the format of the log reader."""
        table = np.frombuffer(self.numbers, dtype=np.float64).reshape(-1, len(self.fields))
        time_ns = (table[:, 0] * 1000.0).astype(np.int64)
        columns = {name: table[:, i] for i, name in enumerate(self.fields)}
        return Columns(self.topic.name, columns, dict.fromkeys(self.fields, "-"), time_ns, 0)


class Memory:
    """Sink for every message of a flight; stores the fields of `KEPT` and passes all messages to a recorder."""

    def __init__(self, onward: Publish = publish_nothing) -> None:
        self._onward = onward
        self._kept = {topic.name: _Kept(topic, fields) for topic, fields in KEPT.items()}
        self.broken = False
        """whether the vehicle's position became NaN"""

    def publish(self, topic: Topic[Any], message: Any) -> None:
        """Store one message and pass it to the recorder."""
        kept = self._kept.get(topic.name)
        if kept is not None:
            kept.numbers.extend(kept.chosen(message))
            if topic is truth_topics.STATE and not math.isfinite(message.north + message.east + message.down):
                self.broken = True
        self._onward(topic, message)

    def tables(self) -> dict[str, Columns]:
        """Return the stored columns by topic name, without empty topics."""
        return {name: kept.columns() for name, kept in self._kept.items() if kept.numbers}
