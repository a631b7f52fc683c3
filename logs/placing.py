"""New files that appear whole or not at all, and never in the place of another."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from avionics.quantities import BadInput


def numbered(path: Path) -> Iterator[Path]:
    """``path``, then the same with ``-2``, ``-3`` and so on before its suffix."""
    yield path
    number = 2
    while True:
        yield path.with_name(f"{path.stem}-{number}{path.suffix}")
        number += 1


def check_new(path: Path, *, made: bool = False) -> None:
    """Refuse a name for a new file that could not be written, before the work for it; nothing is written here.

    Args:
        path: of the file.
        made: whether folders that are missing will be made.

    Raises:
        BadInput: it exists, its folder is missing or is none, or cannot be written to.
    """
    if path.exists() or path.is_symlink():
        raise BadInput(f"{path} exists: it is not overwritten")
    folder = path.parent
    while made and not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.exists():
        raise BadInput(f"cannot write {path}: there is no folder {folder}")
    if not folder.is_dir():
        raise BadInput(f"cannot write {path}: {folder} is no folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BadInput(f"cannot write {path}: folder {folder.resolve()} cannot be written to")


@contextlib.contextmanager
def draft(path: Path) -> Iterator[tuple[IO[bytes], Path]]:
    """An unbuffered temporary file beside ``path``; it is on the disk when the block ends, and gone if that raised.

    Whoever uses it moves it to its place inside the block's end: `claim` or ``os.replace``.

    Raises:
        BadInput: the folder cannot be written to.
    """
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from None
    try:
        with open(descriptor, "wb", buffering=0) as file:  # noqa: PTH123
            yield file, Path(name)
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from None
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
        BadInput: ``path`` exists.
        OSError: the disk refuses.
    """
    try:
        os.link(source, path)
    except FileExistsError:
        raise BadInput(f"{path} exists: it is not overwritten") from None
    except OSError:
        _claim_by_name(source, path)
    else:
        source.unlink()


def _claim_by_name(source: Path, path: Path) -> None:
    """`claim` where a file cannot have two names, as on a memory card."""
    try:
        path.open("xb").close()
    except FileExistsError:
        raise BadInput(f"{path} exists: it is not overwritten") from None
    # The name is now ours, with an empty file behind it that nobody else may take.
    try:
        source.replace(path)
    except OSError:
        path.unlink(missing_ok=True)
        raise
