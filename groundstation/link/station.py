"""Ground-station session: connection, traffic statistics, automatic requests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.commands import CommandExchange
from groundstation.link.connection import Connection
from groundstation.link.exchange import Exchange
from groundstation.link.frames import Arrival
from groundstation.link.latency import Latency
from groundstation.link.missions import Item, MissionDownload
from groundstation.link.mode_change import ModeNames, request_mode_names
from groundstation.link.stream_request import StreamRequest, too_slow
from groundstation.link.traffic import Quality, Traffic
from groundstation.link.vehicle_state import VehicleState, is_wingbeat_vehicle

NOTES_KEPT = 50
LOOK = 3.0
"""s; time from the detection of a vehicle to the check of its message rates"""
LOOK_AGAIN = 10.0
"""s; interval of such checks: a rebooted vehicle has lost its rate requests"""


class Note(NamedTuple):
    """Notice of the ground station about a command."""

    time: float | None
    """s; vehicle time since boot"""
    text: str
    """-; one line"""
    failed: bool = False
    """-; True if it was denied or timed out"""


class Picture(NamedTuple):
    """Snapshot of the data of all views."""

    url: str = ""
    state: VehicleState = VehicleState()
    quality: Quality = Quality()
    silence: float | None = None
    """s; since the last message of the vehicle, None before the first"""
    mission: tuple[Item, ...] = ()
    """downloaded mission"""
    notes: tuple[Note, ...] = ()
    """notices of the ground station, oldest first, at most `NOTES_KEPT`"""
    busy: str = ""
    """-; request in progress, empty for none"""
    recording: Path | None = None
    """path of the recording"""
    note_count: int = 0
    """-; number of notices since the link was opened"""


def new_notes(picture: Picture, note_count: int) -> tuple[Note, ...]:
    """Return the notices added since their count was ``note_count``."""
    return picture.notes[-(picture.note_count - note_count) :] if picture.note_count > note_count else ()


class Station:
    """Ground station that a view polls frequently; `picture` is a value."""

    def __init__(self, connection: Connection, clock: Callable[[], float] = time.monotonic) -> None:
        self.connection = connection
        self.traffic = Traffic()
        self.recording: Callable[[], Path | None] = lambda: None
        self._clock = clock
        self._latency = Latency()
        self._mission: tuple[Item, ...] = ()
        self._notes: tuple[Note, ...] = ()
        self._note_count = 0
        self._requested = False
        self._look_at = math.inf
        self._refused: frozenset[str] = frozenset()
        self._running: list[tuple[str, Exchange]] = []
        connection.overhear(self._handle_frame)

    def _handle_frame(self, arrival: Arrival) -> None:
        self.traffic.handle_frame(arrival)
        if arrival.message is not None:
            self._latency.handle_message(arrival.message, arrival.at)

    def poll(self) -> bool:
        """Receive messages and send due requests; return whether anything was received."""
        heard = bool(self.connection.receive())
        for question in self._latency.questions(self._clock()):
            self.connection.send(question)
        if not self._requested and self.connection.state.system is not None:
            self._requested = True
            self._meet()
        if self._clock() >= self._look_at:
            self._request_streams()
        return heard

    def _meet(self) -> None:
        """Request the identity first: a Wingbeat vehicle may report another autopilot type and needs no stream
        requests.
        """
        if is_wingbeat_vehicle(self.connection.state):
            self._request_modes(None)
            return
        wanted = (float(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),)
        version = CommandExchange(self.connection.target, mavlink.MAV_CMD_REQUEST_MESSAGE, wanted)
        self.connection.begin(version, self._request_modes)
        self._look_at = self._clock() + LOOK

    def _request_modes(self, version: CommandExchange | None) -> None:
        self.connection.begin(request_mode_names(self.connection.target), self._request_mission)

    def _request_streams(self) -> None:
        """Request messages of other vehicles that arrive too seldom, one request at a time."""
        self._look_at = math.inf
        state, now = self.connection.state, self._clock()
        if is_wingbeat_vehicle(state):
            return
        rates = {row.name: row.rate for row in self.traffic.rows(now) if row.sender[0] == state.system}
        slow = tuple(too_slow(rates, self._refused))
        self.connection.begin(StreamRequest(self.connection.target, slow), self._requested_streams)

    def _requested_streams(self, request: StreamRequest) -> None:
        self._refused |= request.refused
        self._look_at = self._clock() + LOOK_AGAIN

    def _request_mission(self, names: ModeNames) -> None:
        self.read_mission()

    def read_mission(self) -> None:
        """Download the mission; `Picture.mission` has it once it is complete."""
        self.connection.begin(MissionDownload(self.connection.target), self._take_mission)

    def _take_mission(self, download: MissionDownload) -> None:
        if not download.failure:
            self._mission = download.items

    def command(self, label: str, exchange: Exchange, done: str) -> None:
        """Start an exchange that the user requested; its result becomes a notice."""
        running = [entry for entry in self._running if entry[0] != label]
        self._running = [*running, (label, exchange)]
        self.connection.begin(exchange, lambda ended: self._end(label, ended, done))

    def _end(self, label: str, ended: Exchange, done: str) -> None:
        self._running = [entry for entry in self._running if entry[0] != label]
        self.note(ended.failure or done, failed=bool(ended.failure))

    def note(self, text: str, failed: bool = False) -> None:
        """Add a notice of the ground station."""
        self._notes = (*self._notes, Note(self.connection.state.time, text, failed))[-NOTES_KEPT:]
        self._note_count += 1

    def picture(self) -> Picture:
        """Return the present snapshot."""
        now, state = self._clock(), self.connection.state
        quality = self.traffic.quality(now)
        return Picture(
            self.connection.url,
            state,
            quality._replace(latency=self._latency.value(now), bad_bytes=self.connection.bad_bytes),
            None if state.received_at is None else now - state.received_at,
            self._mission,
            self._notes,
            ", ".join(label for label, _ in self._running),
            self.recording(),
            self._note_count,
        )
