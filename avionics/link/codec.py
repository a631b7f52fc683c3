"""The wire units of the bridge between world and flight computer, and nowhere else.

One direction carries sensors (HIL_SENSOR, HIL_GPS and Wingbeat's raw counts), the other HIL_ACTUATOR_CONTROLS.
A sensor frame travels as several messages of the same time stamp; HIL_SENSOR comes last and closes the tick.
Numbers are packed straight from and into `avionics.messages`, without pymavlink's message objects, because this
happens in every tick. Telemetry to the ground is in `telemetry.py`, mission items are in `mission_codec.py`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics import messages as m
from avionics.link.dialect import mavlink
from avionics.link.framing import CRC_EXTRA, SIGNED, Frame, build_frame, build_frame_v1, checksum
from wingbeat.records import constructor

FULL_DEFLECTION = math.pi / 2
"""rad; an angle of this size is a control of 1 in HIL_ACTUATOR_CONTROLS, for wings, elevator and rudder alike."""

CONTROL_WING_LEFT, CONTROL_WING_RIGHT, CONTROL_ELEVATOR, CONTROL_RUDDER, CONTROL_THROTTLE = range(5)
"""Places in ``HIL_ACTUATOR_CONTROLS.controls``."""

ACCELEROMETER, GYROSCOPE, MAGNETOMETER = 0x7, 0x38, 0x1C0
IMU_FIELDS = ACCELEROMETER | GYROSCOPE | MAGNETOMETER
"""``HIL_SENSOR.fields_updated`` of an IMU sample; pressures cross as raw counts in a message of their own."""

ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
_CUSTOM_MODE = 1
LOCKSTEP = 1
"""HIL_ACTUATOR_CONTROLS flag: this command answers one sensor frame, whose time it carries."""

UNKNOWN_U16 = 0xFFFF
_DEGE7 = 1e7 * 180.0 / math.pi

HIL_SENSOR: int = mavlink.MAVLINK_MSG_ID_HIL_SENSOR
HIL_GPS: int = mavlink.MAVLINK_MSG_ID_HIL_GPS
HIL_ACTUATOR_CONTROLS: int = mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
ENCODER: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_ENCODER
PRESSURES: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_PRESSURES
ADC_BURST: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_ADC_BURST
TORQUE: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_TORQUE
END: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_END
HIL_RC: int = mavlink.MAVLINK_MSG_ID_HIL_RC_INPUTS_RAW
HEARTBEAT: int = mavlink.MAVLINK_MSG_ID_HEARTBEAT


class ActuatorReply(NamedTuple):
    """A decoded HIL_ACTUATOR_CONTROLS."""

    command: m.ActuatorCommand
    lockstep: bool
    """the command's time is the time of the sensor frame that it answers"""


def _layout(message_id: int) -> struct.Struct:
    unpacker: struct.Struct = mavlink.mavlink_map[message_id].unpacker
    return unpacker


_SENSOR = _layout(HIL_SENSOR)
_GPS = _layout(HIL_GPS)
_ACTUATORS = _layout(HIL_ACTUATOR_CONTROLS)
_ENCODER = _layout(ENCODER)
_PRESSURES = _layout(PRESSURES)
_ADC = _layout(ADC_BURST)
_TORQUE = _layout(TORQUE)
_RC = _layout(HIL_RC)
_SPARE_CHANNELS = (0,) * 4
_NO_PRESSURE = (0.0, 0.0, 0.0, 0.0, IMU_FIELDS, 0)
_SPARE_CONTROLS = (0.0,) * 11
_IMU32 = struct.Struct("<9f")
_CONTROLS32 = struct.Struct("<5f")


def _padded(layout: struct.Struct, payload: bytes) -> tuple[Any, ...]:
    # MAVLink 2 cuts trailing zeros off; a newer sender may append fields.
    size = layout.size
    return layout.unpack(payload.ljust(size, b"\0")[:size] if len(payload) != size else payload)


# --- sensors ---------------------------------------------------------------------------------------------


def encode_imu(imu: m.ImuSample) -> bytes:
    """Payload of HIL_SENSOR."""
    return _SENSOR.pack(*imu, *_NO_PRESSURE)


def decode_imu(payload: bytes) -> m.ImuSample:
    """From a payload of HIL_SENSOR."""
    return m.ImuSample._make(_padded(_SENSOR, payload)[:10])


def encode_gps(fix: m.GpsFix) -> bytes:
    """Payload of HIL_GPS: degE7, mm, cm and cm/s, as PX4 reads it (eph and epv are accuracies in cm)."""
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


