"""MAVLink 2 message signing, with protection against replay.

A signature is the first 48 bits of the SHA-256 of key, frame, link number and timestamp. Timestamps count 10
microseconds since 2015 and increase with every frame of a sender on a link. They are stored in a `KeyStore` with a
reserve (`RESERVE`), so that not every one is written. The code of pymavlink stores the timestamp of a frame before it
has checked the signature, which lets a third party block a station.

The acceptance of timestamps follows https://mavlink.io/en/guide/message_signing.html. However, each stream is
compared with its own last timestamp or, if it is new, with the clock of the vehicle, never with the timestamps of
another stream: a station with its clock ahead cannot block the others.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from typing import NamedTuple, Protocol

from avionics.link.framing import MARKER_V2, SIGNED, Frame

KEY_BYTES = 32
SIGNATURE_BYTES = 13
TICKS_PER_SECOND = 100_000
"""timestamp ticks per second"""
EPOCH = 1_420_070_400.0
"""s; Unix time of the first of January 2015"""
LATEST = 1 << 47
"""limit of a timestamp, in the year 2059: one beyond it would leave none to follow"""
FRESH = 60 * TICKS_PER_SECOND
"""ticks; maximum difference between the first timestamp of a stream and the vehicle's clock, in either direction"""
MAX_STREAMS = 64
"""-; streams with a stored last timestamp; the one with the oldest timestamp is discarded first"""
LAST_ACCEPTED = LATEST - 365 * 86_400 * TICKS_PER_SECOND
"""ticks; maximum accepted timestamp, which leaves a year of timestamps after it"""
AHEAD = 86_400 * TICKS_PER_SECOND
"""ticks; maximum first timestamp of a new key ahead of the vehicle's clock, if it is set"""
RESERVE = 2 * TICKS_PER_SECOND
"""ticks; reserve of stored timestamps: after a crash a station may be rejected for this long, and no earlier frame
can be replayed"""

Stream = tuple[int, int, int]
"""system, component and link number of a sender"""


class Stamps(NamedTuple):
    """Used timestamps: own, and the last of each sender."""

    local: int = 0
    streams: Mapping[Stream, int] = {}
    clock: int = 0
    """ticks; latest plausible time of the vehicle's clock"""


class KeyStore(Protocol):
    """Persistent storage of key and timestamps."""

    def save_key(self, key: bytes | None) -> None:
        """Store a key, or none.

        Raises:
            OSError: the key cannot be stored.
        """

    def save_stamps(self, stamps: Stamps, settle: bool = False) -> None:
        """Store the timestamps; ``settle`` waits for the disk.

        Raises:
            OSError: the timestamps cannot be stored.
        """


class Finding(Enum):
    """Result of the signature check of a frame."""

    SIGNED = "signed"
    UNSIGNED = "unsigned"
    FORGED = "wrong signature"
    REPLAYED = "replayed"
    AHEAD = "time stamp ahead of the clock"


def signature_of(frame: Frame) -> bytes:
    """Return link number, timestamp and signature; empty for an unsigned frame."""
    signed = frame.raw[0] == MARKER_V2 and frame.raw[2] & SIGNED
    return frame.raw[-SIGNATURE_BYTES:] if signed else b""


def digest(key: bytes, data: bytes) -> bytes:
    """Return the 48-bit signature of ``data``.

    The data is a frame up to and including its timestamp.
    """
    return hashlib.sha256(key + data).digest()[:6]


