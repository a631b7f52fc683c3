"""The frame as it enters: recorded as it came, then without the samples that cannot be."""

from __future__ import annotations

from avionics import topics
from avionics.calibration.procedure import RAW_IMU
from avionics.inputs import say
from avionics.messages import (
    ActuatorCommand,
    SensorFrame,
    Severity,
)
from avionics.sensing import inertial, plausibility
from avionics.state import AutopilotState
from avionics.topics import Publish

RECORDED = (
    ("encoder", topics.ENCODER),
    ("pressures", topics.PRESSURES),
    ("adc", topics.ADC),
    ("torque", topics.TORQUE_RAW),
    ("gps", topics.GPS),
    ("receiver", topics.RECEIVER),
)


def record_frame(publish: Publish, frame: SensorFrame) -> None:
    """The sensors as they came, refused samples too: a replay needs what the flight was given."""
    publish(topics.IMU, frame.imu)
    for name, topic in RECORDED:
        sample = getattr(frame, name)
        if sample is not None:
            publish(topic, sample)


def accept(s: AutopilotState, publish: Publish, frame: SensorFrame) -> None:
    """Take the frame, without the samples that cannot be."""
    record_frame(publish, frame)
    s.plausibility, frame, gone_bad = plausibility.step(s.gains.plausibility, s.plausibility, frame)
    if s.plausibility.bad & 1:
        frame = frame._replace(imu=s.frame.imu)
    elif s.calibration.kind not in RAW_IMU:
        imu = inertial.correct(s.gains.imu, frame.imu)
        frame = frame if imu is frame.imu else frame._replace(imu=imu)
    s.frame = frame
    for name in gone_bad:
        say(s, publish, Severity.WARNING, "sensing", f"{name} sample refused: not finite or out of range")


def refuse_time(s: AutopilotState, publish: Publish, frame: SensorFrame) -> ActuatorCommand:
    """A frame that is not later than the last: count it, say so once, repeat the last actuators."""
    record_frame(publish, frame)
    first = not s.plausibility.time_refused
    s.plausibility = plausibility.refuse_time(s.plausibility)
    if first:
        text = f"sensor time went from {s.clock.time_us} to {frame.time_us} us: frames refused"
        say(s, publish, Severity.ERROR, "sensing", text)
    return s.actuators._replace(time_us=frame.time_us)
