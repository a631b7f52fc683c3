"""Flat tables: one number or text per cell, and time in every table."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import count
from typing import Any

from logs.columns import Array, Columns


def with_time(columns: Columns) -> Columns:
    """Return the table with its time (s since boot) as first column if the messages have no time field."""
    if "time_us" in columns:
        return columns
    name = "log_time" if "time" in columns else "time"
    return replace(columns, fields={name: columns.time, **columns.fields}, units={name: "s", **columns.units})


def split(columns: Columns) -> dict[str, Array]:
    """Return columns by name; an array of n values becomes columns ``name_0`` to ``name_n-1``."""
    out: dict[str, Array] = {}
    for name, values in columns.items():
        out |= {f"{name}_{i}": values[:, i] for i in range(values.shape[1])} if values.ndim == 2 else {name: values}
    return out


def split_units(columns: Columns) -> dict[str, str]:
    """Return the units of the columns of `split`, ``-`` for none."""
    widths = {name: values.shape[1] if values.ndim == 2 else None for name, values in columns.items()}
    return {
        part: columns.units[name]
        for name, width in widths.items()
        for part in ([name] if width is None else [f"{name}_{i}" for i in range(width)])
    }


def distinct(names: Iterable[str], taken: Iterable[str] = (), longest: int | None = None) -> list[str]:
    """Return unique names that are not in ``taken``: ``a``, ``a_2``, ``a_3``, at most ``longest`` characters."""
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
    """Convert a column of objects to text: other values as JSON, missing fields as None."""
    return [value if value is None or isinstance(value, str) else _json(value) for value in values.tolist()]


def _json(value: Any) -> str:
    return json.dumps(value, default=lambda other: other.hex() if isinstance(other, bytes) else str(other))
