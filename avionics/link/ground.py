"""All links to the ground: bytes in, commands out; topics in, telemetry out.

`GroundLink` is called between two ticks of the flight computer. It lives on the wall clock and never touches the
flight core: it reads a `VehicleView` and returns inputs, which the core logs and applies at its next tick.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader, decode
from avionics.link.services.commands import CommandService
from avionics.link.services.ftp import FtpService
from avionics.link.services.heartbeat import HeartbeatService
from avionics.link.services.manual import ManualService
from avionics.link.services.mission import MissionService
from avionics.link.services.modes import ModeService
from avionics.link.services.parameters import ParameterService
from avionics.link.services.requests import Requests
from avionics.link.services.service import Output, Reply, Sender, Service
from avionics.link.services.silence import SilenceService
from avionics.link.services.statustext import StatustextService
from avionics.link.services.timesync import TimesyncService
from avionics.link.streams import Streams
from avionics.link.transport import Packet, Peer, Transport, open_transport
from avionics.link.vehicle import Identity, LinkGains, Storage, VehicleView
from avionics.messages import ChannelOverride, CommandKind, Event, Input, PilotInput, Severity

PAUSE = 0.2
"""s; a frame does not pause for longer, even on a slow radio"""

NOISE_EVERY = 1.0
"""s; between two events about noise on a link"""


class LinkCounts(NamedTuple):
    """What went over one link."""

    url: str
    frames: int
    """received with a correct checksum"""
    bad_bytes: int
    """received that were no part of a frame"""
    unknown: int
    """frames received of messages that are not known here"""
    refused: int
    """frames received with a correct checksum whose content does not fit the message"""
    dropped: int
    """frames that could not be sent"""


class _Link:
    """One transport with a reader for each peer."""

    def __init__(self, transport: Transport, identity: Identity) -> None:
        self.transport = transport
        self.name = str(transport.url)
        self.writer = FrameWriter(identity.system, identity.component)
        self.refused = 0
        self._readers: dict[Peer, FrameReader] = {}
        self._shared = FrameReader()
        self._last_data = 0.0
        self._settled = True
        self._noise_told = 0
        self._noise_due = 0.0

    def noise(self, now: float) -> int:
        """Bytes that were no part of a frame since this was last said, at most once in `NOISE_EVERY`."""
        if now < self._noise_due:
            return 0
        self._noise_due = now + NOISE_EVERY
        told, self._noise_told = self._noise_told, self.counts().bad_bytes
        return self._noise_told - told

    def receive(self, now: float) -> list[tuple[Frame, Peer]]:
        """All frames that have arrived, with their senders' addresses."""
        heard: list[tuple[Frame, Peer]] = []
        packets = self.transport.receive(now)
        if not packets:
            return heard if self._settled or now - self._last_data < PAUSE else self._settle()
        self._last_data, self._settled = now, False
        for packet in packets:
            frames = self._cut(packet)
            if frames:
                self.transport.welcome(packet.peer)
                heard += [(frame, packet.peer) for frame in frames]
        return heard

    def _settle(self) -> list[tuple[Frame, Peer]]:
        """Nothing more came: what looks like the beginning of a frame was noise."""
        self._settled = True
        return [(frame, peer) for peer, reader in self._readers.items() for frame in reader.give_up()]

    def _cut(self, packet: Packet) -> list[Frame]:
        if self.transport.datagrams:
            return self._shared.feed(packet.data) + self._shared.give_up()
        if not packet.data:
            self._shared.bad_bytes += self._forget(packet.peer)
            return []
        if packet.peer not in self._readers:
            self._readers[packet.peer] = FrameReader()
        return self._readers[packet.peer].feed(packet.data)

    def _forget(self, peer: Peer) -> int:
        reader = self._readers.pop(peer, None)
        if reader is None:
            return 0
        self._shared.frames += reader.frames
        self._shared.unknown += reader.unknown
        return reader.bad_bytes

    def counts(self) -> LinkCounts:
        """What has gone over the link."""
        readers = [self._shared, *self._readers.values()]
        return LinkCounts(
            self.name,
            sum(reader.frames for reader in readers),
            sum(reader.bad_bytes for reader in readers),
            sum(reader.unknown for reader in readers),
            self.refused,
            self.transport.dropped,
        )


