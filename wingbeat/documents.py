"""TOML and JSON documents: parse with one-line errors, write a TOML document with a line for each value."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from typing import Any

from wingbeat.errors import DocumentError

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


def toml_text(document: Mapping[str, Any]) -> str:
    """Format a vehicle document as TOML: its plain entries, then its sections, a line for each value."""
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
    # A JSON string is a TOML basic string, except for DEL; a date, which no schema accepts, is kept as text.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
