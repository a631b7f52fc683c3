"""Frame intake: recording of raw samples and removal of implausible ones."""

from __future__ import annotations

from typing import Any, Final

from avionics.calibration.procedure import RAW_IMU
from avionics.inputs import publish_event
from avionics.messages import ActuatorCommand, Attitude, ImuSample, SensorFrame
from avionics.sensing import inertial, plausibility
from avionics.sensors import OTHERS, Sensor, publish_samples
from avionics.state import AutopilotState
from avionics.timebase import BASE_RATE
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.message import Severity
from wingbeat.topic import Publish

TICK: Final = 1.0 / BASE_RATE
"""s; period of a tick"""
RECEIVED: Final[tuple[Sensor[Any], ...]] = tuple(sensor for sensor in OTHERS if sensor.receive is not None)


def accept(s: AutopilotState, publish: Publish, frame: SensorFrame) -> None:
    """Accept a frame without its implausible samples."""
    publish_samples(publish, frame)
    s.plausibility, frame, gone_bad = plausibility.step(s.gains.plausibility, s.plausibility, frame, OTHERS)
    if s.plausibility.bad & 1:
        frame = frame._replace(imu=s.frame.imu)
    elif s.plausibility.saturated >= plausibility.SATURATED:
        frame = frame._replace(imu=gravity_substitute(frame.imu, s.attitude))
    elif s.calibration.kind not in RAW_IMU:
        imu = inertial.correct(s.gains.imu, frame.imu)
        frame = frame if imu is frame.imu else frame._replace(imu=imu)
    s.frame = frame
    for sensor in RECEIVED:
        sample = getattr(frame, sensor.field)
        if sample is not None and sensor.receive is not None:
            sensor.receive(s, sample)
    for name in gone_bad:
        publish_event(
            s, publish, Severity.WARNING, "sensing", f"{name} sample rejected: not finite, out of range or repeated"
        )


def refuse_time(s: AutopilotState, publish: Publish, frame: SensorFrame) -> ActuatorCommand:
    """Reject a frame with a time that is not later, or too much later.

    The frame is counted, the first one is reported, and the last actuator command is repeated.
    """
    publish_samples(publish, frame)
    s.plausibility = plausibility.refuse_time(s.plausibility)
    if s.plausibility.time_refused == 1:
        text = f"sensor time went from {s.clock.time_us} to {frame.time_us} us: frames rejected"
        publish_event(s, publish, Severity.ERROR, "sensing", text)
    if s.plausibility.time_refused >= plausibility.TIME_REJECTIONS:
        step_us = s.clock.time_us + round(TICK * 1e6) - frame.time_us
        offset = s.plausibility.time_offset_us + step_us
        s.plausibility = s.plausibility._replace(time_offset_us=offset)
        way = "back" if offset > 0 else "ahead"
        text = f"sensor clock {abs(offset) * 1e-6:.3f} s {way}: new time base accepted"
        publish_event(s, publish, Severity.WARNING, "sensing", text)
    return s.actuators._replace(time_us=frame.time_us)


def gravity_substitute(imu: ImuSample, attitude: Attitude) -> ImuSample:
    """Return the sample with the specific force of unaccelerated flight.

    The force follows from the present attitude.
    """
    w, x, y, z = attitude.quaternion
    g = STANDARD_GRAVITY
    return imu._replace(
        accel_x=-2.0 * g * (x * z - w * y),
        accel_y=-2.0 * g * (y * z + w * x),
        accel_z=-g * (1.0 - 2.0 * (x * x + y * y)),
    )
