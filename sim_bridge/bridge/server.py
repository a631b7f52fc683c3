"""Plays a world to our flight computer: PX4's simulator interface with Wingbeat's raw sensors beside it.

The flight computer connects over TCP and sends HEARTBEAT. It is in lockstep from the first frame, so that a flight is
the same at any speed. PX4 itself, which knocks at the same port, is served by `sim_bridge.bridge.foreign`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

from avionics.link import codec
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader, decode, sole_payload
from avionics.link.transport import Listener, Stream
from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.bridge.pace import Pacer
from sim_bridge.bridge.truth import HIL_STATE_QUATERNION, encode_truth
from sim_bridge.bridge.world import NEUTRAL, SimulationSilent, World
from wingbeat.errors import InputError

DEFAULT_URL = "tcp:127.0.0.1:4560"
"""Default address of the simulator, also for PX4."""


class FlightComputerSilent(RuntimeError):
    """Error: the flight computer did not connect, send or respond in time; the text has the details."""


class Timeouts(NamedTuple):
    """Timeouts for the flight computer."""

    connect: float = 60.0
    """s; for the connection"""
    hello: float = 10.0
    """s; for its first HEARTBEAT"""
    reply: float = 5.0
    """s; for the response to a sensor frame"""
    silence: float = 15.0
    """s; for the client to disconnect after the world has become silent"""
    noise: float = 0.05
    """s; for the rest of an incomplete message"""


class EndReason(IntEnum):
    """Reason of the end of the world; the values of WINGBEAT_END_REASON."""

    FINISHED = 0
    STALLED = 1
    STOPPED = 2


class BridgeStatistics(NamedTuple):
    """Counters of the bridge."""

    frames: int = 0
    """sensor frames sent"""
    stale: int = 0
    """dropped responses with the time of another sensor frame"""
    rejected: int = 0
    """dropped responses with a control that is not a finite number"""
    bad_bytes: int = 0
    """bytes outside of messages"""
    ended: str = ""
    """reason of the end, one line"""


class BridgeServer:
    """Server of the port; `serve` runs one flight."""

    def __init__(
        self,
        url: str = DEFAULT_URL,
        speed: float | None = None,
        timeouts: Timeouts | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the port.

        Args:
            url: ``tcp:HOST:PORT``, ``tcpin:HOST:PORT`` or ``unix:NAME`` (Linux).
            speed: speed factor; None for as fast as possible.
            timeouts: limits of all waits.
            clock: wall clock in s.

        Raises:
            InputError: not such an address, or the port is in use.
        """
        self._listener = Listener(url)
        self._speed = speed
        self._timeouts = timeouts or Timeouts()
        self._clock = clock
        self.busy_poll = False
        """whether to wait for responses without sleeping: see `SocketStream.enable_busy_poll`"""

    @property
    def port(self) -> int:
        """The open port."""
        return self._listener.port

    def serve(self, world: World) -> BridgeStatistics:
        """Wait for a flight computer and fly until the world is finished or the flight computer disconnects.

        Raises:
            InputError: PX4 connected.
            FlightComputerSilent: it did not connect, did not send HEARTBEAT, or did not respond to a sensor frame.
        """
        stream = self._listener.accept(self._timeouts.connect)
        if stream is None:
            raise FlightComputerSilent(
                f"no flight computer connected to {self._listener.url} for {self._timeouts.connect:g} s"
            )
        if self.busy_poll:
            stream.enable_busy_poll()
        session = Session(stream, world, self._timeouts, Pacer(self._speed, self._clock), self._clock)
        try:
            return session.fly()
        finally:
            session.close()

    def close(self) -> None:
        """Close the port."""
        self._listener.close()


