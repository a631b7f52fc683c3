"""PX4 on our world: its simulator interface, which waits for a simulator that listens on TCP 4560.

PX4 connects, requests HIL_STATE_QUATERNION and sends HEARTBEAT; its start-up waits for a HIL_SENSOR. Until its first
HIL_ACTUATOR_CONTROLS, and whenever it is disarmed, the world runs in real time and does not wait. Armed, each sensor
frame waits a moment for its answer, because PX4 does not promise one for every frame.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics.link import codec
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader, decode
from avionics.link.sensor_codec import CODECS
from avionics.link.transport import Listener, Stream
from avionics.messages import SensorFrame
from sim_bridge.bridge.foreign import px4_wire as wire
from sim_bridge.bridge.foreign.flight import ForeignFlight, Rig
from sim_bridge.bridge.foreign.outputs import Outputs, from_controls
from sim_bridge.bridge.foreign.world import AutopilotSilent, Interface, NextStage, Stage, Tell
from sim_bridge.bridge.pace import Pacer
from sim_bridge.bridge.truth import HIL_STATE_QUATERNION, encode_truth
from sim_bridge.bridge.world import SimulationSilent
from sim_bridge.sensors.suite import ticks_of
from wingbeat.message import Severity

PORT = 4560
"""port of instance 0; that of the next instance is one higher"""
IMU_RATE = 250.0
"""Hz; of HIL_SENSOR"""
TICK = 1.0 / IMU_RATE
FIELD_TICKS = ticks_of(IMU_RATE).magnetometer


class Timeouts(NamedTuple):
    """Timeouts of the PX4 connection on the wall clock."""

    connect: float = 600.0
    """s; for a connection, and for a reconnection"""
    hello: float = 10.0
    """s; for its HEARTBEAT"""
    moment: float = 0.010
    """s; for the response to a sensor frame after arming"""
    stall: float = 1.0
    """s; without a message before a notice on the terminal"""
    silence: float = 60.0
    """s; without a message before the connection fails"""


class BridgeStatistics(NamedTuple):
    """Counters of the interface."""

    flights: int = 0
    """-; one for each connection"""
    frames: int = 0
    """-; HIL_SENSOR sent"""
    answers: int = 0
    """-; HIL_ACTUATOR_CONTROLS received and applied"""
    misses: int = 0
    """-; sensor frames without a timely response"""
    late: int = 0
    """-; responses to an older sensor frame, also applied"""
    rejected: int = 0
    """-; responses with a control that is not finite, dropped"""
    strangers: int = 0
    """-; connections of other programs than PX4"""
    bad_bytes: int = 0
    """-; bytes outside of messages"""
    ended: str = ""
    """reason of the end, one line"""

    def plus(self, other: BridgeStatistics) -> BridgeStatistics:
        """Return the sum, with the reason of ``other``."""
        sums = {name: getattr(self, name) + getattr(other, name) for name in self._fields[:-1]}
        return BridgeStatistics(**sums, ended=other.ended)


class Px4Server:
    """Server of the port; `serve` runs one flight per connection, each from the launcher."""

    def __init__(
        self,
        interface: Interface,
        rig: Rig,
        report: Tell,
        timeouts: Timeouts | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the port.

        Raises:
            InputError: the interface's address is not ``tcp:HOST:PORT``, or the port is in use.
        """
        self._listener = Listener(interface.url)
        self._speed = interface.speed
        self._rig = rig
        self._report = report
        self._timeouts = timeouts or Timeouts()
        self._clock = clock

    @property
    def port(self) -> int:
        """The open port."""
        return self._listener.port

    def serve(self, next_stage: NextStage) -> BridgeStatistics:
        """Fly until a simulation is finished, or PX4 does not reconnect.

        Raises:
            AutopilotSilent: no connection, or PX4 stopped responding in flight.
        """
        total = BridgeStatistics()
        while True:
            stream = self._listener.accept(self._timeouts.connect)
            if stream is None:
                return self._abandoned(total)
            session = Px4Session(stream, self._rig, self._report, self._timeouts, self._clock)
            try:
                if session.greet():
                    session.fly(next_stage(), self._speed)
            finally:
                stream.close()
                total = total.plus(session.statistics)
            if not session.hung_up:
                return total

    def _abandoned(self, total: BridgeStatistics) -> BridgeStatistics:
        text = f"{self._listener.url} for {self._timeouts.connect:g} s"
        if total.flights == 0:
            others = f" ({total.strangers} connections rejected: not PX4)" if total.strangers else ""
            raise AutopilotSilent(f"no PX4 connected to {text}{others}")
        return total._replace(ended=f"PX4 did not reconnect to {text}")

    def close(self) -> None:
        """Close the port."""
        self._listener.close()


