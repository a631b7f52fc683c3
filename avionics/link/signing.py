"""MAVLink 2's message signing: who holds the key may speak, and what was said once cannot be said again.

A signature is the first 48 bits of the SHA-256 of key, frame, link number and time stamp. Time stamps count 10
microseconds since 2015 and rise with every frame of a sender on a link; they outlive a restart through a `KeyStore`,
which is told a little more than was used (`RESERVE`), so that it need not be told every time. pymavlink's own code
remembers the time stamp of a frame before it has checked its signature, whereby a stranger can silence a station.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from typing import NamedTuple, Protocol

from avionics.link.framing import MARKER_V2, SIGNED, Frame

KEY_BYTES = 32
SIGNATURE_BYTES = 13
TICKS_PER_SECOND = 100_000
"""of a time stamp"""
EPOCH = 1_420_070_400.0
"""s; Unix time of the first of January 2015"""
LATEST = 1 << 47
"""no time stamp lies behind the year 2059: one that does would leave none to follow it"""
FRESH = 60 * TICKS_PER_SECOND
"""ticks; a sender that was never heard may be so far behind us"""
AHEAD = 86_400 * TICKS_PER_SECOND
"""ticks; a key may come with a first time stamp so far ahead of our clock, where we have one"""
RESERVE = 2 * TICKS_PER_SECOND
"""ticks; after a crash a station may be refused for so long, and nothing it said before can be repeated"""

Stream = tuple[int, int, int]
"""system, component and link number of a sender"""


class Stamps(NamedTuple):
    """The time stamps that were used, our own and each sender's last."""

    ours: int = 0
    streams: Mapping[Stream, int] = {}


class KeyStore(Protocol):
    """Where key and time stamps outlive a restart."""

    def save_key(self, key: bytes | None) -> None:
        """Keep another key, or none; raises `OSError`."""

    def save_stamps(self, stamps: Stamps, settle: bool = False) -> None:
        """Keep the time stamps, where ``settle`` on the disk before this ends; raises `OSError`."""


class Finding(Enum):
    """What is to be said about a frame's signature."""

    SIGNED = "signed"
    UNSIGNED = "unsigned"
    FORGED = "wrong signature"
    REPLAYED = "replayed"


def signature_of(frame: Frame) -> bytes:
    """Link number, time stamp and signature; empty for an unsigned frame."""
    signed = frame.raw[0] == MARKER_V2 and frame.raw[2] & SIGNED
    return frame.raw[-SIGNATURE_BYTES:] if signed else b""


def digest(key: bytes, data: bytes) -> bytes:
    """The 48 bits that sign ``data``: a frame up to its time stamp, this included."""
    return hashlib.sha256(key + data).digest()[:6]


class Signing:
    """The vehicle's key and all time stamps; without a key every frame counts as it is."""

    def __init__(
        self,
        unix_time: Callable[[], float],
        key: bytes | None = None,
        stamps: Stamps = Stamps(),  # noqa: B008 (immutable)
        store: KeyStore | None = None,
    ) -> None:
        self._unix_time = unix_time
        self._key = key
        self._last = stamps.ours
        self._streams = dict(stamps.streams)
        self._store = store
        self._reserved = Stamps(self._last, dict(self._streams))
        self.refused: Counter[Finding] = Counter()
        """frames that were not let in, on all links"""
        self.failure = ""
        """why time stamps are not kept, empty while they are"""

    def __repr__(self) -> str:
        return f"Signing({'on' if self.active else 'off'})"

    @property
    def active(self) -> bool:
        """Whether a key is set."""
        return self._key is not None

    @property
    def kept(self) -> bool:
        """Whether key and time stamps outlive a restart."""
        return self._store is not None

    def set_key(self, key: bytes | None, initial_stamp: int = 0) -> None:
        """Take another key, or None to sign no more; the time stamps go on.

        Raises:
            OSError: it cannot be kept; the old one stays.
        """
        if self._store is not None:
            self._store.save_key(key)
        self._key = key
        self._last = max(self._last, initial_stamp)
        self._reserve()

    def too_far_ahead(self, stamp: int) -> bool:
        """Whether a first time stamp would shut out every station whose clock is right."""
        now = self._now()
        return stamp >= LATEST or (now > 0 and stamp > now + AHEAD)

    def sign(self, frame: bytes, link: int) -> bytes:
        """What follows a frame that carries the signed flag: 13 bytes.

        Raises:
            RuntimeError: there is no key.
        """
        if self._key is None:
            raise RuntimeError("a frame is to be signed, and there is no key")
        tail = bytes([link & 0xFF]) + self._next_stamp().to_bytes(6, "little")
        return tail + digest(self._key, frame + tail)

    def _next_stamp(self) -> int:
        self._last = max(self._last + 1, self._now())
        if self._last > self._reserved.ours:
            self._reserve()
        return self._last

    def _now(self) -> int:
        return min(max(int((self._unix_time() - EPOCH) * TICKS_PER_SECOND), 0), LATEST)

    def examine(self, frame: Frame) -> Finding:
        """Whether the frame is the key holder's and new; only such a one moves the time stamps."""
        signature = signature_of(frame)
        if self._key is None or not signature:
            return Finding.UNSIGNED
        if not hmac.compare_digest(digest(self._key, frame.raw[:-6]), signature[7:]):
            return Finding.FORGED
        stamp = int.from_bytes(signature[1:7], "little")
        stream = (frame.system, frame.component, signature[0])
        if stamp > LATEST or stamp <= self._oldest(stream):
            return Finding.REPLAYED
        self._streams[stream] = stamp
        self._last = max(self._last, stamp)
        if stamp > self._reserved.streams.get(stream, -1) or self._last > self._reserved.ours:
            self._reserve()
        return Finding.SIGNED

    def _oldest(self, stream: Stream) -> int:
        """The time stamp that a frame of this sender must exceed."""
        known = self._streams.get(stream)
        return max(self._last, self._now()) - FRESH - 1 if known is None else known

    def _reserve(self) -> None:
        """Keep more than was used; who is so far behind that he counts as stale anyway is forgotten."""
        stale = max(self._last, self._now()) - FRESH
        self._streams = {stream: stamp for stream, stamp in self._streams.items() if stamp >= stale}
        ahead = {stream: stamp + RESERVE for stream, stamp in self._streams.items()}
        self._reserved = Stamps(max(self._last, self._now()) + RESERVE, ahead)
        self._keep(self._reserved)

    def _keep(self, stamps: Stamps, settle: bool = False) -> None:
        if self._store is None or not self.active:
            return
        try:
            self._store.save_stamps(stamps, settle)
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        """Keep exactly what was used."""
        self._keep(Stamps(self._last, self._streams), settle=True)
