"""Files for MAVLink FTP: the parameters as one file, and the logs.

A path is looked up in the list of existing names and never joined to a folder, so that no path leads to other files.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from avionics.link.vehicle import Parameter, Storage, VehicleView
from wingbeat.errors import InputError

PARAMETERS = "@PARAM/param.pck"
LOGS = ("logs", "@MAV_LOG")
"""folder of logs, and its standard name in MAVLink"""
SUFFIX = ".mcap"
MAX_NAME = 220
"""bytes; limit of a name, because a longer line of a listing does not fit a message"""
LARGEST = 2**32 - 1
"""bytes; limit of a file, because the offsets of FTP have 32 bits"""
_MAGIC, _MAGIC_DEFAULTS = 0x671B, 0x671C
_FLOAT = 4
_HAS_DEFAULT = 1 << 4
_LONGEST_COMMON = 15


class Content(Protocol):
    """Readable content."""

    @property
    def size(self) -> int:
        """Size in bytes."""

    def read(self, offset: int, size: int) -> bytes:
        """Read at most ``size`` bytes, none beyond the end.

        Raises:
            OSError: the content cannot be read.
        """


class Memory(NamedTuple):
    """Content of a file when it was opened."""

    data: bytes

    @property
    def size(self) -> int:
        """Size in bytes."""
        return len(self.data)

    def read(self, offset: int, size: int) -> bytes:
        """Read a part of the content."""
        return self.data[offset : offset + size]


class LogFile(NamedTuple):
    """Log file on disk, which may still grow; it is opened for each read only."""

    path: Path
    size: int
    """size in bytes"""
    modified: int
    """s; modification time since 1970"""

    def read(self, offset: int, size: int) -> bytes:
        """Read a part of the file.

        Raises:
            OSError: the file cannot be read, or its name has become a link.
        """
        descriptor = os.open(self.path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
        try:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.read(descriptor, size)
        finally:
            os.close(descriptor)


class FtpFileSystem:
    """File system of a vehicle."""

    def __init__(
        self,
        vehicle: VehicleView,
        storage: Storage | None = None,
        logs: Path | None = None,
        metadata: Mapping[str, bytes] | None = None,
    ) -> None:
        """Create the file system.

        ``storage`` has the default parameters, ``logs`` is a folder, ``metadata`` maps paths to files.
        """
        self._metadata = metadata or {}
        self._vehicle = vehicle
        self._storage = storage
        self._logs = logs

    def entries(self, path: str) -> list[str] | None:
        """Return the entries of a folder in FTP format; None for an unknown folder.

        The formats are ``F`` name tab size, and ``D`` name.
        """
        place = path.strip("/")
        if place == "":
            return [f"D{LOGS[0]}"]
        if place not in LOGS:
            return None
        return [f"F{name}\t{file.size}" for name, file in sorted(self._log_files().items())]

    def open(self, path: str) -> Content | None:
        """Return the file of a path, or None."""
        place, _, query = path.lstrip("/").partition("?")
        if place == PARAMETERS:
            return Memory(self._parameters(with_defaults="withdefaults=1" in query.split("&")))
        if place in self._metadata:
            return Memory(self._metadata[place])
        folder, _, name = place.rpartition("/")
        return self._log_files().get(name) if folder in LOGS else None

    def logs(self) -> tuple[LogFile, ...]:
        """Return the logs in order of their names."""
        return tuple(file for _, file in sorted(self._log_files().items()))

    def _log_files(self) -> dict[str, LogFile]:
        if self._logs is None:
            return {}
        try:
            with os.scandir(self._logs) as found:
                return {
                    name: LogFile(
                        Path(entry.path),
                        min(entry.stat().st_size, LARGEST),
                        min(max(int(entry.stat().st_mtime), 0), LARGEST),
                    )
                    for entry in found
                    if entry.name.endswith(SUFFIX) and entry.is_file(follow_symlinks=False)
                    if len((name := listed_name(entry.name)).encode()) <= MAX_NAME
                }
        except OSError:
            return {}

    def _parameters(self, with_defaults: bool) -> bytes:
        defaults: Mapping[str, float] | None = None
        if with_defaults and self._storage is not None:
            try:
                defaults = self._storage.defaults()
            except InputError:
                defaults = None
        return pack_parameters(self._vehicle.parameters, defaults)


def listed_name(name: str) -> str:
    """Return the name of a file for listing and opening.

    Characters that are not printable, or not UTF-8 on the disk, are escaped.
    """
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in name)


def pack_parameters(parameters: Sequence[Parameter], defaults: Mapping[str, float] | None = None) -> bytes:
    """Return the packed parameter list of ArduPilot.

    Names are stored without the prefix shared with the previous one, and values as floats. If ``defaults`` are given,
    a value that differs from its default is followed by the default.
    """
    parts = [struct.pack("<HHH", _MAGIC if defaults is None else _MAGIC_DEFAULTS, len(parameters), len(parameters))]
    before = b""
    for parameter in parameters:
        name = parameter.name.encode("ascii", errors="replace")
        usual = None if defaults is None else defaults.get(parameter.name)
        changed = usual is not None and usual != parameter.value
        common = _common(before, name)
        kind = _FLOAT | (_HAS_DEFAULT if changed else 0)
        parts.append(bytes([kind, common | (len(name) - common - 1) << 4]) + name[common:])
        parts.append(struct.pack("<f", parameter.value) + (struct.pack("<f", usual) if changed else b""))
        before = name
    return b"".join(parts)


def _common(before: bytes, name: bytes) -> int:
    most = min(len(before), len(name) - 1, _LONGEST_COMMON)
    return next((place for place in range(most) if before[place] != name[place]), most)