class Px4Session:
    """Session of one connection."""

    def __init__(
        self, stream: Stream, rig: Rig, report: Tell, timeouts: Timeouts, clock: Callable[[], float]
    ) -> None:
        self.statistics = BridgeStatistics()
        self.hung_up = False
        self._stream = stream
        self._rig = rig
        self._report = report
        self._timeouts = timeouts
        self._clock = clock
        self._reader = FrameReader(version_1=False)
        self._writer = codec.FrameWriter(1, 200)
        self._autopilot: int | None = None
        self._outputs = Outputs()
        self._echo = Echo()
        self._truth_interval_us = 0
        self._next_truth_us = 0
        self._received_at = clock()
        self._received_us = 0
        self._stalled = False

    def greet(self) -> bool:
        """Wait for the HEARTBEAT of a PX4; other clients get a message and are disconnected."""
        deadline = self._clock() + self._timeouts.hello
        while self._autopilot is None and not self.hung_up and self._clock() < deadline:
            self._listen(0.05)
        if self._autopilot == mavlink.MAV_AUTOPILOT_PX4:
            self._report(f"PX4 connected from {self._stream.name}: vehicle on the launcher")
            return True
        said = "sent no HEARTBEAT" if self._autopilot is None else f"is MAV_AUTOPILOT {self._autopilot}, not PX4 (12)"
        self._report(f"peer {self._stream.name} {said}: disconnected")
        self._count(strangers=1, bad_bytes=self._reader.bad_bytes)
        self.hung_up = True
        return False

    def fly(self, stage: Stage, speed: float | None) -> None:
        """Exchange sensor frames and controls until the simulation is finished or PX4 disconnects.

        Raises:
            AutopilotSilent: PX4 is connected but does not send.
        """
        flight = ForeignFlight(stage, self._rig, self._report)
        pace = Pace(speed, self._clock)
        self._count(flights=1)
        self._received_at = self._clock()
        ended = "the simulation finished"
        try:
            while not flight.world.finished and not self.hung_up:
                frame = flight.sample(flight.advance(self._outputs, TICK))
                pace.wait_at_rest(frame.time_us, waiting=self._waits)
                self._send(frame, flight)
                armed = self._outputs.armed
                self._await_answer(frame.time_us)
                if self._outputs.armed != armed:
                    flight.report_stage("disarmed" if armed else "armed")
                self._watch_silence(flight)
        except SimulationSilent as silence:
            self._await_hanging_up()
            self.hung_up, ended = False, str(silence)
        if self.hung_up:
            ended = "PX4 disconnected"
            flight.report_stage(
                f"PX4 at {self._stream.name} disconnected; it restarts on the launcher when it reconnects"
            )
        self._count(bad_bytes=self._reader.bad_bytes)
        self.statistics = self.statistics._replace(ended=ended)

    @property
    def _waits(self) -> bool:
        """Whether PX4 runs in lockstep, has responded and is armed, so that its response is awaited."""
        return bool(self._echo.lockstep and self._outputs.armed)

    def _send(self, frame: SensorFrame, flight: ForeignFlight) -> None:
        parts = []
        if self._truth_interval_us and frame.time_us >= self._next_truth_us:
            # The interval need not be a multiple of the frame period: the mean rate is the requested one.
            self._next_truth_us = max(self._next_truth_us + self._truth_interval_us, frame.time_us)
            truth = encode_truth(flight.world.truth(), flight.world.origin)
            parts.append(self._writer.frame(HIL_STATE_QUATERNION, truth))
        if frame.gps is not None:
            gps = CODECS["gps"]
            parts.append(self._writer.frame(gps.message_id, gps.encode(frame.gps)))
        if frame.receiver is not None and not frame.receiver.lost:
            parts.append(self._writer.pack(wire.rc_channels(frame.receiver)))
        sensors = wire.encode_sensors(
            frame, self.statistics.frames % FIELD_TICKS == 0, self._rig.vehicle.gains.air_data
        )
        # HIL_SENSOR sets PX4's clock, so the other messages of this time are sent before it.
        parts.append(self._writer.frame(wire.HIL_SENSOR, sensors))
        self.hung_up |= not self._stream.write(b"".join(parts))
        self._count(frames=1)

    def _await_answer(self, time_us: int) -> None:
        waits = self._waits
        deadline = self._clock() + (self._timeouts.moment if waits else 0.0)
        self._echo = self._echo.sent(time_us)
        self._listen(0.0)
        while waits and not self._echo.prompt and not self.hung_up and self._clock() < deadline:
            self._listen(deadline - self._clock())
        if waits and not self._echo.prompt and not self.hung_up:
            self._count(misses=1)

    def _listen(self, timeout: float) -> None:
        data = self._stream.read(max(timeout, 0.0))
        if data is None:
            self.hung_up = True
            return
        for frame in self._reader.feed(data) if data else []:
            self._received_at = self._clock()
            if frame.message_id == wire.HIL_ACTUATOR_CONTROLS:
                self._obey(wire.decode_controls(frame.payload))
            else:
                self._converse(frame)

    def _obey(self, controls: wire.Controls) -> None:
        outputs = from_controls(self._rig.channels, controls.values, controls.armed)
        if outputs is None:
            self._count(rejected=1)
            return
        self._outputs = outputs
        self._echo = self._echo.has_received(controls)
        self._count(answers=1, late=int(self._echo.lockstep and not self._echo.prompt))

    def _converse(self, frame: Frame) -> None:
        """Process other messages: HEARTBEAT, and requests for truth."""
        message = decode(frame)
        if message.get_type() == "HEARTBEAT":
            self._autopilot = message.autopilot
        elif message.get_type() == "COMMAND_LONG":
            result = mavlink.MAV_RESULT_ACCEPTED if self._request(message) else mavlink.MAV_RESULT_UNSUPPORTED
            ack = mavlink.MAVLink_command_ack_message(message.command, result)
            self.hung_up |= not self._stream.write(self._writer.pack(ack))

    def _request(self, message: Any) -> bool:
        """Set the interval of HIL_STATE_QUATERNION in us; 0 for every frame, -1 for none."""
        if message.command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL or message.param1 != HIL_STATE_QUATERNION:
            return False
        interval = message.param2
        if not math.isfinite(interval) or interval > 1e9:
            return False
        self._truth_interval_us = 0 if interval < 0.0 else max(round(interval), round(TICK * 1e6))
        self._next_truth_us = 0
        return True

    def _watch_silence(self, flight: ForeignFlight) -> None:
        silent = self._clock() - self._received_at
        if self._stalled and silent < self._timeouts.stall:
            self._stalled = False
            flight.report_stage("PX4 resumed")
        if silent < self._timeouts.stall or not self._echo.has_started:
            return
        last = f"last response at t = {self._echo.at_us * 1e-6:.3f} s"
        if not self._stalled:
            self._stalled = True
            flight.report_stage(f"PX4 at {self._stream.name} timed out; {last}", Severity.WARNING)
        if silent >= self._timeouts.silence:
            raise AutopilotSilent(f"PX4 at {self._stream.name} timed out after {silent:.0f} s; {last}")

    def _await_hanging_up(self) -> None:
        deadline = self._clock() + self._timeouts.hello
        while not self.hung_up and self._clock() < deadline:
            self._listen(0.05)

    def _count(self, **more: int) -> None:
        self.statistics = self.statistics._replace(
            **{name: getattr(self.statistics, name) + n for name, n in more.items()}
        )


