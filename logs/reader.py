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
    """An open log; opened by `open_log`, closed by the garbage collector or ``close``."""

    @property
    def parameters(self) -> Parameters:
        """The flight computer's parameters: ``initial`` by name, ``changes`` in flight, ``at(time)``.

        A change is what the flight computer answered to; what a calibration set shows in the next State snapshot.

        Raises:
            InputError: one is not a number, or a part of the file is damaged.
        """
        from logs.settings import parameters_of  # imports the flight code, which takes 0.1 s

        return parameters_of(self)

    @property
    def missions(self) -> tuple[ActiveMission, ...]:
        """The mission at boot and those that replaced it, each with the time from which it held.

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
        """One table of several topics, its columns named ``/topic.field``, all at the same times.

        Numbers are linear between two messages, angles that wrap take the shorter way round (their description in
        the file tells the range, ``-pi to pi``), quaternions keep length 1 and their sign. Whole numbers, switches
        and texts are the last message's. Nothing is extrapolated: NaN stands where a topic has nothing to say.

        Args:
            topics: names, ``topic.field`` or `Topic` values.
            rate: Hz; rows at its multiples since boot, at the messages of the first topic when not given.
            start: s since boot; of the first row.
            end: s since boot; no row at or after it.
            gap: s; NaN in pauses longer than this, or than five of the topic's median periods when not given.

        Raises:
            InputError: the log has no such topic or field, a bad rate, or a part of the file is damaged.
        """
        return aligned(self, topics, rate, start, end, gap)


def open_log(path: Path | str, max_chunk_size: int = MAX_CHUNK_SIZE) -> Log:
    """Open an MCAP file; one that was cut off or is damaged gives what is whole, and says so in ``damage``.

    Chunks that declare more than ``max_chunk_size`` uncompressed bytes count as damaged; no chunk is decompressed
    beyond the size that it declares.

    Raises:
        InputError: the file cannot be read, is empty or is not MCAP.
    """
    path = Path(path)
    data = map_file(path)
    return Log(path, data, read_index(data, max_chunk_size))
