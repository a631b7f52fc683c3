"""The tasks that turn raw samples into physical values."""

from __future__ import annotations

from avionics import piloting, topics
from avionics.inputs import act, say
from avionics.messages import Severity, Stage
from avionics.sensing import air_data, drive_torque, encoders, wing_angle
from avionics.sensing import power as power_meter
from avionics.state import AutopilotState
from avionics.topics import Publish


def power(s: AutopilotState, publish: Publish) -> None:
    """Power of the drives, at each burst of the ADC; the current's zero is learned while disarmed."""
    if s.frame.adc is not None:
        resting = not s.modes.armed and s.modes.stage == Stage.ON_GROUND
        clipped = s.power.clipped
        beat = power_meter.Beat(s.wing.strokes, s.wing.frequency)
        s.power, s.power_state = power_meter.step(s.gains.power, s.power, s.frame.adc, beat, resting)
        publish(topics.POWER, s.power_state)
        if s.power.clipped and not clipped:
            text = "current beyond its sensor's range: power, energy and charge read too low"
            say(s, publish, Severity.WARNING, "power", text)


def wing(s: AutopilotState, publish: Publish) -> None:
    """Wing motion, at each encoder sample; the commanded stroke stands in where the encoders do not tell."""
    gains, before, asked, sample = s.gains.wing_angle, s.wing, s.flapping, s.frame.encoder
    if sample is not None:
        parity = gains.sign_left * gains.sign_right
        s.encoders, counts = encoders.step(s.gains.encoders, s.encoders, sample, asked.frequency, parity)
    elif s.clock.time_us - s.encoders.time_us > encoders.LONGEST_SILENCE_US and s.encoders.time_us >= 0:
        s.encoders, counts = encoders.silence(s.encoders, s.clock.time_us)
    else:
        return
    commanded = wing_angle.Commanded(asked.frequency, asked.phase)
    s.wing_angle, s.wing = wing_angle.step(gains, s.wing_angle, counts, commanded)
    publish(topics.WING, s.wing)
    if s.wing[-3:] != before[-3:]:
        for severity, text in encoders.changes(before, s.wing):
            say(s, publish, severity, "encoders", text)


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
