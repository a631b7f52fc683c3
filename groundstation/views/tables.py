"""Tables of what a vehicle holds and of what a flight came to."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from groundstation.link.parameters import Parameter

PARAMETER_TYPES = {1: "uint8", 2: "int8", 3: "uint16", 4: "int16", 5: "uint32", 6: "int32", 9: "float"}


def plain_table(*columns: tuple[str, str]) -> Table:
    """A table without lines: each column is a heading and ``left`` or ``right``."""
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim")
    for heading, side in columns:
        table.add_column(heading, justify="right" if side == "right" else "left", no_wrap=side == "right")
    return table


def parameter_record(parameter: Parameter) -> dict[str, Any]:
    """A parameter as a JSON object."""
    kind = PARAMETER_TYPES.get(parameter.kind, str(parameter.kind))
    return {"name": parameter.name, "value": parameter.value, "type": kind}
