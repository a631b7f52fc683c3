"""Flat tables: one number or text per cell, and time in every table."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import count
from typing import Any

from logs.columns import Array, Columns


def with_time(columns: Columns) -> Columns:
    """The table with its time (s since boot) as the first column where the messages have none in them."""
    if "time_us" in columns:
        return columns
    name = "log_time" if "time" in columns else "time"
    return replace(columns, fields={name: columns.time, **columns.fields}, units={name: "s", **columns.units})


def split(columns: Columns) -> dict[str, Array]:
    """Columns by name, those of an array of n values as n columns ``name_0`` to ``name_n-1``."""
    out: dict[str, Array] = {}
    for name, values in columns.items():
        out |= {f"{name}_{i}": values[:, i] for i in range(values.shape[1])} if values.ndim == 2 else {name: values}
    return out


def split_units(columns: Columns) -> dict[str, str]:
    """Units of what `split` gives, ``-`` for none."""
    widths = {name: values.shape[1] if values.ndim == 2 else None for name, values in columns.items()}
    return {
        part: columns.units[name]
        for name, width in widths.items()
        for part in ([name] if width is None else [f"{name}_{i}" for i in range(width)])
    }


def distinct(names: Iterable[str], taken: Iterable[str] = (), longest: int | None = None) -> list[str]:
    """Names of which each is there once and none ``taken``: ``a``, ``a_2``, ``a_3``, ``longest`` letters at most."""
    out: list[str] = []
    used = set(taken)
    for name in names:
        free, ending = name[:longest], ""
        for number in count(2):
            if free not in used:
                break
            ending = f"_{number}"
            free = name[: None if longest is None else longest - len(ending)] + ending
        used.add(free)
        out.append(free)
    return out


def texts(values: Array) -> list[str | None]:
    """A column of objects as texts: what is no text as JSON, None where a message lacks the field."""
    return [value if value is None or isinstance(value, str) else _json(value) for value in values.tolist()]


def _json(value: Any) -> str:
    return json.dumps(value, default=lambda other: other.hex() if isinstance(other, bytes) else str(other))
