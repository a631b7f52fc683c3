"""Which telemetry goes out on which link, and when."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from avionics.link.budget import Rank
from avionics.link.dialect import mavlink
from avionics.link.services.service import Room
from avionics.link.telemetry import STREAMS, StreamEntry, boot_ms, mission_current
from avionics.link.vehicle import VehicleView

FASTEST = 0.005
"""s; no message is sent more often"""
LONGEST_WAIT = 5.0
"""s; after which a thinned stream is sent once, whatever its rank"""
_LOOK_AGAIN = 0.005
"""s; until a stream that found no room is looked at again"""


@dataclass
class _Schedule:
    entry: StreamEntry
    interval: float
    due: float
    sent: float = -float("inf")


class Streams:
    """The telemetry schedule of every link, on the wall clock."""

    def __init__(
        self, vehicle: VehicleView, rooms: Sequence[Room], unix_time: Callable[[], float], first_item: int = 0
    ) -> None:
        """``rooms`` says how much each link takes now, ``first_item`` is `Identity.first_item`."""
        self._vehicle = vehicle
        self._unix_time = unix_time
        system_time = StreamEntry(
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
            self._system_time,
            1.0,
            Rank.SECOND,
            frozenset({mavlink.MAV_DATA_STREAM_EXTRA3}),
        )
        current = StreamEntry(
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
            lambda vehicle: mission_current(vehicle, first_item),
            1.0,
            Rank.FIRST,
            frozenset({mavlink.MAV_DATA_STREAM_EXTENDED_STATUS}),
        )
        entries = sorted((*STREAMS, system_time, current), key=lambda entry: entry.rank.value)
        self._rooms = rooms
        self._links = [{entry.message_id: _fresh(entry) for entry in entries} for _ in rooms]
        self._prompt = {entry.message_id: entry.changes for entry in entries if entry.changes is not None}
        self._known = self._told_at_once()
        self._thinned: set[int] = set()
        self._next = -float("inf")

    def _system_time(self, vehicle: VehicleView) -> Any:
        return mavlink.MAVLink_system_time_message(int(self._unix_time() * 1e6), boot_ms(vehicle.time_us))

    def _told_at_once(self) -> dict[int, int]:
        return {message_id: changes(self._vehicle) for message_id, changes in self._prompt.items()}

    def build(self, message_id: int) -> list[Any] | None:
        """The messages of this id as of now, perhaps none; None for one that is not telemetry."""
        schedule = self._links[0].get(message_id) if self._links else None
        return None if schedule is None else _as_list(schedule.entry.build(self._vehicle))

    def set_interval(self, link: int, message_id: int, interval_us: float) -> bool:
        """Microseconds between two messages: 0 for the default, -1 for never; False for an unknown message."""
        schedule = self._links[link].get(message_id)
        if schedule is None:
            return False
        if interval_us == 0:
            schedule.interval = _default(schedule.entry)
        else:
            schedule.interval = max(interval_us * 1e-6, FASTEST) if interval_us > 0 else float("inf")
        # From the last one on, so that asking again and again makes nothing come more often than was asked.
        schedule.due = schedule.sent + schedule.interval if schedule.interval < float("inf") else float("inf")
        self._next = -float("inf")
        return True

    def interval_us(self, link: int, message_id: int) -> int:
        """Microseconds between two messages; -1 for one that is switched off, 0 for one that there is not."""
        schedule = self._links[link].get(message_id)
        if schedule is None:
            return 0
        return round(schedule.interval * 1e6) if schedule.interval < float("inf") else -1

    def set_group(self, link: int, group: int, rate: float) -> bool:
        """A whole group of REQUEST_DATA_STREAM to ``rate`` Hz, 0 for never; False for a group without messages."""
        everything = group == mavlink.MAV_DATA_STREAM_ALL
        chosen = [
            schedule.entry.message_id
            for schedule in self._links[link].values()
            if group in schedule.entry.groups or (everything and schedule.entry.rate > 0.0)
        ]
        for message_id in chosen:
            self.set_interval(link, message_id, 1e6 / rate if rate > 0.0 else -1)
        return bool(chosen)

    def due(self, now: float) -> Iterable[tuple[int, Any]]:
        """Link and message of all that is due at wall-clock time ``now`` in s; costs little while nothing is."""
        self._hurry(now)
        if now < self._next:
            return
        self._next = float("inf")
        for link, schedules in enumerate(self._links):
            for schedule in schedules.values():
                if now >= schedule.due and self._has_room(link, schedule, now):
                    schedule.sent = now
                    schedule.due = max(schedule.due + schedule.interval, now + 0.5 * schedule.interval)
                    for message in _as_list(schedule.entry.build(self._vehicle)):
                        yield link, message
                self._next = min(self._next, schedule.due if schedule.due > now else now + _LOOK_AGAIN)

    def _hurry(self, now: float) -> None:
        """What says something new is due now, on every link that has it at all."""
        before, self._known = self._known, self._told_at_once()
        for message_id, value in self._known.items():
            if value != before[message_id]:
                self._next = now
                for schedules in self._links:
                    schedule = schedules[message_id]
                    schedule.due = min(schedule.due, now) if schedule.interval < float("inf") else schedule.due

    def _has_room(self, link: int, schedule: _Schedule, now: float) -> bool:
        """Whether the link takes a stream of this rank; one that waited long enough goes first."""
        overdue = now - schedule.sent > max(LONGEST_WAIT, 2.0 * schedule.interval)
        if self._rooms[link](0.0 if overdue else schedule.entry.rank.value) > 0.0:
            return True
        if now - schedule.due > schedule.interval:
            self._thinned.add(link)
        return False

    def take_thinned(self) -> set[int]:
        """Links on which a stream had to be left out since the last call."""
        thinned, self._thinned = self._thinned, set()
        return thinned


def _default(entry: StreamEntry) -> float:
    return 1.0 / entry.rate if entry.rate > 0.0 else float("inf")


def _fresh(entry: StreamEntry) -> _Schedule:
    return _Schedule(entry, _default(entry), -float("inf") if entry.rate > 0.0 else float("inf"))


def _as_list(built: Any) -> list[Any]:
    if built is None:
        return []
    return built if isinstance(built, list) else [built]
