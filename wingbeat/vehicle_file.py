"""Vehicle files: TOML files whose values have a unit, an allowed range and a source.

Avionics and simulator declare their own schema and share this reader.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from wingbeat.documents import parse_toml, toml_text
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import read_error_text
from wingbeat.units import INFINITY, Quantity


class Label(NamedTuple):
    """Marks text that is written plainly, ``parent = "fuselage"``: a name needs neither unit nor source."""


class Source(NamedTuple):
    """Where a value comes from: ``kind`` is published, identified or chosen; ``text`` says which or why."""

    kind: str
    text: str


class VehicleFile(NamedTuple):
    """A vehicle file as read: sections as NamedTuples, and the source of every value by ``section.key``."""

    name: str
    title: str
    path: Path
    text: str
    """of the file; with its base merged in where it has one"""
    sections: dict[str, Any]
    sources: dict[str, Source]
    fitted: dict[str, str]


VEHICLE_FOLDER_FILES = ("world.toml", "avionics.toml")
"""files of a vehicle that is a folder: what is, and what the flight computer assumes"""
SOURCE_KINDS = ("published", "identified", "chosen")


class Schema(NamedTuple):
    """The sections of a vehicle file, by name to the NamedTuple class of their keys."""

    required: Mapping[str, type[Any]]
    optional: Mapping[str, type[Any]] = MappingProxyType({})
    repeated: Mapping[str, type[Any]] = MappingProxyType({})
    """sections of named sections, ``[bodies.fuselage]``; read as a dict by name, empty where there is none"""


def name_by_path(path: Path) -> str:
    """Name of a vehicle by the place of its file: its folder's for one of `VEHICLE_FOLDER_FILES`, else the file's."""
    return path.resolve().parent.name if path.name in VEHICLE_FOLDER_FILES else path.stem


def read_vehicle_file(path: Path, schema: Schema, folder: Path | None = None) -> VehicleFile:
    """Read a TOML vehicle file against ``schema``.

    ``base = "robo_raven_ii_d"`` names a file of ``folder``, ``base = "other.toml"`` one beside the file: its values
    hold wherever the file itself has none, key by key; the schema checks what comes of both, which is also ``text``.
    Every value is written ``key = { value = 0.359, unit = "kg", source = "published: Gerdes Table 4" }``; a
    list of numbers is allowed where the field is a tuple. ``fitted = "check"`` marks a chosen value that was
    fitted to a published figure.

    Raises:
        InputError: unreadable file, unknown base or a circle of them, unknown or missing key, wrong unit, value out
            of range, source missing.
    """
    document, text = _document(path, folder, ())
    sources: dict[str, Source] = {}
    fitted: dict[str, str] = {}
    sections: dict[str, Any] = {}
    known = [*schema.required, *schema.optional, *schema.repeated]
    for key in document:
        if key not in known and key not in ("name", "title"):
            raise InputError(f"{path}: unknown section [{key}]; known: {', '.join(known)}")
    for section in schema.required:
        if section not in document:
            raise InputError(f"{path}: section [{section}] is missing")
    for section, record in (*schema.required.items(), *schema.optional.items()):
        if section in document:
            sections[section] = _section(path, section, document[section], record, sources, fitted)
    for family, record in schema.repeated.items():
        sections[family] = {}
        for name, table in _table(path, family, document.get(family, {})).items():
            sections[family][name] = _section(path, f"{family}.{name}", table, record, sources, fitted)
    name = name_by_path(path)
    return VehicleFile(
        str(document.get("name", name)),
        str(document.get("title", name)),
        path,
        text,
        sections,
        sources,
        fitted,
    )


def _document(path: Path, folder: Path | None, above: tuple[Path, ...]) -> tuple[dict[str, Any], str]:
    """A file's document, laid over its base's, and its text; ``above`` are the files that it is the base of."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read vehicle file {path}: {read_error_text(error)}") from None
    try:
        document = dict(_parsed(text))
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None
    if "base" not in document:
        return document, text
    below, chain = _base(path, document.pop("base"), folder), (*above, path)
    if below.resolve() in [one.resolve() for one in chain]:
        raise InputError(f"{chain[0]}: a circle of bases: {' -> '.join(one.stem for one in (*chain, below))}")
    inherited, _ = _document(below, folder, chain)
    for overrides in ("name", "title"):
        inherited.pop(overrides, None)
    merged = _laid_over(inherited, document)
    return merged, f"# {path.name}, its base {below.name} merged in\n" + toml_text(merged)


@lru_cache(maxsize=16)
def _parsed(text: str) -> dict[str, Any]:
    """A document, the same for the same text: its tables are read and not written to."""
    return parse_toml(text)


def _base(path: Path, base: Any, folder: Path | None) -> Path:
    if not isinstance(base, str):
        raise InputError(f"{path}: base must be a vehicle's name or a file's path in quotes")
    beside = base.endswith(".toml")
    found = path.parent / base if beside else (folder or path.parent) / f"{base}.toml"
    if not found.is_file():
        known = sorted(one.stem for one in found.parent.glob("*.toml") if one != path)
        told = f"no file {found}" if beside else f"unknown; known: {', '.join(known)}"
        raise InputError(f'{path}: base = "{base}": {told}')
    return found


