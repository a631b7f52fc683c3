"""Mission, fence and rally point transactions: download and upload."""

from __future__ import annotations

from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.exchange import (
    ATTEMPTS,
    EXPLANATION,
    RETRY,
    Outgoing,
    Progress,
    Target,
    Timer,
    explained,
)

CONFIRMATION = 1.5
"""s; timeout of a vehicle's confirmation of a complete mission, before the last item is repeated"""
REPEATS = 3
"""number of repetitions of the last item if the vehicle does not confirm the mission"""
OFFERS = 2
"""number of repetitions of the whole transfer if the vehicle does not confirm the mission"""


class Item(NamedTuple):
    """Mission item in the format of MISSION_ITEM_INT."""

    frame: int
    """-; MAV_FRAME"""
    command: int
    """-; MAV_CMD"""
    parameters: tuple[float, float, float, float]
    """-; param1 to param4"""
    x: int
    """1e-7 deg or 1e-4 m; latitude or local x"""
    y: int
    """1e-7 deg or 1e-4 m; longitude or local y"""
    z: float
    """m; altitude"""
    autocontinue: int = 1
    """-; 1 to continue with the next item"""


def item_of(message: Any) -> Item:
    """Read the item of a MISSION_ITEM_INT."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    return Item(message.frame, message.command, parameters, message.x, message.y, message.z, message.autocontinue)


class MissionDownload(NamedTuple):
    """MISSION_REQUEST_LIST, then each item, then the acknowledgement to the vehicle."""

    target: Target
    items: tuple[Item, ...] = ()
    total: int | None = None
    timer: Timer = Timer()
    failure: str = ""
    mission_type: int = 0
    """-; MAV_MISSION_TYPE: mission, fence or rally points"""

    @property
    def finished(self) -> bool:
        """Whether every item was received or the download failed."""
        return bool(self.failure) or (self.total is not None and len(self.items) >= self.total)

    def progress(self) -> Progress:
        """Items received, and their total."""
        note = f"got {len(self.items)} of {'?' if self.total is None else self.total} mission items"
        return Progress(len(self.items), self.total or 0, note + (", retrying" if self.timer.attempts > 1 else ""))

    def step(self, now: float, message: Any | None) -> tuple[MissionDownload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(now, message)
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"{self.progress().note.removesuffix(', retrying')}, then timed out"), ()
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _on_message(self, now: float, message: Any) -> tuple[MissionDownload, Outgoing]:
        kind = message.get_type()
        if getattr(message, "mission_type", self.mission_type) != self.mission_type:
            return self, ()
        if kind == "MISSION_COUNT" and self.total is None:
            return self._replace(total=message.count, timer=Timer())._next(now)
        if kind == "MISSION_ITEM_INT" and self.total is not None and message.seq == len(self.items):
            return self._replace(items=(*self.items, item_of(message)), timer=Timer())._next(now)
        if kind == "MISSION_ACK" and message.type != mavlink.MAV_MISSION_ACCEPTED:
            return self._replace(failure=f"mission download denied: {mission_result(message.type)}"), ()
        return self, ()

    def _next(self, now: float) -> tuple[MissionDownload, Outgoing]:
        if self.finished:
            done = mavlink.MAV_MISSION_ACCEPTED
            return self, (mavlink.MAVLink_mission_ack_message(*self.target, done, self.mission_type),)
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _request(self) -> Any:
        if self.total is None:
            return mavlink.MAVLink_mission_request_list_message(*self.target, self.mission_type)
        return mavlink.MAVLink_mission_request_int_message(*self.target, len(self.items), self.mission_type)


class MissionUpload(NamedTuple):
    """MISSION_COUNT, then the items that the vehicle requests, until its MISSION_ACK.

    The vehicle repeats its requests (MAVLink mission protocol). Its final acknowledgement is sent once without a
    request. If it is lost, the last item is sent again: a vehicle with the complete mission acknowledges it again
    (PX4, Wingbeat), reports an error (ArduPilot) or ignores it. Then the transfer is repeated.
    """

    target: Target
    items: tuple[Item, ...]
    sent: int = 0
    """-; highest item sent so far, plus one"""
    timer: Timer = Timer()
    accepted: bool = False
    reason: str = ""
    """-; STATUSTEXT meanwhile, as the reason of a denial"""
    failure: str = ""
    mission_type: int = 0
    """-; MAV_MISSION_TYPE: mission, fence or rally points"""
    result: int | None = None
    """-; MAV_MISSION_RESULT of a denial"""
    repeats: int = 0
    """-; repetitions of the last item"""
    offers: int = 0
    """-; repetitions of the whole transfer"""

    @property
    def finished(self) -> bool:
        """Whether the vehicle acknowledged or the upload failed."""
        return self.accepted or bool(self.failure)

    def progress(self) -> Progress:
        """Items sent, and their total."""
        total = len(self.items)
        if self.repeats or self.offers:
            return Progress(self.sent, total, f"sent all {total} mission items, not confirmed yet, retrying")
        return Progress(self.sent, total, f"sent {self.sent} of {total} mission items")

    def step(self, now: float, message: Any | None) -> tuple[MissionUpload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(now, message)
        if self.finished:
            return self, ()
        if self.result is not None:
            return self._refused(now), ()
        return self._remind(now) if self.timer.due(now, self._wait) else (self, ())

    @property
    def _all_sent(self) -> bool:
        return self.sent == len(self.items)

    @property
    def _wait(self) -> float:
        """Return the timeout in s."""
        if self.sent == 0:
            return RETRY
        return CONFIRMATION if self._all_sent else ATTEMPTS * RETRY

    def _remind(self, now: float) -> tuple[MissionUpload, Outgoing]:
        """Act on a timeout: repeat the count, repeat the last item, or fail."""
        if self.sent == 0 and not self.timer.spent:
            count = mavlink.MAVLink_mission_count_message(*self.target, len(self.items), self.mission_type)
            return self._replace(timer=self.timer.again(now)), (count,)
        if self.sent == 0 or not self._all_sent:
            return self._replace(failure=self._silence()), ()
        if self.repeats < REPEATS:
            again = self._replace(repeats=self.repeats + 1, timer=self.timer.again(now))
            return again, (self._item(self.sent - 1),)
        return self._offer_again(), ()

    def _silence(self) -> str:
        if self.offers:
            return f"sent all {len(self.items)} mission items, not confirmed by the vehicle"
        return f"{self.progress().note}, then timed out"

    def _offer_again(self) -> MissionUpload:
        if self.offers == OFFERS:
            return self._replace(failure=self._silence())
        return self._replace(sent=0, repeats=0, offers=self.offers + 1, timer=Timer())

    def _on_message(self, now: float, message: Any) -> tuple[MissionUpload, Outgoing]:
        kind = message.get_type()
        if kind == "STATUSTEXT" and self._requested:
            return self._replace(reason=explained(self.reason, message)), ()
        if getattr(message, "mission_type", self.mission_type) != self.mission_type:
            return self, ()
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(self.items):
            sent = max(self.sent, message.seq + 1)
            return self._replace(sent=sent, repeats=0, timer=self.timer.answered(now)), (self._item(message.seq),)
        if kind == "MISSION_ACK" and self._requested and self.result is None:
            return self._acknowledged(now, message.type), ()
        return self, ()

    @property
    def _requested(self) -> bool:
        return self.timer.sent_at > float("-inf")

    def _acknowledged(self, now: float, result: int) -> MissionUpload:
        if result == mavlink.MAV_MISSION_ACCEPTED:
            # Before the last item was sent, the acknowledgement is that of an older transfer.
            return self._replace(accepted=self._all_sent)
        if result == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            # A duplicate item; the vehicle continues with the request of the required one.
            return self
        if result == mavlink.MAV_MISSION_ERROR and self.repeats:
            return self._offer_again()
        return self._replace(result=result, timer=Timer(now, 1))._refused(now)

    def _refused(self, now: float) -> MissionUpload:
        """Wait for the reason: the STATUSTEXT may follow the acknowledgement."""
        if not self.reason and not self.timer.due(now, EXPLANATION):
            return self
        reason = f": {self.reason.strip()}" if self.reason else ""
        return self._replace(failure=f"mission rejected: {mission_result(self.result or 0)}{reason}")

    def _item(self, sequence: int) -> Any:
        item = self.items[sequence]
        return mavlink.MAVLink_mission_item_int_message(
            *self.target,
            sequence,
            item.frame,
            item.command,
            int(sequence == 0),
            item.autocontinue,
            *item.parameters,
            item.x,
            item.y,
            item.z,
            self.mission_type,
        )


def mission_result(result: int) -> str:
    """Return the text of a MAV_MISSION_RESULT."""
    entry = mavlink.enums["MAV_MISSION_RESULT"].get(result)
    return str(entry.name).removeprefix("MAV_MISSION_").lower().replace("_", " ") if entry else f"result {result}"
