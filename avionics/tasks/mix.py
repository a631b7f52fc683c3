"""Mixing task: loop outputs to wing strokes and tail angles."""

from __future__ import annotations

from typing import Final

from avionics import topics
from avionics.limits import clip
from avionics.messages import (
    ActuatorCommand,
    FlapCommand,
    Mode,
)
from avionics.mixing import flapping, tail
from avionics.sensing import wing_check
from avionics.state import AutopilotState
from wingbeat.records import constructor
from wingbeat.topic import Publish

MANUAL: Final = Mode.MANUAL
MATCHING_RATE: Final = 3.0
"""rad/s; rate of the free wing toward the angle of a jammed one"""


_new_actuator_command: Final = constructor(ActuatorCommand)
_new_tail_command: Final = constructor(tail.TailCommand)


def mix(s: AutopilotState, publish: Publish) -> None:
    """Mix elevator, roll command and throttle to tail and wing drives."""
    if s.modes.killed:
        stop(s, publish)
        return
    clock, added = s.clock, s.excitation_requested
    yaw_stick = s.pilot.yaw if s.modes.mode == MANUAL and s.modes.armed else 0.0
    asked = _new_tail_command(
        s.pitch_loop_status.elevator,
        s.roll_loop_status.roll_command,
        yaw_stick,
        added.elevator,
        added.rudder,
        added.active,
    )
    s.tail, moved = tail.step(s.gains.tail, s.tail, clock.dt, asked)
    powered = s.modes.armed and not s.modes.cut
    throttle = clip(s.altitude_loop_status.throttle + added.throttle, 0.0, 1.0) if powered else 0.0
    if added.active:
        s.excitation_applied = (
            moved.applied_elevator,
            throttle - s.altitude_loop_status.throttle,
            moved.applied_rudder,
        )
    s.flapping, flap, stroke = flapping.step(
        s.gains.flapping, s.flapping, clock.time_us, clock.dt, throttle, moved.asymmetry
    )
    if s.modes.cut and s.wing_check.jammed in (wing_check.LEFT, wing_check.RIGHT):
        stroke = match_jammed_wing(s, stroke)
    left, right, motor = stroke
    s.actuators = _new_actuator_command(
        clock.time_us, left, right, motor, moved.elevator, moved.rudder, s.modes.armed
    )
    publish(topics.FLAP, flap)
    publish(topics.ACTUATORS, s.actuators)


def stop(s: AutopilotState, publish: Publish) -> None:
    """Stop the drives at once after a kill: wings at their last angles, tail centered."""
    s.flapping, s.tail = flapping.State(), tail.State()
    before, time_us = s.actuators, s.clock.time_us
    s.actuators = ActuatorCommand(time_us, before.wing_left, before.wing_right, 0.0, 0.0, 0.0, 0)
    publish(topics.FLAP, FlapCommand(time_us, 0.0, 0.0, 0.0, 0.0, 0.0))
    publish(topics.ACTUATORS, s.actuators)


def match_jammed_wing(s: AutopilotState, stroke: flapping.Stroke) -> flapping.Stroke:
    """Move the free wing to the angle of the jammed one, for a level glide."""
    limits, step = s.gains.flapping, MATCHING_RATE * s.clock.dt
    left, right = s.wing_check.angles
    if s.wing_check.jammed == wing_check.LEFT:
        wanted = clip(left, limits.travel_min, limits.travel_max)
        return stroke._replace(right=clip(wanted, s.actuators.wing_right - step, s.actuators.wing_right + step))
    wanted = clip(right, limits.travel_min, limits.travel_max)
    return stroke._replace(left=clip(wanted, s.actuators.wing_left - step, s.actuators.wing_left + step))
