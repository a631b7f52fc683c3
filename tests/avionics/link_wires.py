"""Links without sockets: a transport whose other end is in the test, on a clock that the test moves."""

from __future__ import annotations

from typing import Any, NamedTuple

from avionics.link.codec import FrameWriter
from avionics.link.framing import FrameReader, decode
from avionics.link.transport import Packet, Peer
from avionics.link.urls import LinkUrl, parse_url


class Sent(NamedTuple):
    """One frame that the vehicle sent."""

    time: float
    data: bytes
    peer: Peer | None


class Wire:
    """A transport; ``put`` gives bytes to the vehicle, ``sent`` has those that it sent."""

    datagrams = True
    peers: tuple[Peer, ...] | None = None

    def __init__(self, url: str) -> None:
        self.url: LinkUrl = parse_url(url)
        self.dropped = 0
        self.portion = 65536
        self.now = 0.0
        self.sent: list[Sent] = []
        self.welcomed: set[Peer] = set()
        self._waiting: list[Packet] = []

    def receive(self, now: float) -> list[Packet]:
        self.now = now
        packets, self._waiting = self._waiting, []
        return packets

    def register_peer(self, peer: Peer) -> None:
        self.welcomed.add(peer)

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        self.sent.append(Sent(self.now, data, peer))

    def close(self) -> None:
        pass

    def put(self, data: bytes, peer: Peer = "station") -> bytes:
        self._waiting.append(Packet(data, peer))
        return data

    def take(self) -> list[Sent]:
        sent, self.sent = self.sent, []
        return sent

    def incoming(self) -> list[Any]:
        """The messages that were sent since the last call."""
        reader = FrameReader()
        return [decode(frame) for each in self.take() for frame in reader.feed(each.data)]


class Voice:
    """Somebody who speaks: numbers and frames his messages."""

    def __init__(self, system: int, component: int = 190) -> None:
        self._writer = FrameWriter(system, component)

    def frame(self, message: Any) -> bytes:
        return self._writer.pack(message)
