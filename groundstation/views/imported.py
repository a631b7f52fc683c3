"""Report of an import: topics and omissions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from groundstation.views import tables
from groundstation.views.terminal import open_console
from wingbeat.text import pluralize

if TYPE_CHECKING:
    from logs.importing.log_import import ImportReport


def print_imported(report: ImportReport) -> None:
    """Print the topics with their sources, then damage and dropped rows, then the new file."""
    console = open_console()
    console.print(
        Text.assemble(
            (report.vehicle or report.format, "bold"),
            f"   {pluralize(report.messages, 'message')}   {pluralize(report.events, 'event')}   "
            f"{pluralize(report.parameters, 'parameter')}",
        )
    )
    table = tables.plain_table(("topic", ""), ("messages", "right"), ("made of", tables.SENTENCES))
    for row in report.topics:
        table.add_row(row.topic, str(row.messages), row.source)
    console.print(table)
    for line in report.damage:
        console.print(f"damaged: {line}", style="yellow")
    for lost in report.dropped:
        told = f"dropped: {pluralize(lost.rows, 'row')} of {lost.topic}: {lost.reason}"
        console.print(told, style="yellow")
    console.print(report.file)
    if report.later_boots:
        boots = 1 + len(report.later_boots)
        console.print(f"{boots} boots of the vehicle in this file, a log for each", style="yellow")
    for later in report.later_boots:
        print_imported(later)
