"""Atomic creation of new files; existing files are never overwritten."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from wingbeat.errors import InputError

HELD = ".held"
"""how the name of the mark ends by which a recording's name is held"""


def numbered(path: Path) -> Iterator[Path]:
    """``path``, then the same with ``-2``, ``-3`` and so on before its suffix."""
    yield path
    number = 2
    while True:
        yield path.with_name(f"{path.stem}-{number}{path.suffix}")
        number += 1


@contextlib.contextmanager
def locked_name(path: Path) -> Iterator[bool]:
    """Hold the name of a recording, for all files of it; False where another program does.

    A mark beside it, which is gone with the context, is made by who is first and locked as long as it is held: one
    whose program was killed holds nothing. On a file system without locks who made it has the name, and the mark of a
    killed program holds it until somebody deletes that file.

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
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
    """Refuse a name for a new file that could not be written, before the work for it; nothing is written here.

    Args:
        path: of the file.
        made: whether folders that are missing will be made.

    Raises:
        InputError: it exists, its folder is missing or is none, or cannot be written to.
    """
    if path.exists() or path.is_symlink():
        raise InputError(f"{path} exists: it is not overwritten")
    if reason := why_not(path.parent, made=made):
        raise InputError(f"cannot write {path}: {reason}")


def why_not(folder: Path, *, made: bool = False) -> str:
    """Why there can be no new file in ``folder``, in words; empty where there can. ``made``: as of `check_new`."""
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
    """An unbuffered temporary file beside ``path``; it is on the disk when the block ends, and gone if that raised.

    Whoever uses it moves it to its place inside the block's end: `claim` or ``os.replace``.

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
    """Have the disk hold what was written, readable like any other new file."""
    os.fsync(file.fileno())
    mask = os.umask(0)
    os.umask(mask)
    os.fchmod(file.fileno(), 0o666 & ~mask)


def claim(source: Path, path: Path) -> None:
    """Move ``source`` to ``path``, which must not exist; whoever looks finds all of it or nothing.

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
    """`claim` where a file cannot have two names, as on a memory card."""
    try:
        path.open("xb").close()
    except FileExistsError:
        raise InputError(f"{path} exists: it is not overwritten") from None
    # The name is now ours, with an empty file behind it that nobody else may take.
    try:
        source.replace(path)
    except OSError:
        path.unlink(missing_ok=True)
        raise
