"""Columns as a data frame of pandas or polars."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from logs.columns import Array, Columns
from logs.extras import load_extra
from logs.flat import split, split_units, texts
from wingbeat.errors import InputError


def frame(columns: Columns, library: str = "pandas") -> Any:
    """Build a data frame with one row per message; see `logs.log_file.LogFile.frame`."""
    build = FRAMES.get(library)
    if build is None:
        raise InputError(f"no data frames of {library}; there are those of {' and '.join(FRAMES)}")
    return build(load_extra(library, library, "a data frame"), columns)


def _pandas(pandas: Any, columns: Columns) -> Any:
    built = pandas.DataFrame(split(columns), index=pandas.Index(columns.time, name="time"))
    built.attrs["units"] = split_units(columns)
    return built


def _polars(polars: Any, columns: Columns) -> Any:
    name = "log_time" if "time" in columns else "time"
    series = [_series(polars, name, values) for name, values in {name: columns.time, **split(columns)}.items()]
    return polars.DataFrame(series)


def _series(polars: Any, name: str, values: Array) -> Any:
    return (
        polars.Series(name, texts(values), polars.String) if values.dtype == object else polars.Series(name, values)
    )


FRAMES: Mapping[str, Callable[[Any, Columns], Any]] = {"pandas": _pandas, "polars": _polars}
