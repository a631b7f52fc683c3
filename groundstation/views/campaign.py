"""Progress and result of a campaign as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views.tables import NUMBER, SENTENCES, plain_table
from logs.campaigns.metrics import METRICS
from logs.campaigns.run import ResourceUsage
from wingbeat.text import pluralize

MANY = 10000
"""-; number of flights whose time is estimated"""
SHOWN = 5
"""-; number of listed failure reasons, the most frequent first"""


def progress(done: int, size: int, failed: int, remaining: float | None) -> str:
    """Format the progress of a campaign; ``remaining`` in s, None if unknown."""
    failures = f", {failed} failed" if failed else ""
    left = "" if remaining is None or done == size else f", {duration(remaining)} left"
    return f"{done} of {pluralize(size, 'flight')}{failures}{left}"


def duration(seconds: float) -> str:
    """Format a duration: 8 s, 2 min 5 s, 3 h 10 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def in_progress(done: int, size: int) -> str:
    """Return the line of a campaign that is resumed."""
    return f"resuming: {done} of {pluralize(size, 'flight')} complete"


def stopped(done: int, size: int) -> str:
    """Return the line of a campaign that was interrupted."""
    return f"stopped: {done} of {pluralize(size, 'flight')} complete and stored; run the same command to resume"


def too_late_for_logs(table: Path) -> str:
    """Return the notice that completed flights can no longer be recorded."""
    return f"{table} is complete: --logs has no effect; --flight N --log FILE repeats and records one flight"


def summary(name: str, table: Path, outcomes: Mapping[str, int], usage: ResourceUsage) -> RenderableType:
    """Summarize all flights; ``usage`` is the resource usage of those run now."""
    rows = Table.grid(padding=(0, 3))
    rows.add_column(style="dim", min_width=9)
    rows.add_column()
    pace = f"   {usage.flights} flown in {duration(usage.wall_time)}" if usage.flights else "   all flown before"
    rows.add_row("campaign", Text(f"{name}   {pluralize(sum(outcomes.values()), 'flight')}{pace}"))
    told = (f"{count} {outcome}" for outcome, count in sorted(outcomes.items(), key=lambda item: -item[1]) if count)
    rows.add_row("outcomes", Text("   ".join(told)))
    if (time_of_many := usage.time_of(MANY)) is not None:
        each = time_of_many / MANY
        rows.add_row("pace", Text(f"{each:.2g} s a flight; {MANY} flights take {duration(time_of_many)}"))
    if usage.memory:
        early, peak = (f"{value / 1e6:.0f} MB" for value in (usage.early_memory, usage.memory))
        rows.add_row("memory", Text(f"{peak} for the largest worker; {early} in the first tenth of the flights"))
    rows.add_row("table", Text(str(table)))
    hint = Text(f"\nwingbeat campaign report {table} shows distributions, the worst flights and what matters", "dim")
    return Group(rows, hint)


def failures(failed: Sequence[Mapping[str, Any]]) -> str:
    """Return the most frequent failure reasons, a line each."""
    if not failed:
        return ""
    counts = Counter(row["reason"] for row in failed)
    first = {row["reason"]: row["flight"] for row in reversed(failed)}
    lines = [
        f"  {count} ×  {reason}  (flight {first[reason]}{' and others' if count > 1 else ''})"
        for reason, count in counts.most_common(SHOWN)
    ]
    more = len(counts) - len(lines)
    rest = [f"  {pluralize(more, 'other reason')}"] if more > 0 else []
    return "\n".join([f"\n{len(failed)} failed:", *lines, *rest]) + "\n"


def one_flight(
    swept: Sequence[str], values: Mapping[str, Any], row: Mapping[str, Any], log: Path | None
) -> RenderableType:
    """Format the inputs and the result of one flight."""
    table = plain_table(("", ""), ("", NUMBER), ("", SENTENCES), header=False)
    table.add_row("flight", str(row["flight"]), "")
    for key in dict.fromkeys((*swept, *values)):
        table.add_row(key, _written(values[key]), "" if key in swept else "of every flight")
    table.add_row("outcome", row["outcome"], row["reason"])
    for name, metric in METRICS.items():
        if row[name] is not None:
            unit = "" if metric.unit == "-" else metric.unit
            table.add_row(name, *_value(row[name], unit))
    if log is not None:
        table.add_row("log", "", str(log))
    return table


def _value(value: float, unit: str) -> tuple[str, str]:
    """A number and its unit, angles in degrees."""
    return (f"{math.degrees(value):.4g}", "°") if unit == "rad" else (f"{value:.4g}", unit)


def _written(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
