"""Wire units of the bridge between simulator and flight computer.

One direction carries sensors (HIL_SENSOR, HIL_GPS and raw counts of Wingbeat), the other HIL_ACTUATOR_CONTROLS. A
sensor frame consists of several messages with the same timestamp; HIL_SENSOR is the last and closes the tick. Numbers
are packed directly from and into `avionics.messages`, without message objects of pymavlink, because this runs in
every tick. Telemetry to the ground is in `telemetry.py`, mission items are in `mission_codec.py`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics import messages as m
from avionics.link.dialect import mavlink
from avionics.link.framing import CRC_EXTRA, SIGNED, Frame, build_frame, build_frame_v1, checksum
from avionics.link.sensor_codec import BY_MESSAGE, HIL_SENSOR, decode_imu, layout_of, padded
from avionics.link.tick_codec import TickEncoder
from wingbeat.records import constructor

FULL_DEFLECTION = math.pi / 2
"""rad; angle of a control of 1 in HIL_ACTUATOR_CONTROLS, for wings, elevator and rudder"""

CONTROL_WING_LEFT, CONTROL_WING_RIGHT, CONTROL_ELEVATOR, CONTROL_RUDDER, CONTROL_THROTTLE = range(5)
"""indices in ``HIL_ACTUATOR_CONTROLS.controls``"""

ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED"""
_CUSTOM_MODE = 1
LOCKSTEP = 1
"""flag of HIL_ACTUATOR_CONTROLS: the command replies to one sensor frame and has its time"""

HIL_ACTUATOR_CONTROLS: int = mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
END: int = mavlink.MAVLINK_MSG_ID_WINGBEAT_END
HEARTBEAT: int = mavlink.MAVLINK_MSG_ID_HEARTBEAT


class ActuatorReply(NamedTuple):
    """Decoded HIL_ACTUATOR_CONTROLS."""

    command: m.ActuatorCommand
    lockstep: bool
    """True if the time of the command is that of the sensor frame it replies to"""


_ACTUATORS = layout_of(HIL_ACTUATOR_CONTROLS)
_SPARE_CONTROLS = (0.0,) * 11
_CONTROLS32 = struct.Struct("<5f")


class FrameWriter:
    """Framing of the messages of one end of a bridge."""

    def __init__(self, system: int, component: int) -> None:
        self.system = system
        self.component = component
        self.version_1 = False
        """True if the receiver supports MAVLink 1 only"""
        self._sequence = 0
        self._ticks = TickEncoder()
        self._mav: Any = mavlink.MAVLink(None, system, component)

    def frame(self, message_id: int, payload: bytes) -> bytes:
        """Return the next frame of this sender.

        The result is empty for a message that the MAVLink version of the receiver does not have.
        """
        build = build_frame_v1 if self.version_1 else build_frame
        frame = build(message_id, payload, self._sequence, self.system, self.component)
        self._sequence = (self._sequence + bool(frame)) & 0xFF
        return frame

    def pack(self, message: Any) -> bytes:
        """Return the next MAVLink 2 frame from a message object of pymavlink."""
        self._mav.seq = self._sequence
        self._sequence = (self._sequence + 1) & 0xFF
        packed: bytes = message.pack(self._mav)
        return packed

    def pack_signed(self, message: Any, sign: Callable[[bytes], bytes]) -> bytes:
        """Return a frame as `pack` does, with signed flag and the signature from ``sign``."""
        return signed(self.pack(message), message.get_msgId(), sign)

    def sensors(self, frame: m.SensorFrame) -> bytes:
        """Return all messages of one tick as MAVLink 2 frames, HIL_SENSOR last."""
        data, self._sequence = self._ticks.encode(frame, self._sequence, self.system, self.component)
        return data

    def actuators(self, command: m.ActuatorCommand) -> bytes:
        """Return the reply to one tick."""
        return self.frame(HIL_ACTUATOR_CONTROLS, encode_actuators(command))


