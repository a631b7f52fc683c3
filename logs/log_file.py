"""The content of an MCAP file: topics as NumPy columns, events, documents, attachments."""

from __future__ import annotations

import mmap
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from logs.chunks import BEYOND_NS, ChunkSpan, Entries, bodies, entries_of, unpack
from logs.codecs import decode_event, decode_text, value_decoder
from logs.column_batches import Table, fill
from logs.columns import (
    LATEST_NS,
    Columns,
    Stamped,
    fixed_columns,
    free_columns,
    layout_in_file,
    moment,
    signed_log_times,
)
from logs.frames import frame
from logs.index import ALTERED, Index, data_intact, indexes_intact, max_records
from logs.layout import Layout
from logs.listing import Places
from logs.names import parts_of
from logs.recorder import RECORDING
from logs.records import Damage, attachment_at, parse
from wingbeat.errors import InputError
from wingbeat.message import Event, Text
from wingbeat.text import did_you_mean
from wingbeat.topic import Topic

Result = TypeVar("Result")
EVENT_SCHEMA = "foxglove.Log"
MAX_EVENTS_BYTES = 16 << 20
"""bytes, encoded; limit of all events that are read from a log"""
NATIVE = "wingbeat."
"""prefix of the full names of Wingbeat messages"""
TEXT_SCHEMA = "wingbeat.avionics.Text"
IMPORTED, TABLES = (".bin", ".ulg", ".tlog", ".c3d"), (".csv", ".tsv", ".txt")
"""suffixes of the files that `logs.importing` reads without and with a column mapping"""
IMPORTED_HEADS, HEAD_BYTES = (b"ULog", b"\xa3\x95"), 4
"""first bytes of a ULog and of a dataflash log, and their number"""


@dataclass(frozen=True)
class TopicInfo:
    """Properties of a topic in a log."""

    name: str
    channel: int
    schema: str
    """full name of the message"""
    encoding: str
    messages: int
    rate: float | None
    """Hz; nominal, 0 for events, None if the file does not specify it"""
    deterministic: bool | None
    """None if the file does not specify it"""
    layout: Layout | None
    """None if the messages differ in length"""


