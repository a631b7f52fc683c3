"""Board behind a MAVLink bridge: a simulator, or a microcontroller.

The other side sends the messages of a tick and closes it with HIL_SENSOR. HIL_ACTUATOR_CONTROLS with the time of that
HIL_SENSOR releases the next tick of a simulator. A microcontroller on a serial line does not wait, see
docs/reference/serial_board.md. Its device may disconnect and reconnect; losses on the line are counted and reported.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from avionics.board.arrivals import Arrivals, FrameCounters
from avionics.board.board import IDLE_EVERY, BoardSilent, Surroundings
from avionics.board.line_watch import LineWatch, Losses
from avionics.link import codec
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader, decode
from avionics.link.serial_line import SerialLine
from avionics.link.tick_codec import decode_tick
from avionics.link.transport import SocketStream, Stream, open_stream
from avionics.link.urls import LinkUrl, parse_url
from avionics.messages import ActuatorCommand, SensorFrame

ENDINGS: dict[int, str] = {
    mavlink.WINGBEAT_END_REASON_FINISHED: "simulation ended",
    mavlink.WINGBEAT_END_REASON_STALLED: "simulator timed out waiting for a command",
    mavlink.WINGBEAT_END_REASON_STOPPED: "simulator stopped",
}
"""reason sent by the other side at its end"""

Connect = Callable[[LinkUrl, float], Stream | None]


class Timeouts(NamedTuple):
    """Timeouts of the board."""

    connect: float = 30.0
    """s; timeout of the connection, while the simulator starts"""
    first: float = 180.0
    """s; timeout of the first sensor frame, because a simulator may need preparation"""
    frame: float = 5.0
    """s; timeout of every later sensor frame"""
    noise: float = 0.05
    """s; timeout of the remainder of an incomplete message"""


SERIAL_PATIENCE = Timeouts(first=10.0, frame=30.0)
"""timeouts of a microcontroller: no preparation, but time to reconnect its plug"""
IDLE = Surroundings()


def open_line(url: LinkUrl, timeouts: float) -> Stream | None:
    """Connect to the other side; None after the timeout (s).

    Raises:
        InputError: no address of a board, or the device is missing.
    """
    return SerialLine(url.host, url.port) if url.kind == "serial" else open_stream(url, timeouts)


class HilBoard:
    """`Board` behind a bridge, with counters of messages, frames and losses."""

    def __init__(
        self,
        url: str,
        timeouts: Timeouts | None = None,
        connect: Connect = open_line,
        clock: Callable[[], float] = time.monotonic,
        around: Surroundings = IDLE,
    ) -> None:
        """Connect to an address, with or without the prefix ``hil:``.

        The forms are ``tcp:HOST:PORT``, ``tcpin:HOST:PORT``, ``unix:NAME`` and ``serial:DEVICE,BAUD``.

        Raises:
            InputError: not an address of these kinds, or the device is missing.
            BoardSilent: no answer at that address.
        """
        parsed = parse_url(url.removeprefix("hil:"), lockstep=True)
        serial = parsed.kind == "serial"
        self._timeouts = timeouts or (SERIAL_PATIENCE if serial else Timeouts())
        self._clock = clock
        self._around = around
        self._name = f"{'board' if serial else 'simulator'} at {parsed}"
        stream = connect(parsed, self._timeouts.connect)
        if stream is None:
            raise BoardSilent(f"{self._name} did not respond for {self._timeouts.connect:g} s")
        self._stream = stream
        self._line = stream if isinstance(stream, SerialLine) else None
        self._replugged = 0
        self._watch = LineWatch(self._name, around.report)
        self._arrivals = Arrivals()
        self._reader = FrameReader(version_1=False)
        self._writer = codec.FrameWriter(1, 1)
        self._assembler = codec.FrameAssembler()
        self._waiting: deque[Frame] = deque()
        self._ticked = 0
        self._last_heartbeat = self._idled_at = -float("inf")
        self._last_time_us: int | None = None
        self._over = False
        self.ended = ""
        """reason in one line if `read` returned None"""
        self._send_heartbeat()

    @property
    def bad_bytes(self) -> int:
        """Number of bytes outside messages."""
        return self._reader.bad_bytes

    @property
    def frames(self) -> int:
        """Number of received messages."""
        return self._reader.frames + self._ticked

    @property
    def counters(self) -> FrameCounters:
        """Frame counters of a board on a serial line; a lockstep has no losses."""
        return self._arrivals.counters

    @property
    def losses(self) -> Losses:
        """Losses of the line since the start."""
        dropped = 0 if self._line is None else self._line.dropped
        return Losses(self.counters.lost, self.counters.late, self.bad_bytes, dropped)

    def enable_busy_poll(self) -> None:
        """Enable busy polling for the simulator: see `SocketStream.enable_busy_poll`."""
        if isinstance(self._stream, SocketStream):
            self._stream.enable_busy_poll()

    def read(self) -> SensorFrame | None:
        """Wait for the next sensor frame; None if the simulator ended or disconnected.

        A disconnected serial device has the same timeout as a silent one.

        Raises:
            BoardSilent: no sensor frame within the bounded wait.
        """
        limit = self._timeouts.first if self._last_time_us is None else self._timeouts.frame
        started = self._idled_at = self._clock()
        while True:
            while self._waiting:
                frame = self._take(self._waiting.popleft())
                if frame is not None:
                    self._note(frame.time_us, started)
                    return frame
            if self._over:
                return None
            now = self._clock()
            if now - started >= limit:
                raise self._silent(limit)
            if now - self._idled_at >= IDLE_EVERY:
                self._idle()
            sensed = self._receive()
            if sensed is not None:
                self._last_time_us = sensed.time_us
                return sensed
            self._look_after(started)

    def _take(self, frame: Frame) -> SensorFrame | None:
        if frame.message_id == codec.END:
            self._over = True
            self.ended = ENDINGS.get(decode(frame).reason, "simulation ended")
            self._waiting.clear()
            return None
        self._arrivals.message(frame)
        return self._assembler.add(frame)

    def _note(self, time_us: int, started: float) -> None:
        """Count a frame of the board time ``time_us`` after a wait since ``started`` (s)."""
        self._last_time_us = time_us
        if self._line is None:
            return
        now, restarts = self._clock(), self.counters.restarts
        self._arrivals.tick(time_us, now)
        self._watch.received(now - started)
        if self.counters.restarts > restarts:
            self._watch.restarted()
        self._watch.report(now, self.losses)

    def _receive(self) -> SensorFrame | None:
        """Read; return the sensor frame of a lockstep partner whose whole tick arrived at once, as nearly always."""
        data = self._stream.read(self._timeouts.noise)
        if data and self._line is None and not self._reader.pending and not self._assembler.pending:
            tick = decode_tick(data)
            if tick is not None:
                self._ticked += tick.messages
                return tick.frame
        if data is None:
            self._over = True
            self.ended = self.ended or "simulator disconnected"
        elif data:
            self._waiting.extend(self._reader.feed(data))
        else:
            self._waiting.extend(self._reader.give_up())
            self._idle()
        return None

    def _idle(self) -> None:
        self._around.idle()
        self._idled_at = self._clock()

    def _look_after(self, started: float) -> None:
        """Report a serial device without frames since ``started`` (s).

        The counters restart when it reconnects.
        """
        line = self._line
        if line is None:
            return
        if not self._waiting:
            self._watch.waiting(line.plugged, self._clock() - started)
        if line.replugged != self._replugged:
            self._replugged = line.replugged
            self._assembler = codec.FrameAssembler()
            self._arrivals.resume()
            self._send_heartbeat()

    def _silent(self, limit: float) -> BoardSilent:
        since = ", none received before"
        if self._last_time_us is not None:
            since = f", last at t = {self._last_time_us / 1e6:.3f} s"
        return BoardSilent(f"{self._name} sent no sensor frame for {limit:g} s{since}")

    def write(self, command: ActuatorCommand) -> None:
        """Send the actuator command, which releases the next frame.

        A disconnected simulator is detected by `read`.
        """
        self._stream.write(self._writer.actuators(command))
        if self._clock() - self._last_heartbeat >= 1.0:
            self._send_heartbeat()

    def _send_heartbeat(self) -> None:
        self._last_heartbeat = self._clock()
        heartbeat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FLAPPING_WING, mavlink.MAV_AUTOPILOT_GENERIC, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        self._stream.write(self._writer.pack(heartbeat))

    def close(self) -> None:
        """Close the connection."""
        self._over = True
        self._stream.close()