class GroundLink:
    """Owns the transports and the services of a vehicle."""

    def __init__(
        self,
        urls: Sequence[str],
        vehicle: VehicleView,
        identity: Identity | None = None,
        gains: LinkGains | None = None,
        unix_time: Callable[[], float] = time.time,
        storage: Storage | None = None,
    ) -> None:
        """Open all links; without a ``storage`` no parameters are kept.

        Raises:
            BadInput: not a link address, a port in use, a missing device; no link stays open then.
        """
        self._identity = identity or Identity()
        self._vehicle = vehicle
        self._links = [_Link(transport, self._identity) for transport in _open_all(urls)]
        self._unix_time = unix_time
        self._streams = Streams(vehicle, len(self._links), unix_time, self._identity.first_item)
        self._silence = SilenceService(vehicle, gains or LinkGains())
        self._services = self._build_services(gains or LinkGains(), storage)
        self._by_message: dict[str, list[Service]] = {}
        for service in self._services:
            for name in service.handles:
                self._by_message.setdefault(name, []).append(service)
        self._journal: list[Event] = []

    def _build_services(self, gains: LinkGains, storage: Storage | None) -> list[Service]:
        vehicle, identity = self._vehicle, self._identity
        requests = Requests(vehicle, identity, self._streams)
        missions = MissionService(vehicle, gains, identity.first_item)
        return [
            HeartbeatService(vehicle, identity, gains),
            self._silence,
            CommandService(vehicle, identity, requests, missions, storage),
            ParameterService(vehicle, gains),
            missions,
            ModeService(vehicle, identity),
            requests,
            StatustextService(vehicle, self._unix_time),
            TimesyncService(vehicle),
            FtpService(),
            ManualService(vehicle, identity.system),
        ]

    @property
    def counts(self) -> list[LinkCounts]:
        """What has gone over each link."""
        return [link.counts() for link in self._links]

    @property
    def stations(self) -> int:
        """Ground stations that are heard."""
        return self._silence.stations

    def poll(self, now: float) -> list[Input]:
        """Answer all that has arrived, and give the inputs for the flight core in the order of arrival.

        Args:
            now: wall-clock time in s, from any zero, never going back.
        """
        inputs: list[Input] = []
        for number, link in enumerate(self._links):
            for frame, peer in link.receive(now):
                sender = Sender(frame.system, frame.component, number, peer, link.name)
                self._deliver(self._answer(frame, sender, now), inputs)
            noise = link.noise(now)
            if noise:
                text = f"{noise} bytes on {link.name} were no MAVLink"
                self._journal.append(Event(self._vehicle.time_us, Severity.WARNING, "link", text))
        for service in self._services:
            outputs = service.step(now)
            if outputs:
                self._deliver(outputs, inputs)
        return inputs

    def stream(self, now: float) -> None:
        """Send the telemetry that is due at wall-clock time ``now`` in s."""
        for number, message in self._streams.due(now):
            link = self._links[number]
            link.transport.send(link.writer.pack(message))

    def take_events(self) -> list[Event]:
        """What the links did since the last call, for the log (`topics.LINK_EVENTS`)."""
        events, self._journal = self._journal, []
        return events

    def close(self) -> None:
        """Release all ports and devices."""
        for link in self._links:
            link.transport.close()

    def _answer(self, frame: Frame, sender: Sender, now: float) -> list[Output]:
        if frame.system == self._identity.system and frame.component == self._identity.component:
            return []  # our own voice, echoed by a loop of links
        try:
            message = decode(frame)
        except mavlink.MAVError:
            self._links[sender.link].refused += 1
            return []
        self._silence.heard(sender, now)
        if not self._is_for_us(message):
            return []
        services = self._by_message.get(message.get_type(), ())
        return [output for service in services for output in service.receive(message, sender, now)]

    def _is_for_us(self, message: Any) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._identity.system) and component in (0, self._identity.component)

    def _deliver(self, outputs: list[Output], inputs: list[Input]) -> None:
        for output in outputs:
            if not isinstance(output, Reply):
                inputs.append(output)
                self._note(output)
            elif output.to is None:
                for link in self._links:
                    link.transport.send(link.writer.pack(output.message))
            else:
                link = self._links[output.to.link]
                link.transport.send(link.writer.pack(output.message), output.to.peer)

    def _note(self, output: Input) -> None:
        if isinstance(output, PilotInput | ChannelOverride):
            return
        lost = output.kind is CommandKind.LINK_LOST
        text = f"{output.kind.name} {output.name} from {output.source}".replace("  ", " ")
        severity = Severity.WARNING if lost else Severity.INFO
        self._journal.append(Event(self._vehicle.time_us, severity, "link", text))


def _open_all(urls: Sequence[str]) -> list[Transport]:
    opened: list[Transport] = []
    try:
        for url in urls:
            opened.append(open_transport(url))
    except BaseException:
        for transport in opened:
            transport.close()
        raise
    return opened
