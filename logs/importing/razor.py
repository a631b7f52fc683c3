"""Captures of a Razor's serial line.

The firmware sends no time: frames stand in its raster of 20 ms, damaged ones included. The text names the output;
a binary capture is valid between two synch tokens, as `avionics.board.razor_protocol` does it.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from avionics import topics as t
from avionics.board.razor import FrameClock
from avionics.board.razor_protocol import OUTPUTS, TOKEN, Output, Reader, Reading
from logs.importing.counterparts import Columns, checked
from logs.importing.source import ImportedTopic, Series, Source
from wingbeat.errors import InputError
from wingbeat.text import pluralize

STEP_US = round(FrameClock.step * 1e6)
"""us; between two frames"""
BINARY = "oscb"
"""output assumed for a binary capture: calibrated, as requested by the Razor board"""
HEAD = 4096
"""bytes; limit of the search for the format of a capture"""
_LINE = re.compile(rb"#(YPRAG|YPR|A-[CR])=-?\d+\.\d\d,")
_PIECE = 12
"""bytes; size of a read, at most one frame, so that a loss is known before the frame after it"""


class Frame(NamedTuple):
    """One frame and its time."""

    time_us: int
    """us; since the first frame of the capture, damaged frames included"""
    reading: Reading


def is_razor(head: bytes) -> bool:
    """Return whether a file with this start is a capture of a Razor."""
    return bool(_LINE.search(head[:HEAD]) or TOKEN.search(head[:HEAD]))


def output_of(data: bytes) -> Output:
    """Detect the output format of a capture."""
    found = _LINE.search(data[:HEAD])
    if found is None:
        return OUTPUTS[BINARY]
    return next(output for output in OUTPUTS.values() if found[1] in output.lines)


def read_razor(data: bytes) -> Source:
    """Read a capture.

    Raises:
        InputError: no complete frame.
    """
    output = output_of(data)
    reader = Reader(output)
    frames = _frames(data, output, reader)
    if not frames:
        raise InputError("no complete frame of a Razor found" + _why(output))
    lost = reader.count.lost
    damage = [f"{pluralize(lost, 'frame')} damaged, {pluralize(reader.count.bad_bytes, 'byte')}"] if lost else []
    if reader.waiting:
        damage.append(f"{pluralize(reader.waiting, 'byte')} at the end that no synch token confirms")
    notes = {"output": next(name for name, one in OUTPUTS.items() if one is output)}
    made = [imported for imported in (_imu(frames), _attitude(frames)) if imported is not None]
    clock = "since the first frame, by the firmware's raster of 20 ms"
    return Source("razor", {}, "Razor 9DOF", notes=notes, damage=tuple(damage), made=tuple(made), clock=clock)


def _why(output: Output) -> str:
    return " between two synch tokens (send #s00 during the capture)" if output.size else ""


def _frames(data: bytes, output: Output, reader: Reader) -> list[Frame]:
    if not output.size:
        reader.feed(b"#SYNCH00\r\n")  # a line of text shows by itself where a frame begins
    frames: list[Frame] = []
    for at in range(0, len(data), _PIECE):
        for reading in reader.feed(data[at : at + _PIECE]):
            frames.append(Frame((len(frames) + reader.count.lost) * STEP_US, reading))
    return frames


def _imu(frames: list[Frame]) -> ImportedTopic | None:
    found = [(one.time_us, one.reading) for one in frames if one.reading.accel and one.reading.gyro]
    if not found:
        return None
    columns: Columns = {}
    for name in ("accel", "gyro", "mag"):
        rows = np.array([getattr(reading, name) or (np.nan,) * 3 for _, reading in found])
        columns |= {f"{name}_{axis}": rows[:, place] for place, axis in enumerate("xyz")}
    return checked(t.IMU, Series("frames", np.array([at for at, _ in found], np.int64), columns, {}), columns)


def _attitude(frames: list[Frame]) -> ImportedTopic | None:
    found = [(one.time_us, one.reading.angles) for one in frames if one.reading.angles]
    if not found:
        return None
    rows = np.array([angles for _, angles in found])
    columns = {name: rows[:, place] for place, name in enumerate(("roll", "pitch", "yaw"))}
    return checked(t.ATTITUDE, Series("frames", np.array([at for at, _ in found], np.int64), columns, {}), columns)
