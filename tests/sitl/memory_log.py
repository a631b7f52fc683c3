"""A flight kept in memory as columns, for studies of many flights."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from avionics.autopilot import Autopilot
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.topic import Topic


class MemoryLog:
    """Takes messages of a flight and gives a topic's fields as arrays, as a log's reader does."""

    def __init__(self) -> None:
        self.messages: dict[str, list[Any]] = defaultdict(list)
        self._columns: dict[str, dict[str, Any]] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> MemoryLog:
        """Of a flight that is copied as it stands: messages are immutable."""
        twin = MemoryLog()
        twin.messages.update({name: list(kept) for name, kept in self.messages.items()})
        return twin

    def until(self, seconds: float) -> MemoryLog:
        """What was said up to that time since boot: the log of a flight that ended then."""
        early = MemoryLog()
        for name, kept in self.messages.items():
            early.messages[name] = [message for message in kept if message.time_us <= seconds * 1e6]
        return early

    def publish(self, topic: Topic, message: Any) -> None:
        """Keep one message."""
        self.messages[topic.name].append(message)

    def columns(self, topic: Topic) -> Mapping[str, Any]:
        """Arrays by field name."""
        kept = self.messages.get(topic.name)
        if not kept:
            raise InputError(f"the flight has no topic {topic.name}")
        columns = self._columns.get(topic.name, {})
        if not columns or any(len(column) != len(kept) for column in columns.values()):
            columns = {
                name: np.array(values) for name, values in zip(kept[0]._fields, zip(*kept, strict=True), strict=True)
            }
            self._columns[topic.name] = columns
        return MappingProxyType(columns)


def simulate(vehicle: str, scenario: Scenario, mission: str = "circuit") -> MemoryLog:
    """Fly a mission in one process and keep everything that was said."""
    log = MemoryLog()
    world = SimulatedWorld(load_vehicle(vehicle), scenario, log.publish)
    autopilot = Autopilot(load_flight_vehicle(vehicle), load_mission(mission), log.publish)
    fly(world, autopilot, scripted_start())
    return log
