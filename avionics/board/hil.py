"""A board behind a MAVLink bridge: a simulated world, or a microcontroller with the sensors and servos.

The other side sends a tick's messages and closes it with HIL_SENSOR; HIL_ACTUATOR_CONTROLS, carrying the time of that
HIL_SENSOR, releases the next tick.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from avionics.board.board import BoardSilent
from avionics.link import codec
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader, decode
from avionics.link.transport import Stream, open_stream
from avionics.link.urls import LinkUrl, parse_url
from avionics.messages import ActuatorCommand, SensorFrame

ENDINGS: dict[int, str] = {
    mavlink.WINGBEAT_END_REASON_FINISHED: "the simulation is over",
    mavlink.WINGBEAT_END_REASON_STALLED: "the world says that an answer came too late",
    mavlink.WINGBEAT_END_REASON_STOPPED: "the world was stopped",
}
"""what the other side said when it ended, in words"""

Connect = Callable[[LinkUrl, float], Stream | None]


class Patience(NamedTuple):
    """How long the board waits for the other side before it says that nobody answers."""

    connect: float = 30.0
    """s; for the connection, while the world starts"""
    first: float = 180.0
    """s; for the first sensor frame: a world may have to get ready"""
    frame: float = 5.0
    """s; for every later sensor frame"""
    noise: float = 0.05
    """s; for the rest of something that began like a message"""


class HilBoard:
    """A `Board` behind a bridge; ``bad_bytes`` and ``frames`` count what came over it."""

    def __init__(
        self,
        url: str,
        patience: Patience | None = None,
        connect: Connect = open_stream,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Connect to ``tcp:HOST:PORT``, ``tcpin:HOST:PORT`` or ``serial:DEVICE,BAUD``, with or without ``hil:``.

        Raises:
            BadInput: not an address of these kinds, or the device is missing.
            BoardSilent: nobody answered at that address.
        """
        self._patience = patience or Patience()
        self._clock = clock
        parsed = parse_url(url.removeprefix("hil:"))
        self._name = str(parsed)
        stream = connect(parsed, self._patience.connect)
        if stream is None:
            raise BoardSilent(f"the world at {parsed} did not answer for {self._patience.connect:g} s")
        self._stream = stream
        self._reader = FrameReader(version_1=False)
        self._writer = codec.FrameWriter(1, 1)
        self._assembler = codec.FrameAssembler()
        self._waiting: deque[Frame] = deque()
        self._last_heartbeat = -float("inf")
        self._last_time_us: int | None = None
        self._over = False
        self.ended = ""
        """why `read` gave None, one line"""
        self._say_hello()

    @property
    def bad_bytes(self) -> int:
        """Bytes that were no part of a message."""
        return self._reader.bad_bytes

    @property
    def frames(self) -> int:
        """Messages received."""
        return self._reader.frames

    def read(self) -> SensorFrame | None:
        """Wait for the next sensor frame; None when the world ended or hung up.

        Raises:
            BoardSilent: no sensor frame within the bounded wait.
        """
        limit = self._patience.first if self._last_time_us is None else self._patience.frame
        deadline = self._clock() + limit
        while True:
            while self._waiting:
                frame = self._take(self._waiting.popleft())
                if frame is not None:
                    self._last_time_us = frame.time_us
                    return frame
            if self._over:
                return None
            if self._clock() >= deadline:
                raise self._silent(limit)
            self._receive()

    def _take(self, frame: Frame) -> SensorFrame | None:
        if frame.message_id == codec.END:
            self._over = True
            self.ended = ENDINGS.get(decode(frame).reason, "the world ended")
            self._waiting.clear()
            return None
        return self._assembler.add(frame)

    def _receive(self) -> None:
        data = self._stream.read(self._patience.noise)
        if data is None:
            self._over = True
            self.ended = self.ended or "the world hung up"
        elif data:
            self._waiting.extend(self._reader.feed(data))
        else:
            self._waiting.extend(self._reader.give_up())

    def _silent(self, limit: float) -> BoardSilent:
        since = ": it never sent one"
        if self._last_time_us is not None:
            since = f" after the one of t = {self._last_time_us / 1e6:.3f} s"
        return BoardSilent(f"the world at {self._name} sent no sensor frame for {limit:g} s{since}")

    def write(self, command: ActuatorCommand) -> None:
        """Send the actuators, which releases the next frame; a world that hung up is noticed by `read`."""
        self._stream.write(self._writer.actuators(command))
        if self._clock() - self._last_heartbeat >= 1.0:
            self._say_hello()

    def _say_hello(self) -> None:
        self._last_heartbeat = self._clock()
        heartbeat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FLAPPING_WING, mavlink.MAV_AUTOPILOT_GENERIC, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        self._stream.write(self._writer.pack(heartbeat))

    def close(self) -> None:
        """Hang up."""
        self._over = True
        self._stream.close()
