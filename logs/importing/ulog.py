"""PX4's logs (``.ulg``), read by `pyulog`. Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html."""

from __future__ import annotations

import contextlib
import io
import re
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog

from logs.importing.checks import LATEST_US, LONGEST_PAUSE_US
from logs.importing.counterparts import Columns
from logs.importing.source import OF_BOOT, Array, ParameterChange, Series, Source
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.text import pluralize

MAGIC = b"ULog\x01\x12\x35"
_LONGEST_UPTIME_US = 10**14
"""us; three years"""
_HEADER = 16
"""bytes; header before the first message"""
_KINDS = b"BFIMPQALCSOD"
"""of messages"""
_SUFFIXES = {
    "_deg_s": "deg/s", "_dps": "deg/s",
    "_m_s2": "m/s^2", "_m_s": "m/s", "_rad_s": "rad/s", "_rad": "rad", "_deg": "deg", "_ga": "gauss", "_pa": "Pa",
    "_celcius": "degC", "_celsius": "degC", "_degc": "degC", "_v": "V", "_a": "A", "_w": "W", "_mah": "mAh",
    "_wh": "Wh", "_m": "m", "_hz": "Hz", "_us": "us", "_ms": "ms", "_s": "s", "_rpm": "rpm",
}  # fmt: skip
"""Suffixes of PX4 field names that specify a unit."""
_NOT_UNITS = ("var_", "_var", "variance", "cov", "offset", "innov", "test_ratio", "device", "flag", "fault", "cs_")
_NAMES = {"timestamp": "us", "timestamp_sample": "us", "gyro_rad": "rad/s"}
_NAVIGATION = (
    "MANUAL", "ALTCTL", "POSCTL", "AUTO_MISSION", "AUTO_LOITER", "AUTO_RTL", "POSITION_SLOW", "FREE5",
    "ALTITUDE_CRUISE", "FREE3", "ACRO", "FREE2", "DESCEND", "TERMINATION", "OFFBOARD", "STAB", "FREE1",
    "AUTO_TAKEOFF", "AUTO_LAND", "AUTO_FOLLOW_TARGET", "AUTO_PRECLAND", "ORBIT", "AUTO_VTOL_TAKEOFF",
)  # fmt: skip
"""vehicle_status.nav_state"""


def is_ulog(head: bytes) -> bool:
    """Return whether a file with this start is a ULog."""
    return head.startswith(MAGIC)


def read_ulog(data: bytes) -> Source:
    """Read a ULog; damaged parts are omitted and listed in ``damage``.

    Raises:
        InputError: it cannot be read, or has no data.
    """
    places = _places(data)
    log = _parsed(data, places)
    zero = _zero_us(log)
    series = dict(_series(log, zero))
    if not series:
        raise InputError("there is no whole message of data in it")
    texts = {str(key): str(value) for key, value in log.msg_info_dict.items()}
    parameters = {str(name): value for name, value in log.initial_parameters.items() if _is_number(value)}
    changes = tuple(
        ParameterChange(int(at) - zero, str(name), value)
        for at, name, value in log.changed_parameters
        if _is_number(value)
    )
    return Source(
        "ulog", series, _vehicle(texts), zero * 1000 or _epoch_ns(series), (*_events(log, zero), *_modes(series)),
        parameters, changes, texts, _damage(data, log, places),
        clock="since 1970, from the log's first time on" if zero else OF_BOOT,
    )  # fmt: skip


def _zero_us(log: Any) -> int:
    """Return the zero of the times in us: boot, or in a simulation the first message."""
    start = int(log.start_timestamp)
    if not _LONGEST_UPTIME_US <= start < LATEST_US:
        return 0
    stamps = np.concatenate([np.empty(0, np.int64), *(_stamps(one) for one in log.data_list)])
    # Retained messages are slightly older than the log, and some have no time stamp.
    stamps = stamps[stamps > start - LONGEST_PAUSE_US]
    return int(min(start, stamps.min())) if len(stamps) else 0


def _stamps(one: Any) -> NDArray[np.int64]:
    """Return the times of a message in us, empty if a damaged format has another type."""
    times = one.data.get("timestamp")
    if times is None or times.dtype.kind != "u":
        return np.empty(0, np.int64)
    return np.asarray(np.minimum(times.astype(np.uint64), np.uint64(2**62)).astype(np.int64))


def _is_number(value: Any) -> bool:
    """Return whether a parameter is a number; one of a damaged type is bytes or text."""
    return isinstance(value, int | float)


