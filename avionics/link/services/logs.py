"""Log download by LOG_REQUEST_LIST, LOG_REQUEST_DATA and LOG_ERASE.

It serves ground stations that do not use MAVLink FTP.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from avionics.link.budget import BULK, Capacity
from avionics.link.dialect import mavlink
from avionics.link.ftp_files import FtpFileSystem, LogFile
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.statustext import refusal_text

PART = 90
"""bytes; data in one LOG_DATA"""
FRAME_BYTES = 130.0
"""bytes; size of one message on the wire, signed"""
PER_STEP = 16
"""messages; limit of all downloads in one step, so that the senders alternate"""
MOST_DOWNLOADS = 8
LISTING_AGE = 2.0
"""s; maximum age of the folder listing: with 1000 logs it takes 30 ms"""


@dataclass
class _Download:
    number: int
    file: LogFile
    offset: int
    end: int


@dataclass
class _Listing:
    files: tuple[LogFile, ...]
    next: int
    last: int


class LogService:
    """Service for LOG_* messages.

    Logs are numbered from 1 by their names, which begin with the date.
    """

    takes = frozenset({"LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"})

    def __init__(self, files: FtpFileSystem, capacities: Sequence[Capacity]) -> None:
        """Create the service; ``capacities`` return the bytes that each link accepts now."""
        self._files = files
        self._capacities = capacities
        self._listings: dict[Sender, _Listing] = {}
        self._downloads: dict[Sender, _Download] = {}
        self._listed: tuple[LogFile, ...] = ()
        self._read_at = -float("inf")

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process a request; entries and data follow in `step`."""
        kind = message.get_type()
        if kind == "LOG_ERASE":
            return list(refusal_text("logs are not erased over the link", sender))
        self._downloads.pop(sender, None)
        if kind == "LOG_REQUEST_END":
            return []
        if now - self._read_at > LISTING_AGE:
            self._listed, self._read_at = self._files.logs(), now
        if kind == "LOG_REQUEST_LIST":
            return self._list(message, sender)
        if kind == "LOG_REQUEST_DATA":
            return self._begin(message, sender)
        return []

    def _list(self, message: Any, sender: Sender) -> list[Output]:
        files = self._listed
        if not files:
            return [Reply(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0), sender)]
        if len(self._listings) < MOST_DOWNLOADS or sender in self._listings:
            self._listings[sender] = _Listing(files, max(message.start, 1), min(message.end, len(files)))
        return []

    def _begin(self, message: Any, sender: Sender) -> list[Output]:
        files = self._listed
        if not 1 <= message.id <= len(files):
            return list(refusal_text(f"there is no log {message.id}, only {len(files)}", sender))
        if len(self._downloads) >= MOST_DOWNLOADS:
            return list(refusal_text("too many downloads of logs", sender))
        file = files[message.id - 1]
        end = min(message.ofs + message.count, file.size)
        self._downloads[sender] = _Download(message.id, file, message.ofs, end)
        return []

    def step(self, now: float) -> list[Output]:
        """Send the next part of every transfer within the capacity of the links."""
        outputs: list[Output] = []
        for sender, listing in tuple(self._listings.items()):
            outputs += self._entries(sender, listing, self._capacity(sender, outputs))
        for sender, download in tuple(self._downloads.items()):
            outputs += self._parts(sender, download, self._capacity(sender, outputs))
        return outputs

    def _capacity(self, sender: Sender, outputs: Sequence[Output]) -> int:
        room = self._capacities[sender.link](BULK) / FRAME_BYTES
        return int(max(min(room, PER_STEP) - len(outputs), 0.0))

    def _entries(self, sender: Sender, listing: _Listing, most: int) -> list[Output]:
        stop, count = min(listing.next + most, listing.last + 1), len(listing.files)
        entries = [
            mavlink.MAVLink_log_entry_message(number, count, count, file.modified, file.size)
            for number, file in enumerate(listing.files[listing.next - 1 : stop - 1], start=listing.next)
        ]
        listing.next = stop
        if listing.next > listing.last:
            del self._listings[sender]
        return [Reply(entry, sender) for entry in entries]

    def _parts(self, sender: Sender, download: _Download, most: int) -> list[Output]:
        outputs: list[Output] = []
        while len(outputs) < most and sender in self._downloads:
            outputs.append(Reply(self._part(sender, download), sender))
        return outputs

    def _part(self, sender: Sender, download: _Download) -> Any:
        """Return a LOG_DATA; one shorter than `PART` ends the download.

        A read error also ends the download.
        """
        wanted = max(min(PART, download.end - download.offset), 0)
        try:
            data = download.file.read(download.offset, wanted) if wanted else b""
        except OSError:
            data = b""
        message = mavlink.MAVLink_log_data_message(
            download.number, download.offset, len(data), list(data.ljust(PART, b"\0"))
        )
        download.offset += len(data)
        if len(data) < PART or download.offset >= download.end:
            del self._downloads[sender]
        return message
