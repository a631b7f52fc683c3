"""Mapping files: TOML that says what the columns of a table are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from avionics.topics import IMU
from wingbeat.documents import parse_toml
from wingbeat.errors import DocumentError, InputError

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
    try:
        document = parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read mapping {path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"mapping {path}: not valid TOML: {error}") from None
    except DocumentError as error:
        raise InputError(f"mapping {path}: {error}") from None
    for section, keys in _SECTIONS.items():
        _check_keys(path, section, document.get(section, {}), keys)
    unknown = [name for name in document if name not in (*_SECTIONS, "topics")]
    if unknown:
        raise InputError(f"mapping {path}: unknown section [{unknown[0]}]; known: time, table, topics")
    if not document.get("topics") or not isinstance(document["topics"], dict):
        raise InputError(f'mapping {path}: no topic in it; write a section such as [topics."{IMU.name}"]')
    if ("column" in document.get("time", {})) == ("rate" in document.get("time", {})):
        raise InputError(f"mapping {path}: [time] must have either a column or a rate")
    return document


def _check_keys(path: Path, section: str, table: Any, known: tuple[str, ...]) -> None:
    if not isinstance(table, dict):
        raise InputError(f"mapping {path}: {section} must be a section of keys")
    for key in table:
        if key not in known:
            raise InputError(f"mapping {path}: unknown key {section}.{key}; known: {', '.join(known)}")
