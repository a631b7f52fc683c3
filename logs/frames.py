"""Columns as a data frame of pandas or polars."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from logs.columns import Array, Columns
from logs.extras import load_extra
from logs.flat import TIME, export_table, split, split_units, texts
from wingbeat.errors import InputError


def frame(columns: Columns, library: str = "pandas") -> Any:
    """Build a data frame with one row per message; see `logs.log_file.LogFile.frame`."""
    build = FRAMES.get(library)
    if build is None:
        raise InputError(f"no data frames of {library}; there are those of {' and '.join(FRAMES)}")
    return build(load_extra(library, library, "a data frame"), export_table(columns))


def _pandas(pandas: Any, columns: Columns) -> Any:
    table = {name: _category(pandas, values) for name, values in split(columns).items()}
    built = pandas.DataFrame(table).set_index(TIME)
    built.attrs["units"] = {name: unit for name, unit in split_units(columns).items() if name != TIME}
    return built


def _category(pandas: Any, values: Array) -> Any:
    return pandas.Categorical([name or None for name in values.tolist()]) if values.dtype.kind == "U" else values


def _polars(polars: Any, columns: Columns) -> Any:
    return polars.DataFrame([_series(polars, name, values) for name, values in split(columns).items()])


def _series(polars: Any, name: str, values: Array) -> Any:
    if values.dtype.kind == "U":
        return polars.Series(name, [one or None for one in values.tolist()], polars.Categorical)
    return (
        polars.Series(name, texts(values), polars.String) if values.dtype == object else polars.Series(name, values)
    )


FRAMES: Mapping[str, Callable[[Any, Columns], Any]] = {"pandas": _pandas, "polars": _polars}
