"""ArduPilot on our world: its JSON simulator interface, UDP datagrams to port 9002 and back to where they came from.

ArduPilot keeps the time: each new servo packet moves the world by one step of its frame rate and is answered once. A
repeated frame count is a packet sent again, because its answer was lost: it is answered again and nothing moves. A
frame count of 0 is an ArduPilot that has started: the vehicle is put back into the launcher's hand.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

from avionics.link.urls import parse_url
from avionics.messages import ReceiverSample
from sim_bridge.bridge.foreign import ardupilot_wire as wire
from sim_bridge.bridge.foreign.flight import ForeignFlight, Rig
from sim_bridge.bridge.foreign.outputs import Pulses, from_pulses
from sim_bridge.bridge.foreign.world import AutopilotSilent, Interface, NextStage, Tell
from sim_bridge.bridge.pace import Pacer
from sim_bridge.bridge.world import SimulationSilent
from sim_bridge.observation import Observation
from wingbeat.errors import InputError
from wingbeat.message import Severity

PORT = 9002
"""port of instance 0"""
INSTANCE_PORTS = 10
"""port increment per instance"""
LONGEST_SILENCE = 60.0
"""s; time for which a silent simulator discards further packets"""
SENSOR_PERIOD_US = 5000
"""us; sensors are read at 200 Hz, for the recording and the receiver: ArduPilot simulates its own from the true
state
"""


class Timeouts(NamedTuple):
    """Timeouts of the ArduPilot connection on the wall clock."""

    stall: float = 1.0
    """s; without a packet before a notice on the terminal"""
    connect: float = 600.0
    """s; without a packet before the connection fails"""


class BridgeStatistics(NamedTuple):
    """Counters of the interface."""

    flights: int = 0
    """-; one for each start of ArduPilot"""
    frames: int = 0
    """-; executed and acknowledged steps"""
    repeats: int = 0
    """-; repeated packets, acknowledged again"""
    lost: int = 0
    """-; missing frame counts"""
    stale: int = 0
    """-; packets that arrived after a later one, dropped"""
    malformed: int = 0
    """-; datagrams that are not servo packets, rejected"""
    strangers: int = 0
    """-; packets of a second autopilot, rejected"""
    ended: str = ""
    """reason of the end, one line"""


class Order(Enum):
    """Position of a packet in the sequence."""

    START = 0
    NEXT = 1
    REPEAT = 2
    STALE = 3


def order_of(last: int | None, count: int) -> Order:
    """Return the position of frame ``count`` after frame ``last`` (None for no previous frame)."""
    if last is None or (count == 0 and last != 0):
        return Order.START
    if count == last:
        return Order.REPEAT
    return Order.NEXT if count > last else Order.STALE


class ArduPilotServer:
    """Server of the port; `serve` flies until the simulation is finished or ArduPilot disconnects."""

    def __init__(
        self,
        interface: Interface,
        rig: Rig,
        pulses: Pulses,
        report: Tell,
        timeouts: Timeouts | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the port.

        Raises:
            InputError: the interface's address is not ``udpin:HOST:PORT``, or the port is in use.
        """
        self._socket = _bound(interface.url)
        self._speed = interface.speed
        self._rig = rig
        self._pulses = pulses
        self._report = report
        self._timeouts = timeouts or Timeouts()
        self._clock = clock
        self._peer: Any = None
        self._last: int | None = None
        self._answer = b""
        self._stalled = False
        self.statistics = BridgeStatistics()

    @property
    def port(self) -> int:
        """The open port."""
        return int(self._socket.getsockname()[1])

    def serve(self, next_stage: NextStage) -> BridgeStatistics:
        """Respond to packets until the simulation is finished, or no packet arrives.

        Raises:
            AutopilotSilent: ArduPilot did not connect.
        """
        flight: ArduPilotFlight | None = None
        heard_at = self._clock()
        while flight is None or not flight.finished:
            received = self._receive()
            if received is None:
                if self._clock() - heard_at >= self._timeouts.connect:
                    return self._abandoned()
                self._report_timeout(flight)
                continue
            servos, order = received
            heard_at = self._clock()
            if order is Order.START:
                flight = self._begin(next_stage, servos)
            if flight is not None:
                try:
                    self._respond(flight, servos, order)
                except SimulationSilent as silence:
                    return self._fall_silent(str(silence))
        return self.statistics._replace(ended="the simulation finished")

    def _receive(self) -> tuple[wire.Servos, Order] | None:
        """Return the next valid packet and its order, None after a timeout."""
        deadline = self._clock() + self._timeouts.stall
        while (left := deadline - self._clock()) > 0.0:
            self._socket.settimeout(max(left, 1e-3))
            try:
                data, address = self._socket.recvfrom(2048)
            except TimeoutError:
                return None
            except OSError:
                continue  # an answer found nobody there
            taken = self._taken(data, address)
            if taken is not None:
                return taken
        return None

    def _taken(self, data: bytes, address: Any) -> tuple[wire.Servos, Order] | None:
        try:
            servos = wire.decode_servos(data)
        except wire.Malformed as reason:
            self._refuse("malformed", f"a datagram from {_named(address)} rejected: {reason}")
            return None
        same = address == self._peer
        order = order_of(self._last if same or servos.frame_count else None, servos.frame_count)
        if not same and order is not Order.START:
            self._refuse("strangers", f"second autopilot at {_named(address)} rejected")
            return None
        self._peer = address
        return servos, order

    def _refuse(self, what: str, text: str) -> None:
        if getattr(self.statistics, what) == 0:
            self._report(f"{text} (further ones are counted)")
        self._count(**{what: 1})

    def _begin(self, next_stage: NextStage, servos: wire.Servos) -> ArduPilotFlight:
        again = "starts over" if self.statistics.flights else "has come"
        self._report(
            f"ArduPilot at {_named(self._peer)} {again} with {servos.frame_rate} frames/s:"
            " the vehicle is in the launcher's hand"
        )
        self._count(flights=1)
        self._last = None
        return ArduPilotFlight(ForeignFlight(next_stage(), self._rig, self._report), Pacer(self._speed, self._clock))

    def _respond(self, flight: ArduPilotFlight, servos: wire.Servos, order: Order) -> None:
        if self._stalled:
            self._stalled = False
            flight.flight.report_stage("ArduPilot resumed")
        if order is Order.STALE:
            self._count(stale=1)
            return
        if order is Order.REPEAT:
            self._count(repeats=1)
        else:
            lost = servos.frame_count - self._last - 1 if self._last is not None else 0
            self._count(frames=1, lost=lost)
            self._last = servos.frame_count
            self._answer = flight.step(servos, self._rig, self._pulses)
        self._send()

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # who is gone is told by his silence
            self._socket.sendto(self._answer, self._peer)

    def _report_timeout(self, flight: ArduPilotFlight | None) -> None:
        if self._stalled or flight is None:
            return
        self._stalled = True
        text = f"ArduPilot at {_named(self._peer)} timed out after frame {self._last}; waiting"
        flight.flight.report_stage(text, Severity.WARNING)

    def _abandoned(self) -> BridgeStatistics:
        text = f"{self._socket_name} for {self._timeouts.connect:g} s"
        if self.statistics.flights == 0:
            refused = self.statistics.malformed
            seen = f" ({refused} datagrams rejected)" if refused else ""
            raise AutopilotSilent(f"no packet of ArduPilot received on {text}{seen}")
        return self.statistics._replace(ended=f"ArduPilot timed out on {text}")

    @property
    def _socket_name(self) -> str:
        return _named(self._socket.getsockname())

    def _fall_silent(self, reason: str) -> BridgeStatistics:
        """Discard packets until none arrives, or for a minute: the autopilot may repeat its request forever."""
        deadline = self._clock() + LONGEST_SILENCE
        while self._receive() is not None and self._clock() < deadline:
            pass
        return self.statistics._replace(ended=reason)

    def _count(self, **more: int) -> None:
        self.statistics = self.statistics._replace(
            **{name: getattr(self.statistics, name) + n for name, n in more.items()}
        )

    def close(self) -> None:
        """Close the port."""
        self._socket.close()


