"""What a Razor says: the 9DOF AHRS firmware of SparkFun's Razor and Sensor Stick (P. Bartz), versions 1.4 and later.

Commands are letters behind ``#`` without an end of line; angles and sensors come as lines of text or as bare
little-endian floats. A binary frame has no marker, so its borders are found by synch tokens: the answer to
``#s<xy>``, ``#SYNCH<xy>\\r\\n``, is sent between two frames. Whatever lies between two tokens is a whole number of
frames, or bytes were lost in it and none of it is believed.

The board's axes are x forward (toward the connector's edge), y right, z down: FRD. Its accelerometer tells
gravity, +256 on z when it lies level, which is the specific force with its sign turned.
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
"""counts; of 1 g: 3.9 mg a count for raw readings, the reference of calibrated ones"""
GYRO_COUNT = math.radians(0.06957)
"""rad/s; of a count of the ITG-3200, whether its offset is taken off or not"""
RAW_FIELD_COUNT = 1.0 / 1090.0
"""gauss; of a raw count of the HMC5883L at its default gain (an older board's HMC5843: 1/1300)"""
CALIBRATED_FIELD_COUNT = 0.005
"""gauss; of a calibrated one: 100 is the field where it was calibrated, taken as 0.5 gauss, mid of the Earth's"""
LARGEST_COUNT = 33000.0
"""counts; a sensor's register has 16 bits, and a calibration does not change much of it"""

TOKEN = re.compile(rb"#SYNCH(..)\r\n", re.DOTALL)
TOKEN_LENGTH = 10
LONGEST_LINE = 120
"""characters; of a line of text"""
_NUMBER = rb"(-?\d{1,5}\.\d\d)"
_LINE = re.compile(rb"#(YPR|YPRAG|[AMG]-[CR])=" + _NUMBER + rb"((?:," + _NUMBER + rb")+)")


class Angles(NamedTuple):
    """The Razor's own attitude."""

    roll: float
    """rad; right side down is positive"""
    pitch: float
    """rad; nose up is positive"""
    yaw: float
    """rad; clockwise from magnetic north"""


class Reading(NamedTuple):
    """One frame, in the units and body axes (FRD) of `avionics.messages.ImuSample`."""

    accel: Vector | None = None
    """m/s^2; specific force, None in a frame of angles alone"""
    gyro: Vector | None = None
    """rad/s"""
    mag: Vector | None = None
    """gauss; None where the frame has no magnetometer"""
    angles: Angles | None = None
    """where the frame has them"""


class Output(NamedTuple):
    """One of the firmware's output modes."""

    command: bytes
    """that switches it on"""
    size: int
    """bytes; of a binary frame, 0 for text"""
    raw: bool
    """whether the sensors come without the firmware's calibration"""
    lines: tuple[bytes, ...]
    """names of the lines of a frame of text, in their order"""
    help: str
    """what it is, for people"""


OUTPUTS: Mapping[str, Output] = {
    "oscb": Output(b"#oscb", 36, False, (), "nine axes, calibrated, binary"),
    "osct": Output(b"#osct", 0, False, (b"A-C", b"M-C", b"G-C"), "nine axes, calibrated, text"),
    "osrb": Output(b"#osrb", 36, True, (), "nine axes, raw, binary"),
    "osrt": Output(b"#osrt", 0, True, (b"A-R", b"M-R", b"G-R"), "nine axes, raw, text"),
    "ox": Output(b"#ox", 0, False, (b"YPRAG",), "own angles, accelerometer and gyroscope, text (from 1.4.2.1)"),
    "ob": Output(b"#ob", 12, False, (), "own angles alone, binary"),
    "ot": Output(b"#ot", 0, False, (b"YPR",), "own angles alone, text"),
}
"""by the letters that switch them on"""


def synch_request(number: int) -> bytes:
    """Ask for a synch token with a two-digit number."""
    return b"#s%02d" % (number % 100)


def start_request(output: Output, number: int) -> bytes:
    """Stop, choose an output, stream it, and ask for a token, behind which its first frame begins."""
    return b"#o0" + output.command + b"#o1" + synch_request(number)


def believable(values: tuple[float, ...]) -> bool:
    """Whether all are numbers that 16-bit sensors can give (a NaN fails every comparison)."""
    return all(-LARGEST_COUNT <= value <= LARGEST_COUNT for value in values)


def sensors(values: tuple[float, ...], raw: bool) -> Reading:
    """From accelerometer, magnetometer and gyroscope, x, y, z of each, in counts."""
    field = RAW_FIELD_COUNT if raw else CALIBRATED_FIELD_COUNT
    return Reading(
        _scaled(values[0:3], -STANDARD_GRAVITY / GRAVITY_COUNTS),
        _scaled(values[6:9], GYRO_COUNT),
        _scaled(values[3:6], field),
    )


def angles(values: tuple[float, ...]) -> Reading:
    """From yaw, pitch and roll in degrees; with six more values from accelerometer (counts) and gyroscope (rad/s)."""
    yaw, pitch, roll = (math.radians(value) for value in values[:3])
    own = Angles(roll, pitch, yaw)
    if len(values) == 3:
        return Reading(angles=own)
    return Reading(_scaled(values[3:6], -STANDARD_GRAVITY / GRAVITY_COUNTS), _scaled(values[6:9], 1.0), None, own)


def _scaled(values: tuple[float, ...], factor: float) -> Vector:
    x, y, z = values
    return (factor * x, factor * y, factor * z)


class Count(NamedTuple):
    """What a reader made of the bytes."""

    frames: int = 0
    """-; whole frames"""
    lost: int = 0
    """-; frames that came damaged, as far as bytes of them came"""
    bad_bytes: int = 0
    """-; that were no part of a frame, a token or a line"""
    tokens: int = 0
    """-; synch tokens"""
    strange: int = 0
    """-; frames of another output than was asked for: the Razor restarted"""


class Reader:
    """Bytes in, frames out, of one output; believes nothing before the first token."""

    def __init__(self, output: Output) -> None:
        self.output = output
        self.count = Count()
        self.synched = False
        """a token was seen since the start, or since `clear`"""
        self.waiting = 0
        """bytes of binary frames that wait for a token to confirm them"""
        self.received = 0
        """bytes"""
        self._pending = b""
        self._values: list[tuple[float, ...]] = []
        self._step: Callable[[], list[Reading]] = self._binary if output.size else self._text

    def clear(self) -> None:
        """Begin anew: the next token opens the stream."""
        self.synched = False
        self.waiting = 0
        self._pending = b""
        self._values = []

    def feed(self, data: bytes) -> list[Reading]:
        """All frames that are whole, and confirmed, with ``data``."""
        self.received += len(data)
        self._pending += data
        if not self.synched and not self._opened():
            return []
        return self._step()

    def _opened(self) -> bool:
        """Whether there is a first token; what came before it, the output of before, is dropped and not counted."""
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
        """The frames between two tokens."""
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
        """The frame that this line closes, if it does; a line out of its turn breaks a frame off."""
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
        """A frame that had begun is lost, and ``size`` bytes of a line with it."""
        self._lost(int(bool(self._values) or size > 0), size, strange)
        self._values = []

    def _closed(self) -> list[Reading]:
        parts, self._values = self._values, []
        self.count = self.count._replace(frames=self.count.frames + 1)
        if len(parts) == 1:
            return [angles(parts[0])]
        return [sensors(parts[0] + parts[1] + parts[2], self.output.raw)]
