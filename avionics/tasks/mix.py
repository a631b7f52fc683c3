"""The task that turns demands into strokes and tail angles."""

from __future__ import annotations

from avionics import topics
from avionics.limits import clip
from avionics.messages import (
    ActuatorCommand,
    FlapCommand,
    Mode,
)
from avionics.mixing import flapping, tail
from avionics.state import AutopilotState
from avionics.topics import Publish


def mix(s: AutopilotState, publish: Publish) -> None:
    """Elevator, roll command and throttle -> tail and wing drives."""
    if s.modes.killed:
        stop(s, publish)
        return
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


def stop(s: AutopilotState, publish: Publish) -> None:
    """After a kill: drives off without running down, wings told to stay where they are, tail at neutral."""
    s.flapping, s.tail = flapping.State(), tail.State()
    before, time_us = s.actuators, s.clock.time_us
    s.actuators = ActuatorCommand(time_us, before.wing_left, before.wing_right, 0.0, 0.0, 0.0, 0)
    publish(topics.FLAP, FlapCommand(time_us, 0.0, 0.0, 0.0, 0.0, 0.0))
    publish(topics.ACTUATORS, s.actuators)
