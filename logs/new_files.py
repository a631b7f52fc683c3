"""Atomic creation of new files; existing files are never overwritten."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from logs.file_lock import lock
from wingbeat.errors import InputError

HELD = ".held"
"""suffix of the lock file that reserves the name of a recording"""


def numbered(path: Path) -> Iterator[Path]:
    """Yield ``path``, then the same with ``-2``, ``-3`` and so on before its suffix."""
    yield path
    number = 2
    while True:
        yield path.with_name(f"{path.stem}-{number}{path.suffix}")
        number += 1


@contextlib.contextmanager
def locked_name(path: Path) -> Iterator[bool]:
    """Lock the name of a recording; yield False if another program has locked it.

    The first program creates a lock file beside the recording, locks it, and removes it at the end of the context.
    The lock of a killed program is released by the system. On a file system without locks the existence of the lock
    file counts, and the lock file of a killed program has to be deleted by the user.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    mark = path.with_name(f".{path.stem}{HELD}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file, made = _mark(mark)
    except OSError as error:
        raise InputError(f"cannot record to {path}: {why_not(path.parent, made=True) or error.strerror}") from None
    with file:
        ours = _locked(file, made) and _names(mark, file)
        try:
            yield ours
        finally:
            if ours:
                mark.unlink(missing_ok=True)


def _mark(mark: Path) -> tuple[IO[bytes], bool]:
    """The mark, and whether it was made just now."""
    try:
        return mark.open("xb"), True
    except FileExistsError:
        return mark.open("ab"), False


def _locked(file: IO[bytes], made: bool) -> bool:
    try:
        lock(file)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks: who made the mark has the name
        return made
    return True


def _names(mark: Path, file: IO[bytes]) -> bool:
    """Whether the mark still has its name, which another may have taken away before it was locked."""
    with contextlib.suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file.fileno()), mark.stat())
    return False


def check_new(path: Path, *, made: bool = False) -> None:
    """Check that a new file can be written, before the work for it; nothing is written.

    Args:
        path: of the file.
        made: whether missing folders will be created.

    Raises:
        InputError: it exists, its folder is missing or is none, or cannot be written to.
    """
    if path.exists() or path.is_symlink():
        raise InputError(f"{path} exists: it is not overwritten")
    if reason := why_not(path.parent, made=made):
        raise InputError(f"cannot write {path}: {reason}")


def why_not(folder: Path, *, made: bool = False) -> str:
    """Return why no file can be created in ``folder``; empty if it can. ``made`` as in `check_new`."""
    while made and not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.exists():
        return f"there is no folder {folder}"
    if not folder.is_dir():
        return f"{folder} is not a folder"
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return f"folder {folder.resolve()} cannot be written to ({error.strerror})"
    return ""


@contextlib.contextmanager
def draft(path: Path) -> Iterator[tuple[IO[bytes], Path]]:
    """Open an unbuffered temporary file beside ``path``.

    At the end of the block the file is flushed to the disk; after an exception it is deleted. The caller moves it to
    its final path at the end of the block with `claim` or ``os.replace``.

    Raises:
        InputError: the folder cannot be written to.
    """
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    try:
        with open(descriptor, "wb", buffering=0) as file:  # noqa: PTH123
            yield file, Path(name)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        Path(name).unlink(missing_ok=True)


def settle(file: IO[bytes]) -> None:
    """Flush the file to the disk and set the permissions of a new file."""
    os.fsync(file.fileno())
    mask = os.umask(0)
    os.umask(mask)
    os.fchmod(file.fileno(), 0o666 & ~mask)


def claim(source: Path, path: Path) -> None:
    """Move ``source`` to ``path`` atomically; ``path`` must not exist.

    Raises:
        InputError: ``path`` exists.
        OSError: the disk refuses.
    """
    try:
        os.link(source, path)
    except FileExistsError:
        raise InputError(f"{path} exists: it is not overwritten") from None
    except OSError:
        _claim_by_name(source, path)
    else:
        source.unlink()


def _claim_by_name(source: Path, path: Path) -> None:
    """Move like `claim` on a file system without hard links, such as that of a memory card."""
    try:
        path.open("xb").close()
    except FileExistsError:
        raise InputError(f"{path} exists: it is not overwritten") from None
    # The name is reserved now: an empty file exists, and no other program can take it.
    try:
        source.replace(path)
    except OSError:
        path.unlink(missing_ok=True)
        raise
