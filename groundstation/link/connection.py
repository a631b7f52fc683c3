"""Link of the ground station: frames, heartbeat, transaction loop."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame
from avionics.link.signing import Finding, Signing, signature_of
from avionics.link.transport import Packet, Peer, TcpClient, Transport, open_transport
from groundstation.link.answers import LinkSilent, NoAnswer
from groundstation.link.exchange import COMPONENT, SYSTEM, Exchange, Target, concerns
from groundstation.link.frames import Arrival, GroundReader, read
from groundstation.link.vehicle_state import VehicleState, is_autopilot, receive
from wingbeat.errors import InputError
from wingbeat.text import pluralize

AnyExchange = TypeVar("AnyExchange", bound=Exchange)
Ended = Callable[[Any], None]
"""called with an exchange that has ended"""
NUMBER = 0
"""link number in the signatures of the ground station"""
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1; default component of an autopilot"""
PAUSE = 0.01
"""s; polling interval of a silent link"""


class Connection:
    """Link to one vehicle; updates its `VehicleState` from all received messages.

    A ``passive`` connection only listens and sends nothing.
    """

    def __init__(
        self,
        url: str,
        passive: bool = False,
        stays: bool = False,
        clock: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
        signing: Signing | None = None,
    ) -> None:
        """Open the link.

        With a key in ``signing`` every sent frame is signed, and received frames without a valid signature are
        rejected and counted.

        A ``passive`` connection sends nothing. With ``stays`` the heartbeat is that of a ground station, whose loss
        triggers the vehicle's link-loss failsafe; otherwise it is that of a temporary client, which may disconnect.

        Raises:
            InputError: not a link's address, port in use, device missing.
        """
        self.url = url
        self.state = VehicleState()
        self._transport: Transport = open_transport(url)
        self._passive = passive
        self._stays = stays
        self._clock = clock
        self._pause = pause
        self._readers: dict[Peer, GroundReader] = {}
        self._writer = FrameWriter(SYSTEM, COMPONENT)
        self._signing = signing or Signing(time.time)
        self._signed = self._on_message = False
        self._beaten_at = float("-inf")
        self._component: int | None = None
        self._background: list[tuple[Exchange, Ended]] = []
        self._listeners: list[Callable[[Arrival], None]] = []
        self._senders: list[Callable[[Any], None]] = []

    @property
    def target(self) -> Target:
        """Target of commands: the autopilot detected on this link."""
        return Target(self.state.system or 1, self._component or AUTOPILOT)

    def receive(self) -> list[Any]:
        """Receive all pending messages without blocking; send the heartbeat if it is due."""
        return self._receive()[0]

    def _receive(self) -> tuple[list[Any], list[Any]]:
        """Receive pending messages and pass them to the running exchanges."""
        now = self._clock()
        if not self._passive and now - self._beaten_at >= 1.0:
            self._beaten_at = now
            self.send(_heartbeat(self._stays))
        arrivals = [arrival for packet in self._transport.receive(now) for arrival in self._read(packet, now)]
        for arrival in arrivals:
            for listener in self._listeners:
                listener(arrival)
        messages = [arrival.message for arrival in arrivals if arrival.message is not None]
        for message in messages:
            self.state = receive(self.state, message, now)
            self._meet(message)
        answers = [message for message in messages if concerns(message, self.target)]
        self._advance_background(answers, now)
        return messages, answers

    def _meet(self, message: Any) -> None:
        """Identify the autopilot component of the vehicle: the first that reports one, else the default."""
        if message.get_type() != "HEARTBEAT" or not is_autopilot(message):
            return
        component = message.get_srcComponent()
        if message.get_srcSystem() == self.state.system and (self._component is None or component == AUTOPILOT):
            self._component = component

    def overhear(self, listener: Callable[[Arrival], None], sent: Callable[[Any], None] | None = None) -> None:
        """Add a ``listener`` that gets every received frame first, and a ``sent`` listener of sent messages."""
        self._listeners.append(listener)
        if sent is not None:
            self._senders.append(sent)

    def now(self) -> float:
        """s; clock of the arrival times."""
        return self._clock()

    def know_modes(self, names: Mapping[int, str]) -> None:
        """Store the mode names that the vehicle announced."""
        if names:
            self.state = self.state._replace(mode_names=tuple(names.items()))

    @property
    def bad_bytes(self) -> int:
        """Number of received bytes outside of frames."""
        return sum(reader.bad_bytes for reader in self._readers.values())

    @property
    def refused(self) -> int:
        """Number of frames without a signature, with a wrong or repeated one, if there is a key."""
        return sum(self._signing.refused.values())

    def begin(self, exchange: Exchange, ended: Ended = lambda exchange: None) -> None:
        """Run an exchange in the background; ``ended`` is called at its end."""
        self._background.append((exchange, ended))

    def _advance_background(self, messages: list[Any], now: float) -> None:
        running, self._background = self._background, []
        for exchange, ended in running:
            for message in (*messages, None):
                exchange, outgoing = exchange.step(now, message)
                self._send_all(outgoing)
            if exchange.finished:
                ended(exchange)
            else:
                self._background.append((exchange, ended))

    def listen(self, duration: float, enough: Callable[[VehicleState], bool] = lambda state: False) -> None:
        """Receive for ``duration`` (s), or until the state is ``enough``."""
        deadline = self._clock() + duration
        while self._clock() < deadline and not enough(self.state):
            if not self.receive():
                self.wait()

    def _read(self, packet: Packet, now: float) -> list[Arrival]:
        self._on_message = self._on_message or bool(packet.data)
        reader = self._readers.setdefault(packet.peer, GroundReader())
        frames = reader.feed(packet.data)
        if (self._transport.datagrams and not packet.continues) or not packet.data:
            frames += reader.give_up()
        # A frame without a readable message may have a valid checksum or belong to another dialect.
        arrivals = [Arrival(frame, read(frame), now) for frame in frames if self._is_trusted(frame)]
        if any(arrival.message is not None for arrival in arrivals):
            self._transport.register_peer(packet.peer)
        return arrivals

    def _is_trusted(self, frame: Frame) -> bool:
        """Return whether a frame is accepted; the radio's own messages are never signed."""
        self._signed = self._signed or bool(signature_of(frame))
        if not self._signing.active or frame.message_id == mavlink.MAVLINK_MSG_ID_RADIO_STATUS:
            return True
        finding = self._signing.examine(frame)
        if finding is not Finding.SIGNED:
            self._signing.refused[finding] += 1
        return finding is Finding.SIGNED

    def send(self, message: Any) -> None:
        """Send one message to the vehicle."""
        writer, signing = self._writer, self._signing
        if signing.active:
            packed = writer.pack_signed(message, lambda frame: signing.sign(frame, NUMBER))
        else:
            packed = writer.pack(message)
        self._transport.send(packed)
        for sent in self._senders:
            sent(message)

    def wait(self) -> None:
        """Wait for a short time."""
        self._pause(PAUSE)

    def find_vehicle(self, timeout: float = 5.0) -> VehicleState:
        """Wait for the first heartbeat of an autopilot.

        Raises:
            LinkSilent: none was received within ``timeout`` (s).
        """
        deadline = self._clock() + timeout
        while self.state.system is None:
            if self._clock() >= deadline:
                raise LinkSilent(f"no vehicle on {self.url}: {self._silence(timeout)}")
            self.receive()
            self.wait()
        return self.state

    def _silence(self, timeout: float) -> str:
        """Return the probable reason of missing heartbeats."""
        if isinstance(self._transport, TcpClient) and self._transport.trouble and not self._on_message:
            return self._transport.trouble.lower()
        said = f"no heartbeat for {timeout:g} s"
        if self.refused:
            return f"{said}; {pluralize(self.refused, 'frame')} rejected by signature"
        if self._on_message or not self.url.startswith("udpout:"):
            return said
        # A UDP peer with a key does not respond to a client without it.
        advice = (
            "check that the vehicle has this signing key"
            if self._signing.active
            else "check if it needs --signing-key"
        )
        return f"{said}, no other messages; {advice}"

    def run(
        self,
        exchange: AnyExchange,
        watch: Callable[[AnyExchange], None] | None = None,
        timeout: float = 120.0,
    ) -> AnyExchange:
        """Run an exchange to its end; ``watch`` is called after every step.

        Raises:
            NoAnswer: it failed, or took longer than ``timeout`` (s).
        """
        deadline = self._clock() + timeout
        while not exchange.finished:
            for message in self._receive()[1]:
                exchange, outgoing = exchange.step(self._clock(), message)
                self._send_all(outgoing)
            exchange, outgoing = exchange.step(self._clock(), None)
            self._send_all(outgoing)
            if watch is not None:
                watch(exchange)
            if self._clock() >= deadline:
                note = exchange.progress().note or "the vehicle"
                raise NoAnswer(f"{note}: timed out after {timeout:g} s{self._hint()}")
            if not exchange.finished:
                self.wait()
        if exchange.failure:
            raise NoAnswer(exchange.failure + self._hint())
        return exchange

    def _hint(self) -> str:
        """Return a hint about missing responses: a signing vehicle ignores unsigned frames."""
        unsigned = self._signed and not self._signing.active
        return "; the vehicle signs its messages and may require --signing-key" if unsigned else ""

    def _send_all(self, outgoing: tuple[Any, ...]) -> None:
        for message in outgoing:
            self.send(message)

    def close(self) -> None:
        """Close the port."""
        self._transport.close()


def _heartbeat(stays: bool) -> Any:
    """Build the heartbeat of a ground station, whose loss is a link loss, or of a temporary client."""
    kind = mavlink.MAV_TYPE_GCS if stays else mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    return mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3)


def listen_locally(first: int = 14600, last: int = 14999) -> Connection:
    """Open a passive connection on a random free UDP port of the loopback interface.

    The port is random because a vehicle continues to send to the port of a listener that has ended.

    Raises:
        InputError: every port of the range is in use.
    """
    for port in random.sample(range(first, last), last - first):
        try:
            return Connection(f"udpin:127.0.0.1:{port}", passive=True)
        except InputError:
            continue
    raise InputError(f"no free UDP port between {first} and {last}")
