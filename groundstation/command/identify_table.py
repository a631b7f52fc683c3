"""``wingbeat identify TABLE --map MAP.toml``: modes and coefficients from tables of numbers."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from avionics.quantities import BadInput
from groundstation.views.json_document import print_document
from groundstation.views.table_identification import table_identification
from groundstation.views.terminal import open_console
from logs.identification.tables.run import identify_tables
from logs.identification.tables.telling import table_document


def run(files: Sequence[Path], what: str, chosen: argparse.Namespace) -> int:
    """Identify ``what`` from tables, and print it.

    Raises:
        BadInput: a table or map that cannot be used, or an option of logs.
    """
    for option in ("vehicle", "elevator"):
        if getattr(chosen, option) is not None:
            raise BadInput(f"--{option} is for logs: the map tells it of a table")
    found = identify_tables(files, chosen.map, what)
    if chosen.json:
        print_document(table_document(found))
    else:
        open_console().print(table_identification(found))
    return 0
