"""Values with a unit, a range and a source: what vehicle files and messages are declared with.

A leaf module: it imports nothing of Wingbeat, so that the flight computer and the simulated world read
their (different) vehicle files with the same reader.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

INFINITY = float("inf")
NEAR = 0.65
"""-; share of letters in common, in turn, from which on a name may be what was meant: fyl and fly have 0.67"""


class BadInput(ValueError):
    """Something a user supplied cannot be used; its text is one clear line for the terminal."""


class Quantity(NamedTuple):
    """Unit and allowed range of a number in a vehicle file, used as ``Annotated[float, Quantity("m", 0, 2)]``."""

    unit: str
    low: float = -INFINITY
    high: float = INFINITY
    formerly: str = ""
    """earlier key of a renamed field: files may use it, and the MAVLink parameter keeps the name made of it"""


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


class DocumentError(ValueError):
    """Text is not a document of its format; the message is one line without the name of the file."""


INTEGER_LIMIT = 1 << 64
"""-; integers of this magnitude and beyond are rejected: TOML and MCAP have at most 64 bits"""


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    Raises:
        DocumentError: syntax error, nested too deeply for the parser, or an integer of more than 64 bits.
    """
    document: dict[str, Any] = _parse(tomllib.loads, text, "TOML")
    return document


def parse_json(text: str) -> Any:
    """Parse a JSON document.

    Raises:
        DocumentError: syntax error, nested too deeply for the parser, or an integer of more than 64 bits.
    """
    return _parse(json.loads, text, "JSON")


def _parse(load: Callable[[str], Any], text: str, language: str) -> Any:
    try:
        document = load(text)
        _check_integers(document)
    except RecursionError:
        raise DocumentError(f"not valid {language}: nested too deeply") from None
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise DocumentError(f"not valid {language}: {' '.join(str(error).split())}") from None
    except ValueError:  # from int(): over 4300 digits
        raise DocumentError(f"not valid {language}: {_TOO_LONG}") from None
    return document


_TOO_LONG = "an integer has more than 64 bits"


def _check_integers(value: Any) -> None:
    if isinstance(value, int) and abs(value) >= INTEGER_LIMIT:
        raise ValueError(_TOO_LONG)
    if isinstance(value, list):
        for item in value:
            _check_integers(item)
    elif isinstance(value, dict):
        for item in value.values():
            _check_integers(item)


def counted(number: float, noun: str) -> str:
    """A number of things, for people: 1 item, 2 items."""
    return f"{number:.12g} {noun}" + ("" if number == 1 else "s")


def why_unread(error: OSError | UnicodeDecodeError) -> str:
    """Why a file cannot be read as text, in words."""
    if isinstance(error, UnicodeDecodeError):
        return "it is no text in UTF-8"
    return "there is no such file" if isinstance(error, FileNotFoundError) else (error.strerror or str(error))


def meant(name: str, known: Iterable[str]) -> str:
    """`` (meant 'x'?)``, x being the nearest to ``name`` of what is ``known``; empty where nothing else is near."""
    near = difflib.get_close_matches(name, list(known), 1, NEAR)
    return f" (meant {near[0]!r}?)" if near and near[0] != name else ""


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
        BadInput: unreadable file, unknown base or a circle of them, unknown or missing key, wrong unit, value out of
            range, source missing.
    """
    document, text = _document(path, folder, ())
    sources: dict[str, Source] = {}
    fitted: dict[str, str] = {}
    sections: dict[str, Any] = {}
    known = [*schema.required, *schema.optional, *schema.repeated]
    for key in document:
        if key not in known and key not in ("name", "title"):
            raise BadInput(f"{path}: unknown section [{key}]; known: {', '.join(known)}")
    for section in schema.required:
        if section not in document:
            raise BadInput(f"{path}: section [{section}] is missing")
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
        raise BadInput(f"cannot read vehicle file {path}: {why_unread(error)}") from None
    try:
        document = dict(_parsed(text))
    except DocumentError as error:
        raise BadInput(f"{path}: {error}") from None
    if "base" not in document:
        return document, text
    below, chain = _base(path, document.pop("base"), folder), (*above, path)
    if below.resolve() in [one.resolve() for one in chain]:
        raise BadInput(f"{chain[0]}: a circle of bases: {' -> '.join(one.stem for one in (*chain, below))}")
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
        raise BadInput(f"{path}: base must be a vehicle's name or a file's path in quotes")
    beside = base.endswith(".toml")
    found = path.parent / base if beside else (folder or path.parent) / f"{base}.toml"
    if not found.is_file():
        known = sorted(one.stem for one in found.parent.glob("*.toml") if one != path)
        told = f"no file {found}" if beside else f"unknown; known: {', '.join(known)}"
        raise BadInput(f'{path}: base = "{base}": {told}')
    return found


def _laid_over(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Both tables in one, ``overrides`` where both have a value; a value is taken whole, with its unit and source."""
    merged = dict(base)
    for key, entry in overrides.items():
        below = merged.get(key)
        tables = isinstance(entry, dict) and isinstance(below, dict)
        merged[key] = _laid_over(below, entry) if tables and "value" not in entry else entry  # type: ignore[arg-type]
    return merged


