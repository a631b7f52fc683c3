"""Parallel decoding of messages of fixed layout to columns.

A chunk holds a few messages of each topic, too few for NumPy to be quick with. So chunks are unpacked some dozens at
a time, a batch, and all messages that a channel has in it are copied, checked and written into the columns together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.chunks import BEYOND_NS, ChunkSpan, rows_at, unpack
from logs.columns import Array, RowType, column_type, row_type
from logs.layout import Layout
from logs.listing import Listing
from logs.records import Buffer
from wingbeat.cores import available_cores

BATCH_BYTES = 4 * 1024 * 1024
"""Bytes, uncompressed; a compromise between processor cache size and call overhead."""
MOST_THREADS = 4


class Batch(NamedTuple):
    """Chunks that are decompressed together."""

    first: int
    """index of the first chunk"""
    behind: int
    """index after the last chunk"""

    def content(self, data: Buffer, chunks: Sequence[ChunkSpan]) -> bytes:
        """Return the concatenated records of the chunks.

        Raises:
            Damage: a chunk cannot be unpacked or does not match its checksum.
        """
        return b"".join([unpack(data, chunk) for chunk in chunks[self.first : self.behind]])


class Table:
    """Columns of one channel, filled batch by batch from several threads."""

    def __init__(self, layout: Layout, channel: int, listing: Listing, sizes: NDArray[np.int64]) -> None:
        """Allocate the columns of the messages in ``listing``, in chunks of ``sizes`` bytes."""
        self.kind: RowType = row_type(layout, channel)
        self.times = listing.times
        """ns; log time"""
        self.fits = listing.is_inside(sizes, self.kind.kind.itemsize)
        """every message so far has the layout and the location that the message index declares"""
        rows = len(self.times) if self.fits else 0
        self.fields = {item.name: np.empty((rows, *item.shape), column_type(item)) for item in layout.fields}
        self._offsets = listing.offsets
        self._counts = listing.counts
        self._first = np.concatenate(([0], np.cumsum(listing.counts)))

    def take(self, batch: Batch, content: bytes, starts: NDArray[np.int64]) -> None:
        """Copy the messages of a batch whose chunks start at the offsets ``starts`` of ``content``."""
        mine = slice(*self._first[[batch.first, batch.behind]].tolist())
        if not self.fits or mine.start == mine.stop:
            return
        shift = np.repeat(starts.astype(np.uint64), self._counts[batch.first : batch.behind])
        kind = self.kind.kind
        rows = rows_at(content, self._offsets[mine] + shift, np.dtype((np.void, kind.itemsize)))
        if not self.kind.fits(rows, self.times[mine]):
            self.fits = False
            return
        messages = rows.view(kind)
        for name, values in self.fields.items():
            values[mine] = messages[name]

    def between(self, low: int, high: int) -> tuple[NDArray[np.uint64], dict[str, Array]]:
        """Return log times and columns of the messages with log times (ns) from ``low`` to before ``high``."""
        low, high = (min(max(edge, 0), BEYOND_NS) for edge in (low, high))
        kept = (self.times >= low) & (self.times < high)
        if kept.all():
            return self.times, self.fields
        return self.times[kept], {name: values[kept] for name, values in self.fields.items()}


def fill(data: Buffer, chunks: Sequence[ChunkSpan], tables: Iterable[Table]) -> None:
    """Fill all tables in one pass over the chunks.

    Raises:
        Damage: a chunk cannot be unpacked or does not match its checksum.
    """
    tables = list(tables)
    starts = np.cumsum([0, *(chunk.size for chunk in chunks)])

    def take(batch: Batch) -> None:
        content = batch.content(data, chunks)
        for table in tables:
            table.take(batch, content, starts[batch.first : batch.behind] - starts[batch.first])

    on_every_core(take, list(_batches(chunks)))


def _batches(chunks: Sequence[ChunkSpan]) -> Iterator[Batch]:
    first = size = 0
    for number, chunk in enumerate(chunks):
        if size and size + chunk.size > BATCH_BYTES:
            yield Batch(first, number)
            first, size = number, 0
        size += chunk.size
    if first < len(chunks):
        yield Batch(first, len(chunks))


def on_every_core(work: Callable[[Any], None], parts: Sequence[Any]) -> None:
    """Run ``work`` for each part in a thread pool; raise the exception of the first part that failed."""
    threads = min(available_cores(), MOST_THREADS, len(parts))
    if threads < 2:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(threads, "reader") as pool:
        for _ in pool.map(work, parts):
            pass
