"""Export of topics: CSV, npz, Parquet, MATLAB, rosbag2, Rerun."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from logs.columns import Columns
from logs.flat import distinct, export_table, split, split_units, texts
from logs.matlab import write_mat
from logs.new_files import claim, draft, settle
from logs.parquet import write_parquet
from logs.reader import Log
from wingbeat.errors import InputError
from wingbeat.text import pluralize

Tables = Mapping[str, Columns]
Show = Callable[[float, float, str], None]
"""(done, total, what) for a progress bar"""


class Part(NamedTuple):
    """Part of a log to export; all of it by default."""

    topics: Sequence[str] | None = None
    """names, with a rate also ``topic.field``. Default: all topics with messages; for one table only those of fixed
    layout, if there are any (events, documents and images are omitted)
    """
    start: float | None = None
    """s; since boot"""
    end: float | None = None
    """s; since boot, exclusive"""
    rate: float | None = None
    """Hz; rate of one table of all topics, see `Log.aligned`. Default: a table for each topic"""


WHOLE = Part()


class Exported(NamedTuple):
    """Result of an export."""

    files: list[Path]
    left_out: list[str]
    """topics and messages that cannot be decoded, one line each"""


def export(
    log: Log,
    target: Path,
    part: Part = WHOLE,
    form: str | None = None,
    show: Show = lambda done, total, what: None,
) -> Exported:
    """Write a part of a log as one of `FORMS`.

    Args:
        log: source.
        target: a file, or a folder for CSV and Parquet with a file per topic.
        part: topics, time range and rate.
        form: output format (default: the suffix of ``target``, CSV for a folder).
        show: called with the progress.

    Raises:
        InputError: unknown topic or form, a file exists (no file is written then), it cannot be written, a package is
            not installed, several tables would have to go to one file, or the form does not support parts.
    """
    if form is None and target.suffix == ".mcap":
        raise InputError(f"{target}: specify --format {BAG} for a file of ROS 2, or another suffix")
    if form is None and target.suffix and target.suffix[1:] not in FORMS and not target.is_dir():
        raise InputError(
            f"{target}: no export as {target.suffix}; there are {', '.join(FORMS)}, or a folder with a form"
        )
    form = form or (target.suffix[1:] if target.suffix[1:] in FORMS else "csv")
    if form not in FORMS:
        raise InputError(f"no export as {form}; there are {', '.join(FORMS)}")
    if form == FLIGHT:
        return Exported([_write_flight(log, target, part, show)], [])
    if form == BAG:
        _check_bag(target, part)
    part, left_out = _decodable(log, part)
    raw = _tables(log, part, left_out)
    if form == BAG:
        return Exported(_write_bag(log, target, raw, show), (left_out or []) + undecodable_lines(log))
    tables = _export_tables(raw)
    if form in TOGETHER:
        files = _write_together(tables, target, TOGETHER[form])
    elif target.suffix == f".{form}":
        files = _write_one(tables, target, EACH[form])
    else:
        files = _write_each(tables, target, form, show)
    return Exported(files, (left_out or []) + undecodable_lines(log))


def undecodable_lines(log: Log) -> list[str]:
    """Return one line for each topic with omitted messages that cannot be decoded."""
    return [
        f"{topic}: {pluralize(number, 'message')} that cannot be decoded" for topic, number in log.undecodable.items()
    ]


def export_csv(log: Log, folder: Path, topics: Sequence[str] | None = None) -> list[Path]:
    """Write one CSV file per topic, ``main_wing.csv`` for ``/main/wing``; see `export`."""
    return _write_each(_export_tables(_tables(log, Part(topics))), folder, "csv")


def export_npz(log: Log, path: Path, topics: Sequence[str] | None = None) -> Path:
    """Write topics to one npz file; see `export` and `write_npz`."""
    return _write_together(_export_tables(_tables(log, Part(topics))), path, write_npz)[0]


# --- what ------------------------------------------------------------------------------------------------


def _decodable(log: Log, part: Part) -> tuple[Part, list[str] | None]:
    """Return the part without topics that cannot be decoded (unless named), and a line about each of those."""
    if part.topics is not None:
        return part, None
    names, left_out = [], []
    fixed = [name for name in _with_messages(log) if log.topics[name].layout is not None]
    for name in fixed if fixed and part.rate is not None else _with_messages(log):
        try:
            if log.topics[name].layout is None:
                log.columns(name, 0.0, 0.0)
            names.append(name)
        except InputError as reason:
            left_out.append(f"{name}: {reason}")
    return part._replace(topics=names), left_out


def _tables(log: Log, part: Part, left_out: list[str] | None = None) -> dict[str, Columns]:
    """Read the tables; free-layout topics without decodable messages are added to ``left_out`` if it is given."""
    topics = _with_messages(log) if part.topics is None else part.topics
    if part.rate is None:
        _check_whole(log, topics)
        if left_out is None:
            found = log.tables(topics, part.start, part.end)
        else:
            found = _readable_tables(log, topics, part, left_out)
    else:
        found = {"aligned": log.aligned(topics, part.rate, part.start, part.end)}
    return found


def _export_tables(raw: Tables) -> dict[str, Columns]:
    return {name: export_table(columns) for name, columns in raw.items()}


def _readable_tables(log: Log, topics: Sequence[str], part: Part, left_out: list[str]) -> dict[str, Columns]:
    free = [name for name in topics if log.topics[name].layout is None]
    found = log.tables([name for name in topics if name not in free], part.start, part.end)
    for name in free:
        try:
            found[name] = log.columns(name, part.start, part.end)
        except InputError as reason:
            left_out.append(f"{name}: {reason}")
    return {name: found[name] for name in topics if name in found}


def _check_whole(log: Log, topics: Iterable[str]) -> None:
    for name in topics:
        topic = name.rpartition(".")[0]
        if name not in log.topics and topic in log.topics:
            raise InputError(
                f"{name}: a field alone goes into one table of a rate: give a rate, or the topic {topic}"
            )


def _with_messages(log: Log) -> list[str]:
    return [name for name, info in log.topics.items() if info.messages]


# --- how -------------------------------------------------------------------------------------------------


def csv_header(columns: Columns) -> list[str]:
    """Return the column names with units in brackets; a packed array has one column per value."""
    return [name if unit == "-" else f"{name} [{unit}]" for name, unit in split_units(columns).items()]


def write_csv(columns: Columns, file: IO[str]) -> None:
    """Write a topic as CSV: a header, then one line per message with all digits of the numbers."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(csv_header(columns))
    cells = [texts(part) if part.dtype == object else part.tolist() for part in split(columns).values()]
    writer.writerows(zip(*cells, strict=True))


