"""Poses of a vehicle and its parts as frames of viewers.

Viewers have z up, so frames turn here: world NED becomes ENU, body FRD becomes FLU (x forward, y left, z up); angles
keep their meaning.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

from logs.layout import varint

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(w, x, y, z)"""
_HALF_ROOT = math.sqrt(0.5)


class Pose(NamedTuple):
    """Position, attitude and joint angles of the vehicle in NED and FRD axes."""

    time_us: int
    """us; since boot"""
    position_ned: Vector
    """m; center of mass from the launch position"""
    quaternion: Quaternion
    """-; of r_ned_from_frd"""
    flap: tuple[float, float] = (0.0, 0.0)
    """rad; left and right, wing up is positive"""
    twist: tuple[float, float] = (0.0, 0.0)
    """rad; of the tips, left and right, leading edge up is positive"""
    elevator: float = 0.0
    """rad; positive pitches the nose up"""
    rudder: float = 0.0
    """rad; positive yaws the nose right"""

    def can_be_shown(self) -> bool:
        """Return whether position and attitude are finite and no angle is infinite."""
        angles = (*self.flap, *self.twist, self.elevator, self.rudder)
        return math.isfinite(sum(self.position_ned) + sum(self.quaternion)) and not any(map(math.isinf, angles))


def enu_from_ned(vector: Sequence[float]) -> Vector:
    """Convert north, east, down to east, north, up."""
    return vector[1], vector[0], -vector[2]


def enu_from_flu(quaternion: Sequence[float]) -> Quaternion:
    """Convert the quaternion of r_ned_from_frd to that of r_enu_from_flu, both (w, x, y, z).

    The result is the half turn about (1, 1, 0) from NED to ENU, ``quaternion``, and the half turn about x.
    """
    w, x, y, z = quaternion
    return _HALF_ROOT * (w + z), _HALF_ROOT * (x + y), _HALF_ROOT * (x - y), _HALF_ROOT * (w - z)


def wing_in_body(flap: float, twist: float, side: int) -> Quaternion:
    """Return the attitude of a wing in body axes FLU: flap about x, then half the tip twist about the span.

    Half the tip twist is its mean over the span. ``side`` is 1 for the left wing, -1 for the right one; both angles
    in rad.
    """
    a, b = 0.5 * side * flap, -0.25 * twist
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    return ca * cb, sa * cb, ca * sb, sa * sb


def tail_in_body(elevator: float, rudder: float) -> Quaternion:
    """Return the attitude of the tail in body axes FLU: rudder about z, then elevator about y, both in rad.

    Nose up is trailing edge up, nose right is trailing edge right.
    """
    a, b = 0.5 * rudder, 0.5 * elevator
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    return ca * cb, -sa * sb, ca * sb, sa * cb


# Protobuf with the field numbers of foxglove.FrameTransforms: a member is its tag, length and content.
_TRANSFORM, _STAMP, _PARENT, _CHILD, _TRANSLATION, _ROTATION = 0x0A, 0x0A, 0x12, 0x1A, 0x22, 0x2A
_X, _Y, _Z, _W = 0x09, 0x11, 0x19, 0x21
_SECONDS, _NANOS = b"\x08", b"\x10"
_STAMP_BYTES, _TRANSLATION_BYTES, _ROTATION_BYTES = 12, 27, 36


