"""Wire format of sensor samples, from the table `avionics.sensors`.

A message of the Wingbeat dialect has the fields of its sample in the same order. The standard messages differ from
their samples and have a pair of functions in `CONVERSIONS`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from itertools import chain
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


def encode_imu(imu: ImuSample) -> bytes:
    """Return the payload of HIL_SENSOR."""
    return _SENSOR.pack(*imu, *_NO_PRESSURE)


def decode_imu(payload: bytes) -> ImuSample:
    """Decode a payload of HIL_SENSOR."""
    return _new_imu_sample(*padded(_SENSOR, payload)[:10])


def encode_gps(fix: GpsFix) -> bytes:
    """Return the payload of HIL_GPS: degE7, mm, cm and cm/s.

    As in PX4, eph and epv are accuracies in cm.
    """
    speed = math.hypot(fix.v_north, fix.v_east)
    course = math.degrees(math.atan2(fix.v_east, fix.v_north)) % 360.0
    return _GPS.pack(
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


def encode_receiver(sample: ReceiverSample) -> bytes:
    """Return the payload of HIL_RC_INPUTS_RAW.

    The message has no field for a lost signal, which is encoded as a strength of 0.
    """
    rssi = 0 if sample.lost else max(sample.rssi, 1)
    return _RC.pack(sample.time_us, *sample.pulses, *_SPARE_CHANNELS, rssi)


def decode_receiver(payload: bytes) -> ReceiverSample:
    """Decode a payload of HIL_RC_INPUTS_RAW; channels beyond the eighth are ignored."""
    time_us, *pulses, rssi = padded(_RC, payload)
    return ReceiverSample(time_us, tuple(pulses[:CHANNELS]), int(rssi == 0), rssi)


def encode_range(sample: RangeSample) -> bytes:
    """Return the payload of DISTANCE_SENSOR: ms and cm.

    A quality of 1 is an invalid reading.
    """
    return _RANGE.pack(
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


CONVERSIONS: dict[str, tuple[Callable[[Any], bytes], Callable[[bytes], Any]]] = {
    "HIL_SENSOR": (encode_imu, decode_imu),
    "HIL_GPS": (encode_gps, decode_gps),
    "HIL_RC_INPUTS_RAW": (encode_receiver, decode_receiver),
    "DISTANCE_SENSOR": (encode_range, decode_range),
}
"""encoder and decoder of the payload, by the name of a standard message"""


# --- messages of the dialect: the fields of the sample -----------------------------------------------------------


def _codec(sensor: Sensor[T]) -> SampleCodec[T]:
    message_id: int = getattr(mavlink, f"MAVLINK_MSG_ID_{sensor.wire}")
    if sensor.wire in CONVERSIONS:
        return SampleCodec(message_id, *CONVERSIONS[sensor.wire])
    layout, new = layout_of(message_id), constructor(sensor.topic.message)
    lengths = [_length(hint) for hint in get_type_hints(sensor.topic.message, include_extras=True).values()]
    has_arrays = any(lengths)

    def encode(sample: T) -> bytes:
        values: Any = sample
        if not has_arrays:
            return layout.pack(*values)
        parts = (value if length else (value,) for value, length in zip(values, lengths, strict=True))
        return layout.pack(*chain.from_iterable(parts))

    def decode(payload: bytes) -> T:
        if not has_arrays:
            return new(*padded(layout, payload))
        values, fields, at = padded(layout, payload), [], 0
        for length in lengths:
            fields.append(values[at : at + length] if length else values[at])
            at += length or 1
        return new(*fields)

    return SampleCodec(message_id, encode, decode)


def _length(hint: Any) -> int:
    """Return the length of an array field, 0 for a single value."""
    return next((part.length for part in get_args(hint)[1:] if isinstance(part, Wire)), 0)


CODECS: dict[str, SampleCodec[Any]] = {sensor.field: _codec(sensor) for sensor in SENSORS}
"""codecs by the field of `SensorFrame`"""
BY_MESSAGE = {CODECS[sensor.field].message_id: (sensor.field, CODECS[sensor.field].decode) for sensor in OTHERS}
"""field and decoder of messages before HIL_SENSOR in a tick, by message ID"""
HIL_SENSOR: int = CODECS[IMU.field].message_id
_BEFORE_IMU = tuple((sensor.field, CODECS[sensor.field]) for sensor in OTHERS)


TELEMETRY = tuple(sensor for sensor in OTHERS if not sensor.wire.startswith(("HIL_", "WINGBEAT_")))
"""sensors with a wire message that is telemetry for ground stations as well"""
_DECODER = mavlink.MAVLink(None)


def message(sensor: Sensor[T], sample: T) -> Any:
    """Return the MAVLink message object of a sample."""
    codec = CODECS[sensor.field]
    return _DECODER.decode(bytearray(build_frame(codec.message_id, codec.encode(sample), 0, 1, 1)))


def payloads(frame: SensorFrame) -> list[tuple[int, bytes]]:
    """Return message IDs and payloads of one tick; HIL_SENSOR is last and closes it."""
    parts = [
        (codec.message_id, codec.encode(sample))
        for field, codec in _BEFORE_IMU
        if (sample := getattr(frame, field)) is not None
    ]
    return [*parts, (HIL_SENSOR, encode_imu(frame.imu))]


def quantized(frame: SensorFrame) -> SensorFrame:
    """``frame`` as the wire delivers it."""
    samples: dict[str, Any] = {
        sensor.field: sample and CODECS[sensor.field].decode(CODECS[sensor.field].encode(sample))
        for sensor in SENSORS
        for sample in [getattr(frame, sensor.field)]
    }
    return SensorFrame(frame.time_us, **samples)
