"""What can be read over MAVLink FTP: the parameters as one file, and the logs.

A path is looked up among the names that there are, never put together with one, so that no path leads anywhere else.
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
"""The folder of logs, and MAVLink's own name for it."""
SUFFIX = ".mcap"
MAX_NAME = 220
"""bytes; a listing's line with a longer name does not fit a message"""
LARGEST = 2**32 - 1
"""bytes; FTP's offsets have 32 bits"""
_MAGIC, _MAGIC_DEFAULTS = 0x671B, 0x671C
_FLOAT = 4
_HAS_DEFAULT = 1 << 4
_LONGEST_COMMON = 15


class Content(Protocol):
    """Something that can be read."""

    @property
    def size(self) -> int:
        """bytes"""

    def read(self, offset: int, size: int) -> bytes:
        """At most ``size`` bytes, none behind the end; raises `OSError`."""


class Memory(NamedTuple):
    """Bytes as they were when the file was opened."""

    data: bytes

    @property
    def size(self) -> int:
        """bytes"""
        return len(self.data)

    def read(self, offset: int, size: int) -> bytes:
        """A part of them."""
        return self.data[offset : offset + size]


class LogFile(NamedTuple):
    """A log on disk, which may still be growing; opened for each part, so that nothing is left open."""

    path: Path
    size: int
    """bytes"""
    modified: int
    """s; since 1970, when it was last written"""

    def read(self, offset: int, size: int) -> bytes:
        """A part of it; raises `OSError`, also where the name has become a link."""
        descriptor = os.open(self.path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
        try:
            os.lseek(descriptor, offset, os.SEEK_SET)
            return os.read(descriptor, size)
        finally:
            os.close(descriptor)


class FtpFileSystem:
    """The files of a vehicle."""

    def __init__(
        self,
        vehicle: VehicleView,
        storage: Storage | None = None,
        logs: Path | None = None,
        metadata: Mapping[str, bytes] | None = None,
    ) -> None:
        """``storage`` has the default parameters, ``logs`` is a folder, ``metadata`` maps paths to files."""
        self._metadata = metadata or {}
        self._vehicle = vehicle
        self._storage = storage
        self._logs = logs

    def entries(self, path: str) -> list[str] | None:
        """A folder's entries as FTP writes them, ``F`` name tab size or ``D`` name; None for no folder of ours."""
        place = path.strip("/")
        if place == "":
            return [f"D{LOGS[0]}"]
        if place not in LOGS:
            return None
        return [f"F{name}\t{file.size}" for name, file in sorted(self._log_files().items())]

    def open(self, path: str) -> Content | None:
        """The file of this path, or None."""
        place, _, query = path.lstrip("/").partition("?")
        if place == PARAMETERS:
            return Memory(self._parameters(with_defaults="withdefaults=1" in query.split("&")))
        if place in self._metadata:
            return Memory(self._metadata[place])
        folder, _, name = place.rpartition("/")
        return self._log_files().get(name) if folder in LOGS else None

    def logs(self) -> tuple[LogFile, ...]:
        """The logs in the order of their names."""
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
    """A file's name as it is listed and opened: what is not printable, or not UTF-8 on the disk, is escaped."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in name)


def pack_parameters(parameters: Sequence[Parameter], defaults: Mapping[str, float] | None = None) -> bytes:
    """ArduPilot's packed list: names without what they share with the one before, values as floats.

    Where ``defaults`` are given, a value that differs from its own has it behind.
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