class Frames:
    """Encoder of poses as ``foxglove.FrameTransforms`` of body, wings and tail.

    All messages have the same length, so one `struct` call writes each, 15 times faster than the protobuf library.
    The constant text and tags between the numbers are stored.
    """

    def __init__(self, hinge: Vector, tail: Vector, start_epoch_ns: int, prefix: str = "") -> None:
        """Prepare the constant parts of the messages.

        Args:
            hinge: m; of the left wing's leading edge, in body axes FLU.
            tail: m; tail hinge in body axes FLU.
            start_epoch_ns: ns since 1970 at the zero of the vehicle clock.
            prefix: prefix of the frame names.
        """
        self._epoch = start_epoch_ns
        body, right = f"{prefix}body", (hinge[0], -hinge[1], hinge[2])
        self._format, self._arguments = "<", list[Any]()
        self._stamps: list[int] = []
        self._turns: list[slice] = []
        place = self._add("world", body, None)
        for child, translation in (("left_wing", hinge), ("right_wing", right), ("tail", tail)):
            self._add(body, f"{prefix}{child}", translation)
        self._place = slice(place, place + 5, 2)
        self._pack = struct.Struct(self._format).pack

    def packed(self, pose: Pose) -> bytes:
        """Encode one pose.

        Raises:
            ValueError: an angle is infinite.
        """
        arguments = self._arguments
        stamp = _stamp(self._epoch + pose.time_us * 1000)
        for place in self._stamps:
            arguments[place] = stamp
        arguments[self._place] = enu_from_ned(pose.position_ned)
        turns = (
            enu_from_flu(pose.quaternion),
            wing_in_body(pose.flap[0], pose.twist[0], 1),
            wing_in_body(pose.flap[1], pose.twist[1], -1),
            tail_in_body(pose.elevator, pose.rudder),
        )
        for numbers, (w, x, y, z) in zip(self._turns, turns, strict=True):
            arguments[numbers] = (x, y, z, w)
        return self._pack(*arguments)

    def _add(self, parent: str, child: str, translation: Vector | None) -> int:
        """Add a frame, its translation constant or given with every pose; place of the translation's first number."""
        names = _text(_PARENT, parent) + _text(_CHILD, child)
        length = 2 + _STAMP_BYTES + len(names) + 2 + _TRANSLATION_BYTES + 2 + _ROTATION_BYTES
        self._put(bytes((_TRANSFORM,)) + varint(length) + bytes((_STAMP, _STAMP_BYTES)))
        self._stamps.append(len(self._arguments))
        self._put(bytes(_STAMP_BYTES))
        self._put(names + bytes((_TRANSLATION, _TRANSLATION_BYTES, _X)))
        place = self._numbers(translation or (0.0, 0.0, 0.0), (_Y, _Z))
        self._put(bytes((_ROTATION, _ROTATION_BYTES, _X)))
        start = self._numbers((0.0, 0.0, 0.0, 1.0), (_Y, _Z, _W))
        self._turns.append(slice(start, start + 7, 2))
        return place

    def _put(self, constant: bytes) -> None:
        self._format += f"{len(constant)}s"
        self._arguments.append(constant)

    def _numbers(self, values: Sequence[float], tags: Sequence[int]) -> int:
        """Numbers with the tags between them, the first of which is there already."""
        place = len(self._arguments)
        self._format += "d" + "Bd" * len(tags)
        self._arguments.append(values[0])
        for tag, value in zip(tags, values[1:], strict=True):
            self._arguments += (tag, value)
        return place


class Posed(NamedTuple):
    """Pose for a topic of frames; encoded by the recorder, outside of the flight loop."""

    time_us: int
    """us; since boot"""
    frames: Frames
    pose: Pose

    @property
    def body(self) -> bytes:
        """The serialized message, as in `logs.codecs.Stamped`."""
        return self.frames.packed(self.pose)


def _stamp(nanoseconds: int) -> bytes:
    """``google.protobuf.Timestamp`` of an epoch time in ns, always 12 bytes long."""
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return _SECONDS + _wide(seconds) + _NANOS + _wide(rest)


def _wide(value: int) -> bytes:
    """A varint of five bytes, of however few it could be made."""
    return bytes(
        (
            value & 127 | 128,
            value >> 7 & 127 | 128,
            value >> 14 & 127 | 128,
            value >> 21 & 127 | 128,
            value >> 28 & 127,
        )
    )


def _text(tag: int, text: str) -> bytes:
    content = text.encode()
    return bytes((tag,)) + varint(len(content)) + content
