"""What `wingbeat identify` hands over: numbers as a table and a JSON document, and a page to look at."""

from logs.identification.report.numbers import (
    POWER_TRUTH,
    SUBJECTS,
    Identification,
    Row,
    document,
    identify,
    rows,
)

__all__ = ["POWER_TRUTH", "SUBJECTS", "Identification", "Row", "document", "identify", "rows"]