def _write_csv_bytes(columns: Columns, file: IO[bytes]) -> None:
    text = io.StringIO()
    write_csv(columns, text)
    file.write(text.getvalue().encode())


def write_npz(tables: Tables, file: IO[bytes]) -> None:
    """Write tables as arrays, ``main_wing/angle_left`` for field ``angle_left`` of ``/main/wing``.

    The arrays ``main_wing/units`` contain (field, unit) pairs. Fields that are not numbers are omitted. Duplicate
    names are numbered.
    """
    arrays: dict[str, Any] = {}
    for plain, columns in zip(_plain_names(tables), tables.values(), strict=True):
        numbers = [field for field, values in columns.items() if values.dtype != object]
        names = distinct([field.lstrip("/") for field in numbers], ("units",))
        arrays |= {f"{plain}/{name}": columns[field] for name, field in zip(names, numbers, strict=True)}
        units = [[name, columns.units[field]] for name, field in zip(names, numbers, strict=True)]
        arrays[f"{plain}/units"] = np.array(units)
    np.savez_compressed(file, **arrays)


EACH: dict[str, Callable[[Columns, IO[bytes]], None]] = {"csv": _write_csv_bytes, "parquet": write_parquet}
"""forms with one file per table"""
TOGETHER: dict[str, Callable[[Tables, IO[bytes]], None]] = {"npz": write_npz, "mat": write_mat}
"""forms with all tables in one file"""
FLIGHT = "rrd"
"""form without tables: the vehicle along its track"""
BAG = "rosbag2"
"""form for ROS 2: a folder, or one file .mcap"""
FORMS = (*EACH, *TOGETHER, BAG, FLIGHT)


# --- where -----------------------------------------------------------------------------------------------


def _write_each(tables: Tables, folder: Path, form: str, show: Show = lambda done, total, what: None) -> list[Path]:
    """Write one file per table in a folder, created if missing; nothing is written if one exists."""
    plain = zip(tables, _plain_names(tables), strict=True)
    paths = {name: folder / f"{file}.{form}" for name, file in plain}
    taken = next((path for path in paths.values() if path.exists()), None)
    if taken is not None:
        raise InputError(f"{taken} exists: it is not overwritten")
    _make(folder)
    for done, (name, columns) in enumerate(tables.items()):
        show(done, len(tables), name)
        _write(paths[name], partial(EACH[form], columns))
    return list(paths.values())


def _write_one(tables: Tables, path: Path, write: Callable[[Columns, IO[bytes]], None]) -> list[Path]:
    if len(tables) != 1:
        raise InputError(
            f"{path} is one file for {len(tables)} topics: name a folder, one topic or a rate for one table"
        )
    (columns,) = tables.values()
    return _write_together(tables, path, lambda _, file: write(columns, file))


def _write_together(tables: Tables, path: Path, write: Callable[[Tables, IO[bytes]], None]) -> list[Path]:
    _make(path.parent)
    _write(path, partial(write, tables))
    return [path]


def _check_bag(target: Path, part: Part) -> None:
    """Reject a bag that cannot be written, before the log is read."""
    if part.rate is not None:
        raise InputError(f"{BAG} holds every message at its own time: it takes no rate")
    if target.exists():
        raise InputError(f"{target} exists: it is not overwritten")


def _write_bag(log: Log, target: Path, tables: Tables, show: Show) -> list[Path]:
    from logs.rosbag2 import write_rosbag2

    _make(target.parent)
    return write_rosbag2(log, target, tables, show)


def _write_flight(log: Log, path: Path, part: Part, show: Show) -> Path:
    from logs.rrd import encode_rrd  # brings the vehicles, which tables need not wait for

    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    if part != WHOLE:
        raise InputError(f"{FLIGHT} holds the whole flight: it takes no topics, times or rate")
    _make(path.parent)
    data = encode_rrd(log, show)
    _write(path, lambda file: file.write(data))
    return path


def _plain_names(topics: Iterable[str]) -> list[str]:
    """Return unique file names, ``main_wing`` for ``/main/wing``."""
    return distinct(topic.strip("/").replace("/", "_") or "topic" for topic in topics)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror or error}") from None


def _write(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    with draft(path) as (file, name):
        buffered = io.BufferedWriter(file)
        write(buffered)
        buffered.detach()
        settle(file)
        claim(name, path)
