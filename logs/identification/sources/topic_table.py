"""Topics of a log as tables of numbers: finite samples in order of time, and values between them."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from avionics import topics
from logs.identification.results import Array
from logs.reader import Log
from wingbeat.errors import InputError
from wingbeat.topic import Topic

MIN_SAMPLES = 20


class ColumnSource(Protocol):
    """A log, or anything else that gives a topic's fields as arrays."""

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name; a topic that was not recorded is refused or empty."""


class TopicTable:
    """Columns of one topic with its time in seconds, without samples that are not finite."""

    def __init__(self, source: ColumnSource, topic: Topic[Any], *fields: str) -> None:
        try:
            columns = source.columns(topic)
            arrays = [np.asarray(columns[field], dtype=float) for field in ("time_us", *fields)]
        except (KeyError, InputError) as error:
            if isinstance(error, InputError) and topic.name in getattr(source, "topics", ()):
                raise  # it is damaged, so nothing replaces it
            raise InputError(f"the log has no topic {topic.name}, which this needs") from None
        if len(arrays[0]) < MIN_SAMPLES:
            raise InputError(f"topic {topic.name} has {len(arrays[0])} messages; identification needs {MIN_SAMPLES}")
        good = np.all(np.isfinite(arrays), axis=0)
        good[1:] &= np.diff(np.maximum.accumulate(arrays[0])) > 0
        if good.sum() < MIN_SAMPLES:
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

    def zero_order_hold(self, field: str, time: Array) -> Array:
        """The field at ``time`` (s; (M,)) as of its last sample; the first sample's value before it."""
        index = np.clip(np.searchsorted(self.time, time + 1e-7, side="right") - 1, 0, None)
        return self._fields[field][index]


class CachedSource:
    """Columns of ``source``, read once per topic."""

    def __init__(self, source: ColumnSource) -> None:
        self._source = source
        self._columns: dict[str, Mapping[str, Any]] = {}

    @property
    def topics(self) -> Container[str]:
        """Names of the topics that the source has; none if it does not list them."""
        names: Container[str] = getattr(self._source, "topics", ())
        return names

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: as of the source.
        """
        if topic.name not in self._columns:
            self._columns[topic.name] = self._source.columns(topic)
        return self._columns[topic.name]


class ElevatorFromField(NamedTuple):
    """A `ColumnSource` whose elevator command is ``field`` of ``topic`` times ``scale``: a pulse width or a stick.

    The zero of the field does not matter: inputs are changes of the angle.
    """

    log: Log
    topic: str
    field: str
    scale: float
    """rad per unit of the field; positive pitches the nose up"""
    assumed: bool = False
    """the travel is not recorded: derivatives by the elevator scale with it, modes do not"""

    @property
    def note(self) -> str:
        """Line of the report."""
        known = "; assumed, derivatives scale with it: --elevator sets it" if self.assumed else ""
        return f"elevator: {self.topic}.{self.field} at {self.scale:g} rad per unit{known}"

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: the log has no such topic, or the field is no number.
        """
        if topic != topics.ACTUATORS:
            return self.log.columns(topic)
        columns = self.log.columns(self.topic)
        name, _, place = self.field.rstrip("]").partition("[")
        values = columns.fields.get(name)
        if values is not None and place.isdigit() and values.ndim == 2 and int(place) < values.shape[1]:
            values = values[:, int(place)]
        if values is None or values.ndim != 1 or values.dtype.kind not in "fiu":
            numbers = [name for name, each in columns.items() if each.ndim == 1 and each.dtype.kind in "fiu"]
            raise InputError(f"{self.topic} has no number {self.field}; it has: {', '.join(numbers)}")
        return {"time_us": np.rint(columns.time * 1e6), "elevator": values * self.scale}


def time_base(time: Array) -> Array:
    """Times (s) equally spaced over the record ``time`` (s; (N,)), at its median step, gaps and all."""
    step = float(np.median(np.diff(time)))
    base: Array = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    return base
