"""MAVLink telemetry logs (``.tlog``).

The vehicle is the sender of an autopilot's heartbeats; messages of others are kept separately. Times are
those of the vehicle: from the stamps of some of its messages, and between them from the ground's clock.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.link.dialect import mavlink
from avionics.link.framing import MARKER_V1, MARKER_V2, SIGNED
from logs.importing.checks import LATEST_US, boots, nearly_ordered
from logs.importing.counterparts import Columns
from logs.importing.source import Array, History, Series, Source
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.text import pluralize

CLOCKS = ("vehicle", "ground")
"""clocks for the times of the new log"""
STAMP = struct.Struct(">Q")
"""us since 1970 on the ground clock, before each frame"""
_MARKERS = (bytes([MARKER_V1]), bytes([MARKER_V2]))
NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID"""
NOT_VEHICLES = frozenset((5, 6, 18, 26, 27, 30))
"""MAV_TYPE of antenna trackers, ground stations, onboard computers, gimbals, ADS-B receivers and cameras"""
PX4 = 12
WRAP_US = 2**32 * 1000
"""us; range of time stamps of 32 bits in ms"""
_DTYPES = {
    "uint8_t": "u1", "int8_t": "i1", "uint16_t": "u2", "int16_t": "i2", "uint32_t": "u4", "int32_t": "i4",
    "uint64_t": "u8", "int64_t": "i8", "float": "f4", "double": "f8", "char": "O",
}  # fmt: skip
Sender = tuple[int, int]
"""system and component id"""


class ReceivedMessage(NamedTuple):
    """Message of a telemetry log."""

    ground_us: int
    """us since 1970; on the ground clock"""
    sender: Sender
    message: Any


def read_tlog(data: bytes, clock: str = "vehicle") -> list[Source]:
    """Read a telemetry log with the times of the ``vehicle`` or of the ``ground``.

    Returns:
        one source for each boot of the vehicle, in the order of the file; on the ground's clock one for all.

    Raises:
        InputError: no complete frame.
    """
    received, damage = _frames(data)
    if not received:
        raise InputError("no complete MAVLink frame after a time stamp found")
    vehicle = vehicle_of(received)
    if clock == "ground":
        return [_source(received, vehicle, VehicleClock.on_the_ground(received), damage)]
    rows = _stamped_rows(received, vehicle)
    first = boots(_stamps(received, rows)) if rows else [0]
    edges = [0, *(rows[place] for place in first[1:]), len(received)]
    parts = [received[begin:end] for begin, end in itertools.pairwise(edges)]
    return [_source(part, vehicle, VehicleClock.of(part, vehicle), damage) for part in parts]


def _source(
    received: Sequence[ReceivedMessage], vehicle: Sender, clock: VehicleClock, damage: tuple[str, ...]
) -> Source:
    times = clock.at(received).tolist()
    series = _series(received, vehicle, times)
    spoken = [(one, at) for one, at in zip(received, times, strict=True) if one.sender == vehicle]
    values = _parameters(spoken)
    return Source(
        "tlog", series, _name([one for one, _ in spoken]), clock.boot_us * 1000, tuple(_events(spoken)),
        values.initial, tuple(values.changes), {"system": str(vehicle[0]), "component": str(vehicle[1])}, damage,
        clock=clock.description, checksummed=True,
    )  # fmt: skip


def _frames(data: bytes) -> tuple[list[ReceivedMessage], tuple[str, ...]]:
    received: list[ReceivedMessage] = []
    lost = places = at = 0
    unknown: Counter[int] = Counter()
    whole = True
    while at + STAMP.size < len(data):
        end = _end(data, at + STAMP.size)
        frame = data[at + STAMP.size : end] if end <= len(data) else b""
        followed = end == len(data) or data[end + STAMP.size : end + STAMP.size + 1] in _MARKERS
        stamp = STAMP.unpack_from(data, at)[0]
        decoded = _decode(frame, unknown, followed) if frame and stamp < LATEST_US else None
        if decoded is None:
            if whole and end > len(data) > at + STAMP.size:
                return received, (
                    *_damage_texts(lost, places, unknown),
                    f"cut off in the middle of a frame, at byte {at}",
                )
            lost, places, whole, at = lost + 1, places + whole, False, at + 1
            continue
        sender, message = decoded
        if message is not None:
            received.append(ReceivedMessage(stamp, sender, message))
        whole, at = True, end
    rest = len(data) - at
    cut = (f"cut off in the middle of a frame, {pluralize(rest, 'byte')} before the end",) if rest else ()
    return received, (*_damage_texts(lost, places, unknown), *cut)


def _damage_texts(lost: int, places: int, unknown: Counter[int]) -> tuple[str, ...]:
    damage: list[str] = []
    if lost:
        damage.append(f"{pluralize(lost, 'byte')} in {pluralize(places, 'place')} outside of frames")
    if unknown:
        ids = ", ".join(str(number) for number in sorted(unknown))
        damage.append(f"{pluralize(unknown.total(), 'message')} of unknown dialects (ids {ids})")
    return tuple(damage)