class LogFile:
    """Open MCAP file; closed by the garbage collector or ``close``."""

    def __init__(self, path: Path, data: mmap.mmap, index: Index) -> None:
        self.path = path
        self._data = data
        self._index = index
        self.damage: tuple[str, ...] = tuple(index.damage)
        """damage of the file, one line each; empty for an intact file"""
        self.undecodable: dict[str, int] = {}
        """number of messages read so far that cannot be decoded, by topic"""
        self.topics: dict[str, TopicInfo] = {}
        self._by_topic: dict[str, list[Channel]] = {}
        for channel in sorted(index.channels.values(), key=lambda channel: channel.id):
            self._by_topic.setdefault(channel.topic, []).append(channel)
        for name, channels in self._by_topic.items():
            self.topics[name] = self._info(channels[0])

    def __getitem__(self, topic: str) -> Columns:
        """Read one topic as columns, as `columns` does."""
        return self.columns(topic)

    def __repr__(self) -> str:
        count = sum(info.messages for info in self.topics.values())
        fault = "; damaged" if self.damage else ""
        names = ", ".join(sorted(self.topics))
        return f"Log {self.path}: {self.duration:.1f} s, {count} messages{fault}; topics {names}"

    def close(self) -> None:
        """Close the file; it cannot be read afterwards."""
        self._data.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def complete(self) -> bool:
        """Whether the file ends like a finished recording."""
        return self._index.complete

    @property
    def start_ns(self) -> int:
        """ns; log time of the first message, 0 for an empty log."""
        return min((chunk.start_ns for chunk in self._chunks()), default=0)

    @property
    def end_ns(self) -> int:
        """ns; log time of the last message, 0 for an empty log."""
        return max((chunk.end_ns for chunk in self._chunks()), default=0)

    @property
    def duration(self) -> float:
        """s; from the first to the last message."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def uncompressed_bytes(self) -> int:
        """Bytes of all chunks after decompression, as declared in the file."""
        return sum(chunk.size for chunk in self._index.chunks)

    @property
    def boot_ns(self) -> int:
        """ns; log time of the zero of the vehicle clock, that of the first message if not specified."""
        text = self.metadata.get(RECORDING, {}).get("start_epoch_ns", "")
        return int(text) if text.isdecimal() and len(text) < 20 and int(text) <= LATEST_NS else self.start_ns

    def is_native(self, topic: Topic[Any]) -> bool:
        """Return whether the log has messages of a Wingbeat topic in the native encoding."""
        info = self.topics.get(topic.name)
        return info is not None and info.messages > 0 and info.layout is not None and info.schema.startswith(NATIVE)

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata by name; records of the same name are merged, the later values prevail.

        Raises:
            InputError: a record is damaged.
        """
        out: dict[str, dict[str, str]] = {}
        for span in self._index.metadata:
            record = self._checked(partial(parse, Metadata, self._data, span))
            out.setdefault(record.name, {}).update(record.metadata)
        return out

    @property
    def attachments(self) -> list[Attachment]:
        """Files attached to the recording.

        Raises:
            InputError: one is damaged.
        """
        return [self._checked(partial(attachment_at, self._data, span)) for span in self._index.attachments]

    def attachment(self, name: str) -> bytes:
        """Return the content of the attachment ``name``, the latest if there are several.

        Raises:
            InputError: there is none, or it is damaged.
        """
        attachments = self.attachments
        found = [attachment.data for attachment in attachments if attachment.name == name]
        if not found:
            names = ", ".join(attachment.name for attachment in attachments) or "none"
            raise InputError(f"{self.path} has no attachment {name}; it has: {names}")
        return found[-1]

    def columns(self, topic: str | Topic[Any], start: float | None = None, end: float | None = None) -> Columns:
        """Read one topic as columns; see `tables`."""
        name = topic if isinstance(topic, str) else topic.name
        return self.tables([name], start, end)[name]

    def tables(
        self, topics: Iterable[str | Topic[Any]] | None = None, start: float | None = None, end: float | None = None
    ) -> dict[str, Columns]:
        """Read topics (all by default) as columns in one pass over the file.

        Messages that cannot be decoded are omitted and counted in `undecodable`.

        Args:
            topics: names or `Topic` values.
            start: s since boot; inclusive.
            end: s since boot; exclusive.

        Raises:
            InputError: the log has no such topic, or a part of the file is damaged.
        """
        chosen = self.topics if topics is None else topics
        names = list(dict.fromkeys(topic if isinstance(topic, str) else topic.name for topic in chosen))
        window = self._window(start, end)
        channels = {channel.id: channel for name in names for channel in self._channels(name)}
        filled = self._checked(lambda: self._filled(channels, window))
        boot = self.boot_ns
        return {name: self._table(name, boot, window, filled) for name in names}

    def times(self, topic: str | Topic[Any]) -> NDArray[np.float64]:
        """Read the log times (s since boot) of a topic, in the order of the file.

        If a checksum protects the message indexes, as in every file of Wingbeat, only the indexes are read, which is
        much faster than `columns`. Otherwise the messages are read.

        Raises:
            InputError: the log has no such topic, or a part of the file is damaged.
        """
        name = topic if isinstance(topic, str) else topic.name
        parts = self._checked(lambda: [self._listed_times(channel) for channel in self._channels(name)])
        return np.asarray((np.concatenate(parts) - self.boot_ns) * 1e-9, np.float64)

    def _listed_times(self, channel: Channel) -> NDArray[np.int64]:
        times = self._places.times(self._data, channel.id) if self._indexes_intact else None
        if times is None:
            parts = [entries[channel.id]["time"] for entries in self._looked_up if channel.id in entries]
            times = np.concatenate([np.empty(0, np.uint64), *parts])
        return signed_log_times(times, channel.topic)

    @cached_property
    def _places(self) -> Places:
        return Places(self._chunks())

    @cached_property
    def _indexes_intact(self) -> bool:
        """Whether the message indexes are valid without a check of the messages."""
        return indexes_intact(self._data, self._index)

    @cached_property
    def _looked_up(self) -> list[dict[int, Entries]]:
        """Message entries of every chunk by channel, each checked."""
        looked_up: list[dict[int, Entries]] = []
        remaining = max_records(self._data)
        for chunk in self._chunks():
            looked_up.append(self._checked(partial(self._entries, chunk, chunk.channels, remaining)))
            remaining -= sum(map(len, looked_up[-1].values()))
        return looked_up

    def _entries(
        self, chunk: ChunkSpan, channels: Iterable[int], max_records: int | None = None
    ) -> dict[int, Entries]:
        if chunk.entries:
            return chunk.entries
        content = unpack(self._data, chunk)
        return {channel: entries_of(self._data, chunk, content, channel, max_records) for channel in channels}

    def order(self, topics: Iterable[str | Topic[Any]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the order in which messages of several topics were written, regardless of their times.

        Returns:
            two arrays (n,): the index in ``topics`` of each message, and its row in that topic's `columns`.

        Raises:
            InputError: the log has no such topic, or a part of the file is damaged.
        """
        channels = [self._channels(topic if isinstance(topic, str) else topic.name)[0].id for topic in topics]
        kinds, times = [np.empty(0, np.int64)], [np.empty(0, np.uint64)]
        for chunk in self._places.chunks_of(channels):
            here = chunk.channels
            present = [(i, channel) for i, channel in enumerate(channels) if channel in here]
            looked_up = self._checked(partial(self._entries, chunk, [channel for _, channel in present]))
            listed = [looked_up[channel] for _, channel in present]
            entries = np.concatenate(listed)
            along = np.argsort(entries["offset"], kind="stable")
            kinds.append(np.repeat([i for i, _ in present], [len(each) for each in listed])[along])
            times.append(entries["time"][along])
        kind, time = np.concatenate(kinds), np.concatenate(times)
        row = np.zeros(len(kind), np.int64)
        for i in range(len(channels)):
            mine = np.flatnonzero(kind == i)
            row[mine[np.argsort(time[mine], kind="stable")]] = np.arange(len(mine))
        return kind, row

    def frame(
        self, topic: str | Topic[Any], library: str = "pandas", start: float | None = None, end: float | None = None
    ) -> Any:
        """Read one topic as a ``pandas`` frame (index: s since boot) or ``polars`` frame (time in column 1).

        An array of n values is n columns, ``name_0`` and so on. pandas keeps the units in ``attrs["units"]``.

        Raises:
            InputError: as `tables`, or the library is not installed.
        """
        return frame(self.columns(topic, start, end), library)

    def events(self, topic: str | Topic[Any] | None = None) -> list[Event]:
        """Read the events of one topic, or of all event topics, in order of log time.

        Raises:
            InputError: the log has no such topic, or a part of the file is damaged.
        """
        names = [name for name, info in self.topics.items() if info.schema == EVENT_SCHEMA]
        if topic is not None:
            names = [topic if isinstance(topic, str) else topic.name]
        return self._checked(lambda: self._read_events(names))

    def texts(self, topic: str | Topic[Any]) -> list[Text]:
        """Read the documents of a topic with `Text` messages, in order of log time.

        Raises:
            InputError: the log has no such topic, it carries something else, or a part of the file is damaged.
        """
        name = topic if isinstance(topic, str) else topic.name
        self._channels(name)
        if self.topics[name].schema != TEXT_SCHEMA:
            raise InputError(f"{self.path}: {name} carries {self.topics[name].schema}, no texts")
        return self._checked(lambda: [text for _, text in self._decodable(name, decode_text, self._messages(name))])

    def verify(self) -> list[str]:
        """Check everything against its checksums; return the damage, one line each."""
        wrong = list(self.damage)
        for chunk in self._index.chunks:
            try:
                unpack(self._data, chunk)
            except Damage as damage:
                wrong.append(str(damage))
        for span in self._index.attachments:
            try:
                attachment_at(self._data, span)
            except Damage as damage:
                wrong.append(str(damage))
        if not wrong and data_intact(self._data, self._index) is False:
            wrong.append(ALTERED)
        return wrong

    # --- inside -----------------------------------------------------------------------------------------

    def _chunks(self) -> list[ChunkSpan]:
        return [chunk for chunk in self._index.chunks if chunk.places or chunk.entries]

    def _info(self, channel: Channel) -> TopicInfo:
        schema = self._index.schemas.get(channel.schema_id)
        rate, deterministic = channel.metadata.get("rate"), channel.metadata.get("deterministic")
        same = [other.id for other in self._by_topic[channel.topic]]
        return TopicInfo(
            channel.topic,
            channel.id,
            schema.name if schema else "",
            channel.message_encoding,
            sum(self._index.counts.get(number, 0) for number in same),
            _number(rate),
            None if deterministic is None else deterministic == "true",
            layout_in_file(channel, schema),
        )

    def _channels(self, topic: str) -> list[Channel]:
        found = self._by_topic.get(topic)
        if not found:
            guess, has = did_you_mean(topic, self.topics), ", ".join(self.topics) or "none"
            raise InputError(f"{self.path} has no topic {topic}{guess}; it has: {has}")
        return found

    def _read_events(self, topics: list[str]) -> list[Event]:
        found: list[tuple[int, Event]] = []
        size = 0

        def decode(data: bytes) -> Event:
            nonlocal size
            size += len(data)
            if size > MAX_EVENTS_BYTES:
                raise Damage(f"the events of the log exceed {MAX_EVENTS_BYTES >> 20} MiB")
            return decode_event(data)

        for name in topics:
            window = self._window(None, None)
            messages = (pair for channel in self._channels(name) for pair in self._encoded(channel, window))
            found += self._decodable(name, decode, messages)
        return [event for _, event in sorted(found, key=lambda pair: pair[0])]

    def _decodable(
        self, topic: str, decode: Callable[[bytes], Result], messages: Iterable[tuple[int, bytes]]
    ) -> list[tuple[int, Result]]:
        """Decode messages with their log times (ns); those that cannot be decoded are counted.

        Raises:
            Damage: none of them can be decoded.
        """
        out: list[tuple[int, Result]] = []
        failed, reason = 0, None
        for time, data in messages:
            try:
                out.append((time, decode(data)))
            except Damage as damage:
                failed, reason = failed + 1, damage
        if reason is not None and not out:
            raise reason
        if failed:
            self.undecodable[topic] = max(failed, self.undecodable.get(topic, 0))
        return out

    def _window(self, start: float | None, end: float | None) -> tuple[int, int]:
        """Log times in ns, from the first to before the second."""
        boot = self.boot_ns
        low = self.start_ns if start is None else boot + moment(start)
        return low, self.end_ns + 1 if end is None else boot + moment(end)

    def _filled(self, channels: Mapping[int, Channel], window: tuple[int, int]) -> dict[int, Table]:
        """Columns of the channels of fixed layout whose message indexes can be read, in one pass over the chunks."""
        layouts = {number: layout_in_file(channel, self._schema(channel)) for number, channel in channels.items()}
        fixed = {number: layout for number, layout in layouts.items() if layout is not None}
        chunks = self._between(window, fixed)
        sizes = np.array([chunk.size for chunk in chunks], np.int64)
        places, tables = Places(chunks), {}
        for number, layout in fixed.items():
            found = places.listing(self._data, number)
            if found is not None:
                tables[number] = Table(layout, number, found, sizes)
        fill(self._data, chunks, tables.values())
        return tables

    def _table(self, name: str, boot: int, window: tuple[int, int], filled: Mapping[int, Table]) -> Columns:
        channels = self._channels(name)
        layout = layout_in_file(channels[0], self._schema(channels[0]))
        parts = [filled[channel.id] for channel in channels if channel.id in filled]
        whole = len(parts) == len(channels) and all(part.fits for part in parts)
        if layout is None or not whole or len({part.kind.kind for part in parts}) > 1:
            return free_columns(name, boot, layout, self._checked(lambda: self._decoded(channels, window)))
        # The chunk's CRC covers a time, not its copy in the message index: rows are cut only if all copies agree.
        found = [part.between(*window) for part in parts]
        times = self._checked(lambda: signed_log_times(_joined([times for times, _ in found]), name))
        fields = {item.name: _joined([values[item.name] for _, values in found]) for item in layout.fields}
        return fixed_columns(name, boot, layout, times, fields)

    def _decoded(self, channels: list[Channel], window: tuple[int, int]) -> list[Stamped]:
        """Messages decoded one by one, with their log times in ns."""
        out: list[Stamped] = []
        for channel in channels:
            decode = value_decoder(channel, self._schema(channel))
            out += self._decodable(channel.topic, decode, self._encoded(channel, window))
        return out

    def _encoded(self, channel: Channel, window: tuple[int, int]) -> Iterator[tuple[int, bytes]]:
        """Log times in ns and encoded messages of a channel, every one found by a checked message index."""
        for chunk in self._between(window, [channel.id]):
            content = unpack(self._data, chunk)
            entries = _inside(entries_of(self._data, chunk, content, channel.id), chunk, window)
            signed_log_times(entries["time"], channel.topic)
            yield from zip(entries["time"].tolist(), bodies(content, entries), strict=True)

    def _messages(self, topic: str) -> list[tuple[int, bytes]]:
        """Encoded messages of a topic with their log times in ns, in order of these."""
        window = self._window(None, None)
        pairs = [pair for channel in self._channels(topic) for pair in self._encoded(channel, window)]
        return sorted(pairs, key=lambda pair: pair[0])

    def _between(self, window: tuple[int, int], channels: Iterable[int]) -> list[ChunkSpan]:
        """The chunks that have messages of any of the channels and may have some of the window."""
        held = self._places.chunks_of(channels)
        return [chunk for chunk in held if chunk.start_ns < window[1] and chunk.end_ns >= window[0]]

    def _schema(self, channel: Channel) -> Schema | None:
        return self._index.schemas.get(channel.schema_id)

    def _checked(self, read: Callable[[], Result]) -> Result:
        try:
            return read()
        except Damage as damage:
            raise InputError(f"{self.path}: {damage} (wingbeat log recover repairs it)") from None


def map_file(path: Path) -> mmap.mmap:
    """Map a file that begins with MCAP's magic.

    Raises:
        InputError: the file cannot be read, is empty or is not MCAP.
    """
    try:
        with path.open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}{_parts_hint(path)}") from None
    except ValueError:
        raise InputError(f"{path} is empty") from None
    if data[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
        head = data[:HEAD_BYTES]
        data.close()
        raise InputError(f"{path} is not an MCAP log: {_import_hint(path, head)}")
    return data


def _parts_hint(path: Path) -> str:
    """The recordings of the flight that were not joined to a missing file, and the command that does it."""
    parts = [] if path.exists() else parts_of(path)
    names = " and ".join(part.name for part in parts)
    return f"; {names} exist: wingbeat log recover {shlex.quote(str(path))} joins them" if parts else ""


def _import_hint(path: Path, head: bytes) -> str:
    """How a file that is none becomes a log, in words, by its ending or by what it begins with."""
    suffix, name = path.suffix.lower(), shlex.quote(str(path))
    if suffix in IMPORTED or head.startswith(IMPORTED_HEADS):
        return f"wingbeat log import {name} makes one of it"
    if suffix in TABLES:
        return f"wingbeat log import {name} --map MAP.toml makes one of a table"
    return f"wingbeat log import makes one of {', '.join(IMPORTED)}, and with --map MAP.toml of any table"


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _inside(entries: Entries, chunk: ChunkSpan, window: tuple[int, int]) -> Entries:
    """Entries with log times in the window."""
    if window[0] <= chunk.start_ns and chunk.end_ns < window[1]:
        return entries
    times = entries["time"]
    low, high = (min(max(edge, 0), BEYOND_NS) for edge in window)
    return entries[(times >= low) & (times < high)]
