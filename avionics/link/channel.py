"""Link channel: a transport with a reader for each peer, access control and rate."""

from __future__ import annotations

import contextlib
import ipaddress
import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.isolation import Isolation
from avionics.link.budget import BULK, Budget
from avionics.link.codec import FrameWriter, signed
from avionics.link.dialect import mavlink
from avionics.link.framing import CRC_BYTES, HEADER_V2, MARKER_V1, MARKER_V2, Frame, FrameReader
from avionics.link.signing import Finding, Signing
from avionics.link.transport import MOST_PEERS, Packet, Peer, Transport
from avionics.link.vehicle import Identity

PAUSE = 0.2
"""s; maximum pause within a frame, even on a slow radio"""
NOISE_EVERY = 1.0
"""s; minimum interval of events about noise on a link"""
PORTION = 2048
"""bytes; processed between two ticks over all links; the remainder stays in the kernel"""
SMALLEST_PORTION = 280
"""bytes; minimum for one link, independent of the number of links: one of the longest frames"""
VERSION_MEMORY = 5.0
"""s; time without a MAVLink 2 frame after which a peer that sends MAVLink 1 is answered in MAVLink 1"""
VITAL = frozenset({"HEARTBEAT", "COMMAND_ACK"})
"""messages that are sent at any deficit of a link"""


class LinkCounts(NamedTuple):
    """Traffic counters of one link."""

    url: str
    frames: int
    """frames received with a valid checksum"""
    bad_bytes: int
    """received bytes outside frames"""
    unknown: int
    """received frames with an unknown message ID"""
    refused: int
    """frames with a valid checksum and content that does not fit the message"""
    dropped: int
    """frames that could not be sent"""
    unsigned: int
    """frames rejected without a signature"""
    forged: int
    """frames rejected for an invalid signature"""
    replayed: int
    """frames rejected as replayed"""
    forwarded: int
    """frames of other links forwarded to this one"""
    withheld: int
    """frames of other links not forwarded because this one was full"""
    ahead: int = 0
    """frames rejected for a timestamp ahead of the vehicle's clock"""


class ProtocolVersions:
    """Protocol version of each peer: MAVLink 2, unless a peer supports MAVLink 1 only.

    Several stations may share a wire. One frame of MAVLink 2 permits its use for `VERSION_MEMORY`.
    """

    def __init__(self) -> None:
        self._since_version_2: dict[Peer | None, float] = {}
        self._version_1: set[Peer | None] = set()

    def note(self, peer: Peer | None, frames: Sequence[Frame], now: float) -> None:
        """Process frames of a peer at wall-clock time ``now`` (s).

        Frames of a radio do not count.
        """
        versions = {frame.raw[0] for frame in frames if frame.message_id != mavlink.MAVLINK_MSG_ID_RADIO_STATUS}
        if len(self._since_version_2) + len(self._version_1) >= 4 * MOST_PEERS:
            self._since_version_2.clear()
            self._version_1.clear()
        if MARKER_V2 in versions:
            self._version_1.discard(peer)
            self._since_version_2[peer] = now
        elif MARKER_V1 in versions and now - self._since_version_2.get(peer, -math.inf) > VERSION_MEMORY:
            self._version_1.add(peer)

    def is_version_1(self, peer: Peer | None) -> bool:
        """Return whether a peer supports MAVLink 1 only."""
        return peer in self._version_1


class LinkFault(NamedTuple):
    """Fault of a link, for the operator."""

    kind: str
    """-; identifier of faults that are reported once"""
    text: str