class Session:
    """Session with one flight computer."""

    def __init__(
        self, stream: Stream, world: World, timeouts: Timeouts, pacer: Pacer, clock: Callable[[], float]
    ) -> None:
        self._stream = stream
        self._world = world
        self._timeouts = timeouts
        self._pacer = pacer
        self._clock = clock
        self._reader = FrameReader(version_1=False)
        self._writer = codec.FrameWriter(1, 200)
        self._autopilot: int | None = None
        self._hung_up = False
        self._truth_interval_us = 0
        self._next_truth_us = 0
        self._frames = self._stale = self._rejected = 0

    def fly(self) -> BridgeStatistics:
        """Exchange frames until the world is finished or the client disconnects.

        Raises:
            InputError: the client is PX4.
            FlightComputerSilent: it did not send HEARTBEAT, or did not respond to a sensor frame.
        """
        self._await_hello()
        command = NEUTRAL
        ended = "the simulation finished"
        while not self._world.finished:
            try:
                frame = self._world.step(command)
            except SimulationSilent as silence:
                self._await_hanging_up()
                return self._statistics(str(silence))
            self._pacer.wait(frame.time_us)
            self._send(frame)
            # While the flight computer computes.
            self._world.record()
            command = self._await_answer(frame.time_us, command)
            if self._hung_up:
                ended = "flight computer disconnected"
                break
        self._send_end(EndReason.FINISHED)
        return self._statistics(ended)

    def _statistics(self, ended: str) -> BridgeStatistics:
        return BridgeStatistics(self._frames, self._stale, self._rejected, self._reader.bad_bytes, ended)

    def _await_hanging_up(self) -> None:
        deadline = self._clock() + self._timeouts.silence
        while not self._hung_up and self._clock() < deadline:
            self._receive(self._timeouts.noise)

    def _await_hello(self) -> None:
        deadline = self._clock() + self._timeouts.hello
        while self._autopilot is None and not self._hung_up:
            for frame in self._receive(self._timeouts.noise):
                self._listen(frame)
            if self._clock() >= deadline and self._autopilot is None:
                raise FlightComputerSilent(
                    f"the flight computer at {self._stream.name} connected and sent no HEARTBEAT"
                    f" for {self._timeouts.hello:g} s"
                )
        if self._autopilot is None:
            raise FlightComputerSilent(
                f"peer {self._stream.name} disconnected without a HEARTBEAT"
                f" ({self._reader.bad_bytes} bytes were not MAVLink)"
            )
        if self._autopilot == mavlink.MAV_AUTOPILOT_PX4:
            raise InputError(f"PX4 connected from {self._stream.name}: it is served by wingbeat sim --px4")

    def _send(self, frame: SensorFrame) -> None:
        data = self._writer.sensors(frame)
        if self._truth_interval_us and frame.time_us >= self._next_truth_us:
            self._next_truth_us = frame.time_us + self._truth_interval_us
            payload = encode_truth(self._world.truth(), self._world.origin)
            data = self._writer.frame(HIL_STATE_QUATERNION, payload) + data
        self._hung_up |= not self._stream.write(data)
        self._frames += 1

    def _await_answer(self, time_us: int, last: ActuatorCommand) -> ActuatorCommand:
        limit = self._timeouts.reply
        deadline = self._clock() + limit
        while not self._hung_up:
            command = self._receive_answer(min(limit, self._timeouts.noise), time_us)
            if command is not None:
                return command
            if self._clock() >= deadline:
                self._send_end(EndReason.STALLED)
                raise FlightComputerSilent(
                    f"the flight computer at {self._stream.name} did not respond to the sensor frame"
                    f" of t = {time_us / 1e6:.3f} s for {limit:g} s"
                )
        return last

    def _answer(self, frame: Frame, time_us: int) -> ActuatorCommand | None:
        if frame.message_id != codec.HIL_ACTUATOR_CONTROLS:
            self._listen(frame)
            return None
        return self._reply(frame.payload, time_us)

    def _receive_answer(self, timeout: float, time_us: int) -> ActuatorCommand | None:
        data = self._stream.read(timeout)
        # Nearly always the answer arrives alone.
        payload = sole_payload(data, codec.HIL_ACTUATOR_CONTROLS) if data and not self._reader.pending else None
        if payload is not None:
            return self._reply(payload, time_us)
        for frame in self._parse(data, timeout):
            command = self._answer(frame, time_us)
            if command is not None:
                return command
        return None

    def _reply(self, payload: bytes, time_us: int) -> ActuatorCommand | None:
        reply = codec.decode_actuators(payload)
        if reply is None:
            self._rejected += 1
            return None
        if reply.command.time_us != time_us:
            self._stale += 1
            return None
        return reply.command

    def _receive(self, timeout: float) -> list[Frame]:
        return self._parse(self._stream.read(timeout), timeout)

    def _parse(self, data: bytes | None, timeout: float) -> list[Frame]:
        if data is None:
            self._hung_up = True
            return []
        if data:
            return self._reader.feed(data)
        return self._reader.give_up() if timeout >= self._timeouts.noise else []

    def _listen(self, frame: Frame) -> None:
        """Process other messages than actuator commands: HEARTBEAT, and requests for truth."""
        message = decode(frame)
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._autopilot = message.autopilot
        elif kind == "COMMAND_LONG":
            accepted = self._command(message)
            result = mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_UNSUPPORTED
            ack = mavlink.MAVLink_command_ack_message(message.command, result)
            self._hung_up |= not self._stream.write(self._writer.pack(ack))

    def _command(self, message: Any) -> bool:
        if message.command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL or message.param1 != HIL_STATE_QUATERNION:
            return False
        interval = message.param2
        self._truth_interval_us = int(interval) if 0.0 < interval < 1e9 else 0
        if interval == 0.0:
            self._truth_interval_us = self._world.tick_us
        self._next_truth_us = 0
        return True

    def _send_end(self, reason: EndReason) -> None:
        end = mavlink.MAVLink_wingbeat_end_message(0, int(reason))
        self._stream.write(self._writer.pack(end))

    def close(self) -> None:
        """Disconnect."""
        self._stream.close()
