"""Mission protocol: transfer of missions, fences and rally points.

Further messages select the current item and report reached ones. A list is transferred item by item, each requested
and requested again after a timeout; the flight core receives only complete lists.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from avionics import topics
from avionics.link import telemetry
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import Addressee, Slot, notes, read_message, with_altitude, write_message
from avionics.link.services.plans import MOST_ITEMS, PlanPart, assumed_home, plan_parts
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.setpoints import GUIDED_ALTITUDE, GUIDED_WAYPOINT
from avionics.link.services.statustext import refusal_text
from avionics.link.vehicle import Home, LinkGains, VehicleView
from avionics.link.wire_item import HomeUnknown, ItemRefused, WireItem
from avionics.messages import Command, CommandKind, Mode
from wingbeat.text import pluralize

_MISSION = mavlink.MAV_MISSION_TYPE_MISSION
_ALL = mavlink.MAV_MISSION_TYPE_ALL
_ACCEPTED = mavlink.MAV_MISSION_ACCEPTED


@dataclass
class _Upload:
    sender: Sender
    part: PlanPart
    count: int
    deadline: float
    requests: int = 1
    as_int: bool = True
    """True if requested by MISSION_REQUEST_INT; older stations use MISSION_REQUEST"""
    items: list[WireItem] = field(default_factory=list)


class _Pending(NamedTuple):
    sender: Sender
    part: PlanPart
    content: Any
    items: int
    mission_type: int
    """type as received: one type, or all of them"""
    deadline: float
    notes: tuple[str, ...] = ()
    """notices to the operator after acceptance"""
    answered: bool = False
    """True once its sender has received the MISSION_ACK"""
    sent: tuple[WireItem, ...] = ()
    """items as received"""


class _Encoded(NamedTuple):
    """Encoded list of the last request, valid until the list or home changes."""

    content: Any
    home: Home | None
    items: tuple[WireItem, ...]


class MissionService:
    """Service for MISSION_* messages."""

    takes = frozenset(
        {
            "MISSION_COUNT",
            "MISSION_ITEM",
            "MISSION_ITEM_INT",
            "MISSION_REQUEST_LIST",
            "MISSION_REQUEST",
            "MISSION_REQUEST_INT",
            "MISSION_CLEAR_ALL",
            "MISSION_SET_CURRENT",
            "MISSION_ACK",
            "MISSION_WRITE_PARTIAL_LIST",
            "MISSION_REQUEST_PARTIAL_LIST",
        }
    )

    def __init__(self, vehicle: VehicleView, gains: LinkGains, first_item: int = 0) -> None:
        """Create the service; ``first_item`` is `Identity.first_item`."""
        self._vehicle = vehicle
        self._gains = gains
        self._first = first_item
        self._parts = plan_parts(first_item)
        self._upload: _Upload | None = None
        self._without_home: dict[int, _Upload] = {}
        """accepted lists by mission type that require home for their positions"""
        self._pending: list[_Pending] = []
        self._done: tuple[Sender, int, int] | None = None
        self._as_sent: dict[int, tuple[Any, tuple[WireItem, ...]]] = {}
        """lists on board by mission type, and their items as received, so that a download returns every parameter"""
        self._item = 0
        self._encoded: dict[int, _Encoded] = {}

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process one message of a transfer."""
        kind = message.get_type()
        if kind in ("MISSION_ITEM", "MISSION_ITEM_INT"):
            return self._take_item(message, sender, now)
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            return self._give_item(message, sender, as_int=kind == "MISSION_REQUEST_INT")
        if kind == "MISSION_COUNT":
            return self._begin(message, sender, now)
        if kind == "MISSION_REQUEST_LIST":
            return [self._count(message.mission_type, sender)]
        if kind == "MISSION_CLEAR_ALL":
            return self._clear(message.mission_type, sender, now)
        if kind == "MISSION_SET_CURRENT":
            return self._set_current(message.seq, sender)
        if kind == "MISSION_ACK":
            return self._cancelled(message, sender, now)
        return [_ack(sender, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)]

    # --- upload

    def _begin(self, message: Any, sender: Sender, now: float) -> list[Output]:
        mission_type = message.mission_type
        part = self._parts.get(mission_type)
        if part is None:
            return [_ack(sender, mavlink.MAV_MISSION_UNSUPPORTED, mission_type)]
        if self._busy_with_another(sender):
            denied = _ack(sender, mavlink.MAV_MISSION_DENIED, mission_type)
            return [denied, *refusal_text("another mission upload runs", sender)]
        if message.count > MOST_ITEMS:
            text = f"a mission has at most {MOST_ITEMS} items"
            return [_ack(sender, mavlink.MAV_MISSION_NO_SPACE, mission_type), *refusal_text(text, sender)]
        reason = self._vehicle.refusal(self._command(part, part.none, sender))
        if reason:
            return [_ack(sender, mavlink.MAV_MISSION_DENIED, mission_type), *refusal_text(reason, sender)]
        if message.count == 0:
            return self._install(_Pending(sender, part, part.none, 0, mission_type, self._deadline(now)))
        self._upload = _Upload(sender, part, message.count, now + self._gains.retry_interval)
        return [_request(self._upload)]

    def _busy_with_another(self, sender: Sender) -> bool:
        """Return whether an upload of another station is active and has not timed out."""
        upload = self._upload
        return upload is not None and upload.sender != sender and upload.requests <= self._gains.yield_after

    def _deadline(self, now: float) -> float:
        return now + self._gains.confirm

    def _take_item(self, message: Any, sender: Sender, now: float) -> list[Output]:
        upload = self._upload
        if message.current in (GUIDED_WAYPOINT, GUIDED_ALTITUDE):
            return []  # `SetpointService` answers it
        if upload is None or upload.sender != sender:
            repeated = self._done is not None and self._done == (sender, message.seq, message.mission_type)
            return [_ack(sender, _ACCEPTED, message.mission_type)] if repeated else []
        if message.seq != len(upload.items) or message.mission_type != upload.part.mission_type:
            return []
        item = with_altitude(read_message(message), upload.items)
        try:
            upload.part.probe(message.seq, item, self._vehicle.home or assumed_home([*upload.items, item]))
        except ItemRefused as refused:
            return self._refuse(upload, refused, f"mission item {message.seq}: {refused}")
        upload.items.append(item)
        upload.as_int = message.get_type() == "MISSION_ITEM_INT"
        upload.requests, upload.deadline = 1, now + self._gains.retry_interval
        return [_request(upload)] if len(upload.items) < upload.count else self._complete(upload, now)

    def _refuse(self, upload: _Upload, refused: ItemRefused, text: str) -> list[Output]:
        self._upload = None if self._upload is upload else self._upload
        return [_ack(upload.sender, refused.result, upload.part.mission_type), *refusal_text(text, upload.sender)]

    def _complete(self, upload: _Upload, now: float) -> list[Output]:
        self._upload = None if self._upload is upload else self._upload
        part, items = upload.part, upload.items
        try:
            content = part.decode(items, self._vehicle.home)
        except HomeUnknown:
            return self._wait_for_home(upload)
        except ItemRefused as refused:
            return self._refuse(upload, refused, str(refused))
        lines = notes(items, self._first) if part.mission_type == _MISSION else ()
        deadline = self._deadline(now)
        pending = _Pending(upload.sender, part, content, len(items), part.mission_type, deadline, lines)
        return self._install(pending._replace(sent=tuple(items)))

    def _wait_for_home(self, upload: _Upload) -> list[Output]:
        """Accept a list that requires home; it is set once home is known."""
        mission_type, items = upload.part.mission_type, upload.items
        try:
            upload.part.decode(items, assumed_home(items))
        except ItemRefused as refused:
            return self._refuse(upload, refused, str(refused))
        self._without_home[mission_type] = upload
        self._done = (upload.sender, len(items) - 1, mission_type)
        text = f"{pluralize(len(items), 'item')} accepted; they are checked once the GPS gives home"
        return [_ack(upload.sender, _ACCEPTED, mission_type), *refusal_text(text, upload.sender)]

    def _at_home(self, now: float) -> list[Output]:
        """Set the lists that required home; report a denial to the sender."""
        waiting, self._without_home = self._without_home, {}
        outputs: list[Output] = []
        for upload in waiting.values():
            outputs += [each for each in self._complete(upload, now) if not _is_ack(each)]
            self._pending = [
                each._replace(answered=True) if each.sender == upload.sender and each.part == upload.part else each
                for each in self._pending
            ]
        return outputs

    def _install(self, pending: _Pending) -> list[Output]:
        sender = pending.sender
        self._without_home.pop(pending.part.mission_type, None)
        command = self._command(pending.part, pending.content, sender)
        reason = self._vehicle.refusal(command)
        if reason:
            denied = _ack(sender, mavlink.MAV_MISSION_DENIED, pending.mission_type)
            return [denied, *refusal_text(reason, sender)]
        self._pending.append(pending)
        return [command]

    def _command(self, part: PlanPart, content: Any, sender: Sender) -> Command:
        return Command(self._vehicle.time_us, part.kind, "", 0.0, content, sender.name)

    def _clear(self, mission_type: int, sender: Sender, now: float) -> list[Output]:
        """Clear one list, or all; the result for all is that of the mission."""
        if mission_type != _ALL and mission_type not in self._parts:
            return [_ack(sender, _ACCEPTED, mission_type)]
        part = self._parts[_MISSION if mission_type == _ALL else mission_type]
        cleared = self._install(_Pending(sender, part, part.none, 0, mission_type, self._deadline(now)))
        if mission_type != _ALL or isinstance(cleared[0], Reply):
            return cleared
        self._without_home.clear()
        others = [part for part in self._parts.values() if part.mission_type != _MISSION]
        return [*(self._command(part, part.none, sender) for part in others), *cleared]

    def _set_current(self, sequence: int, sender: Sender) -> list[Output]:
        item = float(self.item(sequence))
        command = Command(self._vehicle.time_us, CommandKind.SET_CURRENT_ITEM, "", item, None, sender.name)
        reason = self.current_refusal(sequence) or self._vehicle.refusal(command)
        if reason:
            return list(refusal_text(reason, sender))
        # The flight core selects the item at its next tick; MAVSDK repeats the message until the number matches.
        return [command, Reply(telemetry.mission_current(self._vehicle, self._first, sequence))]

    def item(self, sequence: int) -> int:
        """Return the mission item of a wire number; home represents the first one."""
        return max(sequence - self._first, 0)

    def current_refusal(self, sequence: int) -> str:
        """Return why the item of a wire number cannot be selected; empty if it can."""
        count = len(self._vehicle.mission)
        known = sequence >= 0 and self.item(sequence) < count
        return "" if known else f"there is no mission item {sequence}, only {pluralize(count, 'item')}"

    def _cancelled(self, message: Any, sender: Sender, now: float) -> list[Output]:
        upload = self._upload
        if upload is None or upload.sender != sender or message.type == _ACCEPTED:
            return []
        if message.type == mavlink.MAV_MISSION_UNSUPPORTED and not upload.as_int:
            return self._retry(upload, now)  # MAVSDK refuses MISSION_REQUEST, not the mission
        self._upload = None
        return []

    # --- download

    def _count(self, mission_type: int, sender: Sender) -> Output:
        count = len(self._items(mission_type))
        return Reply(
            mavlink.MAVLink_mission_count_message(sender.system, sender.component, count, mission_type), sender
        )

    def _give_item(self, message: Any, sender: Sender, as_int: bool) -> list[Output]:
        items = self._items(message.mission_type)
        if message.seq >= len(items):
            return [_ack(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)]
        navigation = self._vehicle.latest(topics.NAVIGATION)
        flown = (
            message.mission_type == _MISSION
            and navigation is not None
            and navigation.item + self._first == message.seq
        )
        slot = Slot(message.seq, flown, message.mission_type)
        to = Addressee(sender.system, sender.component)
        return [Reply(write_message(items[message.seq], slot, to, as_int), sender)]

    def _items(self, mission_type: int) -> tuple[WireItem, ...]:
        """Return the wire items of a list, encoded once for all requests."""
        part = self._parts.get(mission_type)
        if part is None:
            return ()
        if mission_type in self._without_home:
            return tuple(self._without_home[mission_type].items)
        content, home = part.on_board(self._vehicle), self._vehicle.home
        known = self._encoded.get(mission_type)
        if known is None or known.content is not content or known.home != home:
            items = part.encode(content, home)
            sent_content, sent = self._as_sent.get(mission_type, (None, ()))
            if sent_content is content and len(sent) == len(items):
                first = self._first if mission_type == _MISSION else 0
                items = (*items[:first], *sent[first:])
            known = self._encoded[mission_type] = _Encoded(content, home, items)
        return known.items

    # --- periodic

    def step(self, now: float) -> list[Output]:
        """Confirm accepted lists, repeat requests after a timeout, report reached items."""
        outputs: list[Output] = []
        if self._without_home and self._vehicle.home is not None:
            outputs += self._at_home(now)
        if self._pending:
            outputs += self._confirm(now)
        if self._upload is not None and now >= self._upload.deadline:
            outputs += self._retry(self._upload, now)
        navigation = self._vehicle.latest(topics.NAVIGATION)
        if navigation is not None and navigation.item != self._item:
            outputs += self._reached(navigation.item)
        return outputs

    def _confirm(self, now: float) -> list[Output]:
        settled = [each for each in self._pending if self._on_board(each) or now >= each.deadline]
        self._pending = [each for each in self._pending if each not in settled]
        return [output for each in settled for output in self._settle(each)]

    def _on_board(self, pending: _Pending) -> bool:
        return bool(pending.part.on_board(self._vehicle) == pending.content)

    def _settle(self, pending: _Pending) -> list[Output]:
        taken = self._on_board(pending)
        if taken:
            self._as_sent[pending.part.mission_type] = (pending.content, pending.sent)
            self._done = (pending.sender, pending.items - 1, pending.mission_type)
        ack = _ack(pending.sender, _ACCEPTED if taken else mavlink.MAV_MISSION_ERROR, pending.mission_type)
        lines = pending.notes if taken else ()
        return [
            *([] if pending.answered else [ack]),
            *(text for line in lines for text in refusal_text(line, pending.sender)),
        ]

    def _retry(self, upload: _Upload, now: float) -> list[Output]:
        if upload.requests >= self._gains.give_up:
            self._upload = None
            return [_ack(upload.sender, mavlink.MAV_MISSION_OPERATION_CANCELLED, upload.part.mission_type)]
        upload.requests += 1
        upload.as_int = not upload.as_int
        upload.deadline = now + self._gains.retry_interval
        return [_request(upload)]

    def _reached(self, item: int) -> list[Output]:
        before, self._item = self._item, item
        if item < before or self._vehicle.mode != Mode.AUTO:
            return []
        return [Reply(mavlink.MAVLink_mission_item_reached_message(before + self._first))]


def _request(upload: _Upload) -> Reply:
    sender = upload.sender
    build = mavlink.MAVLink_mission_request_int_message if upload.as_int else mavlink.MAVLink_mission_request_message
    return Reply(build(sender.system, sender.component, len(upload.items), upload.part.mission_type), sender)


def _is_ack(output: Output) -> bool:
    return isinstance(output, Reply) and isinstance(output.message, mavlink.MAVLink_mission_ack_message)


def _ack(sender: Sender, result: int, mission_type: int = _MISSION) -> Reply:
    message = mavlink.MAVLink_mission_ack_message(sender.system, sender.component, result, mission_type)
    return Reply(message, sender)
