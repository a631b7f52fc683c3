"""Telemetry schedule by link."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from avionics.isolation import Guard, Isolation
from avionics.link.budget import TELEMETRY_FRAMES, Capacity, Rank
from avionics.link.dialect import mavlink
from avionics.link.stream_table import STREAMS, StreamEntry
from avionics.link.telemetry import boot_ms, mission_current
from avionics.link.vehicle import VehicleView

_LONGEST_US = 2**31 - 1
"""us; maximum of MESSAGE_INTERVAL"""
FASTEST = 0.005
"""s; minimum interval of a message"""
LONGEST_WAIT = 5.0
"""s; maximum delay of a thinned stream, independent of its rank"""
_LOOK_AGAIN = 0.005
"""s; retry interval of a stream without capacity"""


Send = Callable[[int, Any], int]
"""function that sends a message on a link and returns the number of frames, one for each peer"""


@dataclass
class _Schedule:
    entry: StreamEntry
    guard: Guard
    kept: float
    """fraction of the depth of a link reserved for streams of a higher rank"""
    interval: float
    due: float
    sent: float = -float("inf")


class Streams:
    """Telemetry schedule of every link, on the wall clock."""

    def __init__(
        self,
        vehicle: VehicleView,
        capacities: Sequence[Capacity],
        unix_time: Callable[[], float],
        isolation: Isolation,
        first_item: int = 0,
    ) -> None:
        """Create the schedule.

        ``capacities`` return the bytes that each link accepts now; ``first_item`` is `Identity.first_item`.
        """
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
        self._capacities = capacities
        self.guards = {entry.message_id: isolation.guard(f"telemetry {_name(entry)}") for entry in entries}
        """guards of the builders"""
        self._links = [
            {entry.message_id: _fresh(entry, self.guards[entry.message_id]) for entry in entries} for _ in capacities
        ]
        self._prompt = {entry.message_id: entry.changes for entry in entries if entry.changes is not None}
        self._known = self._prompt_values()
        self._thinned: set[int] = set()
        self._limited, self._turn = False, 0
        self._next = -float("inf")

    def _system_time(self, vehicle: VehicleView) -> Any:
        return mavlink.MAVLink_system_time_message(int(self._unix_time() * 1e6), boot_ms(vehicle.time_us))

    def _prompt_values(self) -> dict[int, int | None]:
        return {
            message_id: self.guards[message_id].run(changes, self._vehicle)
            for message_id, changes in self._prompt.items()
        }

    def build(self, message_id: int) -> list[Any] | None:
        """Return the present messages of this ID; None if it is not telemetry."""
        schedule = self._links[0].get(message_id) if self._links else None
        return None if schedule is None else _as_list(schedule.guard.run(schedule.entry.build, self._vehicle))

    def set_interval(self, link: int, message_id: int, interval_us: float) -> bool:
        """Set the interval (us) of a message: 0 for the default, -1 to disable.

        The result is False for an unknown message.
        """
        schedule = self._links[link].get(message_id)
        if schedule is None:
            return False
        if interval_us == 0:
            schedule.interval = _default(schedule.entry)
        else:
            schedule.interval = max(interval_us * 1e-6, FASTEST) if interval_us > 0 else float("inf")
        # The interval counts from the last message, so that repeated requests do not increase the rate.
        schedule.due = schedule.sent + schedule.interval if schedule.interval < float("inf") else float("inf")
        self._next = -float("inf")
        return True

    def interval_us(self, link: int, message_id: int) -> int:
        """Return the interval (us) of a message: -1 if disabled, 0 if unknown."""
        schedule = self._links[link].get(message_id)
        if schedule is None:
            return 0
        return min(round(schedule.interval * 1e6), _LONGEST_US) if schedule.interval < float("inf") else -1

    def set_group(self, link: int, group: int, rate: float) -> bool:
        """Set a group of REQUEST_DATA_STREAM to ``rate`` (Hz), 0 to disable.

        The result is False for a group without messages.
        """
        everything = group == mavlink.MAV_DATA_STREAM_ALL
        chosen = [
            schedule.entry.message_id
            for schedule in self._links[link].values()
            if group in schedule.entry.groups or (everything and schedule.entry.rate > 0.0)
        ]
        for message_id in chosen:
            self.set_interval(link, message_id, 1e6 / rate if rate > 0.0 else -1)
        return bool(chosen)

    def send_due(self, now: float, send: Send) -> None:
        """Send the messages due at wall-clock time ``now`` (s).

        The limit is `TELEMETRY_FRAMES` over all links and peers; the message that exceeds it is the last. The links
        alternate message by message, so that none uses the share of another; on each the highest priority is first.
        """
        self._is_on_change(now)
        if now < self._next:
            return
        waiting = [
            deque(
                sorted(
                    (schedule for schedule in schedules.values() if now >= schedule.due),
                    key=lambda schedule: (self._kept(schedule, now), schedule.due),
                )
            )
            for schedules in self._links
        ]
        turns = deque(link for link, queue in enumerate(waiting) if queue)
        turns.rotate(self._turn)
        self._turn += 1
        left = TELEMETRY_FRAMES
        while turns and left > 0:
            link = turns.popleft()
            schedule = waiting[link].popleft()
            if waiting[link]:
                turns.append(link)
            if self._has_capacity(link, schedule, now):
                schedule.sent = now
                schedule.due = max(schedule.due + schedule.interval, now + 0.5 * schedule.interval)
                left -= schedule.guard.run(self._emit, schedule.entry, link, send) or 0
        self._limited = self._limited or any(_is_late(schedule, now) for queue in waiting for schedule in queue)
        self._next = min(
            (
                schedule.due if schedule.due > now else now + _LOOK_AGAIN
                for schedules in self._links
                for schedule in schedules.values()
            ),
            default=float("inf"),
        )

    def _emit(self, entry: StreamEntry, link: int, send: Send) -> int:
        return sum(send(link, message) for message in _as_list(entry.build(self._vehicle)))

    def _is_on_change(self, now: float) -> None:
        """Mark triggered messages with a changed value as due on their links."""
        before, self._known = self._known, self._prompt_values()
        for message_id, value in self._known.items():
            if value != before[message_id]:
                self._next = now
                for schedules in self._links:
                    schedule = schedules[message_id]
                    schedule.due = min(schedule.due, now) if schedule.interval < float("inf") else schedule.due

    def _kept(self, schedule: _Schedule, now: float) -> float:
        """Return the reserved fraction of a link's depth; 0 after a long delay."""
        overdue = now - schedule.sent > max(LONGEST_WAIT, 2.0 * schedule.interval)
        return 0.0 if overdue else schedule.kept

    def _has_capacity(self, link: int, schedule: _Schedule, now: float) -> bool:
        """Return whether the link has capacity for a stream of this rank."""
        if self._capacities[link](self._kept(schedule, now)) > 0.0:
            return True
        if _is_late(schedule, now):
            self._thinned.add(link)
        return False

    def take_thinned(self) -> set[int]:
        """Return the links with an omitted message since the last call."""
        thinned, self._thinned = self._thinned, set()
        return thinned

    def take_limited(self) -> bool:
        """Return whether the limit of all links omitted a message since the last call."""
        limited, self._limited = self._limited, False
        return limited


def _is_late(schedule: _Schedule, now: float) -> bool:
    """Return whether a message is omitted and not only late, except for the first one."""
    return schedule.interval < now - schedule.due < float("inf")


def _name(entry: StreamEntry) -> str:
    return str(mavlink.mavlink_map[entry.message_id].msgname)


def _default(entry: StreamEntry) -> float:
    return 1.0 / entry.rate if entry.rate > 0.0 else float("inf")


def _fresh(entry: StreamEntry, guard: Guard) -> _Schedule:
    return _Schedule(
        entry, guard, entry.rank.value, _default(entry), -float("inf") if entry.rate > 0.0 else float("inf")
    )


def _as_list(built: Any) -> list[Any]:
    if built is None:
        return []
    return built if isinstance(built, list) else [built]
