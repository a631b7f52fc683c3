"""Write the reference of estimators: ``python docs/write_estimators.py docs/reference/estimators.md``."""

from __future__ import annotations

import sys
from pathlib import Path

from logs.identification.estimators.registry import ESTIMATORS, Estimator

HEAD = """# Estimators of identification

Each row is one entry of the registry (`logs/identification/estimators/registry.py`). *Selected by* names the subject
of `wingbeat identify FLIGHT.mcap` or the keys of a [map](../identify_csv.md). The command, the map and this page take
the methods from the registry; a program calls a row:

    from logs.identification.estimators.registry import ESTIMATORS, Request
    result = ESTIMATORS["recursive_least_squares"].estimate(Request(...))

This page is written from the registry (`python docs/write_estimators.py`).

| key | method | reference | selected by |
| --- | --- | --- | --- |
"""
OPTIONS = """
## Options
Options of `Request.options` by estimator.

| key | option | meaning |
| --- | --- | --- |
"""


def reference() -> str:
    """The page: one row for each estimator, and one for each of its options."""
    every = sorted(ESTIMATORS.items())
    rows = [f"| `{key}` | {one.title} | {one.reference} | {_code(key, one)} |" for key, one in every]
    options = [
        f"| `{key}` | `{name}` | {meaning} |"
        for key, one in every for name, meaning in one.options.items()
    ]  # fmt: skip
    return HEAD + "\n".join(rows) + "\n" + OPTIONS + "\n".join(options) + "\n"


def _code(key: str, row: Estimator) -> str:
    """Each alternative of the selection as code."""
    keys = [f'[{part}] method = "{key}"' for part in row.sections]
    if "modes" in row.sections:
        keys.append(f"modes --method {key}")
    return ", ".join(f"`{part.strip()}`" for part in (*keys, *row.selection.split(";")) if part)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
