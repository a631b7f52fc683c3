"""The flight computer's sensing and estimation on the sensors of a flight that another autopilot controls.

It publishes attitude, wing motion, air data, altitude, position, torque and power for the recording, so that the
identification reads this flight as any other. It commands nothing.
"""

from __future__ import annotations

from typing import Any

from avionics import timebase, topics
from avionics.guidance.mission import Mission
from avionics.messages import ActuatorCommand, FlapCommand, SensorFrame, Stage
from avionics.state import initial_state
from avionics.tasks.intake import accept
from avionics.vehicles.loader import FlightVehicle
from wingbeat.topic import Publish, Topic

RECORDED = frozenset(
    topic.name
    for topic in (
        topics.WING, topics.POWER, topics.AIR_DATA, topics.DRIVE_TORQUE, topics.ATTITUDE, topics.ALTITUDE,
        topics.POSITION,
    )
)  # fmt: skip


class Observer:
    """Motion estimator that publishes the estimates of each sensor frame."""

    def __init__(self, vehicle: FlightVehicle, publish: Publish) -> None:
        """Initialize with the gains of the vehicle's flight computer."""
        from avionics.tasks import estimate, sense  # imports filterpy, which takes a second

        self._tasks = (
            sense.power, sense.wing, sense.air, sense.torque, estimate.attitude, estimate.altitude, estimate.position,
        )  # fmt: skip
        self._publish = publish
        self._state = initial_state(vehicle.gains, Mission())
        self._time_us = -1

    def update(self, frame: SensorFrame, flap: FlapCommand, command: ActuatorCommand, is_launched: bool) -> None:
        """Process a frame and its commands; a frame whose time is not later than the last one's is ignored."""
        if frame.time_us <= self._time_us:
            return
        state, self._time_us = self._state, frame.time_us
        state.clock = timebase.advance(state.clock, frame.time_us)
        stage = Stage.EN_ROUTE if is_launched else Stage.WAIT_LAUNCH if command.armed else Stage.ON_GROUND
        state.modes = state.modes._replace(armed=command.armed, stage=stage)
        state.flapping = state.flapping._replace(frequency=flap.frequency, phase=flap.phase)
        state.actuators = command
        accept(state, self._record, frame)
        for task in self._tasks:
            task(state, self._record)

    def _record(self, topic: Topic[Any], message: Any) -> None:
        if topic.name in RECORDED:
            self._publish(topic, message)