def _laid_over(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Both tables in one, ``overrides`` where both have a value; a value is taken whole, with its unit and source."""
    merged = dict(base)
    for key, entry in overrides.items():
        below = merged.get(key)
        tables = isinstance(entry, dict) and isinstance(below, dict)
        merged[key] = _laid_over(below, entry) if tables and "value" not in entry else entry  # type: ignore[arg-type]
    return merged


def _section(
    path: Path,
    section: str,
    table: Mapping[str, Any],
    record: Any,
    sources: dict[str, Source],
    fitted: dict[str, str],
) -> Any:
    hints = _hints(record)
    table = _renamed(_table(path, section, table), hints)
    defaults: dict[str, Any] = getattr(record, "_field_defaults", {})
    for key in table:
        if key not in hints:
            raise InputError(f"{path}: unknown key {section}.{key}; known: {', '.join(hints)}")
    values: dict[str, Any] = {}
    for key, hint in hints.items():
        name = f"{section}.{key}"
        if key not in table:
            if key in defaults:
                continue
            raise InputError(f"{path}: key {name} is missing ({_expectation(hint)})")
        entry = table[key]
        if _is_label(hint):
            values[key] = _label(path, name, entry)
            continue
        if not isinstance(entry, dict) or "value" not in entry:
            raise InputError(f"{path}: {name} must be a table with value, unit and source")
        unknown = set(entry) - {"value", "unit", "source", "fitted"}
        if unknown:
            raise InputError(f"{path}: {name} has unknown parts: {', '.join(sorted(unknown))}")
        values[key] = _value(path, name, entry, hint)
        sources[name] = _source(path, name, entry)
        if "fitted" in entry:
            fitted[name] = str(entry["fitted"])
    return record(**values)


def _renamed(table: Mapping[str, Any], hints: Mapping[str, Any]) -> Mapping[str, Any]:
    """The table with earlier keys replaced; a file that changes one of its base by the earlier key prevails."""
    quantities = ((key, _unwrap(hint)[1]) for key, hint in hints.items())
    former = {key: quantity.formerly for key, quantity in quantities if quantity and quantity.formerly in table}
    return {
        **{key: entry for key, entry in table.items() if key not in former.values()},
        **{key: table[old] for key, old in former.items()},
    }


@cache
def _hints(record: Any) -> Mapping[str, Any]:
    return MappingProxyType(get_type_hints(record, include_extras=True))


def _table(path: Path, section: str, table: Any) -> Mapping[str, Any]:
    if not isinstance(table, dict):
        raise InputError(f"{path}: {section} must be a section of keys")
    return table


def _is_label(hint: Any) -> bool:
    return get_origin(hint) is Annotated and any(isinstance(extra, Label) for extra in get_args(hint))


def _label(path: Path, name: str, entry: Any) -> str:
    if not isinstance(entry, str):
        raise InputError(f"{path}: {name} must be a name in quotes")
    return entry


def _expectation(hint: Any) -> str:
    base, quantity = _unwrap(hint)
    if quantity is None:
        return getattr(base, "__name__", str(base))
    return f"{quantity.low:g} to {quantity.high:g} {quantity.unit}"


def _unwrap(hint: Any) -> tuple[Any, Quantity | None]:
    if get_origin(hint) is Annotated:
        base, *extras = get_args(hint)
        return base, next((extra for extra in extras if isinstance(extra, Quantity)), None)
    return hint, None


def _source(path: Path, name: str, entry: Mapping[str, Any]) -> Source:
    kind, _, text = str(entry.get("source", "")).partition(":")
    if kind not in SOURCE_KINDS or not text.strip():
        raise InputError(f'{path}: {name} needs source = "published|identified|chosen: which or why"')
    return Source(kind, text.strip())


def _value(path: Path, name: str, entry: Mapping[str, Any], hint: Any) -> Any:
    base, quantity = _unwrap(hint)
    value = entry["value"]
    unit = entry.get("unit", "")
    if quantity is not None and unit != quantity.unit:
        raise InputError(f'{path}: {name} must be in "{quantity.unit}", not "{unit}"')
    if get_origin(base) is tuple:
        length = len(get_args(base))
        variable = get_args(base)[-1] is Ellipsis
        if not isinstance(value, list):
            raise InputError(f"{path}: {name} must be a list of {'' if variable else f'{length} '}numbers")
        if not variable and len(value) != length:
            raise InputError(f"{path}: {name} must have {length} numbers, not {len(value)}")
        return tuple(_number(path, name, item, float, quantity) for item in value)
    if base is str:
        if not isinstance(value, str):
            raise InputError(f"{path}: {name} must be text")
        return value
    if base is bool:
        if not isinstance(value, bool):
            raise InputError(f"{path}: {name} must be true or false")
        return value
    return _number(path, name, value, base, quantity)


def _number(path: Path, name: str, value: Any, base: Any, quantity: Quantity | None) -> float | int:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or (base is int and not float(value).is_integer())
    ):
        kind = "a whole number" if base is int else "a number"
        raise InputError(f"{path}: {name} must be {kind}, not {value!r}")
    low, high = (quantity.low, quantity.high) if quantity else (-INFINITY, INFINITY)
    if not low <= value <= high:
        unit = quantity.unit if quantity else ""
        raise InputError(f"{path}: {name} = {value:g} is outside {low:g} to {high:g} {unit}".rstrip())
    return int(value) if base is int else float(value)
