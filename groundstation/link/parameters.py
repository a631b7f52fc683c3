"""Parameter transactions: the list, one parameter, setting one."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.exchange import EXPLANATION, Outgoing, Progress, Target, Timer, explained
from groundstation.link.modes import PX4
from groundstation.link.vehicle_state import VehicleState

BATCH = 12
"""number of missing parameters requested at once"""
DOUBTED = 3
"""transmissions of a value before a response with the old value counts: on a slow link it may belong to a read"""
_INTEGER_LAYOUT = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i"}


class Parameter(NamedTuple):
    """One parameter of the vehicle."""

    name: str
    """-; at most 16 characters"""
    value: float | int
    """-; in the vehicle's unit"""
    kind: int
    """-; MAV_PARAM_TYPE"""
    number: int
    """-; index in the vehicle's list, 65535 if unspecified"""


def decode_parameter(message: Any, bytewise: bool) -> Parameter:
    """Read a PARAM_VALUE; ``bytewise`` for vehicles that send integers as the float's bytes (PX4's way)."""
    value: float | int = message.param_value
    layout = _INTEGER_LAYOUT.get(message.param_type)
    if layout is not None:
        value = int(struct.unpack(layout, struct.pack("<f", value))[0]) if bytewise else round(value)
    return Parameter(_name(message), value, message.param_type, message.param_index)


def encode_value(value: float, kind: int, bytewise: bool) -> float:
    """Return the float that carries ``value`` on the wire.

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
        # The bytes may be a signaling NaN, which floating-point operations would change.
        raise ValueError(f"{value:g} cannot be carried by MAVLink's float")
    return carried


def _name(message: Any) -> str:
    name = message.param_id
    return (name if isinstance(name, str) else name.decode("ascii", "replace")).partition("\0")[0]


def is_bytewise(state: VehicleState) -> bool:
    """Return whether a vehicle sends integers as the float's bytes, from its capabilities or its type."""
    capabilities = state.capabilities or 0
    if capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE:
        return True
    if capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST:
        return False
    return state.autopilot == PX4


class ParameterDownload(NamedTuple):
    """Download of all parameters; missing ones are requested by index after a timeout."""

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
        """Whether every index was received, or the download ended."""
        return bool(self.failure) or (self.total is not None and len(self.values) >= self.total)

    def progress(self) -> Progress:
        """Parameters received, and their total."""
        note = f"got {len(self.values)} of {self.total or '?'} parameters"
        return Progress(len(self.values), self.total or 0, note + (", retrying" if self.retrying else ""))

    def step(self, now: float, message: Any | None) -> tuple[ParameterDownload, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(now, message), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"{self.progress().note.removesuffix(', retrying')}, then timed out"), ()
        asked = self._replace(timer=self.timer.again(now), retrying=self.timer.attempts > 0 or self.total is not None)
        return asked, self._requests()

    def _on_message(self, now: float, message: Any) -> ParameterDownload:
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


def _retrying(timer: Timer, name: str) -> str:
    return f"no response for {name} yet, retrying" if timer.attempts > 1 else ""


class ParameterRead(NamedTuple):
    """Read of one parameter by name."""

    target: Target
    name: str
    bytewise: bool = False
    value: Parameter | None = None
    timer: Timer = Timer()
    failure: str = ""

    @property
    def finished(self) -> bool:
        """Whether it was received, or does not exist."""
        return self.value is not None or bool(self.failure)

    def progress(self) -> Progress:
        """One part."""
        return Progress(int(self.value is not None), 1, _retrying(self.timer, self.name))

    def step(self, now: float, message: Any | None) -> tuple[ParameterRead, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(message), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"no response for parameter {self.name}: check its name"), ()
        request = mavlink.MAVLink_param_request_read_message(*self.target, self.name.encode(), -1)
        return self._replace(timer=self.timer.again(now)), (request,)

    def _on_message(self, message: Any) -> ParameterRead:
        kind = message.get_type()
        if kind == "PARAM_ERROR" and _name(message) == self.name:
            return self._replace(failure=f"the vehicle has no parameter {self.name}")
        if kind == "PARAM_VALUE" and _name(message) == self.name:
            return self._replace(value=decode_parameter(message, self.bytewise))
        return self


class ParameterWrite(NamedTuple):
    """Write of one parameter; the response has the value that the vehicle stored."""

    target: Target
    known: Parameter
    """as read before: name and type"""
    value: float
    """-; requested"""
    bytewise: bool = False
    answer: Parameter | None = None
    timer: Timer = Timer()
    reason: str = ""
    """-; STATUSTEXT meanwhile: reason and limits of a denial"""
    failure: str = ""
    kept: Parameter | None = None
    """value that the vehicle stored instead of the requested one"""
    error: int | None = None
    """-; MAV_PARAM_ERROR"""

    @property
    def finished(self) -> bool:
        """Whether the vehicle responded."""
        return self.answer is not None or bool(self.failure)

    def progress(self) -> Progress:
        """One part."""
        return Progress(int(self.answer is not None), 1, _retrying(self.timer, self.known.name))

    def step(self, now: float, message: Any | None) -> tuple[ParameterWrite, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(now, message), ()
        if not self.finished and (self.kept is not None or self.error is not None):
            return self._refused(now), ()
        if self.finished or not self.timer.due(now):
            return self, ()
        if self.timer.spent:
            return self._replace(failure=f"no response to setting {self.known.name}"), ()
        return self._replace(timer=self.timer.again(now)), (self._request(),)

    def _on_message(self, now: float, message: Any) -> ParameterWrite:
        kind = message.get_type()
        if kind == "STATUSTEXT" and self.timer.attempts:
            return self._replace(reason=explained(self.reason, message))
        if not self.timer.attempts or kind not in ("PARAM_VALUE", "PARAM_ERROR") or _name(message) != self.known.name:
            return self
        if kind == "PARAM_ERROR":
            return self._replace(error=message.error, timer=Timer(now, 1))
        answer = decode_parameter(message, self.bytewise)
        if not same(answer.value, self.value):
            if same(answer.value, self.known.value) and self.timer.attempts < DOUBTED:
                return self
            return self._replace(kept=answer, timer=Timer(now, 1))
        return self._replace(answer=answer)

    def _refused(self, now: float) -> ParameterWrite:
        """Wait for the limits: PARAM_ERROR and STATUSTEXT follow PARAM_VALUE."""
        if not self.reason and not self.timer.due(now, EXPLANATION):
            return self
        return self._replace(failure=f"{self._denial()}{self._because()}")

    def _denial(self) -> str:
        if self.error is not None or self.kept is None:
            return f"parameter rejected: {self.known.name} = {self.value:g}"
        return f"{self.known.name} is {self.kept.value:g} after the request of {self.value:g}"

    def _because(self) -> str:
        entry = None if self.error is None else mavlink.enums["MAV_PARAM_ERROR"].get(self.error)
        words = "" if entry is None else str(entry.name).removeprefix("MAV_PARAM_ERROR_").lower().replace("_", " ")
        reason = self.reason.strip() or words
        return f": {reason}" if reason else ""

    def _request(self) -> Any:
        wire = encode_value(self.value, self.known.kind, self.bytewise)
        return mavlink.MAVLink_param_set_message(*self.target, self.known.name.encode(), wire, self.known.kind)


def same(first: float, second: float) -> bool:
    """Return whether two values are equal after a round trip through the single-precision float."""
    return abs(first - second) <= 1e-6 * max(abs(first), abs(second), 1e-9)
