"""The table of sensors: frame, plausibility check, wire format, recording and replay read it.

To add a sensor: declare its sample and its field of `SensorFrame` in `wingbeat.samples`, and enter a row here.
A sample that MAVLink has a standard message for needs a conversion in `avionics.link.sensor_codec`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos
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
    """One row of the table."""

    field: str
    """field of `SensorFrame`"""
    name: str
    """name in events"""
    topic: Topic[T]
    """sample, rate and channel in the log"""
    wire: str
    """MAVLink message that carries the sample from the board or the simulator"""
    is_plausible: Callable[[Gains, State, T], bool] = plausibility.always_plausible
    """whether a sample is finite and in range"""
    receive: Callable[[AutopilotState, T], None] | None = None
    """what is done with each accepted sample at once; other sensors have a task in `avionics.processors`"""


def _measure_height(s: AutopilotState, sample: RangeSample) -> None:
    """Update the altitude of the terrain below; before the launch the height is the reference."""
    vertical = cos(s.attitude.roll) * cos(s.attitude.pitch)
    at_rest = s.modes.stage in (Stage.ON_GROUND, Stage.WAIT_LAUNCH)
    s.rangefinder = rangefinder.step(s.rangefinder, sample, vertical, s.altitude.altitude, at_rest)


IMU = Sensor("imu", plausibility.IMU, topics.IMU, "HIL_SENSOR")
"""in every frame; its samples are checked by `plausibility.step` itself"""
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
"""all sensors, in the order in which a frame is recorded"""


def publish_samples(publish: Publish, frame: SensorFrame) -> None:
    """Publish all samples of a frame, also those that will be rejected: a replay needs what the flight was given."""
    for sensor in SENSORS:
        sample = getattr(frame, sensor.field)
        if sample is not None:
            publish(sensor.topic, sample)
