"""Files of one recording, limited in size."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import IO

from logs.container import Container
from logs.new_files import numbered
from wingbeat.errors import InputError

Work = Callable[[Container], None]
"""writes whole records to a container"""
Create = Callable[[Path], IO[bytes]]
"""makes a new file without a buffer, or raises `InputError`"""


class Volumes:
    """Writes to the file that is open; what every file of the recording needs is written to each of them.

    Every method that writes raises `OSError` when the disk refuses.
    """

    def __init__(self, path: Path, limit: int, create: Create) -> None:
        """Create the first file.

        Args:
            path: of the first; the others are ``-2``, ``-3`` and so on.
            limit: bytes after which a file is finished and the next begun; 0 for one file of any size.
            create: makes the files.

        Raises:
            InputError: the file exists or cannot be created.
        """
        self.paths: list[Path] = []
        """of the files so far, in turn"""
        self._first, self._limit, self._create = path, limit, create
        self._everywhere: list[Work] = []
        self._earlier = 0
        self._file, self._container = self._opened(path)

    @property
    def written(self) -> int:
        """Bytes of whole records in all files so far."""
        size: int = self._container.size
        return self._earlier + size

    def write(self, work: Work, everywhere: bool = False) -> None:
        """Write to the file that is open; ``everywhere``: to every later one too."""
        if self._limit and self._container.size >= self._limit:
            self._next()
        if everywhere:
            self._everywhere.append(work)
        work(self._container)

    def finish(self) -> None:
        """Write the summary of the file that is open, and close it."""
        self._container.finish()
        self._file.close()

    def give_up(self) -> None:
        """Close the file that is open behind its last whole record."""
        with contextlib.suppress(OSError, ValueError):
            self._file.truncate(self._container.size)
        with contextlib.suppress(OSError, ValueError):
            self._file.close()

    def _next(self) -> None:
        """The next file; where there can be none, the present one grows on rather than lose the rest."""
        places = (place for place in numbered(self._first) if not place.exists())
        try:
            file, container = self._opened(next(places))
        except (InputError, OSError):
            self._limit = 0
            return
        self._earlier += self._container.size
        self.finish()
        self._file, self._container = file, container

    def _opened(self, path: Path) -> tuple[IO[bytes], Container]:
        """A new file with what every file has."""
        file = self._create(path)
        try:
            container = Container(file)
            for work in self._everywhere:
                work(container)
        except BaseException:
            file.close()
            path.unlink(missing_ok=True)
            raise
        self.paths.append(path)
        return file, container
