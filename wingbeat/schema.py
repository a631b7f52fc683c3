"""Validated tables of TOML documents: NamedTuple records from tables, with one-line errors.

A key is the dotted name of a value in its document, ``time.rate``. `error_context` puts the file name, or the number
of an item, in front of the messages.
"""

from __future__ import annotations

import contextlib
import reprlib
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from wingbeat.docstrings import type_hints
from wingbeat.documents import parse_json, parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import did_you_mean, read_error_text
from wingbeat.units import Quantity

MAX_MAGNITUDE = 1e30
"""-; limit of the magnitude of a number: larger ones are mistakes and overflow in computations"""
MAX_INTEGER = 10**9
"""-; largest magnitude of a whole number without a range"""
BLANKS = str.maketrans("\t\N{NO-BREAK SPACE}", "  ")
"""characters of texts that `str.isprintable` rejects, and which are safe in a line"""
TYPE_NAMES = {bool: "true or false", str: "text in quotes"}

Record = TypeVar("Record")


@contextlib.contextmanager
def error_context(context: object) -> Iterator[None]:
    """Put ``context`` in front of the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{context}: {error}") from None


def read_document(path: Path, name: str) -> dict[str, Any]:
    """Read a TOML file, or a JSON file by its suffix; ``name`` is its kind, for error messages.

    Raises:
        InputError: unreadable file or syntax error.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        document = parse_json(text) if path.suffix == ".json" else parse_toml(text)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {name} {path}: {read_error_text(error)}") from None
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None
    with error_context(path):
        return dict(check_table(document, f"the {name}"))


def read_record(record: Callable[..., Record], table: Any, key: str = "") -> Record:
    """Read a ``record`` (NamedTuple class) from a table.

    The type hint of a field defines what its key accepts: ``bool``, ``int``, ``float``, ``str``, another record, a
    ``tuple`` or a ``dict`` of these, and ``| None``. Extras of `typing.Annotated`: a `Quantity` is the unit and the
    range, strings and numbers are the choices. A class with a method ``from_entry(entry, key)`` reads itself.

    Raises:
        InputError: unknown or missing key, or a value of another type or outside its range.
    """
    table = check_table(table, key or "the document")
    hints = field_hints(record)
    check_keys(table, hints, key)
    values = {name: read_value(hints[name], entry, join(key, name)) for name, entry in table.items()}
    defaults: Mapping[str, Any] = getattr(record, "_field_defaults", {})
    for name, hint in hints.items():
        if name not in values and name not in defaults:
            raise InputError(f"{join(key, name)} is missing{expected_text(hint)}")
    return record(**values)


def read_value(hint: Any, value: Any, key: str) -> Any:
    """Read one value; ``hint`` as in `read_record`.

    Raises:
        InputError: the value is of another type or outside its range.
    """
    base, quantity, choices = _unwrap(hint)
    if choices:
        return _choice(base, choices, value, key)
    if get_origin(base) is tuple:
        return _tuple(get_args(base), quantity, value, key)
    if get_origin(base) is dict:
        entries = check_table(value, key)
        return {name: read_value(get_args(base)[1], entry, join(key, name)) for name, entry in entries.items()}
    if base is Any:
        return value
    if hasattr(base, "from_entry"):
        return base.from_entry(value, key)
    if hasattr(base, "_fields"):
        return read_record(base, value, key)
    if base is float:
        return read_number(value, key, quantity)
    if base is int:
        return read_integer(value, key, quantity)
    if not isinstance(value, base):
        raise InputError(f"{key} must be {TYPE_NAMES[base]}, not {reprlib.repr(value)}")
    if base is str and not value.translate(BLANKS).isprintable():
        raise InputError(f"{key} = {reprlib.repr(value)} has characters that cannot be printed")
    return value


def read_number(value: Any, key: str, quantity: Quantity | None = None) -> float:
    """Read a finite number.

    Raises:
        InputError: not a number, or outside the range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{key} must be a number{expected_text(quantity)}, not {reprlib.repr(value)}")
    if not abs(value) <= MAX_MAGNITUDE:
        raise InputError(f"{key} must be a finite number{expected_text(quantity)}, not {reprlib.repr(value)}")
    if quantity is not None and not quantity.low <= value <= quantity.high:
        raise InputError(f"{key} = {value:g} {quantity.violation_text()}")
    return float(value)


def read_integer(value: Any, key: str, quantity: Quantity | None = None) -> int:
    """Read a whole number.

    Raises:
        InputError: not a whole number, or outside the range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not float(value).is_integer():
        raise InputError(f"{key} must be a whole number{expected_text(quantity)}, not {reprlib.repr(value)}")
    low, high = (-MAX_INTEGER, MAX_INTEGER) if quantity is None else (quantity.low, quantity.high)
    if not low <= value <= high:
        violation = "is too large" if quantity is None else f"= {value:g} {quantity.violation_text()}"
        raise InputError(f"{key} {violation}")
    return int(value)


