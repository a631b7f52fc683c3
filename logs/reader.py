"""Open a log: the content of a file, and its parameters, missions and tables of several topics."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from logs.alignment import aligned
from logs.chunks import MAX_CHUNK_SIZE
from logs.columns import Columns
from logs.index import read_index
from logs.log_file import LogFile, map_file
from wingbeat.topic import Topic

if TYPE_CHECKING:
    from logs.settings import ActiveMission, Parameters


class Log(LogFile):
    """Open log; created by `open_log`, closed by the garbage collector or ``close``."""

    @property
    def parameters(self) -> Parameters:
        """Return the flight computer's parameters: ``initial`` by name, ``changes`` in flight, ``at(time)``.

        A change is a setting that the flight computer acknowledged. The effect of a calibration appears in the next
        State snapshot.

        Raises:
            InputError: one is not a number, or a part of the file is damaged.
        """
        from logs.settings import parameters_of  # imports the flight code, which takes 0.1 s

        return parameters_of(self)

    @property
    def missions(self) -> tuple[ActiveMission, ...]:
        """Return the initial mission and its replacements, each with its start time.

        Raises:
            InputError: one cannot be read, or a part of the file is damaged.
        """
        from logs.settings import missions_of

        return missions_of(self)

    def aligned(
        self,
        topics: Iterable[str | Topic[Any]],
        rate: float | None = None,
        start: float | None = None,
        end: float | None = None,
        gap: float | None = None,
    ) -> Columns:
        """Build one table of several topics at common times, with columns ``/topic.field``.

        Numbers are interpolated linearly between two messages. Angles that wrap take the shorter way; their
        description in the file specifies the range, ``-pi to pi``. Quaternions keep length 1 and a continuous sign.
        Integers, flags and texts are those of the previous message. Nothing is extrapolated: rows outside the
        messages of a topic are NaN.

        Args:
            topics: names, ``topic.field`` or `Topic` values.
            rate: Hz; rows at its multiples since boot (default: at the messages of the first topic).
            start: s since boot; of the first row.
            end: s since boot; no row at or after it.
            gap: s; NaN in pauses longer than this (default: five median periods of the topic).

        Raises:
            InputError: the log has no such topic or field, a bad rate, or a part of the file is damaged.
        """
        return aligned(self, topics, rate, start, end, gap)


def open_log(path: Path | str, max_chunk_size: int = MAX_CHUNK_SIZE) -> Log:
    """Open an MCAP file.

    A truncated or damaged file is read as far as it is intact; ``damage`` lists the faults. Chunks that declare more
    than ``max_chunk_size`` uncompressed bytes count as damaged. No chunk is decompressed beyond its declared size.

    Raises:
        InputError: the file cannot be read, is empty or is not MCAP.
    """
    path = Path(path)
    data = map_file(path)
    return Log(path, data, read_index(data, max_chunk_size))
