"""Conversations with a MAVLink vehicle: commands, modes, parameters, missions, each with its retries.

An exchange is a value. ``step(now, message)`` takes the time (s, monotonic) and one message, or None when only time
went by, and returns the next value and the messages to send. Nothing here owns a clock or a socket, so a test plays
a lossy vehicle against it in no time. The retry rules are those of the MAVLink services "Command", "Parameter" and
"Mission" protocols.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, Self

from avionics.link.dialect import mavlink

Outgoing = tuple[Any, ...]

RETRY = 0.7
"""s; silence after which a request is repeated"""
ATTEMPTS = 6
"""requests without any answer before an exchange gives up"""
BATCH = 12
"""missing parameters asked for at once"""
EXPLANATION = 0.3
"""s; a vehicle has to say why it refused"""
LONG_WAIT = 15.0
"""s; allowed to a vehicle that answered IN_PROGRESS"""

SYSTEM = 255
COMPONENT = 190


class Target(NamedTuple):
    """Whom an exchange talks to."""

    system: int = 1
    """-; MAVLink system id"""
    component: int = 1
    """-; MAVLink component id"""


class Progress(NamedTuple):
    """How far an exchange is."""

    done: int
    """-; parts received or sent"""
    total: int
    """-; parts altogether, 0 while unknown"""
    note: str = ""
    """-; for people, such as "got 43 of 120 parameters, retrying\""""


class Exchange(Protocol):
    """A conversation that ends by itself, well or with a ``failure``."""

    @property
    def failure(self) -> str:
        """Why it failed, one line; empty while it did not."""

    @property
    def finished(self) -> bool:
        """True once it ended, well or badly."""

    def progress(self) -> Progress:
        """How far it is."""

    def step(self, now: float, message: Any | None) -> tuple[Self, Outgoing]:
        """Take one message, or the passing of time; return the next value and what to send."""


class Timer(NamedTuple):
    """When the last request went out, and how many went without an answer."""

    sent_at: float = float("-inf")
    """s; monotonic"""
    attempts: int = 0
    """-; since the last answer"""

    def due(self, now: float, wait: float = RETRY) -> bool:
        """Whether it is time to ask (again)."""
        return now - self.sent_at >= wait

    def again(self, now: float) -> Timer:
        """After a request was sent."""
        return Timer(now, self.attempts + 1)

    def answered(self, now: float) -> Timer:
        """After an answer came: the next request waits its full time."""
        return Timer(now, 0)

    @property
    def spent(self) -> bool:
        """Whether all attempts are used."""
        return self.attempts >= ATTEMPTS


# --- commands ---------------------------------------------------------------------------------------------


def text_of(message: Any) -> str:
    """One clean line out of a STATUSTEXT."""
    return chunk_of(message).strip()


def chunk_of(message: Any) -> str:
    """The printable text of a STATUSTEXT that may be a part of a longer one, its spaces kept."""
    text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else " " for letter in text.partition("\0")[0])


