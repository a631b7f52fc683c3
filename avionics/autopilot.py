"""Flight computer: one step per sensor frame."""

from __future__ import annotations

import copy
from collections.abc import Sequence

from avionics import snapshot, timebase
from avionics.guidance.mission import Mission
from avionics.inputs import receive
from avionics.messages import ActuatorCommand, Input, SensorFrame
from avionics.missions import check_mission
from avionics.processors import SCHEDULE, Due, run
from avionics.sensing.plausibility import LONGEST_GAP_US
from avionics.state import AutopilotState, decode_state, initial_state
from avionics.tasks.intake import accept, refuse_time
from avionics.vehicles import FlightVehicle
from wingbeat.errors import InputError
from wingbeat.topic import Publish


class Autopilot:
    """Deterministic flight computer: sensor frames and commands to actuator commands.

    It has no clock of its own. ``state`` is the complete memory; messages go to ``publish`` at the rate of their
    topics.
    """

    def __init__(
        self,
        vehicle: FlightVehicle,
        mission: Mission,
        publish: Publish,
        schedule: tuple[Due, ...] | None = None,
    ) -> None:
        """Start disarmed, in MANUAL, before the first frame.

        Args:
            vehicle: parameters, from `avionics.vehicles.load_vehicle`.
            mission: mission of AUTO; may be empty.
            publish: called with a topic and its message.
            schedule: tasks due in each tick (default: `processors.SCHEDULE`); that of `processors.Stopwatch` measures
            run times.

        Raises:
            InputError: the mission cannot be flown.
        """
        refusal = check_mission(mission)
        if refusal:
            raise InputError(refusal)
        self.vehicle = vehicle
        self._publish = publish
        self._schedule = SCHEDULE if schedule is None else schedule
        self._state = initial_state(vehicle.gains, mission)

    def step(self, frame: SensorFrame, commands: Sequence[Input] = ()) -> ActuatorCommand:
        """Run one tick: sense, estimate, guide, stabilize, mix, report."""
        s, publish = self._state, self._publish
        offset_us = s.plausibility.time_offset_us
        if offset_us:
            frame = frame.shifted(offset_us)
        if not (0 < frame.time_us - s.clock.time_us <= LONGEST_GAP_US or s.clock.time_us < 0):
            receive(s, publish, commands)
            return refuse_time(s, publish, frame)._replace(time_us=frame.time_us - offset_us)
        s.clock = timebase.advance(s.clock, frame.time_us)
        receive(s, publish, commands)
        accept(s, publish, frame)

        sense, estimate, guide, stabilize, mix, report = self._schedule[s.clock.ticks % len(self._schedule)]
        run(sense, s, publish)
        run(estimate, s, publish)
        run(guide, s, publish)
        run(stabilize, s, publish)
        run(mix, s, publish)
        run(report, s, publish)
        return s.actuators._replace(time_us=frame.time_us - offset_us) if offset_us else s.actuators

    @property
    def state(self) -> AutopilotState:
        """Copy of the complete memory; its parts are immutable."""
        return copy.copy(self._state)

    @property
    def memory(self) -> AutopilotState:
        """Complete memory, for reading within the same tick only."""
        return self._state

    def snapshot(self) -> str:
        """Return the complete memory as exact JSON text."""
        return snapshot.encode(self._state)

    def restore(self, text: str) -> None:
        """Continue from a `snapshot`, with bit-identical steps.

        Raises:
            InputError: not a snapshot of this flight computer; the present memory is kept.
        """
        self._state = decode_state(text)
