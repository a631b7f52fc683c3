"""``wingbeat vehicles``: vehicles and the sources of their values."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from avionics.vehicles import load_vehicle as load_flight_vehicle
from avionics.vehicles import vehicle_names as flight_names
from groundstation.command import options
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from sim_bridge.mechanism import total_mass
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, models_of, vehicle_names
from wingbeat.documents import parse_toml
from wingbeat.vehicle_file import SOURCE_KINDS, Source

WIDEST = 100
"""characters; maximum line length before wrapping"""
EXAMPLES = ("wingbeat vehicles", "wingbeat vehicles robo_raven_ii_d", "wingbeat vehicles --json")
JSON_KEYS = {
    "vehicles": "list of {name, title, mass, wingspan, aerodynamics, flies, sources}; kg, m; aerodynamics: names of"
    " the models that --aerodynamics takes; flies: has a flight computer's file",
    "values": "with a name: list of {key, value, unit, kind, source, fitted};"
    " unit: - for a plain number, null for a word",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "List the vehicles; with a name, every value with its source."
    parser = options.build_parser("vehicles", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("name", nargs="?", metavar="V|PATH", help="a vehicle of the list, a file or a folder")
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Print the list, or one vehicle.

    Raises:
        InputError: unknown vehicle, or invalid file.
    """
    chosen = build_parser().parse_args(arguments)
    if chosen.name is None:
        _list(chosen.json)
    else:
        world, avionics = options.vehicle_files(chosen.name)
        vehicle = load_vehicle(world)
        _show(vehicle, avionics, chosen.json)
        files = [vehicle, load_flight_vehicle(avionics).file] if _flies(vehicle, avionics) else [vehicle]
        for line in options.name_warnings(*files):
            print(f"wingbeat: {line}", file=sys.stderr)
    return 0


def _list(as_json: bool) -> None:
    records = [_record(load_vehicle(name), name in flight_names()) for name in vehicle_names()]
    if as_json:
        print_document({"vehicles": records})
        return
    table = tables.plain_table(
        ("vehicle", ""), ("mass", "right"), ("span", "right"), ("can fly", ""), ("values", ""), ("", "text")
    )
    for record in records:
        counts = ", ".join(f"{count} {kind}" for kind, count in record["sources"].items() if count)
        mass, span = f"{record['mass'] * 1e3:.0f} g", f"{record['wingspan']:.2f} m"
        table.add_row(
            Text(record["name"], style="bold"),
            mass,
            span,
            "yes" if record["flies"] else "no",
            counts,
            record["title"],
        )
    console = _narrow_console()
    console.print(table)
    console.print(
        "\ncan fly: has a flight-computer file; the others can be trimmed, linearized and measured"
        "\nwingbeat vehicles NAME shows every value with its source",
        style="dim",
    )


def _narrow_console() -> Console:
    console = open_console()
    console.width = min(console.width, WIDEST)
    return console


def _record(vehicle: SimulatedVehicle, flies: bool) -> dict[str, Any]:
    return {
        "name": vehicle.name,
        "title": vehicle.title,
        "mass": total_mass(vehicle),
        "wingspan": 2.0 * vehicle.wing.semispan,
        "aerodynamics": models_of(vehicle),
        "flies": flies,
        "sources": count_kinds(vehicle.sources.values()),
    }


def count_kinds(sources: Iterable[Source]) -> dict[str, int]:
    """Count the published, identified and chosen values."""
    counts = Counter(source.kind for source in sources)
    return {kind: counts[kind] for kind in SOURCE_KINDS}


def _flies(vehicle: SimulatedVehicle, avionics: str) -> bool:
    """Return whether the vehicle has a flight computer file."""
    return avionics in flight_names() or (Path(avionics) != vehicle.path and Path(avionics).is_file())


def _show(vehicle: SimulatedVehicle, avionics: str, as_json: bool) -> None:
    """Print one vehicle; ``avionics`` is the name of its flight computer file, which need not exist."""
    flies = _flies(vehicle, avionics)
    units = file_units(vehicle.text)
    values = [
        {
            "key": key,
            "value": _value(vehicle, key),
            "unit": units.get(key),
            "kind": source.kind,
            "source": source.text,
            "fitted": vehicle.fitted.get(key),
        }
        for key, source in vehicle.sources.items()
    ]
    if as_json:
        print_document({"vehicles": [_record(vehicle, flies)], "values": values})
        return
    console = _narrow_console()
    console.print(Text(vehicle.title, style="bold"))
    console.print(Text(_models(vehicle)))
    table = tables.plain_table(("", ""), ("value", "right"), ("source", "text"))
    for value in values:
        source = Text.assemble((f"{value['kind']}: ", "dim"), str(value["source"]))
        table.add_row(value["key"], f"{_written(value['value'])}{_unit(value['unit'])}", source)
    console.print(table)
    if flies:
        flight = load_flight_vehicle(avionics)
        counts = ", ".join(f"{count} {kind}" for kind, count in count_kinds(flight.file.sources.values()).items())
        console.print(
            f"\nthe flight computer's file has {counts} values; {len(flight.defaults)} are the flight code's defaults"
            " (docs/parameters.md)",
            style="dim",
        )


def _models(vehicle: SimulatedVehicle) -> str:
    flown = vehicle.aerodynamics.model
    others = ", ".join(name for name in models_of(vehicle) if name != flown)
    return f"flown with {flown}" + (f"; --aerodynamics takes {others} too" if others else "")


def _value(vehicle: SimulatedVehicle, key: str) -> Any:
    section, _, name = key.rpartition(".")
    family, _, member = section.partition(".")
    record = vehicle.sections[family]
    return getattr(record[member] if member else record, name)


def file_units(text: str) -> dict[str, str]:
    """Return the units of a vehicle file by ``section.key``; text values have none."""
    found: dict[str, str] = {}

    def look(where: str, table: dict[str, Any]) -> None:
        for name, entry in table.items():
            key = f"{where}.{name}" if where else name
            if isinstance(entry, dict) and "value" not in entry:
                look(key, entry)
            elif isinstance(entry, dict) and isinstance(entry.get("unit"), str):
                found[key] = entry["unit"]

    look("", parse_toml(text))
    return found


def _unit(unit: str | None) -> str:
    return "" if unit in (None, "-") else f" {unit}"


def _written(value: Any) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} … {value[-1]:g}" if len(value) > 3 else " ".join(f"{number:g}" for number in value)
    return f"{value:g}" if isinstance(value, int | float) else str(value)