def _events(log: Any, zero: int) -> Iterator[Event]:
    for one in log.logged_messages:
        yield Event(int(one.timestamp) - zero, _severity(one.log_level), "vehicle", one.message.strip())
    for at, name, value in log.changed_parameters:
        if _is_number(value):
            yield Event(
                int(at) - zero,
                Severity.INFO,
                "parameters",
                f"{name} set to {value if isinstance(value, int) else format(value, '.9g')}",
            )
    for lost in log.dropouts:
        yield Event(
            int(lost.timestamp) - zero, Severity.WARNING, "logger", f"{lost.duration} ms of the log were lost"
        )


class _Stream(io.BytesIO):
    """File in which a read beyond the end advances the position by the full size.

    The package seeks back by the requested size; otherwise it would read the end of a damaged file in an endless
    loop.
    """

    def read(self, size: int | None = -1, /) -> bytes:
        """Read up to ``size`` bytes."""
        at, data = self.tell(), super().read(size)
        if size is not None and size > len(data):
            self.seek(at + size)
        return data


def _parsed(data: bytes, places: NDArray[np.int64] | None) -> Any:
    """Read a log; the data messages of an undamaged one are decoded here, a topic at a time."""
    if places is not None:
        buffer = np.frombuffer(data, np.uint8)
        log = _read(_without_data(data, buffer, places))
        if not log.file_corruption and not log.has_data_appended and _decode(log, buffer, places):
            return log
    return _read(data)


def _read(data: bytes) -> Any:
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return ULog(_Stream(data))
    except MemoryError:
        raise
    except Exception as error:  # a damaged file makes the package raise whatever it comes to
        raise InputError(f"it cannot be read as a ULog: {error or type(error).__name__}") from None


def _places(data: bytes) -> NDArray[np.int64] | None:
    """Return the offsets of all whole messages, and that behind the last; None if a kind is not known."""
    places, at, end = [], _HEADER, len(data)
    while at + 3 <= end:
        if data[at + 2] not in _KINDS:
            return None
        places.append(at)
        at += 3 + data[at] + 256 * data[at + 1]
    if at > end and places:
        at = places.pop()  # cut off
    return np.array([*places, at], np.int64)


