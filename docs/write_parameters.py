"""Write the parameter reference: ``python docs/write_parameters.py docs/parameters.md``."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from avionics.parameters import Parameter, get, grounded, parameter_table
from avionics.vehicles import load_vehicle
from avionics.vehicles.loader import SECTIONS

VEHICLES = ("robo_raven_ii_d", "arizona_100cm", "ulg_ornithopter")
HEAD = """# Parameters

Every parameter of the built-in vehicles, as ground stations list it. Written by `make docs/parameters.md` from the
`Gains` docstrings and the vehicle files. A vehicle file without a key takes the default; a key without a default must
be in the file. Parameters marked * can be set only while disarmed.

"""


def reference() -> str:
    """Markdown with one table for each section; values by vehicle in the order of ``VEHICLES``."""
    gains = [load_vehicle(name).gains for name in VEHICLES]
    tables = [parameter_table(each) for each in gains]
    entries = {name: entry for table in tables for name, entry in table.items()}
    sections: dict[str, list[str]] = {}
    for name, entry in entries.items():
        values = [
            f"{get(each, table[name]):.6g}" if name in table else "-"
            for each, table in zip(gains, tables, strict=True)
        ]
        text = entry.description.replace("|", "\\|")
        cells = [
            f"{name}{'*' if grounded(entry) else ''}",
            entry.key,
            entry.unit,
            _range(entry),
            _default(entry),
            *values,
            text,
        ]
        sections.setdefault(entry.section, []).append(f"| {' | '.join(cells)} |")
    heads = ["parameter", "key", "unit", "range", "default", *VEHICLES, "description"]
    rule = f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}\n"
    parts = [f"## {section}\n{rule}" + "\n".join(rows) + "\n" for section, rows in sections.items()]
    return HEAD + "\n".join(parts)


def _default(entry: Parameter) -> str:
    default = SECTIONS[entry.section]._field_defaults.get(entry.key)
    if default is None:
        return "-"
    value = default[min(entry.place, len(default) - 1)] if isinstance(default, tuple) else default
    return f"{value:.6g}"


def _range(entry: Parameter) -> str:
    low, high = (f"{bound:g}" if math.isfinite(bound) else "" for bound in (entry.low, entry.high))
    return f"{low} to {high}".strip() if low or high else "any"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
