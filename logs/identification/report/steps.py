"""The steps by which a stepwise regression chose its terms, as a table."""

from __future__ import annotations

from logs.identification.estimators.stepwise import Step
from logs.identification.report.document import Table


def step_table(steps: tuple[Step, ...]) -> Table:
    """A row a step: what entered or left, its statistics, and why."""
    rows = tuple(
        (
            f"{number}", one.action, one.term.replace("*", " "), one.colored_f, one.statistics.r_squared,
            one.statistics.press, one.statistics.pse, one.why,
        )
        for number, one in enumerate(steps)
    )  # fmt: skip
    return Table(("step", "", "term", "F", "R²", "PRESS", "PSE", "why"), rows)
