"""Parameter files in QGroundControl's tab-separated format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from groundstation.link.exchange import Target
from groundstation.link.parameters import Parameter
from wingbeat.errors import InputError
from wingbeat.text import read_error_text

HEADING = "# Vehicle-Id\tComponent-Id\tName\tValue\tType"


def write(path: Path, target: Target, parameters: Sequence[Parameter]) -> None:
    """Write a new file.

    Raises:
        FileExistsError: the file is there already.
    """
    rows = [f"{target.system}\t{target.component}\t{p.name}\t{p.value!r}\t{p.kind}" for p in parameters]
    with path.open("x", encoding="utf-8") as file:
        file.write("\n".join((HEADING, *rows)) + "\n")


def read(path: Path) -> dict[str, float]:
    """Read the values by name.

    Raises:
        InputError: unreadable, or a line that is malformed; the message has its number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read parameter file {path}: {read_error_text(error)}") from None
    values: dict[str, float] = {}
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            name, value = words[2], float(words[3])
        except (IndexError, ValueError):
            raise InputError(f"{path}, line {number}: not vehicle, component, name, value, type") from None
        if not math.isfinite(value):
            raise InputError(f"{path}, line {number}: {name} is not a finite number")
        values[name] = value
    if not values:
        raise InputError(f"{path} has no parameters")
    return values
