"""The rows that benchmarks leave, as one table at the end of the run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table
from rows import HEADINGS, ROWS, cells, machine, replace_table

# The mechanism as MuJoCo is told it lies with the tests of the physics.
sys.path.append(str(Path(__file__).parents[1] / "sim_bridge"))


def pytest_terminal_summary(config: pytest.Config) -> None:
    if not ROWS:
        return
    table = Table(title=machine())
    for heading in HEADINGS:
        table.add_column(heading, justify="right" if heading in HEADINGS[1:3] else "left")
    for row in ROWS:
        table.add_row(*cells(row))
    Console(width=None if sys.stdout.isatty() else 150).print(table)
    kept = config.getoption("--bench-table")
    if kept:
        replace_table(Path(kept), ROWS)
