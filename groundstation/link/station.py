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
"""s; after a vehicle was met, until it is looked at how often it says what the screen shows"""
LOOK_AGAIN = 10.0
"""s; between two such looks: a vehicle that booted anew has forgotten what it was asked for"""


class Note(NamedTuple):
    """A line of the ground's own: what became of a command."""

    time: float | None
    """s; of the vehicle since boot"""
    text: str
    """-; one line"""
    failed: bool = False
    """-; True when it was refused or not answered"""


class Picture(NamedTuple):
    """Everything that a view shows, as it was at one moment."""

    url: str = ""
    state: VehicleState = VehicleState()
    quality: Quality = Quality()
    silence: float | None = None
    """s; since the last message of the vehicle, None before the first"""
    mission: tuple[Item, ...] = ()
    """what is aboard, as far as it was asked for"""
    notes: tuple[Note, ...] = ()
    """of the ground, oldest first, at most `NOTES_KEPT`"""
    busy: str = ""
    """-; what is being asked of the vehicle, empty for nothing"""
    recording: Path | None = None
    """where what is heard goes"""
    note_count: int = 0
    """-; lines of the ground since the link was opened"""


def new_notes(picture: Picture, note_count: int) -> tuple[Note, ...]:
    """What was noted since the count of lines was ``note_count``."""
    return picture.notes[-(picture.note_count - note_count) :] if picture.note_count > note_count else ()


class Station:
    """Polled often by whoever shows it; `picture` is a value."""

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
        """Take what has come and ask what is due; whether anything came."""
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
        """Ask who it is first: ours may call itself another's, and need not be asked for what it sends anyway."""
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
        """Ask a vehicle that is not ours for what comes too seldom, one question at a time."""
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
        """Ask for the mission aboard; `Picture.mission` has it once it is whole."""
        self.connection.begin(MissionDownload(self.connection.target), self._take_mission)

    def _take_mission(self, download: MissionDownload) -> None:
        if not download.failure:
            self._mission = download.items

    def command(self, label: str, exchange: Exchange, done: str) -> None:
        """Begin a conversation that a person asked for; what becomes of it is noted."""
        running = [entry for entry in self._running if entry[0] != label]
        self._running = [*running, (label, exchange)]
        self.connection.begin(exchange, lambda ended: self._end(label, ended, done))

    def _end(self, label: str, ended: Exchange, done: str) -> None:
        self._running = [entry for entry in self._running if entry[0] != label]
        self.note(ended.failure or done, failed=bool(ended.failure))

    def note(self, text: str, failed: bool = False) -> None:
        """Add a line of the ground's own."""
        self._notes = (*self._notes, Note(self.connection.state.time, text, failed))[-NOTES_KEPT:]
        self._note_count += 1

    def picture(self) -> Picture:
        """What is known now."""
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
