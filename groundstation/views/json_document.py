"""JSON for programs: plain types, and null for what is not finite, because JSON has no word for it."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any


def print_document(document: Any) -> None:
    """One indented JSON document on stdout."""
    json.dump(plain(document), sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write("\n")


def print_line(document: Any) -> None:
    """One JSON document on a line of its own, at once."""
    print(json.dumps(plain(document), ensure_ascii=False, allow_nan=False), flush=True)


def plain(value: Any) -> Any:
    """``value`` in the types of JSON; a NamedTuple becomes an object, an array a list."""
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