class CommandExchange(NamedTuple):
    """One COMMAND_LONG until its COMMAND_ACK (MAVLink command protocol)."""

    target: Target
    command: int
    """-; MAV_CMD"""
    parameters: tuple[float, ...] = ()
    """-; up to seven"""
    timer: Timer = Timer()
    in_progress: bool = False
    result: int | None = None
    """-; MAV_RESULT of the final acknowledgement"""
    reason: str = ""
    """-; last line the vehicle said meanwhile: why it refuses"""
    failure: str = ""
    percent: int = 0
    """-; how far the vehicle says that it is, while it is in progress"""

    @property
    def accepted(self) -> bool:
        """True once the vehicle said yes."""
        return self.result is not None and self.result == int(mavlink.MAV_RESULT_ACCEPTED)

    @property
    def finished(self) -> bool:
        """True once accepted, refused or given up."""
        return self.accepted or bool(self.failure)

    def progress(self) -> Progress:
        """One part, the acknowledgement; or what the vehicle says while it is in progress."""
        return Progress(self.percent, 100) if self.in_progress else Progress(int(self.finished), 1)

    def step(self, now: float, message: Any | None) -> tuple[CommandExchange, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(now, message), ()
        if self.finished:
            return self, ()
        if self.result is not None:
            return self._refused(now), ()
        if not self.timer.due(now, LONG_WAIT if self.in_progress else RETRY):
            return self, ()
        if self.timer.spent or self.in_progress:
            return self._replace(failure=f"no answer to {command_name(self.command)}"), ()
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _heard(self, now: float, message: Any) -> CommandExchange:
        kind = message.get_type()
        if kind == "STATUSTEXT" and self.timer.attempts and message.severity <= mavlink.MAV_SEVERITY_WARNING:
            return self._replace(reason=(self.reason if message.chunk_seq else "") + chunk_of(message))
        if kind != "COMMAND_ACK" or message.command != self.command or not self.timer.attempts:
            return self
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            percent = message.progress if message.progress <= 100 else 0
            return self._replace(in_progress=True, timer=Timer(now, 1), percent=percent)
        return self._replace(result=message.result, timer=Timer(now, 1))

    def _refused(self, now: float) -> CommandExchange:
        """Give the vehicle a moment to say why: its STATUSTEXT may come after the acknowledgement."""
        if not self.reason and not self.timer.due(now, EXPLANATION):
            return self
        return self._replace(failure=refusal(self.command, self.result or 0, self.reason.strip()))

    def _request(self) -> Any:
        values = (*self.parameters, *(0.0,) * (7 - len(self.parameters)))
        return mavlink.MAVLink_command_long_message(
            self.target.system, self.target.component, self.command, self.timer.attempts, *values
        )


class CalibrationExchange(NamedTuple):
    """A command that calibrates, and the parameters that the vehicle then announces."""

    request: CommandExchange
    changed: tuple[Parameter, ...] = ()
    """-; announced since the request"""
    ended_at: float | None = None
    """s; when the vehicle acknowledged its end"""
    settled: bool = False
    """-; the parameters have had the time to come"""

    @property
    def failure(self) -> str:
        """Why it failed, one line; empty while it did not."""
        return self.request.failure

    @property
    def finished(self) -> bool:
        """True once refused, or once ended and settled."""
        return bool(self.failure) or self.settled

    def progress(self) -> Progress:
        """What the vehicle says."""
        return self.request.progress()

    def step(self, now: float, message: Any | None) -> tuple[CalibrationExchange, Outgoing]:
        """See `Exchange.step`."""
        request, outgoing = self.request.step(now, message)
        changed = self.changed
        if message is not None and message.get_type() == "PARAM_VALUE":
            changed = (*changed, decode_parameter(message, bytewise=False))
        ended_at = now if request.accepted and self.ended_at is None else self.ended_at
        settled = ended_at is not None and now - ended_at > EXPLANATION
        return CalibrationExchange(request, changed, ended_at, settled), outgoing


def command_name(command: int) -> str:
    """Name of a MAV_CMD without its prefix, or its number."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return str(entry.name).removeprefix("MAV_CMD_") if entry else f"command {command}"


def refusal(command: int, result: int, reason: str) -> str:
    """One line that says who refused what, and the vehicle's own words where it gave any."""
    entry = mavlink.enums["MAV_RESULT"].get(result)
    name = str(entry.name).removeprefix("MAV_RESULT_").lower().replace("_", " ") if entry else f"result {result}"
    return f"the vehicle refused {command_name(command)}: {reason or name}"


class ModeChange(NamedTuple):
    """DO_SET_MODE until a HEARTBEAT shows the mode: an acknowledgement alone does not prove it."""

    request: CommandExchange
    custom_mode: int
    """-; as HEARTBEAT will show it"""
    confirmed: bool = False
    accepted_at: float | None = None
    timed_out: bool = False

    @property
    def failure(self) -> str:
        """Why it failed, one line."""
        if self.timed_out:
            return "the vehicle accepted the mode but did not change to it" + self._because()
        return self.request.failure

    def _because(self) -> str:
        return f": {self.request.reason}" if self.request.reason else ""

    @property
    def finished(self) -> bool:
        """True once the heartbeat shows the mode, or it failed."""
        return self.confirmed or bool(self.failure)

    def progress(self) -> Progress:
        """Two parts: acknowledged, and shown."""
        return Progress(int(self.request.finished) + int(self.confirmed), 2)

    def step(self, now: float, message: Any | None) -> tuple[ModeChange, Outgoing]:
        """See `Exchange.step`."""
        if message is not None and message.get_type() == "HEARTBEAT" and self.request.timer.attempts:
            return self._replace(confirmed=message.custom_mode == self.custom_mode), ()
        request, outgoing = self.request.step(now, message)
        accepted_at = self.accepted_at
        if request.accepted and accepted_at is None:
            accepted_at = now
        late = accepted_at is not None and now - accepted_at > ATTEMPTS * RETRY
        return self._replace(request=request, accepted_at=accepted_at, timed_out=late), outgoing


def change_mode(target: Target, custom_mode: int, main_and_sub: bool) -> ModeChange:
    """Build the exchange; ``main_and_sub`` for the custom modes of PX4's layout (main << 16 | sub << 24)."""
    numbers = (custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF) if main_and_sub else (custom_mode, 0)
    flags = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    command = CommandExchange(target, mavlink.MAV_CMD_DO_SET_MODE, (flags, float(numbers[0]), float(numbers[1])))
    return ModeChange(command, custom_mode)


class ModeNames(NamedTuple):
    """Ask for AVAILABLE_MODES; a vehicle without them is no failure."""

    request: CommandExchange
    names: Mapping[int, str] = {}
    """custom mode to name"""
    total: int | None = None
    heard_at: float | None = None
    failure: str = ""
    given_up: bool = False

    @property
    def finished(self) -> bool:
        """True once all names are known, or the vehicle has none."""
        return self.given_up or (self.total is not None and len(self.names) >= self.total)

    def progress(self) -> Progress:
        """Modes heard of."""
        return Progress(len(self.names), self.total or 0)

    def step(self, now: float, message: Any | None) -> tuple[ModeNames, Outgoing]:
        """See `Exchange.step`."""
        if message is not None and message.get_type() == "AVAILABLE_MODES":
            name = str(message.mode_name).partition("\0")[0].strip()
            names = {**self.names, message.custom_mode: name}
            return self._replace(names=names, total=message.number_modes, heard_at=now), ()
        request, outgoing = self.request.step(now, message)
        quiet = self.heard_at is not None and now - self.heard_at > 2 * RETRY
        return self._replace(request=request, given_up=bool(request.failure) or quiet), outgoing


def request_mode_names(target: Target) -> ModeNames:
    """Build the exchange that asks a vehicle for the names of its modes."""
    wanted = (float(mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES), 0.0)
    return ModeNames(CommandExchange(target, mavlink.MAV_CMD_REQUEST_MESSAGE, wanted))


# --- parameters -------------------------------------------------------------------------------------------

_INTEGER_LAYOUT = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i"}


class Parameter(NamedTuple):
    """One parameter of the vehicle."""

    name: str
    """-; at most 16 characters"""
    value: float | int
    """-; in the vehicle's own unit"""
    kind: int
    """-; MAV_PARAM_TYPE"""
    number: int
    """-; in the vehicle's list, 65535 when not said"""


def decode_parameter(message: Any, bytewise: bool) -> Parameter:
    """Read a PARAM_VALUE; ``bytewise`` for vehicles that send integers as the float's bytes (PX4's way)."""
    value: float | int = message.param_value
    layout = _INTEGER_LAYOUT.get(message.param_type)
    if layout is not None:
        value = int(struct.unpack(layout, struct.pack("<f", value))[0]) if bytewise else round(value)
    return Parameter(_name(message), value, message.param_type, message.param_index)


def encode_value(value: float, kind: int, bytewise: bool) -> float:
    """The float that carries ``value`` on the wire.

    Raises:
        ValueError: the value does not fit the parameter's integer type.
    """
    layout = _INTEGER_LAYOUT.get(kind)
    if layout is None:
        return float(value)
    if value != int(value):
        raise ValueError(f"{value:g} is not a whole number")
    try:
        packed = struct.pack(layout, int(value))
    except struct.error:
        raise ValueError(f"{value:g} does not fit the parameter's type") from None
    if not bytewise:
        return float(value)
    carried = float(struct.unpack("<f", packed)[0])
    if struct.pack("<f", carried) != packed:
        # The bytes are those of a signalling NaN, which arithmetic silences on its way.
        raise ValueError(f"{value:g} cannot be carried by MAVLink's float")
    return carried


def _name(message: Any) -> str:
    name = message.param_id
    return (name if isinstance(name, str) else name.decode("ascii", "replace")).partition("\0")[0]


class ParameterDownload(NamedTuple):
    """The whole list; what is missing after a silence is asked for by index."""

    target: Target
    bytewise: bool = False
    values: Mapping[int, Parameter] = {}
    """index to parameter"""
    total: int | None = None
    timer: Timer = Timer()
    retrying: bool = False
    failure: str = ""

    @property
    def finished(self) -> bool:
        """True once every index was heard, or nothing more comes."""
        return bool(self.failure) or (self.total is not None and len(self.values) >= self.total)

    def progress(self) -> Progress:
        """Parameters received, of how many."""
        note = f"got {len(self.values)} of {self.total or '?'} parameters"
        return Progress(len(self.values), self.total or 0, note + (", retrying" if self.retrying else ""))

    def step(self, now: float, message: Any | None) -> tuple[ParameterDownload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(now, message), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"{self.progress().note.removesuffix(', retrying')}, then silence"), ()
        asked = self._replace(timer=self.timer.again(now), retrying=self.timer.attempts > 0 or self.total is not None)
        return asked, self._requests()

    def _heard(self, now: float, message: Any) -> ParameterDownload:
        if message.get_type() != "PARAM_VALUE" or message.param_index >= message.param_count:
            return self
        values = {**self.values, message.param_index: decode_parameter(message, self.bytewise)}
        return self._replace(values=values, total=message.param_count, timer=self.timer.answered(now))

    def _requests(self) -> Outgoing:
        if self.total is None:
            return (mavlink.MAVLink_param_request_list_message(*self.target),)
        missing = [index for index in range(self.total) if index not in self.values]
        return tuple(
            mavlink.MAVLink_param_request_read_message(*self.target, b"", index) for index in missing[:BATCH]
        )


class ParameterRead(NamedTuple):
    """One parameter by its name."""

    target: Target
    name: str
    bytewise: bool = False
    value: Parameter | None = None
    timer: Timer = Timer()
    failure: str = ""

    @property
    def finished(self) -> bool:
        """True once it was heard, or is known not to exist."""
        return self.value is not None or bool(self.failure)

    def progress(self) -> Progress:
        """One part."""
        return Progress(int(self.value is not None), 1)

    def step(self, now: float, message: Any | None) -> tuple[ParameterRead, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(message), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"no answer about parameter {self.name}: does it exist?"), ()
        request = mavlink.MAVLink_param_request_read_message(*self.target, self.name.encode(), -1)
        return self._replace(timer=self.timer.again(now)), (request,)

    def _heard(self, message: Any) -> ParameterRead:
        kind = message.get_type()
        if kind == "PARAM_ERROR" and _name(message) == self.name:
            return self._replace(failure=f"the vehicle has no parameter {self.name}")
        if kind == "PARAM_VALUE" and _name(message) == self.name:
            return self._replace(value=decode_parameter(message, self.bytewise))
        return self


class ParameterWrite(NamedTuple):
    """Set one parameter; the answer says what the vehicle made of it."""

    target: Target
    known: Parameter
    """as read before: name and type"""
    value: float
    """-; asked for"""
    bytewise: bool = False
    answer: Parameter | None = None
    timer: Timer = Timer()
    reason: str = ""
    """-; what the vehicle said meanwhile: why it refuses, and what it allows"""
    failure: str = ""
    kept: Parameter | None = None
    """what the vehicle holds instead of the value asked for"""
    error: int | None = None
    """-; MAV_PARAM_ERROR"""

    @property
    def finished(self) -> bool:
        """True once the vehicle answered."""
        return self.answer is not None or bool(self.failure)

    def progress(self) -> Progress:
        """One part."""
        return Progress(int(self.answer is not None), 1)

    def step(self, now: float, message: Any | None) -> tuple[ParameterWrite, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._heard(now, message), ()
        if not self.finished and (self.kept is not None or self.error is not None):
            return self._refused(now), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"no answer to setting {self.known.name}"), ()
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _heard(self, now: float, message: Any) -> ParameterWrite:
        kind = message.get_type()
        if kind == "STATUSTEXT" and self.timer.attempts and message.severity <= mavlink.MAV_SEVERITY_WARNING:
            return self._replace(reason=(self.reason if message.chunk_seq else "") + chunk_of(message))
        if not self.timer.attempts or kind not in ("PARAM_VALUE", "PARAM_ERROR") or _name(message) != self.known.name:
            return self
        if kind == "PARAM_ERROR":
            return self._replace(error=message.error, timer=Timer(now, 1))
        answer = decode_parameter(message, self.bytewise)
        if not _same(answer.value, self.value):
            return self._replace(kept=answer, timer=Timer(now, 1))
        return self._replace(answer=answer)

    def _refused(self, now: float) -> ParameterWrite:
        """Give the vehicle a moment to say what it allows: PARAM_ERROR and STATUSTEXT follow PARAM_VALUE."""
        if not self.reason and not self.timer.due(now, EXPLANATION):
            return self
        return self._replace(failure=f"{self._denial()}{self._because()}")

    def _denial(self) -> str:
        if self.error is not None or self.kept is None:
            return f"the vehicle refused to set {self.known.name} = {self.value:g}"
        return f"the vehicle kept {self.known.name} = {self.kept.value:g}, not {self.value:g}"

    def _because(self) -> str:
        entry = None if self.error is None else mavlink.enums["MAV_PARAM_ERROR"].get(self.error)
        words = "" if entry is None else str(entry.name).removeprefix("MAV_PARAM_ERROR_").lower().replace("_", " ")
        reason = self.reason.strip() or words
        return f": {reason}" if reason else ""

    def _request(self) -> Any:
        wire = encode_value(self.value, self.known.kind, self.bytewise)
        return mavlink.MAVLink_param_set_message(*self.target, self.known.name.encode(), wire, self.known.kind)


def _same(first: float, second: float) -> bool:
    """Equal after a round trip through the wire's single-precision float."""
    return abs(first - second) <= 1e-6 * max(abs(first), abs(second), 1e-9)


# --- missions ---------------------------------------------------------------------------------------------


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
