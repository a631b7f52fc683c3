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
"""writes complete records to a container"""
Create = Callable[[Path], IO[bytes]]
"""creates a file without a buffer, or raises `InputError`"""


class Volumes:
    """Writer to the open file of a recording that may be split into several files.

    Records that every file needs are repeated in each of them. Every method that writes raises `OSError` if the disk
    fails.
    """

    def __init__(self, path: Path, limit: int, create: Create) -> None:
        """Create the first file.

        Args:
            path: of the first; the others are ``-2``, ``-3`` and so on.
            limit: bytes after which the file is finished and the next one is begun; 0 for one file of any size.
            create: creates the files.

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
        """Bytes of complete records in all files so far."""
        size: int = self._container.size
        return self._earlier + size

    def write(self, work: Work, everywhere: bool = False) -> None:
        """Write to the open file and, with ``everywhere``, to every later one."""
        if self._limit and self._container.size >= self._limit:
            self._next()
        if everywhere:
            self._everywhere.append(work)
        work(self._container)

    def finish(self) -> None:
        """Write the summary of the open file and close it."""
        self._container.finish()
        self._file.close()

    def give_up(self) -> None:
        """Close the open file after its last complete record."""
        with contextlib.suppress(OSError, ValueError):
            self._file.truncate(self._container.size)
        with contextlib.suppress(OSError, ValueError):
            self._file.close()

    def _next(self) -> None:
        """Begin the next file; if it cannot be created, the present one continues to grow."""
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
        """Create a file with the records that every file needs."""
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
