"""Flat tables: one number or text per cell, time first, enumerations with the names of their values."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import count
from typing import Any

from logs.columns import Array, Columns, names_of

TIME = "time"
"""s since boot: first column of every exported table, index of a pandas frame"""
RENAMED = {TIME: f"message_{TIME}"}
"""field of a message whose name is taken, and its column"""


def export_table(columns: Columns) -> Columns:
    """Return the table of an export.

    The first column is `TIME`. A field of that name becomes ``message_time``. An enumeration ``mode`` is followed by
    ``mode_name`` with the names of its values (NumPy strings, empty if there is none).
    """
    taken = {RENAMED.get(name, name) for name in columns}
    fields: dict[str, Array] = {TIME: columns.time}
    units, labels, descriptions = {TIME: "s"}, {}, {TIME: "since boot"}
    for source, values in columns.fields.items():
        name = RENAMED.get(source, source)
        fields[name], units[name] = values, columns.units[source]
        descriptions[name] = columns.descriptions.get(source, "")
        if source in columns.labels:
            labels[name] = columns.labels[source]
            (named,) = distinct([f"{name}_name"], taken)
            fields[named], units[named] = names_of(values, labels[name]), "-"
            taken.add(named)
    return replace(columns, fields=fields, units=units, labels=labels, descriptions=descriptions)


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
