"""Files that are there whole or not at all: of text, at the edge (parameters, keys and their time stamps)."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path


def write_whole(path: Path, text: str, settle: bool = True) -> None:
    """Put a file of this ``text`` in the place of ``path``: the old one or the new one, never a part.

    `mkstemp` makes it its owner's alone. Where ``settle`` it outlives a power cut from here on, name and all, which
    waits for the disk.

    Raises:
        OSError: it cannot be written; the old file stays as it is.
    """
    descriptor, scratch = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            if settle:
                file.flush()
                os.fsync(file.fileno())
        Path(scratch).replace(path)
    except BaseException:
        Path(scratch).unlink(missing_ok=True)
        raise
    if settle:
        settle_names(path.parent)


def settle_names(folder: Path) -> None:
    """Let the names in ``folder`` outlive a power cut, where the system can.

    Raises:
        OSError: the disk does not take them.
    """
    if os.name != "posix":
        return
    with contextlib.suppress(FileNotFoundError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
