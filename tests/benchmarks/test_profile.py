"""Where the time of a flight in one process goes: its ten most expensive functions (``make bench``)."""

from __future__ import annotations

import cProfile
import pstats
import sys
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table
from rows import Row, leave
from test_flight_speed import VEHICLE, computer

from avionics.missions.script import scripted_start
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

FLIGHT = 20.0
"""s"""
MOST = 10
KERNEL = "advance_ordered"
"""what a flight is made of: the compiled steps of the physics"""
LARGEST_SHARE = 0.1
"""-; of any other function alone: more would be a surprise"""
Entry = tuple[tuple[str, int, str], tuple[int, int, float, float, object]]


def profiled() -> pstats.Stats:
    """Of a flight without a log; its kernels are compiled before."""
    fly(SimulatedWorld(load_vehicle(VEHICLE), Scenario(duration=2.0)), computer(), scripted_start())
    world, autopilot = SimulatedWorld(load_vehicle(VEHICLE), Scenario(duration=FLIGHT)), computer()
    profile = cProfile.Profile()
    profile.runcall(fly, world, autopilot, scripted_start())
    return pstats.Stats(profile)


def place(file: str, line: int, name: str) -> str:
    if file == "~":
        return name.partition(" at 0x")[0].strip("<>")
    return f"{'/'.join(Path(file).parts[-3:])}:{line} {name}"


@pytest.mark.bench
def test_ten_most_expensive_functions() -> None:
    """Own time; what a compiled kernel takes is in the function that calls it. The profiler's own cost is in too."""
    told = profiled().stats  # type: ignore[attr-defined]
    entries: list[Entry] = sorted(told.items(), key=lambda entry: entry[1][2], reverse=True)
    whole = sum(entry[1][2] for entry in entries)
    table = Table(title=f"A flight of {FLIGHT:g} s in one process, {whole:.2f} s under the profiler")
    for heading in ("own time, s", "of the whole", "calls", "function"):
        table.add_column(heading, justify="left" if heading == "function" else "right", no_wrap=True)
    for where, (_, calls, own, *_) in entries[:MOST]:
        table.add_row(f"{own:.3f}", f"{own / whole:.1%}", f"{calls:,}", place(*where))
    Console(file=sys.stdout, width=150).print(table)
    most, second = entries[:2]
    for number, (where, spent), requested in (
        ("most", most, ""),
        ("second most", second, f"at most {LARGEST_SHARE:g}"),
    ):
        what = f"{number} expensive function of a flight: {place(*where)}"
        leave(Row(what, spent[2] / whole, None, "of the profile", requested=requested))
    assert most[0][2].rstrip(">").endswith(KERNEL)
    assert second[1][2] < LARGEST_SHARE * whole