def toml_text(document: Mapping[str, Any]) -> str:
    """A vehicle document as TOML text: its plain entries, then its sections, a line for each value."""
    return "\n".join(_toml_lines("", document)) + "\n"


def _toml_lines(section: str, table: Mapping[str, Any]) -> list[str]:
    inside = {key: entry for key, entry in table.items() if isinstance(entry, dict) and "value" not in entry}
    lines = [f"{_toml_key(key)} = {_toml(entry)}" for key, entry in table.items() if key not in inside]
    if section and (lines or not inside):
        lines.insert(0, f"\n[{section}]")
    for key, entry in inside.items():
        lines += _toml_lines(f"{section}.{_toml_key(key)}" if section else _toml_key(key), entry)
    return lines


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml(key)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_toml_key(key)} = {_toml(part)}" for key, part in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    # A JSON string is a TOML basic string, but for DEL; a date, which no schema takes, is kept as its text.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


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
            raise BadInput(f"{path}: unknown key {section}.{key}; known: {', '.join(hints)}")
    values: dict[str, Any] = {}
    for key, hint in hints.items():
        name = f"{section}.{key}"
        if key not in table:
            if key in defaults:
                continue
            raise BadInput(f"{path}: key {name} is missing ({_expectation(hint)})")
        entry = table[key]
        if _is_label(hint):
            values[key] = _label(path, name, entry)
            continue
        if not isinstance(entry, dict) or "value" not in entry:
            raise BadInput(f"{path}: {name} must be a table with value, unit and source")
        unknown = set(entry) - {"value", "unit", "source", "fitted"}
        if unknown:
            raise BadInput(f"{path}: {name} has unknown parts: {', '.join(sorted(unknown))}")
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
        raise BadInput(f"{path}: {section} must be a section of keys")
    return table


def _is_label(hint: Any) -> bool:
    return get_origin(hint) is Annotated and any(isinstance(extra, Label) for extra in get_args(hint))


def _label(path: Path, name: str, entry: Any) -> str:
    if not isinstance(entry, str):
        raise BadInput(f"{path}: {name} must be a name in quotes")
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
        raise BadInput(f'{path}: {name} needs source = "published|identified|chosen: which or why"')
    return Source(kind, text.strip())


def _value(path: Path, name: str, entry: Mapping[str, Any], hint: Any) -> Any:
    base, quantity = _unwrap(hint)
    value = entry["value"]
    unit = entry.get("unit", "")
    if quantity is not None and unit != quantity.unit:
        raise BadInput(f'{path}: {name} must be in "{quantity.unit}", not "{unit}"')
    if get_origin(base) is tuple:
        length = len(get_args(base))
        variable = get_args(base)[-1] is Ellipsis
        if not isinstance(value, list):
            raise BadInput(f"{path}: {name} must be a list of {'' if variable else f'{length} '}numbers")
        if not variable and len(value) != length:
            raise BadInput(f"{path}: {name} must have {length} numbers, not {len(value)}")
        return tuple(_number(path, name, item, float, quantity) for item in value)
    if base is str:
        if not isinstance(value, str):
            raise BadInput(f"{path}: {name} must be text")
        return value
    if base is bool:
        if not isinstance(value, bool):
            raise BadInput(f"{path}: {name} must be true or false")
        return value
    return _number(path, name, value, base, quantity)


def _number(path: Path, name: str, value: Any, base: Any, quantity: Quantity | None) -> float | int:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or (base is int and not float(value).is_integer())
    ):
        kind = "a whole number" if base is int else "a number"
        raise BadInput(f"{path}: {name} must be {kind}, not {value!r}")
    low, high = (quantity.low, quantity.high) if quantity else (-INFINITY, INFINITY)
    if not low <= value <= high:
        unit = quantity.unit if quantity else ""
        raise BadInput(f"{path}: {name} = {value:g} is outside {low:g} to {high:g} {unit}".rstrip())
    return int(value) if base is int else float(value)
