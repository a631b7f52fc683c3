"""Atomic replacement of text files: parameters, keys, settings."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path


def write_atomically(path: Path, text: str, sync: bool = True) -> None:
    """Replace the file at ``path`` by one with this ``text``; after a crash it is the old one or the new one.

    Only the owner can read it, as for `mkstemp`. With ``sync`` the call returns after file and name are on the disk.

    Raises:
        OSError: the file cannot be written; the old one is unchanged.
    """
    descriptor, scratch = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        Path(scratch).replace(path)
    except BaseException:
        Path(scratch).unlink(missing_ok=True)
        raise
    if sync:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Write the names in ``folder`` to the disk, if the system supports it.

    Raises:
        OSError: the disk rejects them.
    """
    if os.name != "posix":
        return
    with contextlib.suppress(FileNotFoundError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
