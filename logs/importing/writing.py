"""Writer of imported series as an MCAP log."""

from __future__ import annotations

import json
import re
import tempfile
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from avionics.topics import CHANGES, EVENTS
from logs.batches import batched
from logs.codecs import Document
from logs.importing.source import Array, ImportedTopic, ParameterChange, Series
from logs.layout import Field, Layout
from logs.new_files import claim, settle
from logs.recorder import McapRecorder
from logs.scene import PLAIN_BIRD, SceneRecorder
from wingbeat.errors import InputError
from wingbeat.message import Event, Text
from wingbeat.topic import Topic

FIRST_CHANNEL = 4000
"""of the topics of other programs, in the order of their names"""
TIME = Field("time_us", 1, "fixed64", 0, "us", "since the source's boot")
_SCALARS = {"f8": "double", "f4": "float", "f2": "float", "u8": "fixed64", "i8": "sfixed64"}
Progress = Callable[[float, float], None]
"""called with the completed and the total work"""


class Stream(NamedTuple):
    """Topic with all its messages, as columns of their fields."""

    topic: Topic[Any]
    series: Series


class Extras(NamedTuple):
    """Content of a log besides its topics."""

    epoch_ns: int
    """ns since 1970 at the zero of the source's clock"""
    events: Sequence[Event]
    changes: Sequence[ParameterChange]
    """of parameters after boot"""
    notes: Mapping[str, Mapping[str, str]]
    """metadata by name"""
    attachments: Mapping[str, Callable[[Mapping[str, int]], bytes]]
    """JSON documents by name, each built from the number of messages added for viewers, by topic"""


def imported_stream(imported: ImportedTopic) -> Stream:
    """Return a Wingbeat topic with the rate of its source."""
    rate = rate_of(imported.series)
    return Stream(imported.topic._replace(rate=rate), imported.series)


def source_streams(format_name: str, series: Mapping[str, Series]) -> list[Stream]:
    """Return the source's own messages as topics, ``/ulg/vehicle_status``."""
    return [
        Stream(_source_topic(format_name, FIRST_CHANNEL + number, one), one)
        for number, (_, one) in enumerate(sorted(series.items()))
    ]


def topic_name(format_name: str, name: str) -> str:
    """Return the topic name of a source series."""
    return f"/{format_name}/{name}"


def rate_of(series: Series) -> float:
    """Return the rate in Hz from the median period, to three digits; 0 without a positive median."""
    periods = np.diff(series.time_us)
    median = float(np.median(periods)) if len(periods) else 0.0
    return float(f"{1e6 / median:.3g}") if median > 0.0 else 0.0


def _source_topic(format_name: str, channel: int, series: Series) -> Topic[Any]:
    text = any(values.dtype == object for values in series.columns.values())
    message: Any = Document if text else _message(format_name, series)
    return Topic(topic_name(format_name, series.name), message, channel, rate_of(series), deterministic=True)


def _message(format_name: str, series: Series) -> Any:
    """A tuple of the time and every column, with the layout that the log needs."""
    fields = (TIME, *_fields(series))
    make: Any = namedtuple
    made: Any = make("Row", ["time_us", *(f"column_{number}" for number in range(1, len(fields)))])
    name = re.sub(r"[^A-Za-z0-9_]+", "_", series.name)
    made.LAYOUT = Layout(f"{format_name}.{name}", f"{series.name} of the imported log", fields)
    return made


def _fields(series: Series) -> Iterator[Field]:
    names: set[str] = {TIME.name}
    for number, (column, values) in enumerate(series.columns.items(), 2):
        name = re.sub(r"[^A-Za-z0-9_]+", "_", column) or f"column_{number}"
        name = name if not name[0].isdigit() else f"_{name}"
        while name in names:
            name += "_"
        names.add(name)
        length = values.shape[1] if values.ndim == 2 else 0
        yield Field(name, number, _scalar(values), length, series.units.get(column, "") or "-")


def _scalar(values: Array) -> str:
    kind = values.dtype
    default = "sfixed32" if kind.kind == "i" else "fixed32"
    return _SCALARS.get(f"{kind.kind}{kind.itemsize}", default)


def write_log(path: Path, streams: Sequence[Stream], extras: Extras, progress: Progress) -> Mapping[str, int]:
    """Write a new log atomically; return how many messages were added for viewers, by topic.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", suffix=".part", dir=path.parent) as folder:
            draft = Path(folder) / "draft.mcap"
            added = _write(draft, streams, extras, progress)
            with draft.open("rb+") as file:
                settle(file)
            claim(draft, path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    return added


def _write(path: Path, streams: Sequence[Stream], extras: Extras, progress: Progress) -> Mapping[str, int]:
    # A constant wall clock: the same source gives the same file.
    with McapRecorder(path, start_epoch_ns=extras.epoch_ns, clock=lambda: 0.0) as recorder:
        for name, values in extras.notes.items():
            recorder.note(name, dict(values))
        feeds = [(stream.topic, stream.series.time_us, _messages(stream)) for stream in streams]
        if extras.events:
            said = sorted(extras.events, key=lambda event: event.time_us)
            feeds.append((EVENTS, np.array([event.time_us for event in said], np.int64), iter(said)))
        if extras.changes:
            changes = sorted(extras.changes, key=lambda change: change.time_us)
            times_us = np.array([change.time_us for change in changes], np.int64)
            feeds.append((CHANGES, times_us, map(_change, changes)))
        order = _order([times for _, times, _ in feeds])
        seen = SceneRecorder(recorder, PLAIN_BIRD, extras.epoch_ns, estimated=True)
        with batched(seen.record_all) as publish:
            for number, feed in enumerate(order):
                topic, _, messages = feeds[feed]
                publish(topic, next(messages))
                if number % 10_000 == 0:
                    progress(number, len(order))
        for name, made in extras.attachments.items():
            recorder.attach(name, "application/json", made(seen.added))
    trouble = recorder.failure or recorder.refusal
    if trouble:
        raise InputError(trouble)
    return seen.added


def _change(change: ParameterChange) -> Text:
    document = {"parameter": change.name, "value": change.value, "source": "log"}
    return Text(max(change.time_us, 0), json.dumps(document))


def _order(times: Sequence[Array]) -> list[int]:
    """Which feed has the next message, in order of time."""
    feeds = np.repeat(np.arange(len(times)), [len(one) for one in times])
    every = np.concatenate([*times, np.empty(0, np.int64)])
    order: list[int] = feeds[np.argsort(every, kind="stable")].tolist()
    return order


def _messages(stream: Stream) -> Iterator[Any]:
    series, message = stream.series, stream.topic.message
    columns = [values.tolist() for values in series.columns.values()]
    rows = zip(series.time_us.tolist(), *columns, strict=True)
    if message is not Document:
        return map(message._make, rows)
    names = tuple(series.columns)
    return (Document(row[0], dict(zip(names, map(_plain, row[1:]), strict=True))) for row in rows)


def _plain(value: Any) -> Any:
    """A value in the types of JSON, which has no word for what is not finite."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
