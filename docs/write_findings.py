"""Write the reference of findings: ``python docs/write_findings.py docs/reference/findings.md``."""

from __future__ import annotations

import pkgutil
import sys
from importlib import import_module
from pathlib import Path

from logs import identification
from logs.identification.findings import CATALOG

HEAD = """# Findings of identification

A finding says what was done (info), what casts doubt on a number (warning), or why a parameter has no number
(withheld). JSON of `wingbeat identify` has them under `findings`: `code`, `severity`, `subject`, `value`, `limit` and
`text`. Programs compare the code. `wingbeat identify TABLE` prints the text and the remedy. This page is written from
the catalog (`python docs/write_findings.py`).

| code | text | meaning | remedy |
| --- | --- | --- | --- |
"""


def reference() -> str:
    """The page: one row for each code."""
    for module in pkgutil.walk_packages(identification.__path__, f"{identification.__name__}."):
        import_module(module.name)
    import_module("logs.model_range")
    rows = [
        f"| `{code}` | {_cell(one.text)} | {_cell(one.meaning)} | {_cell(one.remedy)} |"
        for code, one in sorted(CATALOG.items())
    ]
    return HEAD + "\n".join(rows) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
