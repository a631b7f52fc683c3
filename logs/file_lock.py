"""Advisory locks on open files, released when the file is closed or its process ends."""

from __future__ import annotations

import os
import sys
from typing import IO, Any

if sys.platform == "win32":
    import msvcrt

    PLACE = 1 << 40
    """byte that is locked: locks of Windows are mandatory, so it lies beyond the data of any file"""

    def lock(file: IO[Any], shared: bool = False) -> None:
        """Lock an open file without waiting. A shared lock is exclusive here: there is no other.

        Raises:
            BlockingIOError: another program has the lock.
        """
        handle = file.fileno()
        position = os.lseek(handle, 0, os.SEEK_CUR)
        try:
            os.lseek(handle, PLACE, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(error.errno, error.strerror) from None
        finally:
            os.lseek(handle, position, os.SEEK_SET)

else:
    import fcntl

    def lock(file: IO[Any], shared: bool = False) -> None:
        """Lock an open file without waiting, exclusively or ``shared`` with other readers.

        Raises:
            BlockingIOError: another program has the lock.
            OSError: the file system has no locks.
        """
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
