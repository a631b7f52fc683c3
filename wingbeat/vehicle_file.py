"""Vehicle files: TOML files whose values have a unit, an allowed range and a source.

Avionics and simulator declare their own schema and share this reader.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from wingbeat.documents import parse_toml, toml_text
from wingbeat.errors import DocumentError, InputError
from wingbeat.schema import (
    check_keys,
    check_table,
    error_context,
    expected_text,
    field_hints,
    join,
    quantity_of,
    read_value,
)
from wingbeat.text import did_you_mean, read_error_text


class Label(NamedTuple):
    """Marker of a text value without unit and source, ``parent = "fuselage"``."""


class Source(NamedTuple):
    """Source of a value: ``kind`` is published, identified or chosen; ``text`` has the details."""

    kind: str
    text: str


class VehicleFile(NamedTuple):
    """A vehicle file as read: sections as NamedTuples, and the source of every value by ``section.key``."""

    name: str
    title: str
    path: Path
    text: str
    """of the file; merged with its base if it has one"""
    sections: dict[str, Any]
    sources: dict[str, Source]
    fitted: dict[str, str]


VEHICLE_FOLDER_FILES = ("world.toml", "avionics.toml")
"""files of a vehicle folder: simulated vehicle, and flight computer configuration"""
SENSOR_SET = "sensors"
"""key of a vehicle file that names a sensor set, and folder of the supplied sets"""
SOURCE_KINDS = ("published", "identified", "chosen")
ENTRY_KEYS = ("value", "unit", "source", "fitted")


class Schema(NamedTuple):
    """The sections of a vehicle file, by name to the NamedTuple class of their keys."""

    required: Mapping[str, type[Any]]
    optional: Mapping[str, type[Any]] = MappingProxyType({})
    repeated: Mapping[str, type[Any]] = MappingProxyType({})
    """sections of named sections, ``[bodies.fuselage]``; read as a dict by name, empty if there is none"""


def name_by_path(path: Path) -> str:
    """Return the name of a vehicle file: its folder's for one of `VEHICLE_FOLDER_FILES`, else the file's."""
    return path.resolve().parent.name if path.name in VEHICLE_FOLDER_FILES else path.stem


def read_vehicle_file(path: Path, schema: Schema, folder: Path | None = None) -> VehicleFile:
    """Read a TOML vehicle file against ``schema``.

    ``base = "robo_raven_ii_d"`` names a file of ``folder``, ``base = "other.toml"`` one beside the file: its values
    hold wherever the file itself has none, key by key; the schema checks what comes of both, which is also ``text``.
    ``sensors = "modern"`` names a sensor set in the same way, a file of ``folder/sensors``: its values prevail over
    those of the base, and the values of the file itself over both.
    Every value is written ``key = { value = 0.359, unit = "kg", source = "published: Gerdes Table 4" }``; a
    list of numbers is allowed where the field is a tuple. ``fitted = "check"`` marks a chosen value that was
    fitted to a published figure.

    Raises:
        InputError: unreadable file, unknown base or sensor set, a circle of bases, unknown or missing key, wrong
            unit, value out of range, source missing.
    """
    document, text = _document(path, folder, ())
    name = name_by_path(path)
    vehicle = VehicleFile(str(document.get("name", name)), str(document.get("title", name)), path, text, {}, {}, {})
    with error_context(path):
        _read_sections(vehicle, document, schema)
    return vehicle


def _read_sections(vehicle: VehicleFile, document: Mapping[str, Any], schema: Schema) -> None:
    known = [*schema.required, *schema.optional, *schema.repeated]
    for key in document:
        if key not in known and key not in ("name", "title"):
            raise InputError(f"unknown section [{key}]{did_you_mean(key, known)}; known: {', '.join(known)}")
    for section in schema.required:
        if section not in document:
            raise InputError(f"section [{section}] is missing")
    for section, record in (*schema.required.items(), *schema.optional.items()):
        if section in document:
            vehicle.sections[section] = _section(vehicle, section, document[section], record)
    for family, record in schema.repeated.items():
        entries = check_table(document.get(family, {}), family)
        vehicle.sections[family] = {
            name: _section(vehicle, join(family, name), table, record) for name, table in entries.items()
        }


def _document(path: Path, folder: Path | None, above: tuple[Path, ...]) -> tuple[dict[str, Any], str]:
    """A file's document, laid over its base's, and its text; ``above`` are the files that it is the base of."""
    document, text = _read(path)
    if "base" not in document and SENSOR_SET not in document:
        return document, text
    inherited: dict[str, Any] = {}
    names = []
    if "base" in document:
        below, chain = _named_file(path, document, "base", folder), (*above, path)
        if below.resolve() in [one.resolve() for one in chain]:
            raise InputError(f"{chain[0]}: a circle of bases: {' -> '.join(one.stem for one in (*chain, below))}")
        inherited, _ = _document(below, folder, chain)
        for overrides in ("name", "title"):
            inherited.pop(overrides, None)
        names.append(f"its base {below.name}")
    if SENSOR_SET in document:
        sensors = _named_file(path, document, SENSOR_SET, (folder or path.parent) / SENSOR_SET)
        inherited = _laid_over(inherited, _read(sensors)[0])
        names.append(f"its sensors {sensors.name}")
    merged = _laid_over(inherited, document)
    return merged, f"# {path.name}, {' and '.join(names)} merged in\n" + toml_text(merged)


def _read(path: Path) -> tuple[dict[str, Any], str]:
    """A file's document and its text."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read vehicle file {path}: {read_error_text(error)}") from None
    try:
        return dict(_parsed(text)), text
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None


