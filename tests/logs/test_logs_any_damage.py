"""A flown file cut at 1,000 random bytes, and with 1,000 random bits flipped: nothing wrong is returned silently.

Everything that a reader can ask is asked of each: a value is the whole file's, or the file says that it is damaged.
"""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode
from recorded import flight, record

from avionics import topics
from logs.attached import aircraft_of
from logs.checksums import OPCODE as CHECKSUMS
from logs.columns import Columns
from logs.index import read_index
from logs.info import summary
from logs.log_file import TEXT_SCHEMA
from logs.reader import Log, open_log
from logs.records import Span, records
from logs.recover import recover
from logs.strokes import strokes
from logs.summary import summarize
from wingbeat.errors import InputError

ORDERED = (topics.IMU, topics.WING, topics.ATTITUDE)
Reading = Mapping[str, Any]
"""what was answered, or `Refused`, by what was asked"""


class Refused(str):
    """The one line with which a reading was refused."""


# --- everything that can be asked -------------------------------------------------------------------------


def attempt(read: Callable[[], Any]) -> Any:
    try:
        return read()
    except InputError as error:
        assert str(error) and "\n" not in str(error)
        return Refused(error)


def topics_of(log: Log) -> dict[str, Any]:
    return {name: (info.channel, info.schema, info.encoding, info.layout) for name, info in log.topics.items()}


def counts_of(log: Log) -> dict[str, Any]:
    return {name: (info.messages, info.rate, info.deterministic) for name, info in log.topics.items()}


def columns_of(log: Log) -> dict[str, Any]:
    result = attempt(log.tables)
    if not isinstance(result, Refused):
        return dict(result)
    return {name: attempt(lambda n=name: log.columns(n)) for name in log.topics}


def texts_of(log: Log) -> dict[str, Any]:
    return {n: attempt(lambda n=n: log.texts(n)) for n, info in log.topics.items() if info.schema == TEXT_SCHEMA}


def times_of(log: Log) -> dict[str, Any]:
    return {name: attempt(lambda n=name: log.times(n)) for name in log.topics}


def info_of(log: Log) -> dict[str, Any]:
    return {key: value for key, value in summary(log).items() if key not in ("file", "complete", "damage")}


READINGS: Mapping[str, Callable[[Log], Any]] = {
    "topics": topics_of,
    "counts": counts_of,
    "columns": columns_of,
    "events": lambda log: log.events(),
    "texts": texts_of,
    "metadata": lambda log: log.metadata,
    "attachments": lambda log: [vars(attachment) for attachment in log.attachments],
    "parameters": lambda log: log.parameters,
    "missions": lambda log: log.missions,
    "times": times_of,
    "order": lambda log: log.order(ORDERED),
    "info": info_of,
    "flight": summarize,
    "strokes": strokes,
    "aligned": lambda log: log.aligned(ORDERED, 50.0),
    "aircraft": aircraft_of,
    "extent": lambda log: (log.boot_ns, log.start_ns, log.end_ns),
}


def everything(log: Log) -> Reading:
    return {name: attempt(lambda r=read: r(log)) for name, read in READINGS.items()}


# --- comparison ---------------------------------------------------------------------------------------------


def same(one: Any, other: Any) -> bool:
    """Equal in type, shape and every value, NaN to NaN."""
    if isinstance(one, Columns) and isinstance(other, Columns):
        return same(vars(one), vars(other))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.dtype == object or one.dtype != other.dtype or one.shape != other.shape:
            return one.dtype == other.dtype and same(one.tolist(), other.tolist())
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other or (one != one and other != other))


def differs(result: Any, whole: Any, path: str = "") -> Iterator[str]:
    """Where an answer that was not refused is not the whole file's."""
    if isinstance(result, Refused):
        return
    if type(result) is dict and type(whole) is dict and result.keys() == whole.keys():
        for key in result:
            yield from differs(result[key], whole[key], f"{path}.{key}")
    elif not same(result, whole):
        yield path


def rows(columns: Columns) -> list[Any]:
    fields = [values.tolist() for values in columns.fields.values()]
    return [repr(row) for row in zip(columns.log_time_ns.tolist(), *fields, strict=True)]


def parts_of(whole: Iterable[Any], result: Iterable[Any]) -> bool:
    """Whether everything found is in the whole, as often at most."""
    left = sorted(map(repr, whole))
    for one in sorted(map(repr, result)):
        place = np.searchsorted(np.array(left, object), one) if left else 0
        if place == len(left) or left.pop(int(place)) != one:
            return False
    return True


def strangers(result: Reading, whole: Reading) -> Iterator[str]:
    """What the readings of a file that says it is damaged have and the whole file has not."""
    for name, columns in result["columns"].items():
        known = whole["columns"].get(name)
        if not isinstance(columns, Refused) and not (known and _within(columns, known)):
            yield f"columns.{name}"
    for key in ("events", "attachments"):
        if not isinstance(result[key], Refused) and not parts_of(whole[key], result[key]):
            yield key
    for name, texts in result["texts"].items():
        if not isinstance(texts, Refused) and not parts_of(whole["texts"][name], texts):
            yield f"texts.{name}"
    if not isinstance(result["metadata"], Refused):
        yield from (
            f"metadata.{name}" for name, v in result["metadata"].items() if not same(v, whole["metadata"].get(name))
        )