class Signing:
    """Key of the vehicle and all timestamps; without a key every frame is accepted."""

    def __init__(
        self,
        unix_time: Callable[[], float],
        key: bytes | None = None,
        stamps: Stamps = Stamps(),  # noqa: B008 (immutable)
        store: KeyStore | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._unix_time = unix_time
        self._monotonic = monotonic
        self._key = key
        self._last = stamps.local
        self._streams = dict(stamps.streams)
        self._clock_kept = stamps.clock
        self._anchor = (self._clock() if self._is_set() else stamps.local, monotonic())
        """ticks, s; timestamp and monotonic clock at the start, or when a new key set the time. It continues if the
        system clock is set meanwhile"""
        self._awaits_first = True
        self._store = store
        self._reserved = stamps._replace(streams=dict(self._streams))
        self.refused: Counter[Finding] = Counter()
        """rejected frames on all links"""
        self.failure = ""
        """reason why time stamps are not stored; empty if they are"""

    def __repr__(self) -> str:
        return f"Signing({'on' if self.active else 'off'})"

    @property
    def active(self) -> bool:
        """True if a key is set."""
        return self._key is not None

    @property
    def kept(self) -> bool:
        """True if key and timestamps are stored persistently."""
        return self._store is not None

    def set_key(self, key: bytes | None, initial_stamp: int = 0) -> None:
        """Set a key, or None to disable signing; the timestamps continue.

        Raises:
            OSError: the key cannot be stored; the old one is kept.
        """
        if self._store is not None:
            self._store.save_key(key)
        self._key = key
        self._last = max(self._last, initial_stamp)
        if initial_stamp > self._now():
            self._anchor = (initial_stamp, self._monotonic())
        self._awaits_first = True
        self._reserve()

    def too_far_ahead(self, stamp: int) -> bool:
        """Return whether a first timestamp would block every station with a correct clock."""
        now = self._clock()
        return stamp >= LATEST or (now > 0 and stamp > now + AHEAD)

    def sign(self, frame: bytes, link: int) -> bytes:
        """Return the 13 bytes that follow a frame with the signed flag.

        Raises:
            RuntimeError: there is no key.
        """
        if self._key is None:
            raise RuntimeError("a frame is to be signed, and there is no key")
        tail = bytes([link & 0xFF]) + self._next_stamp().to_bytes(6, "little")
        return tail + digest(self._key, frame + tail)

    def _next_stamp(self) -> int:
        self._last = max(self._last + 1, self._now())
        if self._last > self._reserved.local:
            self._reserve()
        return self._last

    def _now(self) -> int:
        """Return the later of the vehicle's clock and the clock started at the anchor."""
        anchored = self._anchor[0] + int((self._monotonic() - self._anchor[1]) * TICKS_PER_SECOND)
        return min(max(self._clock(), anchored, 0), LATEST)

    def _clock(self) -> int:
        """Return the time of the vehicle's clock, negative before 2015."""
        return int((self._unix_time() - EPOCH) * TICKS_PER_SECOND)

    def _is_set(self) -> bool:
        """Return whether the vehicle's clock is plausible."""
        return self._clock() > 0

    def examine(self, frame: Frame) -> Finding:
        """Check whether a frame is signed with the key and new.

        Only such a frame updates the timestamps.
        """
        signature = signature_of(frame)
        if self._key is None or not signature:
            return Finding.UNSIGNED
        if not hmac.compare_digest(digest(self._key, frame.raw[:-6]), signature[7:]):
            return Finding.FORGED
        stamp = int.from_bytes(signature[1:7], "little")
        stream = (frame.system, frame.component, signature[0])
        finding = self._judge(stream, stamp)
        if finding is Finding.SIGNED:
            self._accept(stream, stamp)
        return finding

    def _judge(self, stream: Stream, stamp: int) -> Finding:
        """Compare a timestamp with the last of its stream, or of a new one with the clock.

        The first frame after the start or after a new key may be ahead by any time: it sets the clock of a vehicle
        that is behind. No other frame may be more than a minute ahead of the vehicle's clock and of its sent frames,
        to which stations raise their own timestamps.
        """
        oldest = (self._clock() if self._is_set() else self._clock_kept) - FRESH - 1
        if stamp <= self._streams.get(stream, oldest):
            return Finding.REPLAYED
        latest = max(self._now(), self._last) + FRESH
        if stamp > (LAST_ACCEPTED if self._awaits_first else min(latest, LAST_ACCEPTED)):
            return Finding.AHEAD
        return Finding.SIGNED

    def _accept(self, stream: Stream, stamp: int) -> None:
        # A clock that is not set has only the reserve of the last run, which may be up to a minute behind.
        tolerance = 0 if self._awaits_first and not self._is_set() else FRESH
        if stamp > self._now() + tolerance:
            self._anchor = (stamp, self._monotonic())
        self._awaits_first = False
        self._streams[stream] = stamp
        if stamp > self._reserved.streams.get(stream, -1):
            self._reserve()

    def _reserve(self) -> None:
        """Store the timestamps with a reserve."""
        for stream in sorted(self._streams, key=self._streams.__getitem__)[:-MAX_STREAMS]:
            del self._streams[stream]
        ahead = {stream: stamp + RESERVE for stream, stamp in self._streams.items()}
        self._reserved = self._stamps()._replace(local=max(self._last, self._now()) + RESERVE, streams=ahead)
        self._keep(self._reserved)

    def _stamps(self) -> Stamps:
        return Stamps(self._last, self._streams, self._clock() if self._is_set() else self._clock_kept)

    def _keep(self, stamps: Stamps, settle: bool = False) -> None:
        if self._store is None or not self.active:
            return
        try:
            self._store.save_stamps(stamps, settle)
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        """Store the exact used timestamps."""
        self._keep(self._stamps(), settle=True)
