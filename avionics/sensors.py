"""Table of sensors for frames, checks, wire format, recording and replay.

To add a sensor, declare its sample and its field of `SensorFrame` in `wingbeat.samples`, and enter a row here. A
sample with a standard MAVLink message needs a conversion in `avionics.link.sensor_codec`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from avionics import topics
from avionics.messages import Stage
from avionics.sensing import plausibility, rangefinder
from avionics.sensing.plausibility import Gains, State
from wingbeat.samples import RangeSample, SensorFrame
from wingbeat.topic import Publish, Topic

if TYPE_CHECKING:
    from avionics.state import AutopilotState

T = TypeVar("T")


class Sensor(NamedTuple, Generic[T]):
    """Row of the sensor table."""

    field: str
    """field of `SensorFrame`"""
    name: str
    """name in events"""
    topic: Topic[T]
    """topic in the log with sample type, rate and channel"""
    wire: str
    """MAVLink message of the sample from the board or the simulator"""
    is_plausible: Callable[[Gains, State, T], bool] = plausibility.always_plausible
    """check that a sample is finite and in range"""
    receive: Callable[[AutopilotState, T], None] | None = None
    """handler of each accepted sample; other sensors have a task in `avionics.processors`"""


def _measure_height(s: AutopilotState, sample: RangeSample) -> None:
    """Update the terrain altitude; before launch the height is the reference."""
    vertical = cos(s.attitude.roll) * cos(s.attitude.pitch)
    at_rest = s.modes.stage in (Stage.ON_GROUND, Stage.WAIT_LAUNCH)
    s.rangefinder = rangefinder.step(s.rangefinder, sample, vertical, s.altitude.altitude, at_rest)


IMU = Sensor("imu", plausibility.IMU, topics.IMU, "HIL_SENSOR")
"""present in every frame; checked by `plausibility.step`"""
OTHERS: tuple[Sensor[Any], ...] = (
    Sensor("encoder", plausibility.ENCODER, topics.ENCODER, "WINGBEAT_ENCODER", plausibility.encoder_plausible),
    Sensor("pressures", "pressures", topics.PRESSURES, "WINGBEAT_PRESSURES", plausibility.pressures_plausible),
    Sensor("adc", "ADC", topics.ADC, "WINGBEAT_ADC_BURST", plausibility.adc_plausible),
    Sensor("torque", "torque", topics.TORQUE_RAW, "WINGBEAT_TORQUE", plausibility.torque_plausible),
    Sensor("gps", "GPS", topics.GPS, "HIL_GPS", plausibility.gps_plausible),
    Sensor("receiver", "receiver", topics.RECEIVER, "HIL_RC_INPUTS_RAW"),
    Sensor("rangefinder", "rangefinder", topics.RANGE, "DISTANCE_SENSOR", rangefinder.is_plausible, _measure_height),
)
SENSORS: tuple[Sensor[Any], ...] = (IMU, *OTHERS)
"""all sensors, in recording order"""
_TOPICS: tuple[Topic[Any], ...] = tuple(sensor.topic for sensor in SENSORS)
_samples = attrgetter(*(sensor.field for sensor in SENSORS))
"""all samples of a frame, in the order of `SENSORS`"""


def publish_samples(publish: Publish, frame: SensorFrame) -> None:
    """Publish all samples of a frame.

    This includes samples that will be rejected, because a replay needs the inputs of the flight.
    """
    for topic, sample in zip(_TOPICS, _samples(frame), strict=True):
        if sample is not None:
            publish(topic, sample)