def _within(columns: Columns, known: Columns) -> bool:
    count = len(columns.log_time_ns)
    if not count:
        return True
    if columns.units != known.units or columns.labels != known.labels:
        return False
    shorter = {name: values[:count] for name, values in known.fields.items()}
    return same(columns.fields, shorter) or set(rows(columns)) <= set(rows(known))


def check(path: Path, whole: Reading) -> Reading:
    """Read a damaged file; what it answers is the whole file's, or it says that it is damaged."""
    log = attempt(lambda: open_log(path))
    if isinstance(log, Refused):
        return {}
    with log:
        result = everything(log)
        assert all("\n" not in line for line in log.damage)
        wrong = list(strangers(result, whole) if log.damage else differs(result, whole))
        assert not wrong, f"{wrong} wrong, and of damage it says: {log.damage}"
    return result


# --- the study ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds as ``wingbeat fly`` records them: two parts, joined."""
    path = tmp_path_factory.mktemp("flown") / "flown.mcap"
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--duration", "2", "--log", str(path)]
    subprocess.run([*command, "--json", "--speed", "max"], stdout=subprocess.DEVNULL, check=True, timeout=600)
    return path


def read(path: Path) -> Reading:
    with open_log(path) as log:
        assert log.complete and log.verify() == []
        return everything(log)


def spans_by_kind(data: bytes) -> dict[str, list[Span]]:
    """The records by what they are; the heads of the chunks, since their contents are most of the file."""
    index = read_index(data)
    kinds: dict[str, list[Span]] = {
        "magic": [Span(0, 0, 8), Span(0, len(data) - 8, 8)],
        "chunk head": [Span(0, chunk.span.offset, 48) for chunk in index.chunks],
    }
    for span in records(data, 8, len(data) - 8):
        kinds.setdefault(str(span.opcode), []).append(span)
    return kinds


def places(data: bytes, count: int, source: random.Random) -> Iterator[int]:
    """Bits of a file: two in five anywhere, the others of any kind of record alike."""
    kinds = list(spans_by_kind(data).values())
    for _ in range(count):
        if source.random() < 0.4:
            yield source.randrange(8 * len(data))
        else:
            span = source.choice(source.choice(kinds))
            yield 8 * span.offset + source.randrange(8 * span.length)


def flipped(data: bytes, bit: int) -> bytes:
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def check_repair(path: Path, before: Reading, whole: Reading) -> None:
    """A repaired file is whole and answers what the damaged one did."""
    with open_log(path) as log:
        was = bool(log.damage)
    recover(path)
    with open_log(path) as log:
        assert log.complete and log.verify() == []
    after = check_again(path, whole)
    assert not was or not [name for name in before if name != "info" and not same(before[name], after[name])]


def check_again(path: Path, whole: Reading) -> Reading:
    """The readings of a repaired file, which no longer says what it lacks."""
    with open_log(path) as log:
        result = everything(log)
    assert not list(strangers(result, whole))
    return result


def cut_anywhere(folder: Path, data: bytes, whole: Reading, cuts: Iterable[int]) -> None:
    for cut in cuts:
        path = folder / f"cut_{cut}.mcap"
        path.write_bytes(data[:cut])
        result = check(path, whole)
        assert result or cut < 8, f"a file of {cut} bytes was refused"
        if result:
            check_repair(path, result, whole)
        for left in folder.glob(f"{path.name}*"):
            left.unlink()


def flip_anywhere(folder: Path, data: bytes, whole: Reading, bits: Iterable[int]) -> None:
    path = folder / "flipped.mcap"
    for bit in bits:
        path.write_bytes(flipped(data, bit))
        try:
            check(path, whole)
        except AssertionError as error:
            raise AssertionError(f"bit {bit % 8} of byte {bit // 8}: {error}") from None


@pytest.mark.validate
def test_a_flown_file_cut_at_a_thousand_random_bytes(tmp_path: Path, recording: Path) -> None:
    data, source = recording.read_bytes(), random.Random(1)
    cut_anywhere(tmp_path, data, read(recording), (source.randrange(len(data)) for _ in range(1000)))


@pytest.mark.validate
def test_a_flown_file_with_a_thousand_random_bits_flipped(tmp_path: Path, recording: Path) -> None:
    data = recording.read_bytes()
    assert {str(int(Opcode.METADATA)), str(int(Opcode.ATTACHMENT)), str(CHECKSUMS)} <= spans_by_kind(data).keys()
    flip_anywhere(tmp_path, data, read(recording), places(data, 1000, random.Random(2)))


def test_a_recording_of_every_topic_with_a_few_cuts_and_flips(tmp_path: Path) -> None:
    path = record(tmp_path / "whole.mcap", flight(0.5))
    data, whole, source = path.read_bytes(), read(path), random.Random(3)
    cut_anywhere(tmp_path, data, whole, (source.randrange(len(data)) for _ in range(6)))
    flip_anywhere(tmp_path, data, whole, places(data, 40, source))
