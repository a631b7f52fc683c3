"""Topics for other programs: CSV and NumPy's npz."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from avionics.quantities import BadInput
from logs.columns import Columns
from logs.placing import claim, draft, settle
from logs.reader import Log


def csv_header(columns: Columns) -> list[str]:
    """Names of a topic's columns with their units in brackets; a packed array has one column per value."""
    names: list[str] = []
    for name, values in columns.items():
        unit = columns.units[name]
        ending = "" if unit == "-" else f" [{unit}]"
        parts = [f"{name}_{i}" for i in range(values.shape[1])] if values.ndim == 2 else [name]
        names += [part + ending for part in parts]
    return names


def write_csv(columns: Columns, file: IO[str]) -> None:
    """Write a topic as CSV: a header line, then one line per message; numbers keep all their digits."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(csv_header(columns))
    flat: list[list[Any]] = []
    for values in columns.values():
        flat += [part.tolist() for part in (values.T if values.ndim == 2 else [values])]
    writer.writerows(zip(*flat, strict=True))


def export_csv(log: Log, folder: Path, topics: Sequence[str] | None = None) -> list[Path]:
    """Write one file per topic, ``main_wing.csv`` for ``/main/wing``; return their paths.

    Args:
        log: what to export.
        folder: where to; created when missing.
        topics: names; all topics with messages when not given.

    Raises:
        BadInput: unknown topic, a file exists (then none is written), or the folder cannot be written to.
    """
    tables = log.tables(_with_messages(log) if topics is None else topics)
    paths = {name: folder / f"{_plain(name)}.csv" for name in tables}
    taken = next((path for path in paths.values() if path.exists()), None)
    if taken is not None:
        raise BadInput(f"{taken} exists: it is not overwritten")
    _make(folder)
    for name, columns in tables.items():
        _write(paths[name], partial(_write_csv_bytes, columns))
    return list(paths.values())


def export_npz(log: Log, path: Path, topics: Sequence[str] | None = None) -> Path:
    """Write topics to one npz file: array ``main_wing/angle_left`` for field ``angle_left`` of ``/main/wing``.

    Units are in the arrays ``main_wing/units`` of (field, unit) pairs. Fields that are not numbers are left out.

    Raises:
        BadInput: unknown topic, the file exists, or it cannot be written.
    """
    tables = log.tables(_with_messages(log) if topics is None else topics)
    arrays: dict[str, Any] = {}
    for name, columns in tables.items():
        numbers = {field: values for field, values in columns.items() if values.dtype != object}
        arrays |= {f"{_plain(name)}/{field}": values for field, values in numbers.items()}
        arrays[f"{_plain(name)}/units"] = np.array([[field, columns.units[field]] for field in numbers])
    _make(path.parent)
    _write(path, lambda file: np.savez_compressed(file, **arrays))
    return path


def _write_csv_bytes(columns: Columns, file: IO[bytes]) -> None:
    text = io.StringIO()
    write_csv(columns, text)
    file.write(text.getvalue().encode())


def _with_messages(log: Log) -> list[str]:
    return [name for name, info in log.topics.items() if info.messages]


def _plain(topic: str) -> str:
    return topic.strip("/").replace("/", "_") or "topic"


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot write to {folder}: {error.strerror or error}") from None


def _write(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    if path.exists():
        raise BadInput(f"{path} exists: it is not overwritten")
    with draft(path) as (file, name):
        buffered = io.BufferedWriter(file)
        write(buffered)
        buffered.detach()
        settle(file)
        claim(name, path)
