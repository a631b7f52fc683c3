"""Recording paths of commands, and repair of the last flight's files."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from logs.join import join
from logs.live.follower import is_recorded
from logs.names import PARTS, reserved
from logs.new_files import HELD, locked_name
from logs.recorder import McapRecorder, Writing
from logs.recover import recover_left
from wingbeat.errors import InputError
from wingbeat.text import pluralize

WORLD, COMPUTER = PARTS
"""suffixes of the recordings that ``wingbeat fly`` joins"""
LEFT_FOR = 10.0
"""s; age of the last byte of a flight's recordings below which its command may still join them"""


def put_right(folder: Path) -> None:
    """Repair and join the recordings of interrupted flights in ``folder``, and report that on stderr."""
    pairs = list(_left_separate(folder))
    for path, done in recover_left(folder):
        print(f"repaired truncated recording {path}: {pluralize(done.messages, 'message')} kept", file=sys.stderr)
    for parts, flight in pairs:
        with suppress(InputError, OSError), locked_name(flight) as ours:
            if ours:
                join(parts, flight)
                print(f"joined two recordings to {flight}", file=sys.stderr)
    _unmark(folder)


def _unmark(folder: Path) -> None:
    """Delete the lock files of names that no process holds, as left by killed commands."""
    for mark in folder.glob(f".*{HELD}"):
        with suppress(InputError, OSError), locked_name(mark.with_name(f"{mark.name[1:].removesuffix(HELD)}.mcap")):
            pass


def _left_separate(folder: Path) -> Iterator[tuple[list[Path], Path]]:
    """Yield pairs of recordings of world and flight computer that are no longer written, and their joined log."""
    for world in sorted(folder.glob(f"*{WORLD}")):
        name = world.name.removesuffix(WORLD)
        parts, flight = [world, world.with_name(name + COMPUTER)], world.with_name(f"{name}.mcap")
        with suppress(InputError, OSError):
            newest = max(part.stat().st_mtime for part in parts)
            if time.time() - newest > LEFT_FOR and not flight.exists() and not any(map(is_recorded, parts)):
                yield parts, flight


def begin_recording(log: Path | None, name: str, writing: Writing, start_epoch_ns: int | None = None) -> McapRecorder:
    """Create a recorder to the new file ``log``, or to ``recordings/NAME-TIME.mcap`` with a locked name.

    Raises:
        InputError: ``log`` exists, or the file cannot be created.
    """
    if log is not None:
        return McapRecorder(log, start_epoch_ns=start_epoch_ns, writing=writing)
    with reserved(name) as path:
        return McapRecorder(path, start_epoch_ns=start_epoch_ns, writing=writing)


def format_recording_paths(recorder: McapRecorder) -> str:
    """Return the files of a recording, and why it ended early, if it did."""
    first, *others = map(str, recorder.paths)
    more = f" and {pluralize(len(others), 'more file')} up to {others[-1]}" if others else ""
    left_out = f"; {pluralize(recorder.dropped, 'message')} dropped: disk too slow" if recorder.dropped else ""
    return f"{first}{more}{left_out}" + (f"; {recorder.failure}" if recorder.failure else "")
