"""Messages as columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from logs.chunks import MESSAGE_HEAD
from logs.layout import SCALARS, Field, Layout
from logs.records import Damage
from logs.schema import layout_from_schema
from wingbeat.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[Any]
Stamped = tuple[int, dict[str, Any]]
"""Log time in ns and the values of one message."""
LATEST_NS = 2**63 - 1
"""ns; latest log time, in the year 2262: a greater one indicates damage"""
_BLOCK = 256
"""Rows checked at a time, so that they stay in the processor cache."""


RENAMED = {"/system/calibration": {"calibration_count": "begun", "begun": "calibration_count"}}
"""Former or later name of a renamed field, by topic: recordings and scripts of both versions can be read."""


@dataclass(frozen=True)
class Columns(Mapping[str, Array]):
    """A topic as columns: ``columns["pitch"]`` is an array with one row per message, in order of log time.

    Whole numbers come as int64 (uint64 only for values beyond it), so that differences cannot wrap. A packed array
    of n values is a column of shape (messages, n).
    """

    topic: str
    fields: dict[str, Array]
    units: dict[str, str]
    """by field, ``-`` for none"""
    log_time_ns: NDArray[np.int64]
    """ns; MCAP's log time"""
    boot_ns: int
    """ns; log time at which the vehicle's clock was zero"""
    labels: dict[str, dict[int, str]] = field(default_factory=dict)
    """names of enumerations' values, by field"""
    descriptions: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tables: tuple[dict[str, Any], ...] = (self.units, self.labels, self.descriptions)
        for table in tables:
            for name, other in RENAMED.get(self.topic, {}).items():
                if other in table:
                    table.setdefault(name, table[other])

    def __getitem__(self, name: str) -> Array:
        if name not in self.fields:
            other = RENAMED.get(self.topic, {}).get(name, "")
            if other in self.fields:
                return self.fields[other]
        return self.fields[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        """Count the fields; the number of messages is ``len(columns.time)``."""
        return len(self.fields)

    def __repr__(self) -> str:
        count = len(self.log_time_ns)
        span = f" from {self.time[0]:.3f} to {self.time[-1]:.3f} s" if count else ""
        units = (f"{name} ({self.units.get(name, '-')})" for name in self.fields)
        return f"{self.topic}: {count} messages{span}; {', '.join(units)}"

    def to_pandas(self) -> pd.DataFrame:
        """Return a data frame with one row per message, indexed by the time in s since boot (needs pandas).

        A packed array of n values becomes n columns, ``name[0]`` and so on. An enumeration ``mode`` is followed by
        ``mode_name``, a category.
        """
        import pandas as pd

        table: dict[str, Any] = {}
        for name, values in self.fields.items():
            if values.ndim == 1:
                table[name] = values
            else:
                table |= {f"{name}[{i}]": values[:, i] for i in range(values.shape[1])}
            if name in self.labels and f"{name}_name" not in self.fields:
                table[f"{name}_name"] = pd.Categorical(names_of(values, self.labels[name]))
        return pd.DataFrame(table, index=pd.Index(self.time, name="time"))

    @property
    def time(self) -> NDArray[np.float64]:
        """s; since boot, of every message."""
        if "time_us" in self.fields:
            return np.asarray(self.fields["time_us"] * 1e-6, np.float64)
        return np.asarray((self.log_time_ns - self.boot_ns) * 1e-9, np.float64)


def names_of(values: Array, labels: Mapping[int, str]) -> Array:
    """Return the names of an enumeration's values; a value without one as its number, NaN as the empty string."""
    unique, inverse = np.unique(values, return_inverse=True)
    names = ["" if math.isnan(value) else labels.get(int(value), str(int(value))) for value in unique.tolist()]
    return np.array(names, dtype=np.str_)[inverse.reshape(values.shape)]


class RowType(NamedTuple):
    """NumPy type of a complete message record of fixed layout, header included."""

    kind: np.dtype[np.void]
    """fields by name; those of the record header begin with a slash"""
    mask: NDArray[np.uint8]
    """255 at the bytes that are equal in every record of a channel (opcode, length, channel, tags); repeated for a
    block
    """
    pattern: NDArray[np.uint8]
    """values of these bytes, 0 elsewhere; repeated for a block"""

    def fits(self, rows: Array, times: NDArray[np.uint64]) -> bool:
        """Check that all rows (``kind.itemsize`` bytes each) match the pattern and have these log times in ns."""
        raw, step = rows.view(np.uint8), len(self.mask)
        blocks = (raw[start : start + step] for start in range(0, len(raw), step))
        if not all(np.array_equal(block & self.mask[: len(block)], self.pattern[: len(block)]) for block in blocks):
            return False
        return np.array_equal(rows.view(self.kind)["/log_time"], times)


def layout_in_file(channel: Channel, schema: Schema | None) -> Layout | None:
    """Return the layout of a channel as declared in the file; None if its messages differ in length."""
    if schema is None or schema.encoding != "protobuf" or channel.message_encoding != "protobuf":
        return None
    return layout_from_schema(schema.name, schema.data, channel.metadata)


def row_type(layout: Layout, channel: int) -> RowType:
    """Return the NumPy type of the message records of a channel."""
    body = layout.record_type(before=MESSAGE_HEAD.itemsize)
    places: Mapping[str, Any] = body.fields or {}
    head: Mapping[str, Any] = MESSAGE_HEAD.fields or {}
    fields = {name: place[:2] for name, place in places.items()}
    fields |= {f"/{name}": place[:2] for name, place in head.items()}
    described: Any = {
        "names": list(fields),
        "formats": [kind for kind, _ in fields.values()],
        "offsets": [offset for _, offset in fields.values()],
        "itemsize": body.itemsize,
    }
    pattern, mask = np.zeros(body.itemsize, np.uint8), np.zeros(body.itemsize, np.uint8)
    constants = [(0, bytes([Opcode.MESSAGE])), (1, (body.itemsize - 9).to_bytes(8, "little"))]
    constants += [(9, channel.to_bytes(2, "little"))]
    constants += [(places[item.name][1] - len(item.tag), item.tag) for item in layout.fields]
    for offset, data in constants:
        pattern[offset : offset + len(data)] = list(data)
        mask[offset : offset + len(data)] = 255
    return RowType(np.dtype(described), np.tile(mask, _BLOCK), np.tile(pattern, _BLOCK))


def column_type(kind: Field) -> np.dtype[Any]:
    """Return the NumPy type of the column of a field."""
    return np.dtype(f"<{SCALARS[kind.scalar].code}" if kind.scalar in ("double", "float") else np.int64)


def moment(time: float, most: int = LATEST_NS) -> int:
    """Convert ``time`` in s to ns, limited to ``most`` in magnitude.

    Raises:
        InputError: it is not a number.
    """
    if math.isnan(time):
        raise InputError(f"{time:g} s is no time")
    return round(min(max(time, -most * 1e-9), most * 1e-9) * 1e9)


def signed_log_times(times: NDArray[np.uint64], topic: str) -> NDArray[np.int64]:
    """Convert log times (ns) of a topic to signed integers.

    Raises:
        Damage: one of them is beyond `LATEST_NS`.
    """
    if int(times.max(initial=0)) > LATEST_NS:
        raise Damage(f"a log time of {topic} is beyond the year 2262")
    return times.astype(np.int64)


def fixed_columns(
    topic: str, boot_ns: int, layout: Layout, times: NDArray[np.int64], fields: dict[str, Array]
) -> Columns:
    """Build the columns of `column_type` with their log times (ns), in any order."""
    if np.any(times[1:] < times[:-1]):
        order = np.argsort(times, kind="stable")
        times, fields = times[order], {name: values[order] for name, values in fields.items()}
    kinds = {item.name: item for item in layout.fields}
    return _columns(
        topic, boot_ns, layout, times, {name: _whole(values, kinds[name]) for name, values in fields.items()}
    )


def _whole(values: Array, kind: Field) -> Array:
    """The column, with values beyond int64 as what they are."""
    beyond = kind.scalar == "fixed64" and int(values.min(initial=0)) < 0
    return values.view(np.uint64) if beyond else values


def free_columns(topic: str, boot_ns: int, layout: Layout | None, messages: Sequence[Stamped]) -> Columns:
    """Build columns from decoded messages; missing numbers are NaN, columns of other types hold objects."""
    messages = sorted(messages, key=lambda message: message[0])
    names = list(dict.fromkeys(name for _, values in messages for name in values))
    if layout is not None and not messages:
        names = [item.name for item in layout.fields]
    fields = {name: _gathered([values.get(name) for _, values in messages]) for name in names}
    return _columns(topic, boot_ns, layout, np.array([time for time, _ in messages], np.int64), fields)


def _gathered(values: list[Any]) -> Array:
    if all(isinstance(value, int | float) for value in values):
        return np.array(values)
    if None in values and all(value is None or _is_float(value) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    lengths = {len(value) if isinstance(value, list) else -1 for value in values}
    if len(lengths) == 1 and lengths != {-1} and all(isinstance(v, int | float) for value in values for v in value):
        return np.array(values)
    out = np.empty(len(values), object)
    for row, value in enumerate(values):
        out[row] = value
    return out


def _is_float(value: Any) -> bool:
    """Whether a number is one that a double holds exactly; switches are no numbers."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, float) or abs(value) <= 2**53


def _columns(
    topic: str, boot_ns: int, layout: Layout | None, times: NDArray[np.int64], fields: dict[str, Array]
) -> Columns:
    known = {item.name: item for item in layout.fields} if layout else {}
    return Columns(
        topic,
        fields,
        {name: known[name].unit if name in known else "-" for name in fields},
        times,
        boot_ns,
        {name: dict(known[name].labels) for name in fields if name in known and known[name].labels},
        {name: known[name].description if name in known else "" for name in fields},
    )