def _end(data: bytes, at: int) -> int:
    """Return the end of a frame that begins at ``at``; beyond all data if there is no frame."""
    if at + 6 > len(data):
        return len(data) + 1
    if data[at] == MARKER_V1:
        return at + 8 + data[at + 1]
    if data[at] == MARKER_V2:
        return at + 12 + data[at + 1] + (13 if data[at + 2] & SIGNED else 0)
    return at


def _decode(frame: bytes, unknown: Counter[int], followed: bool) -> tuple[Sender, Any] | None:
    """Decode sender and message of a frame; message None for an unknown message, None for an invalid frame.

    The checksum of an unknown message cannot be verified: the frame is accepted if another frame follows.
    """
    first = frame[0] == MARKER_V1
    number = frame[5] if first else int.from_bytes(frame[7:10], "little")
    sender = (frame[3], frame[4]) if first else (frame[5], frame[6])
    for dialect in _dialects():
        if number in dialect.mavlink_map:
            with contextlib.suppress(dialect.MAVError, ValueError, struct.error):
                return sender, _decoder(dialect).decode(bytearray(frame))
            return None
    unknown[number] += followed
    return (sender, None) if followed else None


@functools.cache
def _dialects() -> tuple[Any, ...]:
    from pymavlink.dialects.v20 import ardupilotmega

    return mavlink, ardupilotmega


@functools.cache
def _decoder(dialect: Any) -> Any:
    return dialect.MAVLink(None)


def vehicle_of(received: Sequence[ReceivedMessage]) -> Sender:
    """Return the sender of most autopilot heartbeats; without any, the sender of most messages."""
    autopilots = Counter(
        one.sender
        for one in received
        if one.message.get_type() == "HEARTBEAT"
        and one.message.autopilot != NO_AUTOPILOT
        and one.message.type not in NOT_VEHICLES
    )
    return (autopilots or Counter(one.sender for one in received)).most_common(1)[0][0]


class VehicleClock(NamedTuple):
    """Vehicle clock, estimated from its time stamps."""

    rows: NDArray[np.int64]
    """places in the file of the messages with a time stamp"""
    vehicle_us: NDArray[np.int64]
    """us; nondecreasing, the latest stamp so far"""
    ground_us: NDArray[np.int64]
    """us since 1970; ground clock of these messages"""
    stamped: bool
    """whether messages are recorded at their own time stamps"""
    description: str
    """-; description of the times"""

    @classmethod
    def of(cls, received: Sequence[ReceivedMessage], vehicle: Sender) -> VehicleClock:
        """Build the clock from all plausible time stamps of the vehicle; without any, from the ground clock."""
        rows = _stamped_rows(received, vehicle)
        stamps = _stamps(received, rows)
        kept = nearly_ordered(stamps)
        if not kept.any():
            return cls.on_the_ground(received)
        places = np.array(rows, np.int64)[kept]
        ground = np.array([received[row].ground_us for row in places.tolist()], np.int64)
        latest = np.maximum.accumulate(stamps[kept])
        return cls(places, latest, ground, True, "since the vehicle's boot, by its stamps")

    @classmethod
    def on_the_ground(cls, received: Sequence[ReceivedMessage]) -> VehicleClock:
        """Build the ground clock, from the first frame."""
        first = np.array([min(one.ground_us for one in received)], np.int64)
        description = "the ground computer's clock, since the first frame"
        return cls(np.array([0], np.int64), np.array([0], np.int64), first, False, description)

    @property
    def boot_us(self) -> int:
        """us since 1970; time of the zero of the vehicle clock."""
        return max(int(np.median(self.ground_us - self.vehicle_us)), 0)

    def at(self, received: Sequence[ReceivedMessage]) -> NDArray[np.int64]:
        """Return us since boot of each message in the order of the file.

        A message has its own time stamp. Without one it lies as long after the last stamp as the ground's clock says,
        and not after the next stamp: a step of the ground's clock moves no message beyond the stamps beside it.
        """
        ground = np.array([one.ground_us for one in received], np.int64)
        if not self.stamped:
            return np.asarray(np.maximum(ground - self.ground_us[0], 0), np.int64)
        rows, count = np.arange(len(received)), len(self.rows)
        following = np.searchsorted(self.rows, rows)
        last = np.maximum(np.searchsorted(self.rows, rows, side="right") - 1, 0)
        since = ground - self.ground_us[last]
        since = np.where(rows >= self.rows[0], np.maximum(since, 0), np.minimum(since, 0))
        times = self.vehicle_us[last] + since
        # Behind the last stamp only the ground's clock remains.
        ends = self.vehicle_us[np.minimum(following, count - 1)]
        times = np.maximum(np.where(following < count, np.minimum(times, ends), times), 0)
        stamps = _stamps(received, range(len(received)))
        return np.asarray(np.where(stamps > 0, stamps, times), np.int64)


