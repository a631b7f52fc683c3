"""Tables as Apache Parquet (``pyarrow``)."""

from __future__ import annotations

import json
from typing import IO, Any

import numpy as np

from logs.columns import Array, Columns
from logs.extras import load_extra
from logs.flat import texts


def write_parquet(columns: Columns, file: IO[bytes]) -> None:
    """Write a table; arrays become lists, NumPy strings a dictionary (pandas and polars: categories).

    The metadata of each column are ``unit`` and, if known, ``description`` and ``labels`` (JSON); those of the table
    are ``wingbeat.topic`` and ``wingbeat.boot_ns``, the epoch time (ns) of the zero of the vehicle clock.

    Raises:
        InputError: pyarrow is not installed.
    """
    arrow = load_extra("pyarrow", "pyarrow", "writing Parquet")
    parquet = load_extra("pyarrow.parquet", "pyarrow", "writing Parquet")
    arrays = {name: _array(arrow, values) for name, values in columns.items()}
    fields = [arrow.field(name, values.type, metadata=_about(columns, name)) for name, values in arrays.items()]
    about = {"wingbeat.topic": columns.topic, "wingbeat.boot_ns": str(columns.boot_ns)}
    table = arrow.Table.from_arrays(list(arrays.values()), schema=arrow.schema(fields, metadata=about))
    content = arrow.BufferOutputStream()
    parquet.write_table(table, content, compression="zstd")
    file.write(memoryview(content.getvalue()))


def _array(arrow: Any, values: Array) -> Any:
    if values.dtype == object:
        return arrow.array(texts(values), arrow.string())
    if values.dtype.kind == "U":
        return arrow.array([name or None for name in values.tolist()], arrow.string()).dictionary_encode()
    if values.ndim == 1:
        return arrow.array(values)
    # Parquet has no lists of fixed size, and some readers reject those that Arrow stores as such.
    offsets = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
    return arrow.ListArray.from_arrays(arrow.array(offsets), arrow.array(values.ravel()))


def _about(columns: Columns, name: str) -> dict[str, str]:
    about = {"unit": columns.units[name], "description": columns.descriptions.get(name, "")}
    labels = columns.labels.get(name)
    if labels:
        about["labels"] = json.dumps({str(value): label for value, label in labels.items()})
    return {key: text for key, text in about.items() if text}
