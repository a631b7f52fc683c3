"""File of the signing key, and file of the used timestamps.

The key file has one line: 64 hexadecimal digits, or ``passphrase`` and a text, whose SHA-256 is the key as in
MAVProxy and QGroundControl. Only its owner may have read access. Neither file is logged.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

from avionics.link.signing import KEY_BYTES, Signing, Stamps
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.files import sync_folder, write_atomically

_PASSPHRASE = "passphrase "
_OTHERS = 0o077


class KeyFile:
    """Key file; implements `avionics.link.signing.KeyStore`."""

    def __init__(self, path: Path) -> None:
        """Store the path; no file is read or written."""
        self.path = path
        self._stamps = path.with_name(path.name + ".stamps")

    def load_key(self) -> bytes | None:
        """Return the key; None without a file.

        Raises:
            InputError: the file cannot be read, is not a key, or others may read it.
        """
        try:
            text = self.path.read_text(encoding="utf-8-sig").strip()
            others = os.name == "posix" and self.path.stat().st_mode & _OTHERS
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"signing key {self.path}: cannot be read ({type(error).__name__})") from None
        if others:
            raise InputError(f"signing key {self.path} can be read by others: chmod 600 {self.path}")
        return self._key(text)

    def _key(self, text: str) -> bytes:
        if text.startswith(_PASSPHRASE) and len(text) > len(_PASSPHRASE):
            return hashlib.sha256(text.removeprefix(_PASSPHRASE).encode()).digest()
        with contextlib.suppress(ValueError):
            if len(key := bytes.fromhex(text)) == KEY_BYTES:
                return key
        raise InputError(f"signing key {self.path}: not {2 * KEY_BYTES} hexadecimal digits, and no passphrase")

    def load_stamps(self) -> Stamps:
        """Return the timestamps stored with the key; none without a file.

        Raises:
            InputError: the file is damaged; without it old frames could be replayed.
        """
        try:
            document = parse_json(self._stamps.read_text(encoding="utf-8-sig"))
            streams = {(int(a), int(b), int(c)): int(stamp) for a, b, c, stamp in document["streams"]}
            return Stamps(int(document["ours"]), streams, int(document.get("clock", 0)))
        except FileNotFoundError:
            return Stamps()
        except (OSError, ValueError, TypeError, KeyError, OverflowError):
            raise InputError(
                f"time stamps of the signing key, {self._stamps}, are damaged: remove the file"
            ) from None

    def save_key(self, key: bytes | None) -> None:
        """Write the key with access for its owner only, or remove it."""
        if key is None:
            self.path.unlink(missing_ok=True)
            sync_folder(self.path.parent)
        else:
            _write(self.path, key.hex() + "\n", settle=True)

    def save_stamps(self, stamps: Stamps, settle: bool = False) -> None:
        """Write the timestamps.

        ``settle`` waits for the disk, which takes several ticks and is not for use in flight.
        """
        streams = [[*stream, stamp] for stream, stamp in stamps.streams.items()]
        document = {"ours": stamps.local, "streams": streams, "clock": stamps.clock}
        _write(self._stamps, json.dumps(document) + "\n", settle)


def load_signing(file: KeyFile | None, unix_time: Callable[[], float] = time.time) -> Signing:
    """Return the signing state of the link: key of the file and unique timestamps.

    Raises:
        InputError: the file or its timestamps cannot be used.
    """
    if file is None:
        return Signing(unix_time)
    return Signing(unix_time, file.load_key(), file.load_stamps(), file)


def _write(path: Path, text: str, settle: bool) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_atomically(path, text, settle)
