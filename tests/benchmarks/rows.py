"""What benchmarks leave: rows of one table, ours beside a peer or a limit that was measured in the same run."""

from __future__ import annotations

import os
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"
"""what stands before and behind the table in a file"""
HEADINGS = ("what", "ours", "peer or limit", "unit", "peer", "asked of ours")


class Row(NamedTuple):
    """One measurement of ours beside one of a peer."""

    what: str
    computed: float
    peer: float | None
    """of the peer, or a limit measured in the same run"""
    unit: str
    name: str = ""
    """of the peer, with its version"""
    requested: str = ""
    """of ours, where the test asserts it"""


ROWS: list[Row] = []
"""of this run, in the order they were measured"""


def leave(row: Row) -> None:
    """Keep a row for the table at the end of the run, and say it now."""
    ROWS.append(row)
    sys.stdout.write(" | ".join(cell for cell in cells(row) if cell) + "\n")


def peer(package: str) -> str:
    """A package's name with its installed version."""
    return f"{package} {version(package)}"


def cells(row: Row) -> tuple[str, ...]:
    """A row's texts, in the order of `HEADINGS`."""
    return (row.what, number(row.computed), number(row.peer), row.unit, row.name, row.requested)


def number(value: float | None) -> str:
    """Three digits that count, and all before the point."""
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def processor() -> str:
    """What the system calls the processor."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def machine() -> str:
    """One line on where and when the rows were measured."""
    return f"{os.cpu_count()} cores, {processor()}, Python {platform.python_version()}, {time.strftime('%Y-%m-%d')}"


def markdown(rows: list[Row]) -> str:
    """The table and its machine, between the markers."""
    lines = [HEADINGS, tuple("---" for _ in HEADINGS), *map(cells, rows)]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"{BEGIN}\nMeasured on {machine()}.\n\n{table}\n{END}"


def replace_table(path: Path, rows: list[Row]) -> None:
    """Put the table of this run in the place of the one in ``path``.

    Raises:
        ValueError: the markers are not in the file.
    """
    text = path.read_text(encoding="utf-8")
    before, begun, rest = text.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not begun or not ended:
        raise ValueError(f"{path}: no table between {BEGIN} and {END}")
    path.write_text(before + markdown(rows) + after, encoding="utf-8")
