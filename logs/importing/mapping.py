"""Mapping files: TOML that says what the columns of a table are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avionics.topics import IMU
from wingbeat.errors import InputError
from wingbeat.schema import check_keys, check_table, error_context, read_document

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
"""What a mapping looks like; the value in its unit is column * scale + offset."""
_SECTIONS = {
    "time": ("column", "unit", "start", "rate"),
    "table": ("skip", "delimiter", "names", "decimal", "encoding"),
}


def load_mapping(path: Path) -> dict[str, Any]:
    """A mapping, its sections and keys checked.

    Raises:
        InputError: it cannot be read, or has a section or key that is not known.
    """
    document = read_document(path, "mapping")
    with error_context(f"mapping {path}"):
        _check(document)
    return document


def _check(document: Mapping[str, Any]) -> None:
    check_keys(document, (*_SECTIONS, "topics"))
    for section, keys in _SECTIONS.items():
        check_keys(check_table(document.get(section, {}), section), keys, section)
    if not document.get("topics") or not isinstance(document["topics"], dict):
        raise InputError(f'no topic in it; write a section such as [topics."{IMU.name}"]')
    if ("column" in document.get("time", {})) == ("rate" in document.get("time", {})):
        raise InputError("[time] must have either a column or a rate")
