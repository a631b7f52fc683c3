"""A log's topics as tables of numbers: their finite samples in order of time, and values between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.topic import Topic

LEAST_SAMPLES = 20


class ColumnSource(Protocol):
    """A log, or anything else that gives a topic's fields as arrays."""

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name; a topic that was not recorded is refused or empty."""


class TopicTable:
    """One topic's columns with its time in seconds, cleared of samples that are not finite."""

    def __init__(self, source: ColumnSource, topic: Topic[Any], *fields: str) -> None:
        try:
            columns = source.columns(topic)
            arrays = [np.asarray(columns[field], dtype=float) for field in ("time_us", *fields)]
        except (KeyError, InputError) as error:
            if isinstance(error, InputError) and topic.name in getattr(source, "topics", ()):
                raise  # it is there, and damaged: nothing can stand for it
            raise InputError(f"the log has no topic {topic.name}, which this needs") from None
        if len(arrays[0]) < LEAST_SAMPLES:
            raise InputError(
                f"topic {topic.name} has {len(arrays[0])} messages; identification needs {LEAST_SAMPLES}"
            )
        good = np.all(np.isfinite(arrays), axis=0)
        good[1:] &= np.diff(np.maximum.accumulate(arrays[0])) > 0
        if good.sum() < LEAST_SAMPLES:
            raise InputError(f"topic {topic.name} has too few finite samples in order of time")
        self.time: Array = arrays[0][good] * 1e-6
        """s; (N,), since boot, rising"""
        self._fields = {field: array[good] for field, array in zip(fields, arrays[1:], strict=True)}

    def __getitem__(self, field: str) -> Array:
        return self._fields[field]

    def linear(self, field: str, time: Array) -> Array:
        """The field at ``time`` (s; (M,)), linear between samples; as the topic has it."""
        values: Array = np.interp(time, self.time, self._fields[field])
        return values

    def held(self, field: str, time: Array) -> Array:
        """The field at ``time`` (s; (M,)), held since its last sample; the first sample's value before it."""
        index = np.clip(np.searchsorted(self.time, time + 1e-7, side="right") - 1, 0, None)
        return self._fields[field][index]


def time_base(time: Array) -> Array:
    """Times (s) equally spaced over the record ``time`` (s; (N,)), at its median step, gaps and all."""
    step = float(np.median(np.diff(time)))
    base: Array = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    return base
