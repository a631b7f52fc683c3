"""The tasks that turn raw samples into physical values."""

from __future__ import annotations

from avionics import piloting, topics
from avionics.inputs import act
from avionics.messages import (
    Stage,
)
from avionics.sensing import air_data, drive_torque, wing_angle
from avionics.sensing import power as power_meter
from avionics.state import AutopilotState
from avionics.topics import Publish


def power(s: AutopilotState, publish: Publish) -> None:
    """Power of the drives, at each burst of the ADC."""
    if s.frame.adc is not None:
        s.power, s.power_state = power_meter.step(s.gains.power, s.power, s.frame.adc, s.wing.strokes)
        publish(topics.POWER, s.power_state)


def wing(s: AutopilotState, publish: Publish) -> None:
    """Wing motion, at each encoder sample."""
    if s.frame.encoder is not None:
        s.wing_angle, s.wing = wing_angle.step(s.gains.wing_angle, s.wing_angle, s.frame.encoder)
        publish(topics.WING, s.wing)


def air(s: AutopilotState, publish: Publish) -> None:
    """Airspeed and pressure altitude, at each pressure sample; the pitot's zero is learned while disarmed."""
    if s.frame.pressures is not None:
        on_ground = not s.modes.armed and s.modes.stage == Stage.ON_GROUND
        s.air_data, s.air = air_data.step(s.gains.air_data, s.air_data, s.frame.pressures, on_ground)
        publish(topics.AIR_DATA, s.air)


def torque(s: AutopilotState, publish: Publish) -> None:
    """Torque of the drives, at each sample of the strain gauges."""
    if s.frame.torque is not None:
        publish(topics.DRIVE_TORQUE, drive_torque.step(s.gains.torque, s.frame.torque))


def pilot(s: AutopilotState, publish: Publish) -> None:
    """The receiver's frame, if one came, and what its switches ask for; sticks that have grown stale."""
    sample = s.frame.receiver
    if sample is not None:
        act(s, publish, piloting.take_receiver(s, publish, sample), "receiver")
    if s.ways_in.source:
        piloting.watch(s, publish)
