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
    """One kind of message of a foreign log, as columns in the order of the file."""

    name: str
    """of its topic behind that of the format: ``ATT``, ``vehicle_status``"""
    time_us: NDArray[np.int64]
    """us; (N,), since the source's boot"""
    columns: Mapping[str, Array]
    """(N,), or (N, k) of an array; of objects where it is text"""
    units: Mapping[str, str]
    """by column, as the source has them; none where it tells none"""

    def taken(self, rows: Array) -> Series:
        """The rows at ``rows``, a mask or indices."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return self._replace(time_us=self.time_us[rows], columns=columns)


def shifted(series: Series, by_us: int) -> Series:
    """The same rows, ``by_us`` later."""
    return series._replace(time_us=series.time_us + by_us)


class Dropped(NamedTuple):
    """Rows that were left out of a topic."""

    topic: str
    reason: str
    """-; one line"""
    rows: int


class ImportedTopic(NamedTuple):
    """One of the project's topics, made and checked."""

    topic: Topic[Any]
    source: str
    """name of the series it was made of"""
    series: Series
    """columns by the message's fields but for ``time_us``"""
    kept: NDArray[np.bool_]
    """rows of the source's series that are in it"""
    dropped: tuple[Dropped, ...]


class Source(NamedTuple):
    """A foreign log as read."""

    format: str
    """-; a key of `log_import.FORMATS`"""
    series: Mapping[str, Series]
    vehicle: str = ""
    """-; what the source says of itself; empty for nothing"""
    epoch_ns: int = 0
    """ns since 1970 at which the source's clock was zero; 0 where it does not tell"""
    events: tuple[Event, ...] = ()
    parameters: Mapping[str, float] = {}
    notes: Mapping[str, str] = {}
    """further facts for the metadata"""
    damage: tuple[str, ...] = ()
    """what was wrong with the file, one line each"""
    dropped: tuple[Dropped, ...] = ()
    """what the reader itself left out"""
    made: tuple[ImportedTopic, ...] = ()
    """the project's topics that the reader itself made"""
    clock: str = OF_BOOT
    """-; what the times count"""
    checksummed: bool = False
    """a value is not doubted: 65535 stands for 'not known' in many fields of MAVLink"""
