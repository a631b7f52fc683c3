"""TOML sections as NamedTuples: every key checked, every complaint one line that names the key and what is known."""

from __future__ import annotations

import math
import reprlib
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from wingbeat.documents import parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import did_you_mean

LARGEST = 1e30
"""a number beyond it is a slip of the pen, and overflows what is made of it"""


def read_section(record: type[Any], table: Any, key: str) -> Any:
    """A ``record`` (NamedTuple class) from a TOML ``table``, ``key`` being its name in the file.

    A field's hint says what its key takes: ``bool``, ``int``, ``float``, ``str``, another record, a ``tuple`` or a
    ``dict`` by name of these, and ``| None``. A string among `typing.Annotated` extras is a choice that is allowed.
    A record with a method ``from_entry(entry, key)`` reads itself.

    Raises:
        InputError: an unknown or missing key, or a value of another kind.
    """
    if not isinstance(table, dict):
        raise InputError(f"{key or 'the map'} must be a section of keys, not {reprlib.repr(table)}")
    hints = get_type_hints(record, include_extras=True)
    for name in table:
        check_known(name, hints, _joined(key, name))
    values = {name: _value(hints[name], entry, _joined(key, name)) for name, entry in table.items()}
    defaults: Mapping[str, Any] = getattr(record, "_field_defaults", {})
    for name in hints:
        if name not in values and name not in defaults:
            raise InputError(f"{_joined(key, name)} is missing")
    return record(**values)


def read_document(path: Path) -> dict[str, Any]:
    """A map's TOML, nothing of it checked yet.

    Raises:
        InputError: it cannot be read, or is no TOML.
    """
    try:
        return parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read map {path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"map {path}: not valid TOML: {error}") from None
    except DocumentError as error:
        raise InputError(f"map {path}: {error}") from None


def check_known(name: str, known: Any, key: str) -> None:
    """Refuse a name that is none of ``known``.

    Raises:
        InputError: with the nearest that is known, and all of them.
    """
    if name in known:
        return
    raise InputError(f"unknown key {key}{did_you_mean(name, known)}; known: {', '.join(known)}")


def _joined(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _value(hint: Any, entry: Any, key: str) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        return _value(next(one for one in get_args(hint) if one is not type(None)), entry, key)
    if get_origin(hint) is Annotated:
        return _choice(hint, entry, key)
    if get_origin(hint) is tuple:
        return _several(get_args(hint), entry, key)
    if get_origin(hint) is dict:
        if not isinstance(entry, dict):
            raise InputError(f"{key} must be a section of keys, not {reprlib.repr(entry)}")
        return {name: _value(get_args(hint)[1], one, _joined(key, name)) for name, one in entry.items()}
    if hasattr(hint, "from_entry"):
        return hint.from_entry(entry, key)
    if hasattr(hint, "_fields"):
        return read_section(hint, entry, key)
    return _plain(hint, entry, key)


def _choice(hint: Any, entry: Any, key: str) -> Any:
    base, *allowed = get_args(hint)
    value = _value(base, entry, key)
    known = {_folded(one): one for one in allowed}
    for one in value if isinstance(value, tuple) else (value,):
        if _folded(one) not in known:
            raise InputError(f"{key} = {reprlib.repr(one)} is not known; known: {', '.join(map(str, allowed))}")
    if isinstance(value, tuple):
        return tuple(dict.fromkeys(known[_folded(one)] for one in value))
    return known[_folded(value)]


def _folded(choice: Any) -> Any:
    """One of several words, however its parts are joined: short_period is short period, nelder-mead nelder_mead."""
    return " ".join(choice.replace("_", " ").replace("-", " ").split()) if isinstance(choice, str) else choice


def _several(kinds: tuple[Any, ...], entry: Any, key: str) -> tuple[Any, ...]:
    open_ended = kinds[-1] is Ellipsis
    if not isinstance(entry, list) or (not open_ended and len(entry) != len(kinds)):
        raise InputError(
            f"{key} must be a list{'' if open_ended else f' of {len(kinds)}'}, not {reprlib.repr(entry)}"
        )
    each = [kinds[0]] * len(entry) if open_ended else kinds
    return tuple(
        _value(kind, one, f"{key}[{place}]") for place, (kind, one) in enumerate(zip(each, entry, strict=True))
    )


def _plain(hint: Any, entry: Any, key: str) -> Any:
    if hint is float:
        return number(entry, key)
    if hint is Any:
        return entry
    words = {bool: "true or false", int: "a whole number", str: "text in quotes"}
    if not isinstance(entry, hint) or (hint is int and isinstance(entry, bool)):
        raise InputError(f"{key} must be {words[hint]}, not {reprlib.repr(entry)}")
    if hint is str and not entry.isprintable():
        raise InputError(f"{key} = {reprlib.repr(entry)} has characters that cannot be printed")
    if hint is int and abs(entry) > 10**9:
        raise InputError(f"{key} is too large")
    return entry


def number(entry: Any, key: str) -> float:
    """A finite number of a map.

    Raises:
        InputError: it is none.
    """
    if isinstance(entry, bool) or not isinstance(entry, int | float):
        raise InputError(f"{key} must be a number, not {reprlib.repr(entry)}")
    if not abs(entry) <= LARGEST or math.isnan(entry):
        raise InputError(f"{key} must be a finite number, not {reprlib.repr(entry)}")
    return float(entry)