def decode_gps(payload: bytes) -> m.GpsFix:
    """From a payload of HIL_GPS; an unknown accuracy becomes 655.35 m, the largest the wire can say."""
    time_us, lat, lon, alt, eph, epv, _, vn, ve, vd, _, fix_type, satellites, _, _ = _padded(_GPS, payload)
    return m.GpsFix(
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


def encode_encoder(sample: m.EncoderSample) -> bytes:
    """Payload of WINGBEAT_ENCODER."""
    return _ENCODER.pack(*sample)


def decode_encoder(payload: bytes) -> m.EncoderSample:
    """From a payload of WINGBEAT_ENCODER."""
    return m.EncoderSample._make(_padded(_ENCODER, payload))


def encode_pressures(sample: m.PressureSample) -> bytes:
    """Payload of WINGBEAT_PRESSURES."""
    return _PRESSURES.pack(*sample)


def decode_pressures(payload: bytes) -> m.PressureSample:
    """From a payload of WINGBEAT_PRESSURES."""
    return m.PressureSample._make(_padded(_PRESSURES, payload))


def encode_adc(burst: m.AdcBurst) -> bytes:
    """Payload of WINGBEAT_ADC_BURST; the counts are unsigned 16-bit."""
    return _ADC.pack(burst.time_us, *burst.voltage_counts, *burst.current_counts)


def decode_adc(payload: bytes) -> m.AdcBurst:
    """From a payload of WINGBEAT_ADC_BURST."""
    values = _padded(_ADC, payload)
    return m.AdcBurst(values[0], values[1 : 1 + m.BURST_LENGTH], values[1 + m.BURST_LENGTH :])


def encode_torque(sample: m.TorqueSample) -> bytes:
    """Payload of WINGBEAT_TORQUE."""
    return _TORQUE.pack(*sample)


def decode_torque(payload: bytes) -> m.TorqueSample:
    """From a payload of WINGBEAT_TORQUE."""
    return m.TorqueSample._make(_padded(_TORQUE, payload))


def encode_receiver(sample: m.ReceiverSample) -> bytes:
    """Payload of HIL_RC_INPUTS_RAW; it has no field for a lost signal: that is a strength of 0."""
    rssi = 0 if sample.lost else max(sample.rssi, 1)
    return _RC.pack(sample.time_us, *sample.pulses, *_SPARE_CHANNELS, rssi)


def decode_receiver(payload: bytes) -> m.ReceiverSample:
    """From a payload of HIL_RC_INPUTS_RAW; channels beyond the eighth are passed over."""
    time_us, *pulses, rssi = _padded(_RC, payload)
    return m.ReceiverSample(time_us, tuple(pulses[: m.CHANNELS]), int(rssi == 0), rssi)


SENSOR_DECODERS: dict[int, tuple[str, Callable[[bytes], Any]]] = {
    ENCODER: ("encoder", decode_encoder),
    PRESSURES: ("pressures", decode_pressures),
    ADC_BURST: ("adc", decode_adc),
    TORQUE: ("torque", decode_torque),
    HIL_GPS: ("gps", decode_gps),
    HIL_RC: ("receiver", decode_receiver),
}
"""What may come before HIL_SENSOR in a tick: field of `SensorFrame` and decoder by message id."""

_SENSOR_ENCODERS: tuple[tuple[int, str, Callable[[Any], bytes]], ...] = (
    (ENCODER, "encoder", encode_encoder),
    (PRESSURES, "pressures", encode_pressures),
    (ADC_BURST, "adc", encode_adc),
    (TORQUE, "torque", encode_torque),
    (HIL_GPS, "gps", encode_gps),
    (HIL_RC, "receiver", encode_receiver),
)


class FrameWriter:
    """Numbers and frames what one end of a bridge says."""

    def __init__(self, system: int, component: int) -> None:
        self.system = system
        self.component = component
        self.version_1 = False
        """whether the receiver understands MAVLink 1 only"""
        self._sequence = 0
        self._mav: Any = mavlink.MAVLink(None, system, component)

    def frame(self, message_id: int, payload: bytes) -> bytes:
        """The next frame of this sender; empty for a message that the receiver's MAVLink does not have."""
        build = build_frame_v1 if self.version_1 else build_frame
        frame = build(message_id, payload, self._sequence, self.system, self.component)
        self._sequence = (self._sequence + bool(frame)) & 0xFF
        return frame

    def pack(self, message: Any) -> bytes:
        """The next MAVLink 2 frame of this sender, from one of pymavlink's message objects."""
        self._mav.seq = self._sequence
        self._sequence = (self._sequence + 1) & 0xFF
        packed: bytes = message.pack(self._mav)
        return packed

    def pack_signed(self, message: Any, sign: Callable[[bytes], bytes]) -> bytes:
        """As `pack`, with the flag that says so and behind it what ``sign`` gives for the frame."""
        return signed(self.pack(message), message.get_msgId(), sign)

    def sensors(self, frame: m.SensorFrame) -> bytes:
        """All messages of one tick, HIL_SENSOR last."""
        parts = [
            self.frame(message_id, encode(sample))
            for message_id, field, encode in _SENSOR_ENCODERS
            if (sample := getattr(frame, field)) is not None
        ]
        parts.append(self.frame(HIL_SENSOR, encode_imu(frame.imu)))
        return b"".join(parts)

    def actuators(self, command: m.ActuatorCommand) -> bytes:
        """The reply to one tick."""
        return self.frame(HIL_ACTUATOR_CONTROLS, encode_actuators(command))


def signed(unsigned: bytes, message_id: int, sign: Callable[[bytes], bytes]) -> bytes:
    """A frame with the flag that says so and behind it what ``sign`` gives for it."""
    frame = bytearray(unsigned)
    frame[2] |= SIGNED
    crc = checksum(bytes(frame[1:-2]) + CRC_EXTRA[message_id])
    frame[-2:] = crc.to_bytes(2, "little")
    return bytes(frame) + sign(bytes(frame))


class FrameAssembler:
    """Collects the messages of one tick until HIL_SENSOR closes it."""

    def __init__(self) -> None:
        self._parts: dict[str, Any] = {}

    def add(self, frame: Frame) -> m.SensorFrame | None:
        """The sensor frame when this message closes a tick; messages that are no sensors are passed over."""
        if frame.message_id == HIL_SENSOR:
            imu = decode_imu(frame.payload)
            parts, self._parts = self._parts, {}
            return m.SensorFrame(imu.time_us, imu, **parts)
        known = SENSOR_DECODERS.get(frame.message_id)
        if known is not None:
            self._parts[known[0]] = known[1](frame.payload)
        return None


# --- actuators -------------------------------------------------------------------------------------------


Controls = tuple[float, float, float, float, float]
"""left and right wing, elevator, rudder, throttle, as the first five of ``HIL_ACTUATOR_CONTROLS.controls``"""


def _limited(control: float) -> float:
    # A NaN, of which no comparison holds, travels as it is; the reader refuses it.
    if control > 1.0:
        return 1.0
    return -1.0 if control < -1.0 else control


def _controls(command: m.ActuatorCommand) -> Controls:
    _, left, right, throttle, elevator, rudder, _ = command
    return (
        _limited(left / FULL_DEFLECTION),
        _limited(right / FULL_DEFLECTION),
        _limited(elevator / FULL_DEFLECTION),
        _limited(rudder / FULL_DEFLECTION),
        _limited(throttle),
    )


_new_actuator_command = constructor(m.ActuatorCommand)


def _commanded(time_us: int, controls: Controls, armed: int) -> m.ActuatorCommand | None:
    """The command of its controls; None when one is not a finite number."""
    left, right, elevator, rudder, throttle = controls
    if not math.isfinite(left + right + elevator + rudder + throttle):
        return None
    return _new_actuator_command(
        time_us, left * FULL_DEFLECTION, right * FULL_DEFLECTION, throttle,
        elevator * FULL_DEFLECTION, rudder * FULL_DEFLECTION, 1 if armed else 0,
    )  # fmt: skip


def encode_actuators(command: m.ActuatorCommand) -> bytes:
    """Payload of HIL_ACTUATOR_CONTROLS; angles beyond `FULL_DEFLECTION` are limited to it.

    The time is that of the sensor frame answered, and the flags say so.
    """
    mode = _CUSTOM_MODE | (ARMED if command.armed else 0)
    return _ACTUATORS.pack(command.time_us, LOCKSTEP, *_controls(command), *_SPARE_CONTROLS, mode)


def decode_actuators(payload: bytes) -> ActuatorReply | None:
    """From a payload of HIL_ACTUATOR_CONTROLS; None when a control is not a finite number."""
    values = _padded(_ACTUATORS, payload)
    command = _commanded(values[0], values[2:7], values[-1] & ARMED)
    return None if command is None else ActuatorReply(command, bool(values[1] & LOCKSTEP))


# --- the same numbers in one process and over the wire -----------------------------------------------------


def quantised_imu(imu: m.ImuSample) -> m.ImuSample:
    """``imu`` as HIL_SENSOR delivers it: float32."""
    return m.ImuSample(imu.time_us, *_IMU32.unpack(_IMU32.pack(*imu[1:])))


def quantised_gps(fix: m.GpsFix) -> m.GpsFix:
    """``fix`` as HIL_GPS delivers it: degE7, mm, cm and cm/s."""
    return decode_gps(encode_gps(fix))


def quantised(frame: m.SensorFrame) -> m.SensorFrame:
    """``frame`` as the wire delivers it; counts cross unchanged."""
    gps = frame.gps if frame.gps is None else quantised_gps(frame.gps)
    heard = frame.receiver
    receiver = heard if heard is None else decode_receiver(encode_receiver(heard))
    return frame._replace(imu=quantised_imu(frame.imu), gps=gps, receiver=receiver)


def quantised_command(command: m.ActuatorCommand) -> m.ActuatorCommand:
    """``command`` as the wire delivers it; a command that is not finite is returned as it is."""
    controls = _CONTROLS32.unpack(_CONTROLS32.pack(*_controls(command)))
    return _commanded(command.time_us, controls, command.armed) or command
