"""What commands that record have in common: the last flight's file put right, and what is said of their own."""

from __future__ import annotations

import sys
from pathlib import Path

from avionics.quantities import counted
from logs.recorder import McapRecorder
from logs.recover import recover_left


def put_right(folder: Path) -> None:
    """Repair what a flight that was cut off left in ``folder``, and say so on stderr."""
    for path, done in recover_left(folder):
        print(f"repaired {path}, which was cut off: {counted(done.messages, 'message')} kept", file=sys.stderr)


def told_paths(recorder: McapRecorder) -> str:
    """The files of a recording, and why it ended early if it did."""
    first, *others = map(str, recorder.paths)
    more = f" and {counted(len(others), 'more file')} up to {others[-1]}" if others else ""
    left_out = f"; {counted(recorder.dropped, 'message')} left out: the disk was too slow" if recorder.dropped else ""
    return f"{first}{more}{left_out}" + (f"; {recorder.failure}" if recorder.failure else "")
