"""A Razor on a pseudo terminal: obeys the firmware's commands, streams its outputs, loses bytes, restarts.

Written from the description of the protocol alone, so that it checks the driver's constants with its own.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable
from typing import NamedTuple

from sim_bridge.bridge.microcontroller import Pty

STEP = 0.02
"""s; the firmware's raster"""
FIELD_DIP = math.radians(60.0)


class Motion(NamedTuple):
    """Attitude in rad and body rates in rad/s at one time."""

    roll: float
    pitch: float
    yaw: float
    rates: tuple[float, float, float]


def level(time: float) -> Motion:
    return Motion(0.0, 0.0, 0.0, (0.0, 0.0, 0.0))


class FakeRazor:
    """``pump`` runs one turn of its loop; ``now`` is its clock, s."""

    def __init__(self, motion: Callable[[float], Motion] = level, seed: int = 1, knows_ox: bool = True) -> None:
        self.line = Pty()
        self.address = f"razor:{self.line.device}"
        self.now = 0.0
        self.frames = 0
        self.requests: list[bytes] = []
        self.loss = 0.0
        """probability of a byte to be lost on the way out"""
        self.deaf = False
        """its receive line is not connected"""
        self._motion = motion
        self._random = random.Random(seed)
        self._knows_ox = knows_ox
        self._swallow = 0
        self._pending = b""
        self.restart(0)

    def restart(self, turns: int) -> None:
        """Power on: text angles stream after ``turns`` of the loop for its boot loader, which eats what comes."""
        self.output, self.streaming, self._single = b"ot", True, False
        self._booting = turns
        self._pending = b""

    def swallow(self, count: int) -> None:
        """Lose the next ``count`` bytes on the way out."""
        self._swallow += count

    def pump(self) -> None:
        """One turn of 20 ms: read commands, put out a frame."""
        self.now += STEP
        heard = self.line.read(0.0) or b""
        if self._booting:
            self._booting -= 1
            return
        if not self.deaf:
            self._pending += heard
        self._obey()
        if self.streaming or self._single:
            self._single = False
            self.frames += 1
            self.send(self.frame())

    def send(self, data: bytes) -> None:
        """Put bytes out, over a line that loses some."""
        kept = bytearray()
        for byte in data:
            if self._swallow:
                self._swallow -= 1
            elif self._random.random() >= self.loss:
                kept.append(byte)
        if kept:
            self.line.write(bytes(kept))

    def _obey(self) -> None:
        lengths = {b"f": 2, b"s": 4, b"o": 3}
        while len(self._pending) >= 2:
            letter = self._pending[1:2]
            if self._pending[:1] != b"#" or letter not in lengths:
                self._pending = self._pending[1:]
                continue
            size = lengths[letter] + (2 if self._pending[1:3] == b"os" else 0)
            if len(self._pending) < size:
                return
            command, self._pending = self._pending[:size], self._pending[size:]
            self.requests.append(command)
            self._do(command)

    def _do(self, command: bytes) -> None:
        if command == b"#f":
            self._single = True
        elif command.startswith(b"#s"):
            self.send(b"#SYNCH" + command[2:] + b"\r\n")
        elif command in (b"#o0", b"#o1"):
            self.streaming = command == b"#o1"
        elif command in (b"#ob", b"#ot") or command.startswith(b"#os") or (command == b"#ox" and self._knows_ox):
            self.output = command[1:]

    def frame(self) -> bytes:
        """The output of this moment."""
        observed = self._motion(self.now)
        ypr = [math.degrees(angle) for angle in (observed.yaw, observed.pitch, observed.roll)]
        accel, field, gyro = self._counts(observed)
        if self.output == b"ob":
            return struct.pack("<3f", *ypr)
        if self.output == b"ot":
            return _line("YPR", ypr)
        if self.output == b"ox":
            return _line("YPRAG", [*ypr, *accel, *observed.rates])
        if self.output.endswith(b"b"):
            return struct.pack("<9f", *accel, *field, *gyro)
        kind = self.output[2:3].decode().upper()
        return b"".join(_line(f"{name}-{kind}", axes) for name, axes in zip("AMG", (accel, field, gyro), strict=True))

    def _counts(self, observed: Motion) -> tuple[list[float], list[float], list[float]]:
        """Gravity, field and rates as its registers have them: whole counts, and a count of noise."""
        raw = self.output[2:3] == b"r"
        down = _body(observed, (0.0, 0.0, 1.0))
        north = _body(observed, (math.cos(FIELD_DIP), 0.0, math.sin(FIELD_DIP)))
        strength = 0.5 * 1090.0 if raw else 100.0
        return (
            [round(256.0 * axis) + self._random.choice((-1.0, 0.0, 1.0)) for axis in down],
            [round(strength * axis) + self._random.choice((-1.0, 0.0, 1.0)) for axis in north],
            [round(math.degrees(rate) * 14.375) + self._random.choice((-1.0, 0.0, 1.0)) for rate in observed.rates],
        )


def _line(name: str, values: list[float]) -> bytes:
    return f"#{name}={','.join(f'{value:.2f}' for value in values)}\r\n".encode()


def _body(observed: Motion, ned: tuple[float, float, float]) -> tuple[float, float, float]:
    """An earth vector in body axes: turned back by yaw, then pitch, then roll."""
    x, y, z = ned
    x, y = (
        math.cos(observed.yaw) * x + math.sin(observed.yaw) * y,
        math.cos(observed.yaw) * y - math.sin(observed.yaw) * x,
    )
    x, z = (
        math.cos(observed.pitch) * x - math.sin(observed.pitch) * z,
        math.sin(observed.pitch) * x + math.cos(observed.pitch) * z,
    )
    y, z = (
        math.cos(observed.roll) * y + math.sin(observed.roll) * z,
        math.cos(observed.roll) * z - math.sin(observed.roll) * y,
    )
    return x, y, z
