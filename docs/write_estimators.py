"""Write the reference of estimators: ``python docs/write_estimators.py docs/reference/estimators.md``."""

from __future__ import annotations

import sys
from pathlib import Path

from logs.identification.estimators.registry import estimators

HEAD = """# Estimators of identification

Each row is one entry of the registry (`logs/identification/estimators/registry.py`). *Selected by* names the subject
of `wingbeat identify FLIGHT.mcap` or the keys of a [map](../identify_csv.md); rows without it are for programs:

    from logs.identification.estimators.registry import Request, estimators
    result = estimators()["recursive_least_squares"].estimate(Request(...))

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
    every = [one for _, one in sorted(estimators().items())]
    rows = [f"| `{one.name}` | {one.title} | {one.reference} | {_code(one.selection)} |" for one in every]
    options = [
        f"| `{one.name}` | `{name}` | {meaning} |"
        for one in every for name, meaning in one.options.items()
    ]  # fmt: skip
    return HEAD + "\n".join(rows) + "\n" + OPTIONS + "\n".join(options) + "\n"


def _code(selection: str) -> str:
    """Each alternative of a selection as code."""
    return ", ".join(f"`{part.strip()}`" for part in selection.split(";") if part)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
