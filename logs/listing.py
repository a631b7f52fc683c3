"""Message indexes of a channel over many chunks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from logs.chunks import ENTRY_TYPE, PLACE_TYPE, ChunkSpan, Entries, listed_entries
from logs.records import HEAD, Buffer

INDEX_HEAD = np.dtype(
    {
        "names": ["opcode", "length", "channel", "size"],
        "formats": ["u1", "<u8", "<u2", "<u4"],
        "offsets": [0, 1, 9, 11],
        "itemsize": 15,
    }
)
"""Header of a message index record, without its entries."""

_NUMBER = np.dtype("<u8")
"""A time or an offset in an entry."""

Counts = NDArray[np.int64]


class Listing(NamedTuple):
    """Messages of a channel, chunk by chunk, from the message indexes; without a checksum, so unchecked."""

    times: NDArray[np.uint64]
    """ns; log time"""
    offsets: NDArray[np.uint64]
    """bytes; offset in the chunk"""
    counts: Counts
    """number of messages in each chunk"""

    def is_inside(self, sizes: NDArray[np.int64], length: int) -> bool:
        """Check that the records at the offsets end inside their chunks of these sizes in bytes."""
        last = np.repeat(sizes - length, self.counts)
        return bool(np.all(last >= 0) and np.all(self.offsets <= last.astype(np.uint64)))


class Places:
    """Locations of the message indexes of several chunks in the file."""

    def __init__(self, chunks: Sequence[ChunkSpan]) -> None:
        self.chunks = chunks
        self._walked = any(chunk.entries for chunk in chunks)
        told = np.frombuffer(b"".join([chunk.places for chunk in chunks]), PLACE_TYPE)
        each = [len(chunk.places) // PLACE_TYPE.itemsize for chunk in chunks]
        self._chunk = np.repeat(np.arange(len(chunks)), each)
        self._channel = np.ascontiguousarray(told["channel"])
        self._offset = told["offset"].astype(np.int64)

    @property
    def channels(self) -> list[int]:
        """Return the channels with a message index."""
        return [int(channel) for channel in np.unique(self._channel)]

    def chunks_of(self, channels: Iterable[int]) -> list[ChunkSpan]:
        """Return the chunks with messages of any of the channels."""
        if self._walked:
            return [chunk for chunk in self.chunks if not chunk.entries.keys().isdisjoint(channels)]
        found = np.unique(self._chunk[np.isin(self._channel, list(channels))])
        return [self.chunks[number] for number in found.tolist()]

    def listing(self, data: Buffer, channel: int) -> Listing | None:
        """Return the messages of ``channel`` in the chunks; None if a message index cannot be read."""
        found = self._entries(data, channel)
        if found is not None:
            counts, places = found
            raw = np.frombuffer(data, np.uint8)
            offsets = _gathered(raw, places + _NUMBER.itemsize, _NUMBER)
            if _is_monotonic(offsets, counts):
                return Listing(_gathered(raw, places, _NUMBER), offsets, counts)
        return self._one_by_one(data, channel)

    def times(self, data: Buffer, channel: int) -> NDArray[np.uint64] | None:
        """Return the log times (ns) of ``channel``; None if they cannot be read in one step."""
        found = self._entries(data, channel)
        return None if found is None else _gathered(np.frombuffer(data, np.uint8), found[1], _NUMBER)

    def _entries(self, data: Buffer, channel: int) -> tuple[Counts, NDArray[np.int64]] | None:
        """Return the message count of the channel in each chunk, and the file offsets of their index entries.

        None if a message index is not a complete one of this channel, or if the chunks were scanned.
        """
        mine = self._channel == channel
        found = None if self._walked else _stored(data, self._offset[mine], channel)
        if found is None or int(found.sum()) * ENTRY_TYPE.itemsize > len(data):  # an index that is named repeatedly
            return None
        counts = np.zeros(len(self.chunks), np.int64)
        counts[self._chunk[mine]] = found
        first = self._offset[mine] + INDEX_HEAD.itemsize
        within = np.arange(int(found.sum())) - np.repeat(np.cumsum(found) - found, found)
        return counts, np.repeat(first, found) + within * ENTRY_TYPE.itemsize

    def _one_by_one(self, data: Buffer, channel: int) -> Listing | None:
        nothing = np.empty(0, ENTRY_TYPE)
        known: list[Entries] = []
        size = 0
        for chunk in self.chunks:
            part = listed_entries(data, chunk, channel) if channel in chunk.channels else nothing
            size += 0 if part is None or self._walked else part.nbytes
            if part is None or size > len(data):
                return None
            known.append(part)
        entries = np.concatenate([nothing, *known])
        return Listing(entries["time"], entries["offset"], np.array([len(part) for part in known], np.int64))


def _is_monotonic(offsets: NDArray[np.uint64], counts: Counts) -> bool:
    """Return whether the offsets in each chunk increase, so that no message is named twice."""
    chunk = np.repeat(np.arange(len(counts)), counts)
    return bool(np.all((offsets[1:] > offsets[:-1]) | (chunk[1:] > chunk[:-1])))


def _stored(data: Buffer, offsets: NDArray[np.int64], channel: int) -> Counts | None:
    """Return the entry counts of the message index records of one channel at ``offsets``.

    None if one of them is not such a record, or incomplete.
    """
    raw = np.frombuffer(data, np.uint8)
    if len(offsets) and not 0 <= int(offsets.min()) <= int(offsets.max()) <= len(raw) - INDEX_HEAD.itemsize:
        return None
    heads = _gathered(raw, offsets, INDEX_HEAD)
    counts, rest = np.divmod(heads["size"].astype(np.int64), ENTRY_TYPE.itemsize)
    whole = (heads["opcode"] == int(Opcode.MESSAGE_INDEX)) & (heads["channel"] == channel) & (rest == 0)
    whole &= heads["length"] == heads["size"] + INDEX_HEAD.itemsize - HEAD.size
    whole &= offsets + INDEX_HEAD.itemsize + counts * ENTRY_TYPE.itemsize <= len(raw)
    return counts if whole.all() else None


def _gathered(raw: NDArray[np.uint8], places: NDArray[np.int64], kind: np.dtype[Any]) -> NDArray[Any]:
    """Copy values of type ``kind`` from unaligned positions."""
    count = len(raw) - kind.itemsize + 1
    windows: Entries = np.ndarray((count,), np.dtype((np.void, kind.itemsize)), raw.data, strides=(1,))
    return windows[places].view(kind)
