"""Parameter service: list, read by name or index, set.

A set is always answered by PARAM_VALUE, once the flight core has set the value or after a timeout, with the value in
use. Consecutive sets of one parameter have one answer, to the last. A value changed by other means, such as a
calibration, is sent to all stations.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.link.budget import PARAMETERS, Capacity
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.statustext import refusal_text
from avionics.link.vehicle import LinkGains, Parameter, VehicleView
from avionics.messages import Command, CommandKind

_ROUNDING = 2e-7
"""-; relative rounding error: PARAM_VALUE has 24 bits"""


VALUE_BYTES = 50.0
"""bytes; size of a signed PARAM_VALUE"""
MOST_LISTS = 16
"""concurrent lists on one link, equal to its stations; a further one ends the oldest"""


class _Pending(NamedTuple):
    value: float
    deadline: float


class ParameterService:
    """Service for PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""

    takes = frozenset({"PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})

    def __init__(self, vehicle: VehicleView, gains: LinkGains, capacities: Sequence[Capacity]) -> None:
        """Create the service; ``capacities`` return the bytes that each link accepts now."""
        self._vehicle = vehicle
        self._gains = gains
        self._capacities = capacities
        self._index = {parameter.name: number for number, parameter in enumerate(vehicle.parameters)}
        self._lists: dict[Sender, int] = {}
        self._pending: dict[int, _Pending] = {}
        self._shown = vehicle.parameters

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Begin a list, answer a read request, or pass a set to the flight core."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._begin_list(sender)
            return []
        if kind == "PARAM_REQUEST_READ":
            return self._read(message, sender)
        return self._set(message, sender, now)

    def _begin_list(self, sender: Sender) -> None:
        """Begin a list; a repeated request keeps its position in the queue."""
        if sender not in self._lists:
            waiting = [other for other in self._lists if other.link == sender.link]
            for oldest in waiting[: max(len(waiting) + 1 - MOST_LISTS, 0)]:
                del self._lists[oldest]
        self._lists[sender] = 0

    def _read(self, message: Any, sender: Sender) -> list[Output]:
        index = message.param_index
        if index < 0:
            index = self._index.get(message.param_id, -1)
        if not 0 <= index < len(self._index):
            return [_error(message.param_id, message.param_index, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST, sender)]
        return [Reply(self._value(index), sender)]

    def _set(self, message: Any, sender: Sender, now: float) -> list[Output]:
        index = self._index.get(message.param_id)
        if index is None:
            return [
                _error(message.param_id, -1, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST, sender),
                *refusal_text(f"no parameter {message.param_id}", sender),
            ]
        parameter = self._vehicle.parameters[index]
        value = _within(parameter, message.param_value)
        if value is None:
            limits = f"{parameter.minimum:g} and {parameter.maximum:g} {parameter.unit}".rstrip()
            text = f"{parameter.name} must be within {limits}"
            # The error precedes the value: MAVSDK takes a value other than the requested one as stale and repeats.
            return [
                _error(parameter.name, index, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, sender),
                Reply(self._value(index), sender),
                *refusal_text(text, sender),
            ]
        command = Command(self._vehicle.time_us, CommandKind.SET_PARAMETER, parameter.name, value, None, sender.name)
        reason = self._vehicle.refusal(command)
        if reason:
            refused = _error(parameter.name, index, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED, sender)
            return [refused, Reply(self._value(index), sender), *refusal_text(reason, sender)]
        self._pending[index] = _Pending(value, now + self._gains.confirm)
        return [command]

    def step(self, now: float) -> list[Output]:
        """Send changed values to all stations, and the next part of every list."""
        changed = self._changed()
        if not self._pending and not self._lists and not changed:
            return []
        told = [
            number for number, each in self._pending.items() if now >= each.deadline or self._has(number, each.value)
        ]
        for number in told:
            del self._pending[number]
        told += [number for number in changed if number not in told and number not in self._pending]
        replies: list[Output] = [Reply(self._value(number)) for number in told]
        taken: Counter[int] = Counter()
        for sender, begin in tuple(self._lists.items()):
            part = self._part(sender, begin, taken[sender.link])
            taken[sender.link] += len(part)
            replies += part
        return replies

    def _changed(self) -> list[int]:
        """Return the indices of the parameters changed since the last step."""
        before, now = self._shown, self._vehicle.parameters
        if now is before:
            return []
        self._shown = now
        return [number for number, (a, b) in enumerate(zip(before, now, strict=True)) if a.value != b.value]

    def _part(self, sender: Sender, begin: int, taken: int) -> list[Output]:
        room = min(self._capacities[sender.link](PARAMETERS) / VALUE_BYTES, self._gains.parameters_per_step) - taken
        fits = math.ceil(max(room, 0.0))
        end = min(begin + fits, len(self._index))
        self._lists[sender] = end
        if end == len(self._index):
            del self._lists[sender]
        return [Reply(self._value(index), sender) for index in range(begin, end)]

    def _has(self, number: int, value: float) -> bool:
        return math.isclose(self._vehicle.parameters[number].value, value, rel_tol=_ROUNDING, abs_tol=1e-30)

    def _value(self, index: int) -> Any:
        parameter = self._vehicle.parameters[index]
        return mavlink.MAVLink_param_value_message(
            parameter.name.encode(), parameter.value, mavlink.MAV_PARAM_TYPE_REAL32, len(self._index), index
        )


def _within(parameter: Parameter, value: float) -> float | None:
    """Return ``value``, limited within the rounding error; None if out of range.

    A limit rounded to 24 bits may be slightly out of range.
    """
    for limit in (parameter.minimum, parameter.maximum):
        if math.isclose(value, limit, rel_tol=_ROUNDING):
            return limit
    return value if parameter.minimum <= value <= parameter.maximum else None


def _error(name: str, index: int, error: int, sender: Sender) -> Reply:
    message = mavlink.MAVLink_param_error_message(sender.system, sender.component, name.encode(), index, error)
    return Reply(message, sender)