@lru_cache(maxsize=16)
def _parsed(text: str) -> dict[str, Any]:
    """A document, the same for the same text: its tables are read and not written to."""
    return parse_toml(text)


def _named_file(path: Path, document: dict[str, Any], key: str, folder: Path | None) -> Path:
    """Remove ``key`` from the document and return the file that it names, of ``folder`` or next to ``path``."""
    name = document.pop(key)
    if not isinstance(name, str):
        raise InputError(f"{path}: {key} must be a name or a file's path in quotes")
    is_path = name.endswith(".toml")
    file = path.parent / name if is_path else (folder or path.parent) / f"{name}.toml"
    if not file.is_file():
        known = sorted(one.stem for one in file.parent.glob("*.toml") if one != path)
        reason = f"no file {file}" if is_path else f"unknown; known: {', '.join(known)}"
        raise InputError(f'{path}: {key} = "{name}": {reason}')
    return file


def _laid_over(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Both tables in one, ``overrides`` where both have a value; a value is taken whole, with its unit and source."""
    merged = dict(base)
    for key, entry in overrides.items():
        below = merged.get(key)
        tables = isinstance(entry, dict) and isinstance(below, dict)
        merged[key] = _laid_over(below, entry) if tables and "value" not in entry else entry  # type: ignore[arg-type]
    return merged


def _section(vehicle: VehicleFile, section: str, table: Any, record: Any) -> Any:
    hints = field_hints(record)
    table = _renamed(check_table(table, section), hints)
    defaults: dict[str, Any] = getattr(record, "_field_defaults", {})
    check_keys(table, hints, section)
    values: dict[str, Any] = {}
    for name, hint in hints.items():
        key = join(section, name)
        if name not in table:
            if name not in defaults:
                raise InputError(f"{key} is missing{expected_text(hint)}")
        elif _is_label(hint):
            values[name] = read_value(str, table[name], key)
        else:
            values[name] = _value(vehicle, key, table[name], hint)
    return record(**values)


def _value(vehicle: VehicleFile, key: str, entry: Any, hint: Any) -> Any:
    """Read a value with its unit and its source."""
    if not isinstance(entry, dict) or "value" not in entry:
        raise InputError(f"{key} must be a table with value, unit and source")
    check_keys(entry, ENTRY_KEYS, key)
    quantity = quantity_of(hint)
    unit = entry.get("unit", "")
    if quantity is not None and unit != quantity.unit:
        raise InputError(f'{key} must be in "{quantity.unit}", not "{unit}"')
    value = read_value(hint, entry["value"], key)
    kind, _, text = str(entry.get("source", "")).partition(":")
    if kind not in SOURCE_KINDS or not text.strip():
        raise InputError(f'{key} needs source = "published|identified|chosen: which or why"')
    vehicle.sources[key] = Source(kind, text.strip())
    if "fitted" in entry:
        vehicle.fitted[key] = str(entry["fitted"])
    return value


def _renamed(table: Mapping[str, Any], hints: Mapping[str, Any]) -> Mapping[str, Any]:
    """The table with earlier keys replaced; a file that changes one of its base by the earlier key prevails."""
    quantities = ((key, quantity_of(hint)) for key, hint in hints.items())
    former = {key: quantity.formerly for key, quantity in quantities if quantity and quantity.formerly in table}
    return {
        **{key: entry for key, entry in table.items() if key not in former.values()},
        **{key: table[old] for key, old in former.items()},
    }


def _is_label(hint: Any) -> bool:
    """Whether a field is a plain name, see `Label`."""
    return get_origin(hint) is Annotated and any(isinstance(extra, Label) for extra in get_args(hint))