def _boot_us(message: Any) -> int:
    """Return the time stamp of a message in us since boot; 0 without one."""
    return 0 if message.get_type() == "SYSTEM_TIME" else 1000 * int(getattr(message, "time_boot_ms", 0))


def _stamped_rows(received: Sequence[ReceivedMessage], vehicle: Sender) -> list[int]:
    """Return the places of the vehicle's messages with a time stamp."""
    return [row for row, one in enumerate(received) if one.sender == vehicle and _boot_us(one.message)]


def _stamps(received: Sequence[ReceivedMessage], rows: Sequence[int]) -> NDArray[np.int64]:
    """Return the time stamps in us of the messages at ``rows``."""
    return _unwrapped(np.array([_boot_us(received[row].message) for row in rows], np.int64))


def _unwrapped(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return time stamps, 0 for none, on across the end of their 32 bits of ms (49.7 days)."""
    known = stamps > 0
    steps = np.diff(stamps[known])
    turns = (steps < -WRAP_US // 2).astype(np.int64) - (steps > WRAP_US // 2)
    result = stamps.copy()
    if known.any():
        result[known] += np.concatenate(([0], np.cumsum(turns))) * WRAP_US
    return result


def _series(received: Sequence[ReceivedMessage], vehicle: Sender, times: Sequence[int]) -> dict[str, Series]:
    groups: dict[str, list[tuple[ReceivedMessage, int]]] = {}
    for one, at in zip(received, times, strict=True):
        groups.setdefault(_series_name(one, vehicle), []).append((one, at))
    return {name: _one_series(name, members) for name, members in groups.items()}


def _series_name(one: ReceivedMessage, vehicle: Sender) -> str:
    kind = one.message.get_type()
    if one.sender == vehicle:
        return str(kind)
    system, component = one.sender
    return f"component_{component}/{kind}" if system == vehicle[0] else f"system_{system}/{kind}"


def _one_series(name: str, members: list[tuple[ReceivedMessage, int]]) -> Series:
    kind = type(members[0][0].message)
    columns: Columns = {}
    units: dict[str, str] = {}
    for field in kind.fieldnames:
        dtype = _DTYPES[kind.fieldtypes[kind.fieldnames.index(field)]]
        values = [getattr(one.message, field) for one, _ in members]
        columns[field] = _texts(values) if dtype == "O" else np.array(values, dtype)
        units[field] = kind.fieldunits_by_name.get(field, "")
    return Series(name, np.array([at for _, at in members], np.int64), columns, units)


def _texts(values: list[Any]) -> Array:
    return np.array([_text(value) for value in values], object)


def _text(value: Any) -> str:
    description = value.decode("utf-8", "replace") if isinstance(value, bytes | bytearray) else str(value)
    return description.partition("\0")[0]


def _name(spoken: Sequence[ReceivedMessage]) -> str:
    """Kind of the vehicle and its number, as ``QUADROTOR 1``."""
    beat = next((one.message for one in spoken if one.message.get_type() == "HEARTBEAT"), None)
    if beat is None:
        return ""
    entry = _dialects()[1].enums["MAV_TYPE"].get(beat.type)
    description = entry.name.removeprefix("MAV_TYPE_") if entry else str(beat.type)
    return f"{description} {spoken[0].sender[0]}"


def _events(spoken: Sequence[tuple[ReceivedMessage, int]]) -> Iterator[Event]:
    """Texts, and changes of mode and arming."""
    before = ""
    for one, at in spoken:
        kind = one.message.get_type()
        if kind == "STATUSTEXT":
            severity = one.message.severity
            yield Event(at, Severity(severity) if severity < 8 else Severity.INFO, "vehicle", _text(one.message.text))
        elif kind == "HEARTBEAT" and (now := _mode(one.message)) != before:
            before = now
            yield Event(at, Severity.INFO, "vehicle", now)


def _mode(beat: Any) -> str:
    """Return mode and arming of a heartbeat, with the autopilot's mode name if known."""
    from pymavlink import mavutil

    with contextlib.suppress(Exception):  # the package's tables have gaps
        named = mavutil.mode_string_v10(beat)
        return f"mode {named}, {'armed' if beat.base_mode & 128 else 'disarmed'}"
    return f"mode {beat.custom_mode}, {'armed' if beat.base_mode & 128 else 'disarmed'}"


def _parameters(spoken: Sequence[tuple[ReceivedMessage, int]]) -> History:
    """Return the first received value of each parameter, and different ones later."""
    bytewise = any(one.message.get_type() == "HEARTBEAT" and one.message.autopilot == PX4 for one, _ in spoken)
    values = History()
    for one, at in spoken:
        if one.message.get_type() == "PARAM_VALUE":
            values.add(at, _text(one.message.param_id), _value(one.message, bytewise))
    return values


def _value(message: Any, bytewise: bool) -> float:
    """Return a parameter's value; PX4 stores the bytes of an integer in the float."""
    if bytewise and message.param_type != 9:
        return int(struct.unpack("<i", struct.pack("<f", message.param_value))[0])
    return float(message.param_value)
