"""The reference peer of a serial board: a simulated microcontroller with sensors and servos.

It keeps its own clock and does not wait: every tick it sends its sensor samples, applies the newest actuator frame,
and goes to the rest position after a time without one. Specification: docs/reference/serial_board.md.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

from avionics.link import codec
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader
from avionics.link.serial_line import SerialLine
from avionics.link.transport import Stream
from avionics.link.urls import LinkUrl, parse_url
from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.bridge.pace import Pacer
from sim_bridge.bridge.server import EndReason
from sim_bridge.bridge.world import NEUTRAL, SimulationSilent, World
from wingbeat.errors import InputError

REST_AFTER = 0.5
"""s; timeout of actuator frames, after which drives and servos go to the rest position"""
REST = NEUTRAL
"""rest position: disarmed, drives off, wings, elevator and rudder at 0"""
PTY = "pty"
"""address of a new pseudo terminal"""


class BridgeStatistics(NamedTuple):
    """Counters of the microcontroller."""

    frames: int = 0
    """-; sensor frames sent"""
    dropped: int = 0
    """-; sensor frames that the line did not accept"""
    commands: int = 0
    """-; applied actuator frames"""
    stale: int = 0
    """-; actuator frames older than an applied one, or with a time in the future"""
    rejected: int = 0
    """-; actuator frames with a control that is not a finite number"""
    rests: int = 0
    """-; number of changes to the rest position"""
    bad_bytes: int = 0
    """-; bytes outside of messages"""
    sent: int = 0
    """bytes; of sensor frames"""
    ended: str = ""
    """reason of the end, one line"""


class Microcontroller:
    """Simulated microcontroller: sends sensors, applies actuator commands, one tick after the other."""

    def __init__(self, stream: Stream, world: World) -> None:
        self._stream = stream
        self._world = world
        self._reader = FrameReader(version_1=False)
        self._writer = codec.FrameWriter(1, 200)
        self._received_us: int | None = None
        self._now_us = 0
        self._statistics = BridgeStatistics()
        self.command = REST
        """present command of drives and servos"""

    @property
    def statistics(self) -> BridgeStatistics:
        """The counts so far."""
        return self._statistics._replace(bad_bytes=self._reader.bad_bytes)

    def tick(self) -> SensorFrame:
        """Run one tick: apply commands, read sensors, send.

        Raises:
            SimulationSilent: the world sends no more sensor frames.
        """
        self._listen()
        self._watch()
        frame = self._world.step(self.command)
        self._now_us = frame.time_us
        data = self._writer.sensors(frame)
        taken = self._stream.write(data)
        count = self._statistics
        self._statistics = count._replace(
            frames=count.frames + 1, dropped=count.dropped + (not taken), sent=count.sent + len(data)
        )
        return frame

    def send_end(self) -> None:
        """Notify the flight computer of the end of a simulated world; a real board does not."""
        end = mavlink.MAVLink_wingbeat_end_message(self._now_us, int(EndReason.FINISHED))
        self._stream.write(self._writer.pack(end))

    def _listen(self) -> None:
        for frame in self._reader.feed(self._stream.read(0.0) or b""):
            if frame.message_id != codec.HIL_ACTUATOR_CONTROLS:
                continue
            reply = codec.decode_actuators(frame.payload)
            if reply is None:
                self._statistics = self._statistics._replace(rejected=self._statistics.rejected + 1)
            else:
                self._obey(reply.command)

    def _obey(self, command: ActuatorCommand) -> None:
        """Apply an actuator frame if it belongs to a later tick than the last one."""
        old = self._received_us is not None and command.time_us <= self._received_us
        if old or command.time_us > self._now_us:
            self._statistics = self._statistics._replace(stale=self._statistics.stale + 1)
            return
        self.command, self._received_us = command, command.time_us
        self._statistics = self._statistics._replace(commands=self._statistics.commands + 1)

    def _watch(self) -> None:
        """Go to the rest position if the newest actuator frame is too old."""
        if self._received_us is not None and self._now_us - self._received_us > REST_AFTER * 1e6:
            self.command, self._received_us = REST, None
            self._statistics = self._statistics._replace(rests=self._statistics.rests + 1)


class SerialPeer:
    """Server of a world over a serial line, in the world's time; the serial counterpart of `BridgeServer`."""

    def __init__(self, url: str, speed: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        """Open ``serial:DEVICE,BAUD``, or create a pseudo terminal (``pty``) whose name is then `address`.

        Args:
            url: address.
            speed: speed factor; None for 1, because a microcontroller runs in real time.
            clock: wall clock in s.

        Raises:
            InputError: not such an address, or the device cannot be opened.
        """
        self._stream: Stream = Pty() if url == PTY else _opened(parse_url(url))
        self.address = self._stream.name
        """``serial:DEVICE,BAUD`` for the other end of a pseudo terminal, else the given address"""
        self._pacer = Pacer(1.0 if speed is None else speed, clock)

    def serve(self, world: World) -> BridgeStatistics:
        """Run ticks until the world is finished or silent."""
        board = Microcontroller(self._stream, world)
        ended = "the simulation finished"
        try:
            while not world.finished:
                self._pacer.wait(board.tick().time_us)
            board.send_end()
        except SimulationSilent as silence:
            ended = str(silence)
        return board.statistics._replace(ended=ended)

    def close(self) -> None:
        """Close the device."""
        self._stream.close()


def _opened(url: LinkUrl) -> SerialLine:
    if url.kind != "serial":
        raise InputError(f"{url}: a microcontroller is on serial:DEVICE,BAUD")
    return SerialLine(url.host, url.port)


class Pty:
    """One end of a pseudo terminal; the flight computer opens the other, ``device``, like any serial device."""

    def __init__(self) -> None:
        """Create one.

        Raises:
            InputError: this platform has none.
        """
        if sys.platform == "win32":
            raise InputError("this platform has no pseudo terminals")
        import tty

        self._master, self._slave = os.openpty()
        # Kept open, so that a reconnecting reader does not end the line; raw, so that no byte is changed.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self.name = f"serial:{self.device},921600"

    def read(self, timeout: float) -> bytes | None:
        """Read bytes as soon as available; empty after ``timeout`` s, None once it is closed."""
        if self._master < 0:
            return None
        try:
            ready, _, _ = select.select([self._master], [], [], timeout)
            return os.read(self._master, 65536) if ready else b""
        except OSError:
            return b""

    def write(self, data: bytes) -> bool:
        """Write without blocking; return False if the buffer is full."""
        try:
            return os.write(self._master, data) == len(data)
        except OSError:
            return False

    def close(self) -> None:
        """Close both ends."""
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(end)
        self._master = self._slave = -1
