"""MATLAB files, version 5."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import IO, Any

import numpy as np

from logs.columns import Array, Columns
from logs.flat import distinct, texts
from wingbeat.errors import InputError

LONGEST_NAME = 63
"""characters of a MATLAB name"""
LARGEST = 2**31
"""bytes; limit of a variable in a file of version 5"""
UNITS, TOPIC = "units", "topic"
_KEYWORDS = (
    "break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global", "if",
    "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while",
)  # fmt: skip


def write_mat(tables: Mapping[str, Columns], file: IO[bytes]) -> None:
    """Write one struct per table, ``main_wing`` for ``/main/wing``: a field per column, a row per message.

    The field ``units`` of the struct has the unit of each column under the same name, ``topic`` the topic name.

    Raises:
        InputError: a table is larger than a variable can be.
    """
    from scipy.io import savemat  # takes longer to load than most that this folder does

    structs = {name: _struct(columns) for name, columns in zip(matlab_names(tables), tables.values(), strict=True)}
    savemat(file, structs, long_field_names=True, do_compression=True, oned_as="column")


def matlab_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return unique valid MATLAB names that are not in ``taken``.

    Letters, digits and underscores, 63 characters at most.
    """
    return distinct([_allowed(name) for name in names], taken, LONGEST_NAME)


def _allowed(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name.strip("/")) or "table"
    plain = plain if plain[0].isalpha() else f"x{plain}"
    return f"{plain}_" if plain in _KEYWORDS else plain


def _struct(columns: Columns) -> dict[str, Any]:
    size = sum(values.nbytes for values in columns.values())
    if size >= LARGEST:
        raise InputError(
            f"{columns.topic} has {size / 1e9:.1f} GB, a variable of a MATLAB 5 file at most 2.1: export a part of it"
        )
    names = matlab_names(columns, (UNITS, TOPIC))
    struct: dict[str, Any] = {name: _values(values) for name, values in zip(names, columns.values(), strict=True)}
    struct[UNITS] = dict(zip(names, (columns.units[name] for name in columns), strict=True))
    struct[TOPIC] = columns.topic
    return struct


def _values(values: Array) -> Array:
    if values.dtype.kind not in "OU":
        return values
    cells = np.empty(len(values), object)
    cells[:] = [text or "" for text in texts(values)]
    return cells
