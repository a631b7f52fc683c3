"""Import of a log of another program."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from avionics.topics import CHANGES, EVENTS, EXCITATION, IMU, WING
from logs.importing import (
    c3d,
    csv_table,
    dataflash,
    dataflash_records,
    dataflash_topics,
    motion_capture,
    razor,
    tlog,
    tlog_topics,
    ulog,
    ulog_topics,
)
from logs.importing.checks import BEHIND, LATE_US, LATEST_US, Mask, end_of, not_behind, sound
from logs.importing.clocks import align, of_import, of_log
from logs.importing.counterparts import Counterpart, make_all
from logs.importing.excitation import excitation_topic
from logs.importing.source import Dropped, ImportedTopic, Series, Source, shifted
from logs.importing.wing import WingSource, wing_topic
from logs.importing.writing import Extras, Progress, imported_stream, source_streams, topic_name, write_log
from logs.names import PARAMETERS
from logs.new_files import check_new
from logs.reader import open_log
from wingbeat.errors import InputError
from wingbeat.message import Event

IMPORT = "wingbeat.import"
"""Name of the metadata record with the source of an imported log."""
NOTES = "source.notes"
"""Name of the metadata record with other facts of the source."""
AUTOPILOTS = ("ulog", "dataflash", "tlog")
"""formats of autopilots, whose logs may have strokes and identification inputs"""
LATEST_NS = LATEST_US * 1000
"""ns since 1970; a later zero of the clock is damage"""
REPORT = "import_report.json"
"""Name of the attachment with the complete report."""


class Format(NamedTuple):
    """Reader of the logs of one program."""

    name: str
    topics: str
    """-; prefix of the names of its own topics"""
    counterparts: Sequence[Counterpart]


FORMATS: Mapping[str, Format] = {
    "dataflash": Format("ArduPilot dataflash", "dataflash", dataflash_topics.COUNTERPARTS),
    "ulog": Format("PX4 ULog", "ulg", ulog_topics.COUNTERPARTS),
    "tlog": Format("MAVLink telemetry log", "tlog", tlog_topics.COUNTERPARTS),
    "razor": Format("Razor 9DOF serial capture", "razor", ()),
    "motion capture": Format("motion capture", "mocap", ()),
    "csv": Format("table of comma-separated values", "csv", ()),
}
"""By `Source.format`."""


class TopicCount(NamedTuple):
    """Topic in the new log."""

    topic: str
    source: str
    """-; name of its source series; empty for a topic copied unchanged"""
    messages: int


class ImportReport(NamedTuple):
    """Result of an import."""

    file: str
    """-; the new log"""
    source: str
    """-; name of the source file"""
    format: str
    sha256: str
    """-; of the source"""
    importer: str
    """-; version of the importing program"""
    vehicle: str
    """-; vehicle description in the source"""
    messages: int
    topics: tuple[TopicCount, ...]
    events: int
    parameters: int
    damage: tuple[str, ...]
    """damage of the source, one line each"""
    dropped: tuple[Dropped, ...]
    """dropped rows, by topic and reason"""
    later_boots: tuple[ImportReport, ...] = ()
    """reports of the logs of later boots in the same file"""


class Checked(NamedTuple):
    """Valid data of a source."""

    imported: list[ImportedTopic]
    """Wingbeat topics"""
    series: dict[str, Series]
    """series of the source"""
    events: list[Event]
    dropped: list[Dropped]


class Choice(NamedTuple):
    """Options of an import."""

    source: Path
    target: Path
    mapping: Path | None = None
    """-; TOML; assignment of a table's columns"""
    clock: str = "vehicle"
    """clock of a .tlog, one of `tlog.CLOCKS`"""
    onboard: Path | None = None
    """log of the same flight that defines the clock of the new one"""
    wing: WingSource = WingSource()
    """what the wing strokes are made of"""


def import_log(choice: Choice, progress: Progress = lambda done, total: None) -> ImportReport:
    """Convert a log of another program to a new log, or to one for each boot of the vehicle in it.

    Returns:
        the report, with those of later boots. The log of the second boot is ``TARGET-boot2.mcap``.

    Raises:
        InputError: it cannot be read, has an unknown format or no data, or a target exists; nothing is written
            then.
    """
    check_new(choice.target, made=True)
    data = read_bytes(choice.source)
    try:
        with np.errstate(all="ignore"):  # garbage overflows; what comes of it is looked at
            sources = read_source(choice, data)
            parts = [_with_strokes(one, _checked(one), choice.wing) for one in sources]
        full = [(one, checked) for one, checked in parts if checked.imported or checked.series]
        if not full:
            raise InputError(f"no row of it can be true{_reasons(parts[0][1].dropped)}")
    except InputError as reason:
        raise InputError(f"{choice.source}: {_line(str(reason))}") from None
    targets = [boot_path(choice.target, number) for number in range(1, len(full) + 1)]
    for target in targets:
        check_new(target, made=True)
    first, *later = (
        _convert(choice._replace(target=target), data, source, checked, progress)
        for target, (source, checked) in zip(targets, full, strict=True)
    )
    return first._replace(later_boots=tuple(later))


