"""The task that turns demands into strokes and tail angles."""

from __future__ import annotations

from avionics import topics
from avionics.limits import clip
from avionics.messages import (
    ActuatorCommand,
    Mode,
)
from avionics.mixing import flapping, tail
from avionics.state import AutopilotState
from avionics.topics import Publish


def mix(s: AutopilotState, publish: Publish) -> None:
    """Elevator, roll command and throttle -> tail and wing drives."""
    clock, added = s.clock, s.excited
    yaw_stick = s.pilot.yaw if s.modes.mode == Mode.MANUAL and s.modes.armed else 0.0
    asked = tail.Asked(
        s.elevator.elevator, s.roll_command.roll_command, yaw_stick, added.elevator, added.rudder, added.active
    )
    s.tail, moved = tail.step(s.gains.tail, s.tail, clock.dt, asked)
    throttle = clip(s.vertical.throttle + added.throttle, 0.0, 1.0) if s.modes.armed else 0.0
    if added.active:
        s.applied = (moved.applied_elevator, throttle - s.vertical.throttle, moved.applied_rudder)
    s.flapping, flap, stroke = flapping.step(
        s.gains.flapping, s.flapping, clock.time_us, clock.dt, throttle, moved.asymmetry
    )
    s.actuators = ActuatorCommand(
        clock.time_us,
        stroke.left,
        stroke.right,
        stroke.throttle,
        moved.elevator,
        moved.rudder,
        s.modes.armed,
    )
    publish(topics.FLAP, flap)
    publish(topics.ACTUATORS, s.actuators)
