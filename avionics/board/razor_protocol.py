"""Protocol of the Razor AHRS firmware, versions 1.4 and later.

The 9DOF AHRS firmware (P. Bartz) runs on SparkFun's Razor and Sensor Stick. Commands are letters after ``#`` without
an end of line; angles and sensors are sent as lines of text or as little-endian floats. A binary frame has no marker,
so that its limits are found by synch tokens: the answer to ``#s<xy>``, ``#SYNCH<xy>\\r\\n``, is sent between two
frames. The data between two tokens must be a whole number of frames; otherwise bytes were lost and all of it is
discarded.

The board axes are x forward (toward the edge with the connector), y right, z down: FRD. Its accelerometer output is
gravity, +256 on z when level, which is the negative specific force.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Mapping
from typing import NamedTuple

from wingbeat.constants import STANDARD_GRAVITY

Vector = tuple[float, float, float]

GRAVITY_COUNTS = 256.0
"""counts; 1 g: 3.9 mg per count for raw readings, the reference of calibrated ones"""
GYRO_COUNT = math.radians(0.06957)
"""rad/s; one count of the ITG-3200, with or without offset correction"""
RAW_FIELD_COUNT = 1.0 / 1090.0
"""gauss; one raw count of the HMC5883L at its default gain (HMC5843 of older boards: 1/1300)"""
CALIBRATED_FIELD_COUNT = 0.005
"""gauss; one calibrated count: 100 is the field at the calibration, taken as 0.5 gauss, typical of the Earth"""
LARGEST_COUNT = 33000.0
"""counts; limit of a reading: a sensor register has 16 bits, and a calibration changes it little"""

TOKEN = re.compile(rb"#SYNCH(..)\r\n", re.DOTALL)
TOKEN_LENGTH = 10
LONGEST_LINE = 120
"""characters; limit of a line of text"""
_NUMBER = rb"(-?\d{1,5}\.\d\d)"
_LINE = re.compile(rb"#(YPR|YPRAG|[AMG]-[CR])=" + _NUMBER + rb"((?:," + _NUMBER + rb")+)")


class Angles(NamedTuple):
    """Attitude of the Razor."""

    roll: float
    """rad; positive right side down"""
    pitch: float
    """rad; positive nose up"""
    yaw: float
    """rad; clockwise from magnetic north"""


class Reading(NamedTuple):
    """Frame in the units and body axes (FRD) of `avionics.messages.ImuSample`."""

    accel: Vector | None = None
    """m/s^2; specific force, None in a frame with angles only"""
    gyro: Vector | None = None
    """rad/s"""
    mag: Vector | None = None
    """gauss; None in a frame without magnetometer"""
    angles: Angles | None = None
    """attitude; None in a frame without angles"""


class Output(NamedTuple):
    """Output mode of the firmware."""

    command: bytes
    """command that selects it"""
    size: int
    """bytes; size of a binary frame, 0 for text"""
    raw: bool
    """True if the sensors are not calibrated by the firmware"""
    lines: tuple[bytes, ...]
    """names of the lines of a text frame, in order"""
    help: str
    """description"""


OUTPUTS: Mapping[str, Output] = {
    "oscb": Output(b"#oscb", 36, False, (), "nine axes, calibrated, binary"),
    "osct": Output(b"#osct", 0, False, (b"A-C", b"M-C", b"G-C"), "nine axes, calibrated, text"),
    "osrb": Output(b"#osrb", 36, True, (), "nine axes, raw, binary"),
    "osrt": Output(b"#osrt", 0, True, (b"A-R", b"M-R", b"G-R"), "nine axes, raw, text"),
    "ox": Output(b"#ox", 0, False, (b"YPRAG",), "own angles, accelerometer and gyroscope, text (from 1.4.2.1)"),
    "ob": Output(b"#ob", 12, False, (), "own angles alone, binary"),
    "ot": Output(b"#ot", 0, False, (b"YPR",), "own angles alone, text"),
}
"""outputs by the letters of their commands"""


def synch_request(number: int) -> bytes:
    """Return the request of a synch token with a two-digit number."""
    return b"#s%02d" % (number % 100)


def start_request(output: Output, number: int) -> bytes:
    """Return the commands that start an output, with a token before its first frame."""
    return b"#o0" + output.command + b"#o1" + synch_request(number)


def believable(values: tuple[float, ...]) -> bool:
    """Return whether all values are in the range of 16-bit sensors (a NaN fails)."""
    return all(-LARGEST_COUNT <= value <= LARGEST_COUNT for value in values)


def sensors(values: tuple[float, ...], raw: bool) -> Reading:
    """Return the reading of accelerometer, magnetometer and gyroscope in counts.

    The order is x, y, z of each.
    """
    field = RAW_FIELD_COUNT if raw else CALIBRATED_FIELD_COUNT
    return Reading(
        _scaled(values[0:3], -STANDARD_GRAVITY / GRAVITY_COUNTS),
        _scaled(values[6:9], GYRO_COUNT),
        _scaled(values[3:6], field),
    )


def angles(values: tuple[float, ...]) -> Reading:
    """Return the reading of yaw, pitch and roll in degrees.

    Six more values are those of accelerometer (counts) and gyroscope (rad/s).
    """
    yaw, pitch, roll = (math.radians(value) for value in values[:3])
    own = Angles(roll, pitch, yaw)
    if len(values) == 3:
        return Reading(angles=own)
    return Reading(_scaled(values[3:6], -STANDARD_GRAVITY / GRAVITY_COUNTS), _scaled(values[6:9], 1.0), None, own)


def _scaled(values: tuple[float, ...], factor: float) -> Vector:
    x, y, z = values
    return (factor * x, factor * y, factor * z)


class Count(NamedTuple):
    """Statistics of a reader."""

    frames: int = 0
    """-; complete frames"""
    lost: int = 0
    """-; damaged frames"""
    bad_bytes: int = 0
    """-; bytes outside frames, tokens and lines"""
    tokens: int = 0
    """-; synch tokens"""
    strange: int = 0
    """-; frames of another output than requested: the Razor restarted"""


class Reader:
    """Parser of the frames of one output; inactive before the first token."""

    def __init__(self, output: Output) -> None:
        self.output = output
        self.count = Count()
        self.synched = False
        """True once a token was received since the start, or since `clear`"""
        self.waiting = 0
        """bytes of binary frames not yet confirmed by a token"""
        self.received = 0
        """received bytes"""
        self._pending = b""
        self._values: list[tuple[float, ...]] = []
        self._step: Callable[[], list[Reading]] = self._binary if output.size else self._text

    def clear(self) -> None:
        """Restart: the next token begins the stream."""
        self.synched = False
        self.waiting = 0
        self._pending = b""
        self._values = []

    def feed(self, data: bytes) -> list[Reading]:
        """Return all frames that are complete and confirmed with ``data``."""
        self.received += len(data)
        self._pending += data
        if not self.synched and not self._opened():
            return []
        return self._step()

    def _opened(self) -> bool:
        """Return whether a first token was received.

        Data before it, from the previous output, is discarded and not counted.
        """
        token = TOKEN.search(self._pending)
        if token is None:
            self._pending = self._pending[-TOKEN_LENGTH:]
            return False
        self._pending = self._pending[token.end() :]
        self._token()
        self.synched = True
        return True

    def _token(self) -> None:
        self.count = self.count._replace(tokens=self.count.tokens + 1)

    # --- binary -----------------------------------------------------------------------------------------------

    def _binary(self) -> list[Reading]:
        readings: list[Reading] = []
        while token := TOKEN.search(self._pending):
            readings += self._segment(self._pending[: token.start()])
            self._pending = self._pending[token.end() :]
            self._token()
        self.waiting = len(self._pending)
        return readings

    def _segment(self, segment: bytes) -> list[Reading]:
        """Return the frames between two tokens."""
        size = self.output.size
        if b"#YPR=" in segment or len(segment) % size:
            self._lost(max(1, round(len(segment) / size)), len(segment), int(b"#YPR=" in segment))
            return []
        return [reading for at in range(0, len(segment), size) for reading in self._frame(segment[at : at + size])]

    def _frame(self, frame: bytes) -> list[Reading]:
        values = struct.unpack(f"<{len(frame) // 4}f", frame)
        if not believable(values):
            self._lost(1, len(frame), 0)
            return []
        self.count = self.count._replace(frames=self.count.frames + 1)
        return [angles(values) if len(values) == 3 else sensors(values, self.output.raw)]

    def _lost(self, frames: int, size: int, strange: int) -> None:
        count = self.count
        self.count = count._replace(
            lost=count.lost + frames, bad_bytes=count.bad_bytes + size, strange=count.strange + strange
        )

    # --- text -------------------------------------------------------------------------------------------------

    def _text(self) -> list[Reading]:
        *lines, self._pending = self._pending.split(b"\r\n")
        if len(self._pending) > LONGEST_LINE:
            self._broken(len(self._pending), 0)
            self._pending = b""
        return [reading for line in lines for reading in self._line(line)]

    def _line(self, line: bytes) -> list[Reading]:
        """Return the frame completed by a line, if any; a line out of order ends a frame."""
        if line.startswith(b"#SYNCH"):
            self._token()
            return []
        names = self.output.lines
        found = _LINE.fullmatch(line)
        values = () if found is None else tuple(float(part) for part in line.split(b"=")[1].split(b","))
        name = b"" if found is None else found[1]
        whole = len(values) == (9 if name == b"YPRAG" else 3) and believable(values)
        if not whole or name not in names:
            self._broken(len(line), int(whole))
            return []
        if name != names[len(self._values)]:
            self._broken(0, 0)
            if name != names[0]:
                return []
        self._values.append(values)
        return self._closed() if len(self._values) == len(names) else []

    def _broken(self, size: int, strange: int) -> None:
        """Count an incomplete frame as lost, with ``size`` bytes of a line."""
        self._lost(int(bool(self._values) or size > 0), size, strange)
        self._values = []

    def _closed(self) -> list[Reading]:
        parts, self._values = self._values, []
        self.count = self.count._replace(frames=self.count.frames + 1)
        if len(parts) == 1:
            return [angles(parts[0])]
        return [sensors(parts[0] + parts[1] + parts[2], self.output.raw)]