def _data_rows(buffer: NDArray[np.uint8], places: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.flatnonzero(buffer[places[:-1] + 2] == ord("D"))


def _without_data(data: bytes, buffer: NDArray[np.uint8], places: NDArray[np.int64]) -> bytes:
    """Return the log with the first data message of each topic, and the latest before one without a time."""
    rows = _data_rows(buffer, places)
    rows = rows[np.diff(places)[rows] >= 13]  # bytes: header, topic and time
    starts = places[rows]
    keep = np.ones(len(places) - 1, bool)
    keep[_data_rows(buffer, places)] = False
    if len(rows):
        keep[rows[np.unique(_number(buffer, starts + 3, "<u2"), return_index=True)[1]]] = True
        times = _number(buffer, starts + 5, "<u8")
        latest = np.maximum.accumulate(np.where(times >= np.maximum.accumulate(times), np.arange(len(rows)), 0))
        untimed = np.flatnonzero(np.isin(buffer[places[:-1] + 2], [ord("P"), ord("O")]))
        before = np.searchsorted(rows, untimed) - 1
        keep[rows[latest[before[before >= 0]]]] = True
    chosen = np.flatnonzero(keep)
    spans = zip(places[chosen].tolist(), places[chosen + 1].tolist(), strict=True)
    return b"".join([data[:_HEADER], *(data[first:last] for first, last in spans)])


def _number(buffer: NDArray[np.uint8], places: NDArray[np.int64], kind: str) -> Array:
    """Return little-endian numbers at some offsets."""
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(buffer[places[:, None] + np.arange(size)]).view(kind)[:, 0]


def _decode(log: Any, buffer: NDArray[np.uint8], places: NDArray[np.int64]) -> bool:
    """Put all messages into the topics of a log; return whether they have the sizes of its formats."""
    rows = _data_rows(buffer, places)
    starts, sizes = places[rows], np.diff(places)[rows]
    numbers = _number(buffer, starts + 3, "<u2") if len(rows) else np.empty(0, np.uint16)
    if set(np.unique(numbers).tolist()) != {one.msg_id for one in log.data_list}:
        return False
    for one in log.data_list:
        record = next(iter(one.data.values())).base.dtype
        own = numbers == one.msg_id
        if len(set(sizes[own].tolist())) != 1 or sizes[own][0] < 5 + record.itemsize:
            return False
        content = buffer[(starts[own] + 5)[:, None] + np.arange(record.itemsize)].view(record)[:, 0]
        one.data = {name: content[name] for name in record.names}
    return True


def _damage(data: bytes, log: Any, places: NDArray[np.int64] | None) -> tuple[str, ...]:
    damage: list[str] = []
    strange = [str(name) for name, value in log.initial_parameters.items() if not _is_number(value)]
    strange += [str(name) for _, name, value in log.changed_parameters if not _is_number(value)]
    if strange:
        damage.append(f"{pluralize(len(strange), 'parameter')} without a number, the first: {strange[0]}")
    if not int(log.start_timestamp) < LATEST_US:
        damage.append("its first time cannot be")
    rest = 0 if log.has_data_appended else len(data) - (_end_of_messages(data) if places is None else int(places[-1]))
    if log.file_corruption:
        damage.append("damaged inside: messages that could not be read are missing")
    elif rest:
        damage.append(f"cut off in the middle of a message, {pluralize(rest, 'byte')} before the end")
    return tuple(damage)


def _end_of_messages(data: bytes) -> int:
    """Return the end of the last complete message."""
    at = end = _HEADER
    while at + 3 <= len(data):
        at += 3 + struct.unpack_from("<H", data, at)[0]
        end = at if at <= len(data) else end
    return end


def _series(log: Any, zero: int) -> Iterator[tuple[str, Series]]:
    for one in log.data_list:
        name = one.name if not one.multi_id else f"{one.name}_{one.multi_id}"
        stamps = _stamps(one) - zero
        if not len(stamps):
            continue
        columns = _columns({key: value for key, value in one.data.items() if key != "timestamp"})
        yield name, Series(name, stamps, columns, {column: unit_of(column) for column in columns})


def _columns(flat: Mapping[str, Array]) -> Columns:
    """Columns with arrays put together again: ``q[0]``, ``q[1]`` become ``q``; members become ``esc_0_voltage``."""
    arrays: dict[str, list[str]] = {}
    for name in flat:
        whole = re.fullmatch(r"(.*)\[\d+\]", name)
        arrays.setdefault(whole[1] if whole else name, []).append(name)
    columns: Columns = {}
    for name, parts in arrays.items():
        plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
        while plain in columns:
            plain += "_"
        single = len(parts) == 1 and parts[0] == name
        columns[plain] = flat[parts[0]] if single else np.stack([flat[part] for part in parts], axis=1)
    return columns


def unit_of(field: str) -> str:
    """Return the unit in the name of a field, empty if there is none."""
    if any(word in field for word in _NOT_UNITS):
        return ""
    return _NAMES.get(field) or next((unit for end, unit in _SUFFIXES.items() if field.endswith(end)), "")


def _severity(level: int) -> Severity:
    """Of the digit that ULog writes it as."""
    return Severity(level - ord("0")) if ord("0") <= level <= ord("7") else Severity.INFO


def _vehicle(texts: Mapping[str, str]) -> str:
    return " ".join(filter(None, (texts.get("sys_name", ""), texts.get("ver_hw", ""))))


def _modes(series: Mapping[str, Series]) -> Iterator[Event]:
    status = series.get("vehicle_status")
    for field, word in (("nav_state", "mode"), ("arming_state", "arming state")):
        values = None if status is None else status.columns.get(field)
        if status is None or values is None or not _is_whole(values):
            continue
        for row in [0, *(np.flatnonzero(np.diff(values.astype(int))) + 1).tolist()]:
            number = int(values[row])
            named = field == "nav_state" and 0 <= number < len(_NAVIGATION)
            told = _NAVIGATION[number] if named else str(number)
            yield Event(int(status.time_us[row]), Severity.INFO, "vehicle", f"{word} {told}")


def _is_whole(values: Array) -> bool:
    """Return whether a column has one integer in each row, as an undamaged format requires."""
    return values.ndim == 1 and values.dtype.kind in "iu"


def _epoch_ns(series: Mapping[str, Series]) -> int:
    """Return the boot time in ns since 1970 from the GPS; 0 if unknown."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        fixes = series.get(name)
        told = None if fixes is None else fixes.columns.get("time_utc_usec")
        if fixes is not None and told is not None and _is_whole(told) and np.any(told > 0):
            known = told > 0
            return max(int(np.median(told[known].astype(float) - fixes.time_us[known])) * 1000, 0)
    return 0