class ArduPilotFlight:
    """One flight: each servo packet is answered by the state after its step."""

    def __init__(self, flight: ForeignFlight, pacer: Pacer) -> None:
        self.flight = flight
        self._pacer = pacer
        self._next_sample_us = 0
        self._receiver: ReceiverSample | None = None

    @property
    def finished(self) -> bool:
        """Whether the simulation is finished."""
        return self.flight.world.finished

    def step(self, servos: wire.Servos, rig: Rig, pulses: Pulses) -> bytes:
        """Advance by one step of the frame rate and return the state message."""
        outputs = from_pulses(rig.channels, pulses, servos.widths)
        observation = self.flight.advance(outputs, 1.0 / servos.frame_rate)
        self._read_sensors(observation)
        self._pacer.wait(observation.time_us)
        world = self.flight.world
        return wire.encode_state(observation, world.truth(), world.truth_wing(), self._receiver)

    def _read_sensors(self, observation: Observation) -> None:
        if observation.time_us < self._next_sample_us:
            return
        self._next_sample_us = max(self._next_sample_us + SENSOR_PERIOD_US, observation.time_us)
        heard = self.flight.sample(observation).receiver
        self._receiver = self._receiver if heard is None else heard


def _bound(url: str) -> socket.socket:
    where = parse_url(url)
    if where.kind != "udpin":
        raise InputError(f"{url}: ArduPilot's physics listens on udpin:HOST:PORT")
    try:
        family, kind, _, _, address = socket.getaddrinfo(where.host, where.port, type=socket.SOCK_DGRAM)[0]
        port = socket.socket(family, kind)
        port.bind(address)
    except OSError as error:
        raise InputError(f"{url}: cannot listen there: {error.strerror or error}") from None
    return port


def _named(address: Any) -> str:
    return f"{address[0]}:{address[1]}"
