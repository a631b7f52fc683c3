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
from numpy.typing import NDArray

from avionics.topics import CHANGES, EVENTS
from logs.blocks import ColumnSeries
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
        series = [_columns(stream) for stream in streams]
        if extras.events:
            series.append(_messages(EVENTS, sorted(extras.events, key=lambda event: event.time_us)))
        if extras.changes:
            changes = sorted(extras.changes, key=lambda change: change.time_us)
            series.append(_messages(CHANGES, [_change(change) for change in changes]))
        order = _order([one.time_us for one in series])
        scene = SceneRecorder(recorder, PLAIN_BIRD, extras.epoch_ns, estimated=True)
        order, views = _with_views(scene, series, order)
        recorder.record_columns([*series, *views], order, lambda done: progress(done, len(order)))
        for name, made in extras.attachments.items():
            recorder.attach(name, "application/json", made(scene.added))
    trouble = recorder.failure or recorder.refusal
    if trouble:
        raise InputError(trouble)
    return scene.added


def _columns(stream: Stream) -> ColumnSeries:
    """Return a stream for the recorder; rows with text become documents."""
    series = stream.series
    if stream.topic.message is not Document:
        return ColumnSeries(stream.topic, series.time_us, [series.time_us, *series.columns.values()])
    columns = (values.tolist() for values in series.columns.values())
    rows = zip(series.time_us.tolist(), *columns, strict=True)
    names = tuple(series.columns)
    documents = [Document(at, dict(zip(names, map(_plain, row), strict=True))) for at, *row in rows]
    return ColumnSeries(stream.topic, series.time_us, messages=documents)


def _messages(topic: Topic[Any], messages: Sequence[Any]) -> ColumnSeries:
    return ColumnSeries(topic, np.array([message.time_us for message in messages], np.int64), messages=messages)


def _with_views(
    scene: SceneRecorder, series: Sequence[ColumnSeries], order: NDArray[np.intp]
) -> tuple[NDArray[np.intp], list[ColumnSeries]]:
    """Return the order with messages for viewers, each after the one that it follows from, and these messages."""
    watched = [number for number, one in enumerate(series) if one.topic.channel in scene.watched]
    rows = {number: _rows(series[number]) for number in watched}
    views: dict[Topic[Any], tuple[list[Any], list[int]]] = {}
    for place in np.flatnonzero(np.isin(order, watched)).tolist():
        number = int(order[place])
        for topic, message in scene.views_of(series[number].topic.channel, next(rows[number])):
            messages, places = views.setdefault(topic, ([], []))
            messages.append(message)
            places.append(place)
    places_of = [np.arange(len(order)), *(np.array(places, np.intp) for _, places in views.values())]
    numbers = np.repeat(np.arange(len(views)) + len(series), [len(places) for places in places_of[1:]])
    with_views = np.concatenate([order, numbers])[np.argsort(np.concatenate(places_of), kind="stable")]
    return with_views, [_messages(topic, messages) for topic, (messages, _) in views.items()]


def _rows(series: ColumnSeries) -> Iterator[Any]:
    return map(series.topic.message._make, zip(*(values.tolist() for values in series.columns), strict=True))


def _change(change: ParameterChange) -> Text:
    document = {"parameter": change.name, "value": change.value, "source": "log"}
    return Text(max(change.time_us, 0), json.dumps(document))


def _order(times: Sequence[Array]) -> NDArray[np.intp]:
    """Return which series has the next message, in order of time."""
    numbers = np.repeat(np.arange(len(times)), [len(one) for one in times])
    return numbers[np.argsort(np.concatenate([*times, np.empty(0, np.int64)]), kind="stable")]


def _plain(value: Any) -> Any:
    """A value in the types of JSON, which has no word for what is not finite."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