def signed(unsigned: bytes, message_id: int, sign: Callable[[bytes], bytes]) -> bytes:
    """Return a frame with the signed flag and the signature from ``sign``."""
    frame = bytearray(unsigned)
    frame[2] |= SIGNED
    crc = checksum(bytes(frame[1:-2]) + CRC_EXTRA[message_id])
    frame[-2:] = crc.to_bytes(2, "little")
    return bytes(frame) + sign(bytes(frame))


class FrameAssembler:
    """Assembly of the messages of one tick until HIL_SENSOR closes it."""

    def __init__(self) -> None:
        self._parts: dict[str, Any] = {}

    @property
    def pending(self) -> bool:
        """Whether a tick has begun that HIL_SENSOR has not closed."""
        return bool(self._parts)

    def add(self, frame: Frame) -> m.SensorFrame | None:
        """Return the sensor frame if this message closes a tick.

        Messages that are not sensors are ignored.
        """
        if frame.message_id == HIL_SENSOR:
            imu = decode_imu(frame.payload)
            parts, self._parts = self._parts, {}
            return m.SensorFrame(imu.time_us, imu, **parts)
        known = BY_MESSAGE.get(frame.message_id)
        if known is not None:
            field, decode = known
            sample = decode(frame.payload)
            if sample is not None:
                self._parts[field] = sample
        return None


# --- actuators -------------------------------------------------------------------------------------------


Controls = tuple[float, float, float, float, float]
"""left and right wing, elevator, rudder, throttle, the first five of ``HIL_ACTUATOR_CONTROLS.controls``"""


def _limited(control: float) -> float:
    # A NaN fails every comparison and is sent unchanged; the reader rejects it.
    if control > 1.0:
        return 1.0
    return -1.0 if control < -1.0 else control


def _controls(command: m.ActuatorCommand) -> Controls:
    return (
        _limited(command.wing_left / FULL_DEFLECTION),
        _limited(command.wing_right / FULL_DEFLECTION),
        _limited(command.elevator / FULL_DEFLECTION),
        _limited(command.rudder / FULL_DEFLECTION),
        _limited(command.throttle),
    )


_new_actuator_command = constructor(m.ActuatorCommand)


def _commanded(time_us: int, controls: Controls, armed: int) -> m.ActuatorCommand | None:
    """Return the command of the controls; None if one is not finite."""
    left, right, elevator, rudder, throttle = controls
    if not math.isfinite(left + right + elevator + rudder + throttle):
        return None
    return _new_actuator_command(
        time_us, left * FULL_DEFLECTION, right * FULL_DEFLECTION, throttle,
        elevator * FULL_DEFLECTION, rudder * FULL_DEFLECTION, 1 if armed else 0,
    )  # fmt: skip


def encode_actuators(command: m.ActuatorCommand) -> bytes:
    """Return the payload of HIL_ACTUATOR_CONTROLS.

    Angles are limited to `FULL_DEFLECTION`. The time is that of the sensor frame, as indicated by the flags.
    """
    mode = _CUSTOM_MODE | (ARMED if command.armed else 0)
    return _ACTUATORS.pack(command.time_us, LOCKSTEP, *_controls(command), *_SPARE_CONTROLS, mode)


def decode_actuators(payload: bytes) -> ActuatorReply | None:
    """Decode a payload of HIL_ACTUATOR_CONTROLS; None if a control is not finite."""
    values = padded(_ACTUATORS, payload)
    command = _commanded(values[0], values[2:7], values[-1] & ARMED)
    return None if command is None else ActuatorReply(command, bool(values[1] & LOCKSTEP))


# --- identical numbers in one process and over the wire ---------------------------------------------------


def quantized_command(command: m.ActuatorCommand) -> m.ActuatorCommand:
    """Return ``command`` as received over the wire; unchanged if it is not finite."""
    controls = _CONTROLS32.unpack(_CONTROLS32.pack(*_controls(command)))
    return _commanded(command.time_us, controls, command.armed) or command