class Channel:
    """Link of the vehicle."""

    def __init__(
        self,
        number: int,
        transport: Transport,
        identity: Identity,
        signing: Signing,
        isolation: Isolation,
        portion: int = PORTION,
    ) -> None:
        """Create the channel.

        ``number`` is the index of the link, also in its signatures. ``portion`` is its part of `PORTION`.
        """
        transport.portion = portion
        self.transport = transport
        self.name = str(transport.url)
        self.guard = isolation.guard(f"link {self.name}", self.reset, vital=True)
        """guard of transport and reader; a message that cannot be packed is a fault of its sender"""
        self.budget = Budget(transport.url.baud)
        self.refused = 0
        self.unknown = 0
        self.sent = 0
        self._waiting: deque[tuple[Frame, Peer]] = deque()
        self._number = number
        self._address = (identity.system, identity.component)
        self._signing = signing
        self._writers: dict[Peer | None, FrameWriter] = {}
        self._versions = ProtocolVersions()
        self._packer = FrameWriter(*self._address)
        self._readers: dict[Peer, FrameReader] = {}
        self._shared = FrameReader(foreign=True)
        self._last_data = 0.0
        self._settled = True
        self._findings: Counter[Finding] = Counter()
        self._reported: Counter[str] = Counter()
        self._noise_due = 0.0
        self._dropped = self._forwarded = self._withheld = 0

    # --- receive

    def receive(self, now: float) -> None:
        """Queue and count the received frames.

        While a frame is queued, the remaining bytes stay in the kernel.
        """
        if not self._waiting:
            self._waiting.extend(self.guard.run(self._on_received, now) or ())

    def take(self) -> tuple[Frame, Peer] | None:
        """Return the oldest queued frame with the address of its sender."""
        return self._waiting.popleft() if self._waiting else None

    def reset(self) -> None:
        """Discard partially received frames."""
        self._waiting.clear()
        for peer in tuple(self._readers):
            self._shared.bad_bytes += self._drop_peer(peer)
        self._shared.reset()

    def _on_received(self, now: float) -> list[tuple[Frame, Peer]]:
        heard: list[tuple[Frame, Peer]] = []
        packets = self.transport.receive(now)
        if not packets:
            return heard if self._settled or now - self._last_data < PAUSE else self._settle()
        self._last_data, self._settled = now, False
        for packet in packets:
            frames = [frame for frame in self._cut(packet) if self._admits(frame)]
            if frames:
                self.transport.register_peer(packet.peer)
                self._versions.note(self._key(packet.peer), frames, now)
                heard += [(frame, packet.peer) for frame in frames]
        return heard

    def _settle(self) -> list[tuple[Frame, Peer]]:
        """Discard an incomplete frame after a pause and parse the bytes after its marker."""
        self._settled = True
        late = [(frame, peer) for peer, reader in self._readers.items() for frame in reader.give_up()]
        return [(frame, peer) for frame, peer in late if self._admits(frame)]

    def _cut(self, packet: Packet) -> list[Frame]:
        if self.transport.datagrams:
            frames = self._shared.feed(packet.data)
            return frames if packet.continues else frames + self._shared.give_up()
        if not packet.data:
            self._shared.bad_bytes += self._drop_peer(packet.peer)
            return []
        if packet.peer not in self._readers:
            self._readers[packet.peer] = FrameReader(foreign=True)
        return self._readers[packet.peer].feed(packet.data)

    def _drop_peer(self, peer: Peer) -> int:
        reader = self._readers.pop(peer, None)
        if reader is None:
            return 0
        self._shared.frames += reader.frames
        self._shared.unknown += reader.unknown
        return reader.bad_bytes

    def _admits(self, frame: Frame) -> bool:
        """Return whether a frame is accepted.

        Own frames that return in a loop are rejected, and unsigned frames if signing is required.
        """
        if (frame.system, frame.component) == self._address:
            return False
        if not self._signing.active:
            return True
        finding = self._signing.examine(frame)
        if finding is Finding.SIGNED or (finding is Finding.UNSIGNED and self._admits_unsigned(frame)):
            return True
        self._findings[finding] += 1
        self._signing.refused[finding] += 1
        return False

    def _admits_unsigned(self, frame: Frame) -> bool:
        """Return whether an unsigned frame is accepted.

        The user may allow unsigned frames, but not those of another key. Frames of a radio are accepted on its own
        wire.
        """
        if frame.message_id == mavlink.MAVLINK_MSG_ID_RADIO_STATUS and self.transport.url.kind == "serial":
            return True
        return self.transport.url.unsigned and frame.message_id != mavlink.MAVLINK_MSG_ID_SETUP_SIGNING

    def confidential(self, peer: Peer) -> bool:
        """Return whether the link to a peer is private: a wire, or the same computer."""
        if self.transport.url.kind == "serial":
            return True
        with contextlib.suppress(ValueError, TypeError, IndexError):
            return ipaddress.ip_address(peer[0]).is_loopback  # type: ignore[index]
        return False

    # --- send

    def send(self, message: Any, peer: Peer | None = None) -> int:
        """Send a message to one peer, or to all; return the number of sent frames.

        A message is dropped only at an excessive deficit or after a fault. Sequence numbers are counted for each
        peer, so that frames to other peers do not appear as losses.
        """
        if not self.guard.enabled or (self.budget.broke() and message.get_type() not in VITAL):
            self._dropped += 1
            return 0
        peers = self.transport.peers
        hearers = (peer,) if peer is not None or peers is None else peers
        frames = self._pack(message, [self._writer(self._key(each)) for each in hearers])
        sent = [(frame, each) for frame, each in zip(frames, hearers, strict=True) if frame]
        self.budget.spend(max(map(len, frames), default=0))
        self.sent += len(sent)
        for frame, each in sent:
            self.guard.run(self.transport.send, frame, each)
        return len(sent)

    def _key(self, peer: Peer | None) -> Peer | None:
        """Return the key of the sequence number and protocol version of a peer."""
        return None if self.transport.peers is None else peer

    def _writer(self, peer: Peer | None) -> FrameWriter:
        if peer not in self._writers:
            if len(self._writers) >= 2 * MOST_PEERS:
                present = self.transport.peers or ()
                self._writers = {each: writer for each, writer in self._writers.items() if each in present}
            self._writers[peer] = FrameWriter(*self._address)
        writer = self._writers[peer]
        writer.version_1 = self._versions.is_version_1(peer)
        return writer

    def _pack(self, message: Any, writers: Sequence[FrameWriter]) -> list[bytes]:
        """Return a frame of each writer; the payload is packed once."""
        if not writers:
            return []
        number = message.get_msgId()
        frames = [(self._packer if writers[0].version_1 else writers[0]).pack(message)]
        payload = frames[0][HEADER_V2:-CRC_BYTES]
        if writers[0].version_1:
            frames = [writers[0].frame(number, payload)]
        frames += [writer.frame(number, payload) for writer in writers[1:]]
        if not self._signing.active:
            return frames
        return [
            frame if writer.version_1 else signed(frame, number, lambda each: self._signing.sign(each, self._number))
            for frame, writer in zip(frames, writers, strict=True)
        ]

    def forward(self, raw: bytes, peer: Peer | None) -> None:
        """Forward a frame of another link unchanged if the capacity permits."""
        if self.budget.available_bytes(BULK) < len(raw):
            self._withheld += 1
            return
        self._forwarded += 1
        self.sent += 1 if peer is not None else len(self.transport.peers or (None,))
        self.budget.spend(len(raw))
        self.guard.run(self.transport.send, raw, peer)

    # --- status

    def faults(self, now: float) -> list[LinkFault]:
        """Return the faults since the last report.

        The first is reported at once, later ones at most once in `NOISE_EVERY`.
        """
        if now < self._noise_due:
            return []
        noise = self._bad_bytes()
        if noise + self._findings.total() == self._reported.total():
            return []
        self._noise_due = now + NOISE_EVERY
        present = Counter({"noise": noise})
        present.update({finding.value: number for finding, number in self._findings.items()})
        news, self._reported = present - self._reported, present
        return [LinkFault(kind, self._words(kind, number)) for kind, number in news.items()]

    def _words(self, kind: str, number: int) -> str:
        if kind == "noise":
            return f"{number} bytes received on {self.name} are not MAVLink"
        return f"{number} frames rejected on {self.name}: {kind}"

    def _bad_bytes(self) -> int:
        return self._shared.bad_bytes + sum(reader.bad_bytes for reader in self._readers.values())

    @property
    def has_received_frames(self) -> bool:
        """Return whether any byte was received."""
        counts = self.counts()
        return bool(counts.frames or counts.bad_bytes)

    def summary(self) -> str:
        """Return all non-zero counters in one line."""
        url, *numbers = self.counts()
        named = zip(LinkCounts._fields[1:], numbers, strict=True)
        return f"{url}: {', '.join(f'{name} {number}' for name, number in named if number)}"

    def counts(self) -> LinkCounts:
        """Return the counters of the link."""
        readers = [self._shared, *self._readers.values()]
        return LinkCounts(
            self.name,
            sum(reader.frames for reader in readers),
            self._bad_bytes(),
            self.unknown + sum(reader.unknown for reader in readers),
            self.refused,
            self.transport.dropped + self._dropped,
            self._findings[Finding.UNSIGNED],
            self._findings[Finding.FORGED],
            self._findings[Finding.REPLAYED],
            self._forwarded,
            self._withheld,
            self._findings[Finding.AHEAD],
        )
