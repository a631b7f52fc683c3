"""View of the flight computer for the ground link.

It implements `avionics.link.vehicle.VehicleView`.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, TypeVar

from avionics import inputs, parameters, piloting, topics
from avionics.autopilot import Autopilot
from avionics.gains import FlightGains
from avionics.guidance.mission import Fence, Mission, Rally
from avionics.link.vehicle import NO_FRAMES, PATIENT, Home, Parameter
from avionics.messages import ChannelOverride, Command, Mode
from avionics.processors import Due
from avionics.situation import destination
from avionics.vehicles import FlightVehicle
from wingbeat.message import Event, Severity
from wingbeat.topic import Publish, Topic

T = TypeVar("T")


def shown_parameter(gains: FlightGains, entry: parameters.Parameter) -> Parameter:
    """Return the link parameter of a table entry, with its value in ``gains``."""
    return Parameter(
        entry.name,
        parameters.get(gains, entry),
        entry.low,
        entry.high,
        entry.unit if entry.unit != "-" else "",
        entry.description,
        entry.text,
        entry.whole,
        parameters.grounded(entry),
        parameters.choices(entry),
    )


class FlightView:
    """`Autopilot` with read access to its last messages, events and parameters.

    Build it instead of the autopilot and step ``view.autopilot``. Read access has no effect on the autopilot.
    """

    def __init__(
        self,
        vehicle: FlightVehicle,
        mission: Mission,
        publish: Publish,
        schedule: tuple[Due, ...] | None = None,
    ) -> None:
        """Create the `Autopilot`; every message is passed on to ``publish``.

        Raises:
            InputError: the mission cannot be flown.
        """
        self._forward = publish
        self._latest: dict[str, Any] = {}
        self._events: list[Event] = []
        self._table = parameters.parameter_table(vehicle.gains)
        self._parameters: tuple[Parameter, ...] = ()
        self._gains_shown: Any = None
        self._home: Home | None = None
        self.silent = False
        """True without sensor frames, so that commands have no effect; set by the owner of the clock."""
        self.autopilot = Autopilot(vehicle, mission, self._publish, schedule)

    def _publish(self, topic: Topic[Any], message: Any) -> None:
        self._latest[topic.name] = message
        if topic is topics.EVENTS:
            self._events.append(message)
        self._forward(topic, message)

    @property
    def time_us(self) -> int:
        """Time (us) of the last tick since boot."""
        return max(self.autopilot.memory.clock.time_us, 0)

    @property
    def mode(self) -> Mode:
        """Flight mode."""
        return Mode(self.autopilot.memory.modes.mode)

    @property
    def armed(self) -> bool:
        """True if the wings may move."""
        return self.autopilot.memory.modes.armed == 1

    @property
    def mission(self) -> Mission:
        """Mission on board."""
        return self.autopilot.memory.mission

    @property
    def fence(self) -> Fence:
        """Fence of the plan on board."""
        return self.autopilot.memory.fence

    @property
    def rally(self) -> Rally:
        """Rally points on board."""
        return self.autopilot.memory.rally

    @property
    def destination(self) -> tuple[float, float] | None:
        """Target position or circle center (m, north and east of home), None without one."""
        return destination(self.autopilot.memory)

    @property
    def home(self) -> Home | None:
        """Home position, None before the first fix."""
        memory = self.autopilot.memory
        if self._home is None and memory.position.valid and memory.last_fix is not None:
            latitude, longitude = memory.position_filter.home
            self._home = Home(latitude, longitude, memory.last_fix.altitude - memory.altitude.altitude)
        return self._home

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Parameter table; names and order are constant during a flight."""
        gains = self.autopilot.memory.gains
        if gains is not self._gains_shown:
            self._gains_shown = gains
            self._parameters = tuple(shown_parameter(gains, entry) for entry in self._table.values())
        return self._parameters

    def latest(self, topic: Topic[T]) -> T | None:
        """Return the last message of ``topic``, or None before the first."""
        return self._latest.get(topic.name)

    def events(self, after: int) -> Sequence[Event]:
        """Return the events since boot without the first ``after``."""
        return self._events[after:]

    def send_statustext(self, severity: Severity, source: str, text: str) -> None:
        """Publish an event outside the flight core to the ground station and the log."""
        event = Event(self.time_us, severity, source, text)
        self._events.append(event)
        self._forward(topics.LINK_EVENTS, event)

    def refusal(self, command: Command) -> str:
        """Return why the flight core would deny ``command`` now; empty if accepted."""
        if self.silent and command.kind not in PATIENT:
            return NO_FRAMES
        return inputs.refusal(self.autopilot.memory, command)

    def stops(self, override: ChannelOverride) -> list[Command]:
        """Return the commands of overridden switches that stop the wings."""
        acts = piloting.take_override(copy.copy(self.autopilot.memory), _manual_control_lost, override)
        return [
            Command(self.time_us, each.kind, each.name, source="override") for each in acts if each.kind in PATIENT
        ]


def _manual_control_lost(topic: Topic[Any], message: Any) -> None:
    pass
