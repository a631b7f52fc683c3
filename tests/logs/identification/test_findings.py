"""The catalog of findings: documented, every text can be made, every code of the diagnostics is in it."""

from __future__ import annotations

import runpy
import string
from pathlib import Path

from logs.identification.diagnostics.table import CHECKS
from logs.identification.findings import CATALOG

DOCS = Path(__file__).parents[3] / "docs"


def test_the_page_of_findings_is_that_of_the_catalog() -> None:
    page = runpy.run_path(str(DOCS / "write_findings.py"))["reference"]()
    assert (DOCS / "reference" / "findings.md").read_text(encoding="utf-8") == page


def test_every_check_reports_codes_of_the_catalog() -> None:
    assert {code for check in CHECKS for code in check.codes} <= CATALOG.keys()


def test_every_template_can_be_read() -> None:
    for code, one in CATALOG.items():
        assert code.islower() and one.meaning, code
        assert all(field is None or field.isidentifier() for _, field, _, _ in string.Formatter().parse(one.text)), (
            code
        )
