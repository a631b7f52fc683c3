"""What of a campaign is done: a line for each flight, on the disk at once, so that it can go on later."""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from avionics.quantities import BadInput
from logs.campaigns.flown import Row

ENDING = ".flights"
"""how the journal of a table is called: its name and this"""


class Journal:
    """Rows of finished flights in a file of lines, ours alone while it is open; a context manager that closes it."""

    def __init__(self, path: Path, digest: str) -> None:
        """Open the journal of the campaign with that ``digest``, or begin one; a torn last line is cut off.

        Raises:
            BadInput: it is another campaign's, another command has it open, or it cannot be written.
        """
        self.path = path
        self.rows: dict[int, Row] = {}
        """of finished flights, by their number"""
        try:
            self._file: IO[str] = path.open("a+", encoding="utf-8")
        except OSError as error:
            raise BadInput(f"cannot write {path}: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise BadInput(f"{path}: another command is flying this campaign") from None
        try:
            self._read(digest)
        except BaseException:
            self._file.close()
            raise

    def add(self, row: Row) -> None:
        """Keep a flight."""
        self._write(row)
        self.rows[row["flight"]] = row

    def remove(self) -> None:
        """Take the journal away: its table is whole."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: Any) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, digest: str) -> None:
        self._file.seek(0)
        whole = self._file.read()
        if not whole.endswith("\n"):
            whole = whole[: whole.rfind("\n") + 1]
            self._file.truncate(len(whole.encode()))
        head, *lines = whole.splitlines() or [""]
        if not head:
            self._write({"campaign": digest})
        elif _parsed(self.path, head).get("campaign") != digest:
            raise BadInput(
                f"{self.path} is of another campaign, or of this one before its files changed: name another --out"
            )
        rows = [_parsed(self.path, line) for line in lines]
        self.rows = {row["flight"]: row for row in rows}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def _parsed(path: Path, line: str) -> Row:
    try:
        row: Row = json.loads(line)
        row.get("flight")
    except (ValueError, AttributeError):
        raise BadInput(f"{path} is damaged, or no journal of a campaign: name another --out") from None
    return row
