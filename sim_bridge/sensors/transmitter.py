"""A scripted pilot: stick and switch positions from a table of times.

A text file of comma-separated values: the first line names the columns, ``time`` (s since boot, rising) and any of
the fields of `Sticks`; sticks and switches stay where a line put them until the next one. Lines that begin with # are
for people. The position of the mode switch is a number, or one of three fixed names: those of the modes that the
vehicle files which come along give its positions. A file of one's own may give others (``mode_low`` and so on); a
transmitter does not know them, so that with such a file a name is the position and not the mode.
"""

from __future__ import annotations

import csv
import math
from bisect import bisect_right
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from sim_bridge.observation import Observation
from sim_bridge.sensors.receiver import Pilot, Sticks
from wingbeat.errors import InputError
from wingbeat.text import read_error_text

SWITCHES = {"mode": 2, "arm": 1, "kill": 1}
"""-; highest position of each"""
MODES = ("STABILIZED", "LOITER", "AUTO")
"""-; names of the mode switch's positions 0, 1, 2, whatever `mode_low`, `mode_middle`, `mode_high` of the vehicle's
file are"""
CENTRED = ("roll", "pitch", "yaw")
"""from -1 to 1; the throttle from 0"""


class Script(NamedTuple):
    """Stick and switch positions from each time on."""

    times: tuple[float, ...]
    """s; since boot, rising"""
    sticks: tuple[Sticks, ...]
    """from that time on"""
    text: str
    """the table as it was read"""

    def pilot(self) -> Pilot:
        """Return the scripted pilot; before the first time all is neutral."""

        def moved(observed: Observation) -> Sticks:
            place = bisect_right(self.times, observed.time_us * 1e-6)
            return self.sticks[place - 1] if place else Sticks()

        return moved


def load_script(path: str | Path) -> Script:
    """Read a script file.

    Raises:
        InputError: it cannot be read, or a line has impossible values; the message names file and line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {read_error_text(error)}") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()[:1] not in ("", "#")]
    rows = list(csv.reader(line for _, line in lines))
    if len(rows) < 2:
        raise InputError(f"{path} must have a line that names the columns and one for each time")
    names = _names(path, rows[0])
    moved = [_row(f"{path} line {number}", names, row) for (number, _), row in zip(lines[1:], rows[1:], strict=True)]
    times = tuple(time for time, _ in moved)
    if any(later <= earlier for earlier, later in pairwise(times)):
        raise InputError(f"{path}: the times must rise from line to line")
    return Script(times, tuple(sticks for _, sticks in moved), text)


def _names(path: str | Path, row: list[str]) -> list[str]:
    names = [name.strip() for name in row]
    known = ("time", *Sticks._fields)
    if "time" not in names or not set(names) <= set(known) or len(set(names)) < len(names):
        raise InputError(f"{path}: columns are time and any of {', '.join(Sticks._fields)}; not {', '.join(names)}")
    return names


def _row(where: str, names: list[str], row: list[str]) -> tuple[float, Sticks]:
    if len(row) != len(names):
        raise InputError(f"{where} has {len(row)} values for {len(names)} columns")
    values = {name: _number(where, name, text) for name, text in zip(names, row, strict=True)}
    time = values.pop("time")
    positions: dict[str, Any] = {name: _position(where, name, value) for name, value in values.items()}
    return time, Sticks(**positions)


def _number(where: str, name: str, text: str) -> float:
    if name == "mode" and text.strip().upper() in MODES:
        return MODES.index(text.strip().upper())
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        names = f" or {', '.join(MODES)}" if name == "mode" else ""
        raise InputError(f"{where}: {name} must be a number{names}, not {text.strip() or 'nothing'}")
    return value


def _position(where: str, name: str, value: float) -> float:
    low, high, whole = -1 if name in CENTRED else 0, SWITCHES.get(name, 1), name in SWITCHES
    if not low <= value <= high or (whole and value != int(value)):
        kind = "a whole number from" if whole else "from"
        names = f" ({', '.join(MODES)})" if name == "mode" else ""
        raise InputError(f"{where}: {name} must be {kind} {low} to {high}{names}, not {value:g}")
    return int(value) if whole else value
