"""Journal of finished flights for resuming a campaign."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple, Self

from logs.campaigns.single_flight import Row, is_row
from logs.file_lock import lock
from wingbeat.documents import parse_json
from wingbeat.errors import DocumentError, InputError

ENDING = ".flights"
"""suffix of the journal of a table"""


class Journal:
    """Journal of finished flights, locked while it is open; a context manager that closes it."""

    def __init__(self, path: Path, digest: str, file: Path | None = None) -> None:
        """Open the journal of the campaign with that ``digest``, or create it; a torn last line is removed.

        ``file`` is the campaign's file, recorded for reports on an unfinished campaign. A journal of another campaign
        without flights is replaced.

        Raises:
            InputError: it belongs to another campaign, is in use by another command, or cannot be written.
        """
        self.path = path
        self.rows: dict[int, Row] = {}
        """finished flights by number"""
        try:
            self._file: IO[str] = path.open("a+", encoding="utf-8")
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}") from None
        try:
            lock(self._file)
        except OSError:
            self._file.close()
            raise InputError(f"{path}: in use by another command of this campaign") from None
        try:
            self._read(digest, file)
        except BaseException:
            self._file.close()
            raise

    def add(self, row: Row) -> None:
        """Append a flight."""
        self._write(row)
        self.rows[row["flight"]] = row

    def remove(self) -> None:
        """Delete the journal, after its table was written."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: Any) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, digest: str, file: Path | None) -> None:
        self._file.seek(0)
        try:
            whole = self._file.read()
        except UnicodeDecodeError:
            raise _damaged(self.path, "not UTF-8 text") from None
        if not whole.endswith("\n"):
            whole = _ended(whole)
            self._file.truncate(len(whole.encode()))
        head, *lines = whole.splitlines() or [""]
        begun = _head(self.path, head)["campaign"] if head else None
        if begun != digest:
            if lines:
                raise InputError(
                    f"{self.path} belongs to another campaign, or to this one before its files changed:"
                    " choose another --out"
                )
            self._file.truncate(0)
            self._write({"campaign": digest} | ({} if file is None else {"file": str(file)}))
        self.rows = _rows(self.path, lines)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


class JournalHeader(NamedTuple):
    """Content of a journal."""

    digest: str
    file: str
    """of the campaign, as given; empty if the journal does not contain it"""
    rows: dict[int, Row]
    """finished flights by number"""


def read_journal(path: Path) -> JournalHeader:
    """Read a journal without changing it, also while it is being written.

    Raises:
        InputError: it cannot be read, or is not a journal.
    """
    try:
        lines = _ended(path.read_text(encoding="utf-8")).splitlines()
    except UnicodeDecodeError:
        raise _damaged(path, "not UTF-8 text") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    head = _head(path, lines[0]) if lines else {"campaign": ""}
    return JournalHeader(head["campaign"], head.get("file", ""), _rows(path, lines[1:]))


def _ended(text: str) -> str:
    """Whole lines: a torn last one is left out."""
    return text[: text.rfind("\n") + 1]


def _head(path: Path, line: str) -> dict[str, str]:
    """The first line of a journal: ``campaign``, the digest, and ``file``."""
    head = _parsed(path, 1, line)
    if not isinstance(head, dict) or "campaign" not in head or not all(isinstance(v, str) for v in head.values()):
        raise _damaged(path, "line 1 is not a journal's first line")
    return head


def _rows(path: Path, lines: Sequence[str]) -> dict[int, Row]:
    """The finished flights by their number."""
    rows: dict[int, Row] = {}
    for number, line in enumerate(lines, 2):
        row = _parsed(path, number, line)
        if not is_row(row):
            raise _damaged(path, f"line {number} is not a flight's row")
        rows[row["flight"]] = row
    return rows


def _parsed(path: Path, number: int, line: str) -> Any:
    try:
        return parse_json(line)
    except DocumentError as error:
        raise _damaged(path, f"line {number} is {error}") from None


def _damaged(path: Path, reason: str) -> InputError:
    return InputError(f"{path} is damaged, or not a campaign's journal ({reason}): choose another --out")
