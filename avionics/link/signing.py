"""MAVLink 2's message signing: who holds the key may speak, and what was said once cannot be said again.

A signature is the first 48 bits of the SHA-256 of key, frame, link number and time stamp. Time stamps count 10
microseconds since 2015 and rise with every frame of a sender on a link; they outlive a restart through a `KeyStore`,
which is told a little more than was used (`RESERVE`), so that it need not be told every time. pymavlink's own code
remembers the time stamp of a frame before it has checked its signature, whereby a stranger can silence a station.

Which time stamps are accepted follows https://mavlink.io/en/guide/message_signing.html, but each stream is compared
with its own last time stamp or, if it is new, with the vehicle's clock, never with the time stamps of another stream:
a station whose clock is ahead cannot lock out the others.
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
"""of a time stamp"""
EPOCH = 1_420_070_400.0
"""s; Unix time of the first of January 2015"""
LATEST = 1 << 47
"""no time stamp lies behind the year 2059: one that does would leave none to follow it"""
FRESH = 60 * TICKS_PER_SECOND
"""ticks; maximum difference between the first time stamp of a stream and the vehicle's clock, either way"""
MAX_STREAMS = 64
"""-; streams whose last time stamp is kept; the one with the oldest time stamp is forgotten first"""
LAST_ACCEPTED = LATEST - 365 * 86_400 * TICKS_PER_SECOND
"""ticks; a year remains for the time stamps that follow one that is accepted"""
AHEAD = 86_400 * TICKS_PER_SECOND
"""ticks; a key may come with a first time stamp so far ahead of our clock, where we have one"""
RESERVE = 2 * TICKS_PER_SECOND
"""ticks; after a crash a station may be refused for so long, and nothing it said before can be repeated"""

Stream = tuple[int, int, int]
"""system, component and link number of a sender"""


class Stamps(NamedTuple):
    """The time stamps that were used, our own and each sender's last."""

    local: int = 0
    streams: Mapping[Stream, int] = {}
    clock: int = 0
    """ticks; latest plausible reading of the vehicle's own clock"""


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
    AHEAD = "time stamp ahead of the clock"


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
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._unix_time = unix_time
        self._monotonic = monotonic
        self._key = key
        self._last = stamps.local
        self._streams = dict(stamps.streams)
        self._clock_kept = stamps.clock
        self._anchor = (self._clock() if self._is_set() else stamps.local, monotonic())
        """ticks, s; a time stamp and the monotonic clock then: what the vehicle's clock was set to at the start, or
        what a key holder set it up to. It goes on when the system's clock is set meanwhile"""
        self._awaits_first = True
        self._store = store
        self._reserved = stamps._replace(streams=dict(self._streams))
        self.refused: Counter[Finding] = Counter()
        """frames that were not let in, on all links"""
        self.failure = ""
        """reason why time stamps are not stored; empty if they are"""

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
        if initial_stamp > self._now():
            self._anchor = (initial_stamp, self._monotonic())
        self._awaits_first = True
        self._reserve()

    def too_far_ahead(self, stamp: int) -> bool:
        """Whether a first time stamp would shut out every station whose clock is right."""
        now = self._clock()
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
        if self._last > self._reserved.local:
            self._reserve()
        return self._last

    def _now(self) -> int:
        """The later one of the vehicle's clock and of the clock that began at the anchor."""
        anchored = self._anchor[0] + int((self._monotonic() - self._anchor[1]) * TICKS_PER_SECOND)
        return min(max(self._clock(), anchored, 0), LATEST)

    def _clock(self) -> int:
        """The vehicle's own clock, negative before 2015."""
        return int((self._unix_time() - EPOCH) * TICKS_PER_SECOND)

    def _is_set(self) -> bool:
        """Whether the vehicle's own clock is plausible."""
        return self._clock() > 0

    def examine(self, frame: Frame) -> Finding:
        """Whether the frame is the key holder's and new; only such a one moves the time stamps."""
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
        """Compare a time stamp with the last of its stream or, if it is new, with the vehicle's clock.

        The first frame after the start or after a new key may be ahead by any time: it sets up a vehicle whose clock
        is behind. No other frame may be over a minute ahead of the vehicle's clock and of what the vehicle sent,
        to which stations raise their own time stamps.
        """
        oldest = (self._clock() if self._is_set() else self._clock_kept) - FRESH - 1
        if stamp <= self._streams.get(stream, oldest):
            return Finding.REPLAYED
        latest = max(self._now(), self._last) + FRESH
        if stamp > (LAST_ACCEPTED if self._awaits_first else min(latest, LAST_ACCEPTED)):
            return Finding.AHEAD
        return Finding.SIGNED

    def _accept(self, stream: Stream, stamp: int) -> None:
        # A clock that is not set has only the reserve of the last run, up to a minute behind and still accepting.
        tolerance = 0 if self._awaits_first and not self._is_set() else FRESH
        if stamp > self._now() + tolerance:
            self._anchor = (stamp, self._monotonic())
        self._awaits_first = False
        self._streams[stream] = stamp
        if stamp > self._reserved.streams.get(stream, -1):
            self._reserve()

    def _reserve(self) -> None:
        """Keep more than was used."""
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
        """Keep exactly what was used."""
        self._keep(self._stamps(), settle=True)