class Echo(NamedTuple):
    """Assignment of PX4's last response to a sensor frame.

    PX4's time begins at 0 with its first HIL_SENSOR, or it is that of the sensors, depending on its version. The
    offset is the least observed difference between the last sent and the received time.
    """

    sent_us: int = 0
    """us; of the last sensor frame"""
    at_us: int = 0
    """us; time of the sensor frame last responded to"""
    distance_us: int | None = None
    """us; offset from PX4's time to simulated time"""
    lockstep: bool = False
    """PX4 reports lockstep"""

    @property
    def has_started(self) -> bool:
        """Whether a response has been received."""
        return self.distance_us is not None

    @property
    def prompt(self) -> bool:
        """Whether the last response belongs to the last frame."""
        return self.has_started and self.at_us >= self.sent_us

    def sent(self, time_us: int) -> Echo:
        """Return the state after a sensor frame of that time."""
        return self._replace(sent_us=time_us)

    def has_received(self, controls: wire.Controls) -> Echo:
        """Return the state after a response."""
        apart = self.sent_us - controls.time_us
        distance = apart if self.distance_us is None else min(apart, self.distance_us)
        return Echo(self.sent_us, controls.time_us + distance, distance, bool(controls.lockstep))


class Pace:
    """Pacing: real time while PX4's response is not awaited, the requested speed factor otherwise."""

    def __init__(self, speed: float | None, clock: Callable[[], float]) -> None:
        self._speed = speed
        self._clock = clock
        self._waiting = False
        self._pacer = Pacer(self._now(False), clock)

    def _now(self, waiting: bool) -> float | None:
        return 1.0 if self._speed is None and not waiting else self._speed

    def wait_at_rest(self, time_us: int, waiting: bool) -> None:
        """Wait until simulated time ``time_us`` is due."""
        if waiting != self._waiting:
            # A new speed factor is effective from here, without compensation for the time before.
            self._waiting = waiting
            self._pacer = Pacer(self._now(waiting), self._clock)
        self._pacer.wait(time_us)
