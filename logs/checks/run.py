"""All checks of a log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from logs.checks.consistency import check_consistency
from logs.checks.drive import check_drive
from logs.checks.findings import SEVERITIES, Finding
from logs.checks.log_data import LogData, read_log
from logs.checks.timing import check_timing
from logs.checks.values import check_values

if TYPE_CHECKING:
    import pandas as pd

CHECKS: tuple[Callable[[LogData], Iterator[Finding]], ...] = (
    check_timing, check_values, check_consistency, check_drive,
)  # fmt: skip
MOST = 10
"""findings of one code and topic; more are summed up in the last"""


class LogReport(NamedTuple):
    """Result of the checks."""

    log: LogData
    findings: tuple[Finding, ...]
    """the most severe first, then in order of time"""

    def to_pandas(self) -> pd.DataFrame:
        """Return the findings as a table, one row each."""
        import pandas

        columns = [*Finding._fields, "remedy"]
        return pandas.DataFrame([(*one, one.remedy) for one in self.findings], columns=columns)

    def __repr__(self) -> str:
        rows = [f"  {one.severity:8}{one.code:24}{one.start:9.2f} s  {one.text}" for one in self.findings]
        return "\n".join([f"LogReport of {self.log.name}: {len(rows)} findings", *rows])


def check_log(paths: Sequence[Path], mapping: Path | None = None) -> LogReport:
    """Check one log; several tables are topics of one log.

    Raises:
        InputError: a file cannot be read, or has no data.
    """
    return check(read_log(paths, mapping))


def check(log: LogData) -> LogReport:
    """Run every check."""
    with np.errstate(all="ignore"):
        found = [finding for one in CHECKS for finding in one(log)]
    kept: list[Finding] = []
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in found:
        groups.setdefault((finding.code, finding.topic), []).append(finding)
    for members in groups.values():
        members.sort(key=lambda one: one.start)
        kept += members[:MOST]
        if len(members) > MOST:
            last = members[-1]
            text = f"{members[MOST - 1].text}; and {len(members) - MOST} more until {last.end:.1f} s"
            kept[-1] = members[MOST - 1]._replace(text=text, end=last.end)
    kept.sort(key=lambda one: (SEVERITIES.index(one.severity), one.start))
    return LogReport(log, tuple(kept))
