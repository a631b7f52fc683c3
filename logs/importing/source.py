"""Common form of an imported log before checks and writing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wingbeat.message import Event
from wingbeat.topic import Topic

Array = NDArray[Any]
OF_BOOT = "since the source's boot"
"""what times count"""


class Series(NamedTuple):
    """One message type of a foreign log, as columns in the order of the file."""

    name: str
    """topic name after the prefix of the format: ``ATT``, ``vehicle_status``"""
    time_us: NDArray[np.int64]
    """us; (N,), since the source's boot"""
    columns: Mapping[str, Array]
    """(N,), or (N, k) for an array; object arrays for text"""
    units: Mapping[str, str]
    """by column, as in the source; missing if the source has none"""

    def taken(self, rows: Array) -> Series:
        """Return the rows at ``rows``, a mask or indices."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return self._replace(time_us=self.time_us[rows], columns=columns)


def shifted(series: Series, by_us: int) -> Series:
    """Return the series with times increased by ``by_us``."""
    return series._replace(time_us=series.time_us + by_us)


class ParameterChange(NamedTuple):
    """Parameter that was set after boot."""

    time_us: int
    """us since boot"""
    name: str
    value: float


class History:
    """Parameters in the order of the file: the first value of each is that at boot, others are changes."""

    def __init__(self) -> None:
        self.initial: dict[str, float] = {}
        self.changes: list[ParameterChange] = []
        self._last: dict[str, float] = {}

    def add(self, time_us: int, name: str, value: float) -> None:
        """Add a value as it was logged."""
        if name not in self.initial:
            self.initial[name] = value
        elif self._last[name] != value:
            self.changes.append(ParameterChange(time_us, name, value))
        self._last[name] = value


class Dropped(NamedTuple):
    """Rows omitted from a topic."""

    topic: str
    reason: str
    """-; one line"""
    rows: int


class ImportedTopic(NamedTuple):
    """Wingbeat topic made from a source series and checked."""

    topic: Topic[Any]
    source: str
    """name of its source series"""
    series: Series
    """columns by the message's fields but for ``time_us``"""
    kept: NDArray[np.bool_]
    """rows of the source series that it contains"""
    dropped: tuple[Dropped, ...]


class Source(NamedTuple):
    """Foreign log as read."""

    format: str
    """-; a key of `log_import.FORMATS`"""
    series: Mapping[str, Series]
    vehicle: str = ""
    """-; vehicle description in the source; empty if it has none"""
    epoch_ns: int = 0
    """ns since 1970 at the zero of the source's clock; 0 if unknown"""
    events: tuple[Event, ...] = ()
    parameters: Mapping[str, float] = {}
    """at boot; whole numbers are int"""
    changes: tuple[ParameterChange, ...] = ()
    """of parameters, in order of time"""
    notes: Mapping[str, str] = {}
    """other facts for the metadata"""
    damage: tuple[str, ...] = ()
    """damage of the file, one line each"""
    dropped: tuple[Dropped, ...] = ()
    """rows that the reader omitted"""
    made: tuple[ImportedTopic, ...] = ()
    """Wingbeat topics that the reader made"""
    clock: str = OF_BOOT
    """-; meaning of the times"""
    checksummed: bool = False
    """values are protected by a checksum and not checked: 65535 means unknown in many MAVLink fields"""
