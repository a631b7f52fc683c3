"""JSON documents of plain types; null for values that are not finite."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any

from groundstation.views.printable import CONTROLS


def print_document(document: Any) -> None:
    """Print one indented JSON document to stdout."""
    sys.stdout.write(encode(document, indent=2) + "\n")


def print_line(document: Any) -> None:
    """Print one JSON document on one line and flush it."""
    print(encode(document), flush=True)


def encode(document: Any, indent: int | None = None) -> str:
    """Return one JSON document; control characters are escaped."""
    text = json.dumps(plain(document), indent=indent, ensure_ascii=False, allow_nan=False)
    # JSON escapes C0 controls. Other controls occur in strings only, where an escape keeps their value.
    return CONTROLS.sub(lambda match: match[0] if match[0] == "\t" else f"\\u{ord(match[0]):04x}", text)


def plain(value: Any) -> Any:
    """Convert ``value`` to JSON types; a NamedTuple becomes an object, an array a list."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, int | float | str | bool | type(None)) else str(value)
