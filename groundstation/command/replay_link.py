"""``wingbeat replay FILE --mavlink URL``: a recorded flight to a ground station."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from avionics.link.ground import GroundLink
from avionics.link.vehicle import Identity
from groundstation.views import wording
from groundstation.views.printable import unfiltered
from logs.replay.player import Player

POLL = 0.004
"""s; polling interval of the links"""
SHOWN_EVERY = 0.2
"""s; between two lines with the time of the flight"""
JUMP = 10.0
"""s; of flight, step of an arrow key"""
_KEY = re.compile(r"\x1b\[[0-9;]*[A-Za-z~]|.", re.DOTALL)
KEYS = "space pauses, left and right jump 10 s, q ends"


class Playing(NamedTuple):
    """Options of playing a flight to ground stations."""

    urls: Sequence[str]
    start: float
    """s; since boot"""
    identity: Identity


def play(player: Player, playing: Playing, clock: Callable[[], float] = time.monotonic) -> None:
    """Play to the end of the flight, or until q is pressed.

    Raises:
        InputError: not a link address, a port in use, a missing device.
    """
    link = GroundLink(playing.urls, player.view, playing.identity)
    try:
        if playing.start > 0.0:
            player.seek(playing.start)
        with _keyboard() as pressed:
            print(f"playing on {', '.join(playing.urls)}" + (f": {KEYS}" if pressed else ""), file=sys.stderr)
            _loop(player, link, pressed, clock)
    finally:
        link.close()
    print(f"ended at {wording.clock(player.time)}", file=sys.stderr)


def _loop(
    player: Player, link: GroundLink, pressed: Callable[[], list[str]] | None, clock: Callable[[], float]
) -> None:
    shown = float("-inf")
    while not player.over:
        now = clock()
        player.advance(now)
        link.poll(now)
        link.stream(now)
        if pressed is not None:
            if not all(steer(player, key) for key in pressed()):
                break
            if now - shown >= SHOWN_EVERY:
                shown = now
                _show(player)
        time.sleep(POLL)
    if pressed is not None:
        print(file=sys.stderr)


def steer(player: Player, key: str) -> bool:
    """Execute a key; return False to end."""
    if key == " ":
        player.paused = not player.paused
    elif key in ("\x1b[C", "\x1b[D"):
        player.seek(min(max(player.time + (JUMP if key == "\x1b[C" else -JUMP), 0.0), player.end))
    return key not in ("q", "\x03")


def _show(player: Player) -> None:
    state = "paused" if player.paused else "playing"
    print(
        f"\r{wording.clock(player.time)} of {wording.clock(player.end)}  {state}   ",
        end="",
        file=unfiltered(sys.stderr),  # a carriage return of our own
        flush=True,
    )


@contextlib.contextmanager
def _keyboard() -> Iterator[Callable[[], list[str]] | None]:
    """Yield a function that returns the pressed keys; None without a terminal."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        yield None
        return
    try:
        import termios
        import tty
    except ImportError:  # Windows: no keys
        yield None
        return
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield _pressed
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _pressed() -> list[str]:
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return keys_in(os.read(sys.stdin.fileno(), 1024).decode(errors="replace")) if ready else []


def keys_in(typed: str) -> list[str]:
    """Split terminal input into keys: characters, and escape sequences of arrows."""
    return _KEY.findall(typed)
