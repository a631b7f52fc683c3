"""Wire format of sensor samples, from the table `avionics.sensors`.

A message of the Wingbeat dialect has the fields of its sample in the same order. The standard messages differ from
their samples and have a pair of functions in `CONVERSIONS`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from itertools import accumulate, chain
from operator import itemgetter
from typing import Any, Generic, NamedTuple, TypeVar, get_args, get_type_hints

from avionics.link.dialect import mavlink
from avionics.link.framing import build_frame
from avionics.sensors import IMU, OTHERS, SENSORS, Sensor
from wingbeat.message import Wire
from wingbeat.records import constructor
from wingbeat.samples import CHANNELS, GpsFix, ImuSample, RangeSample, ReceiverSample, SensorFrame

T = TypeVar("T")
ACCELEROMETER, GYROSCOPE, MAGNETOMETER = 0x7, 0x38, 0x1C0
IMU_FIELDS = ACCELEROMETER | GYROSCOPE | MAGNETOMETER
"""``HIL_SENSOR.fields_updated`` of an IMU sample; pressures are raw counts in a separate message"""
UNKNOWN_U8, UNKNOWN_U16 = 0xFF, 0xFFFF
_DEGE7 = 1e7 * 180.0 / math.pi
_NO_PRESSURE = (0.0, 0.0, 0.0, 0.0, IMU_FIELDS, 0)
_SPARE_CHANNELS = (0,) * 4


class SampleCodec(NamedTuple, Generic[T]):
    """Codec of the samples of one sensor."""

    message_id: int
    values: Callable[[T], Iterable[Any]]
    """gives the fields of the message in wire order"""
    encode: Callable[[T], bytes]
    decode: Callable[[bytes], T | None]
    """gives None for a message of another sensor"""


def layout_of(message_id: int) -> struct.Struct:
    """Return the layout of the payload of a message."""
    unpacker: struct.Struct = mavlink.mavlink_map[message_id].unpacker
    return unpacker


def padded(layout: struct.Struct, payload: bytes) -> tuple[Any, ...]:
    """Unpack a payload with missing trailing zeros or with fields of a newer sender.

    MAVLink 2 truncates trailing zeros.
    """
    size = layout.size
    return layout.unpack(payload.ljust(size, b"\0")[:size] if len(payload) != size else payload)


# --- standard messages with fields other than those of the sample -----------------------------------------

_SENSOR = layout_of(mavlink.MAVLINK_MSG_ID_HIL_SENSOR)
_GPS = layout_of(mavlink.MAVLINK_MSG_ID_HIL_GPS)
_RC = layout_of(mavlink.MAVLINK_MSG_ID_HIL_RC_INPUTS_RAW)
_RANGE = layout_of(mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR)
_new_imu_sample = constructor(ImuSample)


def imu_values(imu: ImuSample) -> tuple[Any, ...]:
    """Return the fields of HIL_SENSOR."""
    return (*imu, *_NO_PRESSURE)


def decode_imu(payload: bytes) -> ImuSample:
    """Decode a payload of HIL_SENSOR."""
    return _new_imu_sample(*padded(_SENSOR, payload)[:10])


def gps_values(fix: GpsFix) -> tuple[Any, ...]:
    """Return the fields of HIL_GPS: degE7, mm, cm and cm/s.

    As in PX4, eph and epv are accuracies in cm.
    """
    speed = math.hypot(fix.v_north, fix.v_east)
    course = math.degrees(math.atan2(fix.v_east, fix.v_north)) % 360.0
    return (
        fix.time_us,
        round(fix.latitude * _DEGE7),
        round(fix.longitude * _DEGE7),
        round(fix.altitude * 1e3),
        _u16(fix.horizontal_accuracy * 1e2),
        _u16(fix.vertical_accuracy * 1e2),
        _u16(speed * 1e2),
        _i16(fix.v_north * 1e2),
        _i16(fix.v_east * 1e2),
        _i16(fix.v_down * 1e2),
        round(course * 1e2) % 36000,
        min(fix.fix_type, 255),
        min(fix.satellites, 254),
        0,
        0,
    )


def decode_gps(payload: bytes) -> GpsFix:
    """Decode a payload of HIL_GPS.

    An unknown accuracy becomes 655.35 m, the maximum of the field.
    """
    time_us, lat, lon, alt, eph, epv, _, vn, ve, vd, _, fix_type, satellites, _, _ = padded(_GPS, payload)
    return GpsFix(
        time_us,
        lat / _DEGE7,
        lon / _DEGE7,
        alt * 1e-3,
        vn * 1e-2,
        ve * 1e-2,
        vd * 1e-2,
        eph * 1e-2,
        epv * 1e-2,
        fix_type,
        satellites,
    )


def _u16(value: float) -> int:
    return int(min(max(round(value), 0), UNKNOWN_U16 - 1))


def _i16(value: float) -> int:
    return int(min(max(round(value), -32768), 32767))


def receiver_values(sample: ReceiverSample) -> tuple[Any, ...]:
    """Return the fields of HIL_RC_INPUTS_RAW.

    The message has no field for a lost signal, which is encoded as a strength of 0.
    """
    rssi = 0 if sample.lost else max(sample.rssi, 1)
    return (sample.time_us, *sample.pulses, *_SPARE_CHANNELS, rssi)


def decode_receiver(payload: bytes) -> ReceiverSample:
    """Decode a payload of HIL_RC_INPUTS_RAW; channels beyond the eighth are ignored."""
    time_us, *pulses, rssi = padded(_RC, payload)
    return ReceiverSample(time_us, tuple(pulses[:CHANNELS]), int(rssi == 0), rssi)


def range_values(sample: RangeSample) -> tuple[Any, ...]:
    """Return the fields of DISTANCE_SENSOR: ms and cm.

    A quality of 1 is an invalid reading.
    """
    return (
        sample.time_us // 1000,
        *(_u16(distance * 1e2) for distance in (sample.min_distance, sample.max_distance, sample.distance)),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        UNKNOWN_U8,
        0.0,
        0.0,
        *(0.0,) * 4,
        0 if sample.quality == UNKNOWN_U8 else max(sample.quality, 1),
    )


def decode_range(payload: bytes) -> RangeSample | None:
    """From a payload of DISTANCE_SENSOR; None for a sensor that does not look down."""
    time_ms, low, high, distance, _, _, orientation, *_, quality = padded(_RANGE, payload)
    if orientation != mavlink.MAV_SENSOR_ROTATION_PITCH_270:
        return None
    known = {0: UNKNOWN_U8, 1: 0}.get(quality, quality)
    return RangeSample(time_ms * 1000, distance / 1e2, low / 1e2, high / 1e2, known)


CONVERSIONS: dict[str, tuple[Callable[[Any], tuple[Any, ...]], Callable[[bytes], Any]]] = {
    "HIL_SENSOR": (imu_values, decode_imu),
    "HIL_GPS": (gps_values, decode_gps),
    "HIL_RC_INPUTS_RAW": (receiver_values, decode_receiver),
    "DISTANCE_SENSOR": (range_values, decode_range),
}
"""fields of a sample and decoder of the payload, by the name of a standard message"""


# --- messages of the dialect: the fields of the sample -----------------------------------------------------------


def _codec(sensor: Sensor[T]) -> SampleCodec[T]:
    message_id: int = getattr(mavlink, f"MAVLINK_MSG_ID_{sensor.wire}")
    layout = layout_of(message_id)
    values, decode = CONVERSIONS.get(sensor.wire) or _same_fields(layout, sensor.topic.message)

    def encode(sample: T) -> bytes:
        return layout.pack(*values(sample))

    return SampleCodec(message_id, values, encode, decode)


def _same_fields(
    layout: struct.Struct, message: Callable[..., T]
) -> tuple[Callable[[Any], Iterable[Any]], Callable[[bytes], T]]:
    """Return fields and decoder of a sample whose message has the same fields; arrays follow the single values."""
    new = constructor(message)
    lengths = [_length(hint) for hint in get_type_hints(message, include_extras=True).values()]
    single = sum(not length for length in lengths)
    ends = list(accumulate(length or 1 for length in lengths))
    fields = itemgetter(
        *(slice(end - size, end) if size else end - 1 for size, end in zip(lengths, ends, strict=True))
    )

    def flattened(sample: Any) -> Iterable[Any]:
        return chain(sample[:single], *sample[single:])

    def decode(payload: bytes) -> T:
        return new(*padded(layout, payload))

    def decode_arrays(payload: bytes) -> T:
        return new(*fields(padded(layout, payload)))

    return (flattened, decode_arrays) if any(lengths) else (iter, decode)


def _length(hint: Any) -> int:
    """Return the length of an array field, 0 for a single value."""
    return next((part.length for part in get_args(hint)[1:] if isinstance(part, Wire)), 0)


CODECS: dict[str, SampleCodec[Any]] = {sensor.field: _codec(sensor) for sensor in SENSORS}
"""codecs by the field of `SensorFrame`"""
BY_MESSAGE = {CODECS[sensor.field].message_id: (sensor.field, CODECS[sensor.field].decode) for sensor in OTHERS}
"""field and decoder of messages before HIL_SENSOR in a tick, by message ID"""
HIL_SENSOR: int = CODECS[IMU.field].message_id


TELEMETRY = tuple(sensor for sensor in OTHERS if not sensor.wire.startswith(("HIL_", "WINGBEAT_")))
"""sensors with a wire message that is telemetry for ground stations as well"""
_DECODER = mavlink.MAVLink(None)


def message(sensor: Sensor[T], sample: T) -> Any:
    """Return the MAVLink message object of a sample."""
    codec = CODECS[sensor.field]
    return _DECODER.decode(bytearray(build_frame(codec.message_id, codec.encode(sample), 0, 1, 1)))


def quantized(frame: SensorFrame) -> SensorFrame:
    """``frame`` as the wire delivers it."""
    samples: dict[str, Any] = {
        sensor.field: sample and CODECS[sensor.field].decode(CODECS[sensor.field].encode(sample))
        for sensor in SENSORS
        for sample in [getattr(frame, sensor.field)]
    }
    return SensorFrame(frame.time_us, **samples)
