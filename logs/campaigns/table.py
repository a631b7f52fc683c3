"""A campaign's table: a row for each flight, as Apache Parquet, with all that a reader must know in its metadata."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics.quantities import BadInput
from logs.campaigns.campaign import Campaign
from logs.campaigns.flown import Row
from logs.campaigns.keys import unit_of
from logs.campaigns.metrics import METRICS
from logs.extras import load_extra
from logs.placing import claim, draft, settle

INSTALL = ("dask[distributed]", "pyarrow")
ABOUT = b"wingbeat.campaign"
"""key of the table's metadata"""
OWN = {
    "flight": "number of the flight",
    "failed": "whether it neither landed nor was still in the air at its end",
    "outcome": "how it ended",
    "reason": "why it failed",
    "log": "name of its recording, empty for none",
}


class About(NamedTuple):
    """What a table knows of its campaign."""

    name: str
    title: str
    file: str
    """of the campaign, as it was given"""
    digest: str
    swept: tuple[str, ...]
    """columns that are inputs"""


class Table(NamedTuple):
    """A table that was read."""

    about: About
    columns: dict[str, list[Any]]
    units: dict[str, str]

    @property
    def size(self) -> int:
        """How many flights."""
        return len(self.columns["flight"])


def arrow(module: str = "pyarrow") -> Any:
    """A module of pyarrow.

    Raises:
        BadInput: it is not installed.
    """
    return load_extra(module, "pyarrow", "a campaign's table", INSTALL)


def write_table(path: Path, campaign: Campaign, rows: Mapping[int, Row]) -> None:
    """Write the rows by their flights' numbers; nothing in the file depends on how or when they were flown.

    Raises:
        BadInput: the file exists or cannot be written, or pyarrow is missing.
    """
    pyarrow, parquet = arrow(), arrow("pyarrow.parquet")
    numbers = sorted(rows)
    inputs = [campaign.values(number) for number in numbers]
    arrays = {"flight": pyarrow.array(numbers, pyarrow.int64())}
    arrays |= {key: _swept(pyarrow, [values[key] for values in inputs]) for key in campaign.swept}
    arrays |= {name: _own(pyarrow, name, [rows[number][name] for number in numbers]) for name in _results()}
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
    """What the table of a campaign will know of it."""
    return About(campaign.name, campaign.title, str(campaign.path), campaign.digest(), campaign.swept)


def read_table(path: Path) -> Table:
    """Read a table.

    Raises:
        BadInput: there is none, it is no campaign's, or pyarrow is missing.
    """
    pyarrow, parquet = arrow(), arrow("pyarrow.parquet")
    if not path.exists():
        raise BadInput(f"cannot read {path}: there is no such file")
    try:
        table = parquet.read_table(path)
        known = json.loads((table.schema.metadata or {})[ABOUT])
    except (OSError, pyarrow.ArrowException) as error:
        raise BadInput(f"cannot read {path}: {' '.join(str(error).split())}") from None
    except (KeyError, ValueError):
        raise BadInput(f"{path} is no table of a campaign") from None
    units = {field.name: (field.metadata or {}).get(b"unit", b"-").decode() for field in table.schema}
    found = About(**{name: known.get(name, "") for name in About._fields})
    return Table(found._replace(swept=tuple(found.swept)), table.to_pydict(), units)


def _results() -> Sequence[str]:
    return [*(name for name in OWN if name != "flight"), *METRICS]


def _swept(pyarrow: Any, values: list[Any]) -> Any:
    """A column of inputs: numbers, texts, lists of numbers; of several kinds as text."""
    try:
        return pyarrow.array(values)
    except (pyarrow.ArrowException, TypeError):
        return pyarrow.array([json.dumps(value) for value in values])


def _own(pyarrow: Any, name: str, values: list[Any]) -> Any:
    kind = pyarrow.bool_() if name == "failed" else pyarrow.string() if name in OWN else pyarrow.float64()
    return pyarrow.array(values, kind)


def _about_column(name: str) -> dict[str, str]:
    if name in METRICS:
        return {"unit": METRICS[name].unit, "description": METRICS[name].text}
    if name in OWN:
        return {"unit": "-", "description": OWN[name]}
    return {"unit": unit_of(name), "description": "input"}
