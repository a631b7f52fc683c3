"""Campaign tables as Apache Parquet with metadata."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from logs.campaigns.campaign import Campaign, load_campaign
from logs.campaigns.journal import JournalHeader, read_journal
from logs.campaigns.keys import unit_of
from logs.campaigns.metrics import METRICS
from logs.campaigns.single_flight import OWN, Row
from logs.extras import load_extra
from logs.new_files import claim, draft, settle
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.text import pluralize

INSTALL = ("dask[distributed]", "pyarrow")
ABOUT = b"wingbeat.campaign"
"""metadata key of the table"""


class About(NamedTuple):
    """Campaign metadata of a table."""

    name: str
    title: str
    file: str
    """of the campaign, as given"""
    digest: str
    swept: tuple[str, ...]
    """columns that are inputs"""
    drawn: tuple[str, ...] | None = None
    """inputs drawn from a continuous distribution; None in a table of an earlier version"""


class Table(NamedTuple):
    """Table as read."""

    about: About
    columns: dict[str, list[Any]]
    units: dict[str, str]
    planned: int | None = None
    """-; number of flights of an unfinished campaign, else None"""

    @property
    def size(self) -> int:
        """Number of flights."""
        return len(self.columns["flight"])


def arrow(module: str = "pyarrow") -> Any:
    """Import a module of pyarrow.

    Raises:
        InputError: it is not installed.
    """
    return load_extra(module, "pyarrow", "a campaign's table", INSTALL)


def write_table(path: Path, campaign: Campaign, rows: Mapping[int, Row]) -> None:
    """Write the rows by flight number; the file does not depend on how or when they were flown.

    Raises:
        InputError: the file exists or cannot be written, or pyarrow is missing.
    """
    pyarrow, parquet = arrow(), arrow("pyarrow.parquet")
    numbers = sorted(rows)
    inputs = [campaign.values(number) for number in numbers]
    arrays = {"flight": pyarrow.array(numbers, pyarrow.int64())}
    arrays |= {key: _swept(pyarrow, [values[key] for values in inputs]) for key in campaign.swept}
    arrays |= {name: _column_array(pyarrow, name, [rows[number][name] for number in numbers]) for name in _results()}
    fields = [pyarrow.field(name, array.type, metadata=_about_column(name)) for name, array in arrays.items()]
    schema = pyarrow.schema(fields, metadata={ABOUT: json.dumps(about(campaign)._asdict())})
    table = pyarrow.Table.from_arrays(list(arrays.values()), schema=schema)
    content = pyarrow.BufferOutputStream()
    parquet.write_table(table, content, compression="zstd")
    with draft(path) as (file, name):
        file.write(memoryview(content.getvalue()))
        settle(file)
        claim(name, path)


def about(campaign: Campaign) -> About:
    """Build the campaign metadata of a table."""
    drawn = tuple(key for key, one in campaign.draw.items() if one.kind != "choice")
    return About(campaign.name, campaign.title, str(campaign.path), campaign.digest(), campaign.swept, drawn)


def read_table(path: Path) -> Table:
    """Read a table.

    Raises:
        InputError: it does not exist, is not a campaign table, or pyarrow is missing.
    """
    pyarrow, parquet = arrow(), arrow("pyarrow.parquet")
    if not path.exists():
        raise InputError(f"cannot read {path}: there is no such file")
    try:
        table = parquet.read_table(path)
        found = _about(parse_json((table.schema.metadata or {})[ABOUT].decode()))
    except (OSError, pyarrow.ArrowException) as error:
        raise InputError(f"cannot read {path}: {' '.join(str(error).split())}") from None
    except (KeyError, ValueError, TypeError, AttributeError):
        raise InputError(f"{path} is not a campaign table") from None
    units = {field.name: (field.metadata or {}).get(b"unit", b"-").decode() for field in table.schema}
    return Table(found, table.to_pydict(), units)


def _about(document: Mapping[str, Any]) -> About:
    """Build `About` from its JSON; the keys of later versions may be absent."""
    name, title, file, digest = (str(document.get(key, "")) for key in ("name", "title", "file", "digest"))
    drawn = tuple(map(str, document["drawn"])) if "drawn" in document else None
    return About(name, title, file, digest, tuple(map(str, document["swept"])), drawn)


def unfinished_table(path: Path) -> Table:
    """Build the table of an unfinished campaign from the journal at ``path``.

    Raises:
        InputError: no flight is complete, the journal is invalid, or its campaign file is missing or changed.
    """
    header = read_journal(path)
    if not header.rows:
        raise InputError(f"{path}: no flight of this campaign has ended yet{_resume_hint(header)}")
    told = f"{path} holds {pluralize(len(header.rows), 'flight')} of a campaign that is not flown to its end"
    try:
        campaign = load_campaign(Path(header.file)) if header.file else None
    except InputError as error:
        raise InputError(f"{told}, and {error}") from None
    if campaign is None or campaign.digest() != header.digest:
        why = "or a file that it names, has changed" if campaign else "can be resumed by the same command"
        raise InputError(f"{told}, whose file, {header.file}, {why}" if campaign else f"{told}: it {why}")
    numbers = sorted(header.rows)
    inputs = [campaign.values(number) for number in numbers]
    columns: dict[str, list[Any]] = {"flight": list(numbers)}
    columns |= {key: [values[key] for values in inputs] for key in campaign.swept}
    columns |= {name: [header.rows[number][name] for number in numbers] for name in _results()}
    units = {name: _about_column(name)["unit"] for name in columns}
    return Table(about(campaign), columns, units, campaign.size)


def _resume_hint(header: JournalHeader) -> str:
    return f"; resume with wingbeat campaign {header.file}" if header.file else ""


def _results() -> Sequence[str]:
    return [*(name for name in OWN if name != "flight"), *METRICS]


def _swept(pyarrow: Any, values: list[Any]) -> Any:
    """A column of inputs: numbers, texts, lists of numbers; of several kinds as text."""
    try:
        return pyarrow.array(values)
    except (pyarrow.ArrowException, TypeError):
        return pyarrow.array([json.dumps(value) for value in values])


def _column_array(pyarrow: Any, name: str, values: list[Any]) -> Any:
    kind = pyarrow.bool_() if name == "failed" else pyarrow.string() if name in OWN else pyarrow.float64()
    return pyarrow.array(values, kind)


def _about_column(name: str) -> dict[str, str]:
    if name in METRICS:
        return {"unit": METRICS[name].unit, "description": METRICS[name].text}
    if name in OWN:
        return {"unit": "-", "description": OWN[name]}
    return {"unit": unit_of(name), "description": "input"}
