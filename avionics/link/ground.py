"""Ground link: commands from received bytes, and telemetry from topics.

`GroundLink` is called between two ticks of the flight computer. It uses the wall clock and has no access to the
flight core: it reads a `VehicleView` and returns inputs, which the core logs and executes at its next tick.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from avionics.isolation import Guard, Isolation, fault_events
from avionics.link.budget import TELEMETRY_FRAMES, Capacity
from avionics.link.channel import PORTION, SMALLEST_PORTION, Channel, LinkCounts
from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, decode
from avionics.link.ftp_files import FtpFileSystem
from avionics.link.metadata import component_metadata
from avionics.link.routing import Router
from avionics.link.services.commands import CommandService
from avionics.link.services.flight_information import FlightInformation
from avionics.link.services.ftp import FtpService
from avionics.link.services.heartbeat import HeartbeatService
from avionics.link.services.logs import LogService
from avionics.link.services.manual import ManualService
from avionics.link.services.mission import MissionService
from avionics.link.services.modes import ModeService, ShownMode
from avionics.link.services.parameters import ParameterService
from avionics.link.services.radio import RadioService
from avionics.link.services.requests import Requests
from avionics.link.services.service import Output, Reply, Sender, Service
from avionics.link.services.setpoints import SetpointService
from avionics.link.services.signing import SigningService
from avionics.link.services.silence import SilenceService
from avionics.link.services.statustext import StatustextService
from avionics.link.services.timesync import TimesyncService
from avionics.link.signing import Signing
from avionics.link.streams import Streams
from avionics.link.transport import Peer, Transport, open_transport
from avionics.link.vehicle import Identity, LinkGains, Storage, VehicleView
from avionics.messages import ChannelOverride, CommandKind, Input, PilotInput
from wingbeat.message import Event, Severity

MOST_WORK = 48
"""-; maximum frames processed and sent in one poll over all links; the frame that exceeds it is the last. At about 30
us each, a flood costs less than half of a tick of 5 ms, and a station that sends once a tick is answered in it"""
WORK_OF_INPUT = 8
"""-; cost of an input for the flight core in frames, because it is logged, executed and reported"""


class Files(NamedTuple):
    """Files of the link, owned by the calling program."""

    storage: Storage | None = None
    """parameters"""
    signing: Signing | None = None
    """key and timestamps of signatures"""
    logs: Path | None = None
    """folder of logs for FTP"""


class ServiceRow(NamedTuple):
    """Row of the table of services."""

    name: str
    build: Callable[[], Service]
    """constructor, also used after a fault"""
    keeps_memory: bool = False
    """True if the service keeps its state after a fault"""
    vital: bool = False
    """True if it is restarted without limit"""


@dataclass
class Hosted:
    """Service with its guard."""

    service: Service
    guard: Guard


class GroundLink:
    """Transports and services of a vehicle."""

    def __init__(
        self,
        urls: Sequence[str | Transport],
        vehicle: VehicleView,
        identity: Identity | None = None,
        gains: LinkGains | None = None,
        unix_time: Callable[[], float] = time.time,
        files: Files = Files(),  # noqa: B008 (immutable)
    ) -> None:
        """Open all links; without ``files`` neither parameters nor a key are stored.

        Raises:
            InputError: not a link address, a port in use, a missing device; all links are closed in this case.
        """
        self._identity = identity or Identity()
        self._vehicle = vehicle
        self._signing = files.signing or Signing(unix_time)
        self._isolation = Isolation()
        transports = _open_all(urls)
        portion = max(PORTION // max(len(transports), 1), SMALLEST_PORTION)
        self._links = [
            Channel(number, transport, self._identity, self._signing, self._isolation, portion)
            for number, transport in enumerate(transports)
        ]
        self._turns = deque(range(len(self._links)))
        self._taken = 0
        ours = (self._identity.system, self._identity.component)
        self._router = Router([link.transport.url.forward for link in self._links], ours)
        self._routing = self._isolation.guard("routing")
        self._telemetry = self._isolation.guard("telemetry")
        self._streams = Streams(vehicle, self._capacities(), unix_time, self._isolation, self._identity.first_item)
        self._silence = SilenceService(vehicle, gains or LinkGains())
        self._texts = StatustextService(vehicle, unix_time)
        self._unsent: deque[Event] = deque(maxlen=64)
        """events for the status text service, which may be disabled"""
        self._services = {row.name: self._host(row) for row in self._table(gains or LinkGains(), files)}
        self._by_message: dict[str, list[Hosted]] = {}
        for hosted in self._services.values():
            for name in hosted.service.takes:
                self._by_message.setdefault(name, []).append(hosted)
        self._journal: list[Event] = []
        self.announced: list[Event] = []
        """reports of link faults to the ground, each once; on UDP possibly without a receiver"""

    def _capacities(self) -> list[Capacity]:
        return [link.budget.available_bytes for link in self._links]

    def _table(self, gains: LinkGains, files: Files) -> tuple[ServiceRow, ...]:
        """Return the services in order of execution."""
        vehicle, identity, shown = self._vehicle, self._identity, ShownMode(self._vehicle, self._identity)

        flights, setpoints = FlightInformation(vehicle), SetpointService(vehicle, identity)

        metadata = component_metadata(vehicle.parameters, files.storage, identity.version)

        def requests() -> Requests:
            return Requests(vehicle, identity, self._streams, shown, flights, metadata)

        def missions() -> MissionService:
            return MissionService(vehicle, gains, identity.first_item)

        def commands() -> CommandService:
            return CommandService(vehicle, identity, requests(), missions(), shown, setpoints, files.storage)

        def note_radio(link: int, free: int, now: float) -> None:
            self._links[link].budget.note_radio(free, now)

        ftp_files = FtpFileSystem(vehicle, files.storage, files.logs, metadata)
        return (
            ServiceRow("heartbeat", lambda: HeartbeatService(vehicle, identity, gains, shown), vital=True),
            ServiceRow("link loss", lambda: self._silence, keeps_memory=True, vital=True),
            ServiceRow("commands", commands, vital=True),
            ServiceRow("parameters", lambda: ParameterService(vehicle, gains, self._capacities())),
            ServiceRow("missions", missions),
            ServiceRow("setpoints", lambda: setpoints, keeps_memory=True),
            ServiceRow("modes", lambda: ModeService(shown), vital=True),
            ServiceRow("stream requests", requests),
            ServiceRow("status text", lambda: self._texts, keeps_memory=True, vital=True),
            ServiceRow("time synchronization", lambda: TimesyncService(vehicle)),
            ServiceRow("FTP", lambda: FtpService(ftp_files, self._capacities())),
            ServiceRow("log download", lambda: LogService(ftp_files, self._capacities())),
            ServiceRow("flight information", lambda: flights, keeps_memory=True),
            ServiceRow("manual control", lambda: ManualService(vehicle, identity.system), vital=True),
            ServiceRow("signing setup", lambda: SigningService(vehicle, self._signing, self._confidential)),
            ServiceRow("radio status", lambda: RadioService(note_radio)),
        )

    def _host(self, row: ServiceRow) -> Hosted:
        def restart() -> None:
            self._services[row.name].service = row.build()

        guard = self._isolation.guard(row.name, None if row.keeps_memory else restart, vital=row.vital)
        return Hosted(row.build(), guard)

    @property
    def counts(self) -> list[LinkCounts]:
        """Return the traffic counters of each link."""
        return [link.counts() for link in self._links]

    @property
    def stations(self) -> int:
        """Return the number of connected ground stations."""
        return self._silence.stations

    def poll(self, now: float) -> list[Input]:
        """Process received frames and return the inputs for the flight core.

        The inputs of each link are in order of arrival. The links alternate frame by frame until none is left or
        `MOST_WORK` is reached. Remaining frames are first at the next call, so that a flood neither delays a tick nor
        blocks another link.

        Args:
            now: s; wall-clock time from any zero, never decreasing.
        """
        inputs: list[Input] = []
        self._isolation.advance(now)
        self._send_events()
        for link in self._links:
            link.budget.advance(now)
            link.receive(now)
        self._take_turns(now, inputs)
        for link in self._links:
            link.guard.run(self._report_link_faults, link, now)
        for hosted in self._services.values():
            hosted.guard.run(self._step, hosted.service, now, inputs)
        self._report_faults()
        return inputs

    def _step(self, service: Service, now: float, inputs: list[Input]) -> None:
        outputs = service.step(now)
        if outputs:
            self._deliver(outputs, inputs)

    def _take_turns(self, now: float, inputs: list[Input]) -> None:
        enough, empty = self._work(inputs) + MOST_WORK, 0
        while empty < len(self._turns) and self._work(inputs) < enough:
            number = self._turns[0]
            self._turns.rotate(-1)
            heard = self._links[number].take()
            if heard is None:
                empty += 1
            else:
                empty = 0
                self._handle_frame(*heard, number, now, inputs)

    def _work(self, inputs: list[Input]) -> int:
        """Return the work done so far, in frames."""
        return self._taken + sum(link.sent for link in self._links) + WORK_OF_INPUT * len(inputs)

    def _handle_frame(self, frame: Frame, peer: Peer, number: int, now: float, inputs: list[Input]) -> None:
        self._taken += 1
        self._routing.run(self._pass_on, frame, number, peer, now)
        sender = Sender(frame.system, frame.component, number, peer, self._links[number].name)
        message = self._links[number].guard.run(self._decoded, frame, number)
        if message is None:
            return
        self._services["link loss"].guard.run(self._silence.received, sender, now)
        if self._is_for_us(message):
            for hosted in self._by_message.get(message.get_type(), ()):
                hosted.guard.run(self._answer, hosted.service, message, sender, now, inputs)

    def _answer(self, service: Service, message: Any, sender: Sender, now: float, inputs: list[Input]) -> None:
        self._deliver(service.receive(message, sender, now), inputs)

    def _pass_on(self, frame: Frame, number: int, peer: Peer, now: float) -> None:
        for hop in self._router.hops(frame, number, peer, now):
            self._links[hop.link].forward(frame.raw, hop.peer)

    def _report_link_faults(self, link: Channel, now: float) -> None:
        """Log link faults; faults other than noise are also reported to the ground once."""
        for complaint in link.faults(now):
            self._journal.append(self._event(Severity.WARNING, complaint.text))
            if complaint.kind != "noise":
                self._announce(Severity.WARNING, f"{complaint.kind} frames rejected on {link.name}")
        if self._signing.failure:
            self._announce(Severity.WARNING, f"signing: time stamps not stored: {self._signing.failure}")

    def _announce(self, severity: Severity, text: str) -> None:
        """Report a text to the ground and the log, once."""
        if all(event.text != text for event in self.announced):
            self._publish(self._event(severity, text))

    def _publish(self, event: Event) -> None:
        self.announced.append(event)
        self._journal.append(event)
        self._unsent.append(event)
        self._send_events()

    def _send_events(self) -> None:
        guard = self._services["status text"].guard
        while self._unsent and guard.enabled:
            guard.run(self._texts.send_statustext, self._unsent.popleft())

    def _report_faults(self) -> None:
        """Report faults of the guards: one line to the ground, the traceback to the log."""
        for fault in self._isolation.take_faults():
            event, *details = fault_events(fault, self._vehicle.time_us)
            self._publish(event)
            self._journal += details

    def _event(self, severity: Severity, text: str) -> Event:
        return Event(self._vehicle.time_us, severity, "link", text)

    def _confidential(self, sender: Sender) -> bool:
        return self._links[sender.link].confidential(sender.peer)

    def stream(self, now: float) -> None:
        """Send the telemetry that is due at wall-clock time ``now`` (s)."""
        self._telemetry.run(self._stream, now)
        self._report_faults()

    def _stream(self, now: float) -> None:
        self._streams.send_due(now, self._send)
        for number in self._streams.take_thinned():
            text = f"{self._links[number].name} bandwidth exceeded, stream rates reduced"
            self._announce(Severity.NOTICE, text)
        if self._streams.take_limited():
            text = f"telemetry exceeds {TELEMETRY_FRAMES} frames per tick: low-priority streams reduced"
            self._announce(Severity.NOTICE, text)

    def _send(self, link: int, message: Any) -> int:
        return self._links[link].send(message)

    def take_events(self) -> list[Event]:
        """Return the link events since the last call, for the log (`topics.LINK_EVENTS`)."""
        events, self._journal = self._journal, []
        return events

    def close(self) -> None:
        """Close all ports and devices, and store the timestamps."""
        self._services["signing setup"].guard.run(self._signing.close)
        for link in self._links:
            link.guard.run(link.transport.close)
            if link.has_received_frames:
                self._journal.append(self._event(Severity.INFO, link.summary()))
        self._report_faults()

    def _decoded(self, frame: Frame, number: int) -> Any:
        """Return the message of a frame; None if it is unknown or does not fit."""
        if frame.message_id not in mavlink.mavlink_map:
            self._links[number].unknown += 1
            return None
        try:
            return decode(frame)
        except mavlink.MAVError:
            self._links[number].refused += 1
            return None

    def _is_for_us(self, message: Any) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._identity.system) and component in (0, self._identity.component)

    def _deliver(self, outputs: list[Output], inputs: list[Input]) -> None:
        # A reply that cannot be sent must not discard the inputs after it.
        for output in outputs:
            if not isinstance(output, Reply):
                inputs.append(output)
                self._note(output)
        for output in outputs:
            if not isinstance(output, Reply):
                continue
            if output.to is None:
                for link in self._links:
                    link.send(output.message)
            else:
                self._links[output.to.link].send(output.message, output.to.peer)

    def _note(self, output: Input) -> None:
        if isinstance(output, PilotInput | ChannelOverride) or output.kind is CommandKind.SET_SETPOINT:
            return
        lost = output.kind is CommandKind.LINK_LOST
        text = f"{output.kind.name} {output.name} from {output.source}".replace("  ", " ")
        self._journal.append(self._event(Severity.WARNING if lost else Severity.INFO, text))


def _open_all(urls: Sequence[str | Transport]) -> list[Transport]:
    opened: list[Transport] = []
    try:
        for url in urls:
            opened.append(open_transport(url) if isinstance(url, str) else url)
    except BaseException:
        for transport in opened:
            transport.close()
        raise
    return opened
