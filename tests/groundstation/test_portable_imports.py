"""The commands of a wheel import without the modules that only POSIX systems have."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "termios", "tty", "pty", "pwd", "grp", "resource"):
            raise ModuleNotFoundError(name)

# Python and the libraries, as they are here
import types, multiprocessing.util, subprocess, asyncio, serial, textual.app, textual.drivers.linux_driver, numba
import pymavlink.mavutil
for name in ("fcntl", "termios", "tty", "pty", "pwd", "grp", "resource"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Missing())
sys.modules["msvcrt"] = types.SimpleNamespace(LK_NBLCK=2, locking=lambda handle, mode, count: None)
import logs
sys.platform, kept = "win32", sys.platform
import logs.file_lock
sys.platform = kept
import importlib
from groundstation.command.main import SUBCOMMANDS
for command in SUBCOMMANDS.values():
    importlib.import_module(command.module)
import wingbeat
for name in wingbeat.__all__:
    getattr(wingbeat, name)
import tempfile
with tempfile.TemporaryFile() as file:
    file.write(b"abc")
    logs.file_lock.lock(file)
    assert file.tell() == 3
    assert "fcntl" not in sys.modules
print("imported")
"""


def test_commands_import_without_posix_modules() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "imported", done.stderr[-3000:]