def check_table(value: Any, key: str) -> Mapping[str, Any]:
    """Return the value if it is a table.

    Raises:
        InputError: it is not.
    """
    if not isinstance(value, dict):
        raise InputError(f"{key} must be a section of keys, not {reprlib.repr(value)}")
    return value


def check_keys(table: Iterable[str], known: Iterable[str], key: str = "") -> None:
    """Check the names of a table's entries; ``key`` is that of the table.

    Raises:
        InputError: an unknown name, with the most similar one that is known, and all of them.
    """
    known = tuple(known)
    for name in table:
        check_known(name, known, join(key, name))


def check_known(name: str, known: Iterable[str], key: str) -> None:
    """Check one name; ``key`` is its full name.

    Raises:
        InputError: as of `check_keys`.
    """
    known = tuple(known)
    if name not in known:
        raise InputError(f"unknown key {key}{did_you_mean(name, known)}; known: {', '.join(known)}")


def join(key: str, name: str) -> str:
    """Return the key of an entry of the table at ``key``."""
    return f"{key}.{name}" if key else name


def expected_text(hint: Any) -> str:
    """Return the allowed range as `` (0 to 2 m)``; empty without one."""
    quantity = hint if isinstance(hint, Quantity | None) else quantity_of(hint)
    return f" ({quantity.range_text()})" if quantity is not None and quantity.is_bounded else ""


def field_hints(record: Any) -> Mapping[str, Any]:
    """Return the type hints of a record's fields, with the extras of `typing.Annotated`."""
    return _field_hints(record)


@cache
def _field_hints(record: Any) -> Mapping[str, Any]:
    return types.MappingProxyType(type_hints(record))


def quantity_of(hint: Any) -> Quantity | None:
    """Return the unit and range of a hint; None without one."""
    return _unwrap(hint)[1]


@cache
def _unwrap(hint: Any) -> tuple[Any, Quantity | None, tuple[Any, ...]]:
    """Type, quantity and choices of a hint; ``| None`` is removed."""
    if get_origin(hint) in (Union, types.UnionType):
        return _unwrap(next(one for one in get_args(hint) if one is not type(None)))
    if get_origin(hint) is not Annotated:
        return hint, None, ()
    base, *extras = get_args(hint)
    quantity = next((extra for extra in extras if isinstance(extra, Quantity)), None)
    return base, quantity, tuple(extra for extra in extras if isinstance(extra, str | int | float))


def _choice(base: Any, choices: tuple[Any, ...], value: Any, key: str) -> Any:
    read = read_value(base, value, key)
    known = {_normalize(choice): choice for choice in choices}
    for one in read if isinstance(read, tuple) else (read,):
        if _normalize(one) not in known:
            raise InputError(f"{key} = {reprlib.repr(one)} is not known; known: {', '.join(map(str, choices))}")
    if isinstance(read, tuple):
        return tuple(dict.fromkeys(known[_normalize(one)] for one in read))
    return known[_normalize(read)]


def _normalize(choice: Any) -> Any:
    """Make the separator of a name's parts a blank: short_period, short-period and short period are the same."""
    return " ".join(choice.replace("_", " ").replace("-", " ").split()) if isinstance(choice, str) else choice


def _tuple(hints: tuple[Any, ...], quantity: Quantity | None, value: Any, key: str) -> tuple[Any, ...]:
    variable = hints[-1] is Ellipsis
    if not isinstance(value, list) or (not variable and len(value) != len(hints)):
        allowed = f"{_list_text(hints)}{expected_text(quantity)}"
        raise InputError(f"{key} must be a {allowed}, not {reprlib.repr(value)}")
    each = [hints[0]] * len(value) if variable else hints
    if quantity is not None:
        each = [Annotated[hint, quantity] for hint in each]
    return tuple(
        read_value(hint, one, f"{key}[{index}]") for index, (hint, one) in enumerate(zip(each, value, strict=True))
    )


def _list_text(hints: tuple[Any, ...]) -> str:
    """Return the length and the kind of a list: ``list of 4 lists of 4 numbers``."""
    item = _unwrap(hints[0])[0]
    length = "" if hints[-1] is Ellipsis else f"{len(hints)} "
    if get_origin(item) is tuple:
        return f"list of {length}{_list_text(get_args(item)).replace('list', 'lists', 1)}"
    return f"list of {length}{'numbers' if item in (float, int) else 'values'}"
