"""Missions, fences and rally points of a MAVLink vehicle: down and up."""

from __future__ import annotations

from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.exchange import ATTEMPTS, RETRY, Outgoing, Progress, Target, Timer, text_of


class Item(NamedTuple):
    """One mission item as MISSION_ITEM_INT carries it."""

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
    """-; 1 to go on to the next item"""


def item_of(message: Any) -> Item:
    """Take the item out of a MISSION_ITEM_INT."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    return Item(message.frame, message.command, parameters, message.x, message.y, message.z, message.autocontinue)


class MissionDownload(NamedTuple):
    """MISSION_REQUEST_LIST, then item by item, then our acknowledgement."""

    target: Target
    items: tuple[Item, ...] = ()
    total: int | None = None
    timer: Timer = Timer()
    failure: str = ""
    mission_type: int = 0
    """-; MAV_MISSION_TYPE: mission, fence or rally points"""

    @property
    def finished(self) -> bool:
        """True once every item was heard."""
        return bool(self.failure) or (self.total is not None and len(self.items) >= self.total)

    def progress(self) -> Progress:
        """Items received, of how many."""
        note = f"got {len(self.items)} of {'?' if self.total is None else self.total} mission items"
        return Progress(len(self.items), self.total or 0, note + (", retrying" if self.timer.attempts > 1 else ""))

    def step(self, now: float, message: Any | None) -> tuple[MissionDownload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(now, message)
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"{self.progress().note.removesuffix(', retrying')}, then silence"), ()
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _heard(self, now: float, message: Any) -> tuple[MissionDownload, Outgoing]:
        kind = message.get_type()
        if getattr(message, "mission_type", self.mission_type) != self.mission_type:
            return self, ()
        if kind == "MISSION_COUNT" and self.total is None:
            return self._replace(total=message.count, timer=Timer())._next(now)
        if kind == "MISSION_ITEM_INT" and self.total is not None and message.seq == len(self.items):
            return self._replace(items=(*self.items, item_of(message)), timer=Timer())._next(now)
        if kind == "MISSION_ACK" and message.type != mavlink.MAV_MISSION_ACCEPTED:
            return self._replace(
                failure=f"the vehicle refused to send its mission: {mission_result(message.type)}"
            ), ()
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
    """MISSION_COUNT, then the items the vehicle asks for, until its MISSION_ACK."""

    target: Target
    items: tuple[Item, ...]
    sent: int = 0
    """-; highest item sent so far, plus one"""
    timer: Timer = Timer()
    accepted: bool = False
    reason: str = ""
    failure: str = ""
    mission_type: int = 0
    """-; MAV_MISSION_TYPE: mission, fence or rally points"""

    @property
    def finished(self) -> bool:
        """True once the vehicle acknowledged."""
        return self.accepted or bool(self.failure)

    def progress(self) -> Progress:
        """Items sent, of how many."""
        return Progress(self.sent, len(self.items), f"sent {self.sent} of {len(self.items)} mission items")

    def step(self, now: float, message: Any | None) -> tuple[MissionUpload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(now, message)
        # Once the vehicle asks for items the retries are its own; ours only covers a lost MISSION_COUNT.
        if self.finished or not self.timer.due(now, RETRY if self.sent == 0 else ATTEMPTS * RETRY):
            return self, ()
        if self.timer.spent or self.sent:
            return self._replace(failure=f"{self.progress().note}, then silence"), ()
        count = mavlink.MAVLink_mission_count_message(*self.target, len(self.items), self.mission_type)
        return self._replace(timer=self.timer.again(now)), (count,)

    def _heard(self, now: float, message: Any) -> tuple[MissionUpload, Outgoing]:
        kind = message.get_type()
        if kind == "STATUSTEXT":
            return self._replace(reason=text_of(message)), ()
        if getattr(message, "mission_type", self.mission_type) != self.mission_type:
            return self, ()
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(self.items):
            sent = max(self.sent, message.seq + 1)
            return self._replace(sent=sent, timer=self.timer.answered(now)), (self._item(message.seq),)
        if kind == "MISSION_ACK" and self.timer.sent_at > float("-inf"):
            return self._acknowledged(message.type), ()
        return self, ()

    def _acknowledged(self, result: int) -> MissionUpload:
        if result == mavlink.MAV_MISSION_ACCEPTED:
            return self._replace(accepted=True)
        reason = f": {self.reason}" if self.reason else ""
        return self._replace(failure=f"the vehicle refused the mission: {mission_result(result)}{reason}")

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
    """Words of a MAV_MISSION_RESULT."""
    entry = mavlink.enums["MAV_MISSION_RESULT"].get(result)
    return str(entry.name).removeprefix("MAV_MISSION_").lower().replace("_", " ") if entry else f"result {result}"