def boot_path(target: Path, number: int) -> Path:
    """Return the new log of the ``number``-th boot in a file, from 1."""
    return target if number == 1 else target.with_name(f"{target.stem}-boot{number}{target.suffix}")


def _convert(choice: Choice, data: bytes, source: Source, checked: Checked, progress: Progress) -> ImportReport:
    if choice.onboard is not None:
        source, checked = _on_clock_of(choice.onboard, source, checked)
    report = _report(choice, data, source, checked)
    streams = [
        *map(imported_stream, checked.imported),
        *source_streams(FORMATS[source.format].topics, checked.series),
    ]
    epoch_ns = source.epoch_ns if 0 <= source.epoch_ns < LATEST_NS else 0
    documents = {REPORT: lambda added: _json(_with_added(report, added))}
    extras = Extras(epoch_ns, checked.events, source.changes, _notes(report, source), documents)
    return _with_added(report, write_log(choice.target, streams, extras, progress))


def read_bytes(path: Path) -> bytes:
    """Read a file.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None


def read_source(choice: Choice, data: bytes) -> list[Source]:
    """Read the source by its first bytes, or by its name if they are not specific; one for each boot.

    Raises:
        InputError: it is empty, or no log of a known format.
    """
    if not data:
        raise InputError("it is empty")
    suffix = choice.source.suffix.lower()
    if choice.mapping is not None and (suffix in (".bin", ".ulg", ".tlog") or ulog.is_ulog(data)):
        raise InputError("--map applies to tables only")
    if ulog.is_ulog(data):
        return [ulog.read_ulog(data)]
    if dataflash_records.is_dataflash(data):
        return dataflash.read_dataflash(data)
    if suffix == ".c3d":
        return [c3d.read_c3d(data)]
    if choice.mapping is None and suffix == ".csv" and motion_capture.is_motion_capture(data):
        return [motion_capture.read_motion_capture(data)]
    if suffix not in (".tlog", ".csv") and choice.mapping is None and razor.is_razor(data):
        return [razor.read_razor(data)]
    named: dict[str, Callable[[], list[Source]]] = {
        ".tlog": lambda: tlog.read_tlog(data, choice.clock),
        ".csv": lambda: [csv_table.read_table(data, choice.mapping)],
        ".bin": lambda: _refuse("an ArduPilot dataflash log"),
        ".ulg": lambda: _refuse("a PX4 ULog"),
    }
    suffix = ".csv" if choice.mapping is not None and suffix not in named else suffix
    if suffix not in named:
        raise InputError(
            "unknown log format; known: .bin, .ulg, .tlog, .c3d, captures of a Razor, any table with --map"
        )
    return named[suffix]()


def _line(text: str) -> str:
    """Convert a text to one line: names in a damaged file may contain any character."""
    return "".join(one if one.isprintable() else "?" for one in " ".join(text.split()))


def _refuse(name: str) -> list[Source]:
    raise InputError(f"it does not begin as {name} does")


def _checked(source: Source) -> Checked:
    """Return the valid data of a source; a row rejected in one topic is rejected in all."""
    known, dropped = FORMATS[source.format], list(source.dropped)
    series: dict[str, Series] = {}
    for name, one in source.series.items():
        whole, lost = sound(one, topic_name(known.topics, name), source.checksummed)
        dropped += lost
        if len(whole.time_us):
            series[name] = whole
    end = _end(source, series)
    dropped += _drop_behind(series, known.topics, end)
    counterparts, failed = make_all(known.counterparts, series)
    imported = [*source.made, *counterparts]
    dropped += failed
    masks: dict[str, Mask] = {}
    for made in imported:
        dropped += made.dropped
        if made.source not in series:
            continue  # made of what is not kept beside it
        masks[made.source] = masks.get(made.source, np.True_) & made.kept
    series |= {name: series[name].taken(mask) for name, mask in masks.items()}
    events = [event for event in source.events if 0 <= event.time_us <= end + LATE_US]
    if len(events) < len(source.events):
        dropped.append(Dropped(EVENTS.name, "time outside of the log", len(source.events) - len(events)))
    return Checked(imported, series, events, dropped)


def _with_strokes(source: Source, checked: Checked, choice: WingSource) -> tuple[Source, Checked]:
    """Add wing strokes and identification inputs, which no other program logs in the form of Wingbeat."""
    made = {one.topic: one for one in checked.imported}
    added, notes = list(checked.imported), dict(source.notes)
    if source.format not in AUTOPILOTS and not choice.topic:
        return source, checked
    excitation = None if EXCITATION in made else excitation_topic(checked.series, source.parameters)
    if excitation is not None:
        added.append(excitation)
    strokes = None if WING in made else wing_topic(checked.series, made.get(IMU), choice)
    if strokes is not None:
        added.append(strokes[0])
        notes["wing"] = f"strokes from {strokes[1]}"
    return source._replace(notes=notes), checked._replace(imported=added)


def _on_clock_of(onboard: Path, source: Source, checked: Checked) -> tuple[Source, Checked]:
    """Convert all times to the clock of another log of the same flight; data before its boot are dropped.

    Raises:
        InputError: the two did not measure the same motion.
    """
    with open_log(onboard) as log:
        aligned = align(of_import(checked.imported), of_log(log))
        epoch_ns = log.boot_ns
    shift = round(aligned.offset * 1e6)
    imported: list[ImportedTopic] = []
    series: dict[str, Series] = {}
    dropped = list(checked.dropped)
    for made in checked.imported:
        moved, lost = sound(shifted(made.series, shift), made.topic.name, trusted=True)
        imported += [made._replace(series=moved)] if len(moved.time_us) else []
        dropped += lost
    for name, one in checked.series.items():
        moved, lost = sound(shifted(one, shift), topic_name(FORMATS[source.format].topics, name), trusted=True)
        series |= {name: moved} if len(moved.time_us) else {}
        dropped += lost
    events = [event._replace(time_us=event.time_us + shift) for event in checked.events if event.time_us + shift >= 0]
    clock = (
        f"that of {onboard.name}, by the angular rate: {aligned.offset:+.4f} s, correlation {aligned.correlation:.3f}"
    )
    return source._replace(epoch_ns=epoch_ns, clock=clock), Checked(imported, series, events, dropped)


def _end(source: Source, series: Mapping[str, Series]) -> int:
    """Return the end of the log in us, 0 for one without rows."""
    rows = [one for one in (*series.values(), *(made.series for made in source.made)) if len(one.time_us)]
    return end_of(rows) if rows else 0


def _drop_behind(series: dict[str, Series], topics: str, end: int) -> list[Dropped]:
    """Remove the rows far after the end of the log from ``series``."""
    dropped = []
    for name, one in list(series.items()):
        mask = not_behind(one.time_us, end)
        if mask.all():
            continue
        dropped.append(Dropped(topic_name(topics, name), BEHIND, int((~mask).sum())))
        series[name] = one.taken(mask)
        if not mask.any():
            del series[name]
    return dropped


def _reasons(dropped: Sequence[Dropped]) -> str:
    return "".join(f"; {one.topic}: {one.reason} ({one.rows})" for one in dropped[:3])


def _report(choice: Choice, data: bytes, source: Source, checked: Checked) -> ImportReport:
    known = FORMATS[source.format]
    topics = [TopicCount(one.topic.name, one.source, len(one.series.time_us)) for one in checked.imported]
    kept = sorted(checked.series.items())
    topics += [TopicCount(topic_name(known.topics, name), "", len(one.time_us)) for name, one in kept]
    if source.changes:
        topics.append(TopicCount(CHANGES.name, "", len(source.changes)))
    return ImportReport(
        str(choice.target), choice.source.name, known.name, hashlib.sha256(data).hexdigest(), version("wingbeat"),
        source.vehicle, sum(topic.messages for topic in topics), tuple(topics), len(checked.events),
        len(source.parameters), source.damage, tuple(checked.dropped),
    )  # fmt: skip


def _with_added(report: ImportReport, added: Mapping[str, int]) -> ImportReport:
    """Return the report with the topics that were added for viewers."""
    topics = (*report.topics, *(TopicCount(name, "", count) for name, count in sorted(added.items())))
    return report._replace(messages=report.messages + sum(added.values()), topics=topics)


def _notes(report: ImportReport, source: Source) -> dict[str, dict[str, str]]:
    facts = {
        "source": report.source,
        "format": report.format,
        "sha256": report.sha256,
        "importer": f"wingbeat {report.importer}",
        "clock": source.clock,
        "damage": "; ".join(report.damage),
        "dropped": str(sum(one.rows for one in report.dropped)),
    } | ({"vehicle": report.vehicle} if report.vehicle else {})
    notes = {IMPORT: facts, NOTES: dict(source.notes)}
    notes[PARAMETERS] = {
        # A number of single precision has nine digits; a whole number has all of its own.
        name: str(value) if isinstance(value, int) else f"{value:.9g}"
        for name, value in source.parameters.items()
    }
    return {name: values for name, values in notes.items() if values}


def _json(report: ImportReport) -> bytes:
    """Return the report as JSON without the new log's name, so that it depends on the source only."""
    document = report._asdict() | {"topics": [topic._asdict() for topic in report.topics]}
    document["dropped"] = [one._asdict() for one in report.dropped]
    del document["file"], document["later_boots"]
    return json.dumps(document, indent=2).encode()
