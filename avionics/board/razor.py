"""Razor 9DOF on a serial line as a board with an IMU only, without a simulator.

The firmware sends no time. The time of a frame follows from its position in the 20 ms raster of the firmware, which
is estimated by a slow filter of the arrival times. A frame delayed in a buffer therefore does not count as a late
sample.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from avionics.board import razor_protocol as protocol
from avionics.board.board import IDLE_EVERY, BoardSilent, Surroundings
from avionics.board.line_watch import LineWatch, Losses
from avionics.board.razor_protocol import OUTPUTS, Angles, Reader, Reading
from avionics.link.serial_line import SerialLine
from avionics.messages import ActuatorCommand, ImuSample, SensorFrame
from wingbeat.errors import InputError

BAUD = 57600
"""baud rate of the firmware"""
OUTPUT = "oscb"
"""default output: the most information for its size, and the only one in which a lost byte is always detected"""
FORMS = "razor:DEVICE[,BAUD[,OUTPUT]]"
WITH_SENSORS = tuple(name for name, output in OUTPUTS.items() if name not in ("ob", "ot"))
"""outputs with sensor data"""
IDLE = Surroundings()


class RazorUrl(NamedTuple):
    """Parsed address of a Razor."""

    device: str
    """-; serial device"""
    baud: int = BAUD
    """-; baud rate"""
    output: str = OUTPUT
    """-; one of `WITH_SENSORS`"""


class Timeouts(NamedTuple):
    """Timeouts of the board."""

    first: float = 6.0
    """s; timeout of the first frame: opening the device restarts some boards, and their boot loader takes 2 s"""
    frame: float = 5.0
    """s; timeout of every later frame"""
    request_interval: float = 0.5
    """s; time without a frame before the output is requested again"""
    token: float = 0.03
    """s; timeout of a synch token before the next request"""
    look: float = 0.02
    """s; timeout of one read"""
    loss: float = 0.0
    """s; timeout of a disconnected device"""


def parse_address(text: str) -> RazorUrl:
    """Parse ``razor:DEVICE[,BAUD[,OUTPUT]]``.

    Raises:
        InputError: no device, an invalid baud rate, or an output without sensors; the text lists the valid ones.
    """
    device, *options = text.strip().removeprefix("razor:").split(",")
    if not device or len(options) > 2:
        raise InputError(f"board {text!r} is not {FORMS}")
    baud = options[0] if options else str(BAUD)
    output = options[1] if len(options) > 1 else OUTPUT
    if not (baud.isascii() and baud.isdigit()) or not 0 < int(baud) <= 10_000_000:
        raise InputError(f"board {text!r}: the baud rate must be a number from 1 to 10000000; form: {FORMS}")
    if output not in WITH_SENSORS:
        raise InputError(f"board {text!r}: the output must be one of {', '.join(WITH_SENSORS)}; form: {FORMS}")
    return RazorUrl(device, int(baud), output)


class FrameClock:
    """Sensor time of frames without a timestamp: a raster that follows the arrivals.

    The estimator is an alpha-beta filter of the arrivals. An arrival far from the raster resets it, because frames
    are missing.
    """

    step = 0.02
    """s; initial period of the frames, that of the firmware"""
    alpha, beta = 0.05, 0.001
    """-; filter gains of time and step: arrivals scatter by most of a step, crystals do not"""
    shortest, longest = 0.004, 0.1
    """s; limits of the step"""
    slip = 2.5
    """steps; deviation of an arrival from the raster that resets it"""

    def __init__(self) -> None:
        self._started: float | None = None
        self._time = 0.0

    def time_us(self, arrival: float, skipped: int = 0) -> int:
        """Return the sensor time (us) of a frame that arrived at ``arrival`` (s).

        ``skipped`` damaged frames preceded it.
        """
        if self._started is None:
            self._started = arrival - self.step
        expected = self._time + (1 + skipped) * self.step
        error = arrival - self._started - expected
        if error > self.slip * self.step:
            self._time = expected + error
        else:
            error = max(error, -self.slip * self.step)
            self._time = max(expected + self.alpha * error, self._time + 0.001)
            self.step = min(max(self.step + self.beta * error, self.shortest), self.longest)
        return round(self._time * 1e6)


class RazorBoard:
    """`Board` with an IMU only; actuator commands are discarded."""

    def __init__(
        self,
        address: str,
        timeouts: Timeouts = Timeouts(),  # noqa: B008  # immutable
        clock: Callable[[], float] = time.monotonic,
        around: Surroundings = IDLE,
    ) -> None:
        """Open ``razor:DEVICE[,BAUD[,OUTPUT]]``.

        Raises:
            InputError: not such an address, or the device cannot be opened.
        """
        device, baud, output = parse_address(address)
        self._timeouts, self._clock, self._around = timeouts, clock, around
        self._name = f"Razor at {device}"
        self._line = SerialLine(device, baud)
        self._watch = LineWatch(self._name, around.report, "frame")
        self._reader = Reader(OUTPUTS[output])
        self._frame_clock = FrameClock()
        self._waiting: deque[tuple[Reading, float, int]] = deque()
        self._number = 0
        self._requested_at = self._received_at = self._token_at = self._idled_at = -float("inf")
        self._strange = 0
        self._last_time_us: int | None = None
        self.angles: Angles | None = None
        """attitude of the Razor, if included in the output"""
        self.restarts = 0
        """restarts during the stream"""
        self.ended = ""
        """always empty, because `read` never returns None"""

    @property
    def count(self) -> protocol.Count:
        """Frames, losses and noise so far."""
        return self._reader.count

    @property
    def losses(self) -> Losses:
        """Losses of the line since the start."""
        return Losses(self.count.lost, 0, self.count.bad_bytes, self._line.dropped)

    @property
    def step(self) -> float:
        """Estimated period (s) of the frames."""
        return self._frame_clock.step

    def read(self) -> SensorFrame | None:
        """Wait for the next frame; never None.

        Raises:
            BoardSilent: no frame within the bounded wait, or the device is disconnected; the text states which.
        """
        began = self._idled_at = self._clock()
        while not self._waiting:
            now = self._clock()
            self._request(now)
            if now - self._idled_at >= IDLE_EVERY:
                self._idle()
            self._receive()
            if not self._waiting:
                self._look_after(self._clock() - began)
        reading, arrival, skipped = self._waiting.popleft()
        now = self._clock()
        self._watch.received(now - began)
        self._watch.report(now, self.losses)
        return self._sensor_frame(reading, self._frame_clock.time_us(arrival, skipped))

    def _request(self, now: float) -> None:
        """Request the output after a timeout, and a token after each binary frame."""
        reader = self._reader
        began_anew = reader.count.strange > self._strange and self._received_at > self._requested_at
        if began_anew or now - max(self._requested_at, self._received_at) >= self._timeouts.request_interval:
            if began_anew:
                self._watch.restarted()
            self._strange, self._requested_at, self._token_at = reader.count.strange, now, now
            self.restarts += began_anew
            reader.clear()
            self._line.write(protocol.start_request(reader.output, self._next()))
        elif reader.waiting >= reader.output.size > 0 and now - self._token_at >= self._timeouts.token:
            self._token_at = now
            self._line.write(protocol.synch_request(self._next()))

    def _next(self) -> int:
        self._number += 1
        return self._number

    def _receive(self) -> None:
        data = self._line.read(self._timeouts.look)
        if not data:
            self._idle()
            return
        before = self.count
        readings = self._reader.feed(data)
        arrival, after = self._clock(), self.count
        if after.tokens > before.tokens:
            self._token_at = -float("inf")
        skipped = after.lost - before.lost
        for reading in readings:
            self._received_at = arrival
            self._waiting.append((reading, arrival, skipped))
            skipped = 0

    def _idle(self) -> None:
        self._around.idle()
        self._idled_at = self._clock()

    def _look_after(self, silence: float) -> None:
        timeouts = self._timeouts
        if not self._line.plugged and silence >= timeouts.loss:
            raise BoardSilent(f"{self._name} disconnected: check the cable")
        self._watch.waiting(self._line.plugged, silence)
        limit = timeouts.first if self._last_time_us is None else timeouts.frame
        if silence >= max(limit, timeouts.loss):
            raise BoardSilent(f"{self._name} sent no frame for {silence:.0f} s: {self._why()}")

    def _why(self) -> str:
        """Return possible reasons of a timeout."""
        if self._last_time_us is not None:
            return f"last at t = {self._last_time_us * 1e-6:.3f} s"
        if self.count.tokens:
            return "it responds, but does not support this output"
        if self._reader.received:
            return "data received, but no response to #s: check its receive line and the baud rate"
        return "no data received: check the device and the baud rate"

    def _sensor_frame(self, reading: Reading, time_us: int) -> SensorFrame:
        self._last_time_us = time_us
        if reading.angles is not None:
            self.angles = reading.angles
        accel, gyro = reading.accel or (0.0, 0.0, 0.0), reading.gyro or (0.0, 0.0, 0.0)
        return SensorFrame(time_us, ImuSample(time_us, *accel, *gyro, *(reading.mag or (0.0, 0.0, 0.0))))

    def write(self, command: ActuatorCommand) -> None:
        """Discard the command; there are no actuators."""

    def close(self) -> None:
        """Restore the output after power-on (angles as text) and close the device."""
        self._line.write(b"#ot#o1")
        self._line.close()
