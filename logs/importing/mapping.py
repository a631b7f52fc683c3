"""Mapping files: TOML descriptions of table columns."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NamedTuple

from avionics.topics import IMU
from wingbeat.errors import InputError
from wingbeat.schema import check_table, error_context, join, read_document, read_number, read_record, read_value
from wingbeat.units import ABOVE_ZERO, Quantity

EXAMPLE = """\
[time]
column = "t"          # or rate = 100.0 (Hz) where the table has no time
unit = "ms"
start = 1200.0        # reading at boot, in that unit; 0 when not given

[table]               # all of it optional
skip = 0              # lines before the one with the names
delimiter = ","       # "whitespace" for any run of blanks
names = true          # false where the first line is one of numbers: the columns are "1", "2" ...
decimal = "."
encoding = "utf-8"    # "latin-1" or "cp1252" of many instruments

[topics."/sensors/imu"]
gyro_y  = { column = "Q", unit = "deg/s" }
accel_x = { column = "Ax", unit = "g", scale = -1.0, offset = 0.02 }
accel_z = { value = -9.81, unit = "m/s^2" }

[topics."/csv/load_cell"]   # a topic of its own, with any fields
rate   = 50.0               # Hz; fewer rows than the table has
thrust = { column = "F", unit = "gf" }
"""
"""Example of a mapping; the value in its unit is column * scale + offset."""


class TimeSection(NamedTuple):
    """Time of the rows: a column or a rate."""

    column: Any = None
    """name of the column"""
    unit: Any = "s"
    start: float = 0.0
    """in the unit; column value at boot"""
    rate: Annotated[float, Quantity("Hz", ABOVE_ZERO)] | None = None


class TableSection(NamedTuple):
    """Layout of the table."""

    skip: Annotated[int, Quantity("-", 0)] = 0
    """-; number of lines before the header"""
    delimiter: str = ","
    names: bool = True
    """whether the first line has the column names"""
    decimal: str = "."
    encoding: str = "utf-8"


class FieldEntry(NamedTuple):
    """Field of a topic: a column, or a constant."""

    column: Any = None
    value: float | None = None
    unit: Any = "-"
    scale: float = 1.0
    offset: float = 0.0


class TopicSection(NamedTuple):
    """Fields of a topic."""

    fields: dict[str, FieldEntry]
    rate: float | None = None
    """Hz; rate of the selected rows, None for all rows"""

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> TopicSection:
        """Read the section; ``rate`` is a field if it has a column. `wingbeat.schema.read_record` calls this.

        Raises:
            InputError: no field, or an entry that cannot be used.
        """
        entries = dict(check_table(entry, key))
        rate = None
        if not isinstance(entries.get("rate", {}), dict):
            rate = read_number(entries.pop("rate"), join(key, "rate"), Quantity("Hz", ABOVE_ZERO))
        if not entries:
            raise InputError(f"{key} has no field")
        for name, one in entries.items():
            if not isinstance(one, dict) or ("column" in one) == ("value" in one):
                forms = '{ column = "...", unit = "..." } or { value = ..., unit = "..." }'
                raise InputError(f"{join(key, name)} must be {forms}")
        return cls(read_value(dict[str, FieldEntry], entries, key), rate)


class TableMapping(NamedTuple):
    """Mapping file."""

    time: TimeSection
    topics: dict[str, TopicSection] = {}
    table: TableSection = TableSection()


def load_mapping(path: Path) -> TableMapping:
    """Read a mapping.

    Raises:
        InputError: it cannot be read, or has an unknown key or an invalid value.
    """
    document = read_document(path, "mapping")
    with error_context(f"mapping {path}"):
        mapping: TableMapping = read_record(TableMapping, document)
        if not mapping.topics:
            raise InputError(f'no topic in it; write a section such as [topics."{IMU.name}"]')
        if (mapping.time.column is None) == (mapping.time.rate is None):
            raise InputError("[time] must have either a column or a rate")
    return mapping
