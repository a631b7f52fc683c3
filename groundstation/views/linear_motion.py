"""Report of linear models."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.text import Text

from groundstation.views import tables
from sim_bridge.flight_mechanics.averaged import AveragedModel
from sim_bridge.flight_mechanics.linear import Linearization, averaged_modes, difference, warnings
from sim_bridge.flight_mechanics.modes import Mode, aliases
from sim_bridge.flight_mechanics.orbit import Orbit

STATES = ("u m/s", "w m/s", "q rad/s", "theta rad")


def linear_tables(linear: Linearization, orbit: Orbit) -> RenderableType:
    """Show the modes of both models, A and B, and warnings."""
    notes = [Text(difference(linear), style="dim"), *(Text(f"beware: {words}") for words in warnings(linear, orbit))]
    return Group(
        Text(), modes_table(linear, orbit), Text(), matrices_table(linear.averaged), *(note for note in notes if note)
    )


def modes_table(linear: Linearization, orbit: Orbit) -> tables.PlainTable:
    """Show one row per mode: of the stroke map those slower than the flapping, then those of A."""
    numbers = (("frequency", "right"), ("damping", "right"), ("period", "right"), ("half or double", "right"))
    table = tables.plain_table(("", tables.GROUP), ("", ""), *numbers)
    slow = [mode for mode in linear.floquet if mode.natural_frequency < 2.0 * math.pi * orbit.inputs.frequency]
    for i, mode in enumerate(slow):
        name = mode.name or _unnamed(mode)
        note = " aliases?" if aliases(mode, orbit.inputs.frequency) else ""
        table.add_row(
            "" if i else "stroke map", Text(name, style="bold" if mode.name else "dim"), *_cells(mode, note)
        )
    for i, mode in enumerate(averaged_modes(linear.averaged)):
        table.add_row(
            "" if i else "A", Text(mode.name or "doubtful", style="bold" if mode.name else "dim"), *_cells(mode)
        )
    return table


def _unnamed(mode: Mode) -> str:
    of = "wings" if mode.body_share < 0.5 else "body and wings"
    return f"{of}, {'lateral' if mode.lateral else 'symmetric'}"


def matrices_table(model: AveragedModel) -> tables.PlainTable:
    """Show A and B, a row for each state derivative."""
    columns = ((name, "right") for name in (*STATES, "elevator rad", "unexplained"))
    table = tables.plain_table(("A, B", ""), *columns)
    for i, state in enumerate(STATES):
        left = f"{100.0 * model.unexplained[i]:.2g} %" if i < len(model.unexplained) else ""
        table.add_row(f"rate of {state.split()[0]}", *(f"{value:.4g}" for value in (*model.a[i], model.b[i])), left)
    return table


def _cells(mode: Mode, note: str = "") -> tuple[str, ...]:
    half = f"{'half' if mode.time_to_half > 0.0 else 'double'} in {abs(mode.time_to_half):.3g} s"
    if mode.eigenvalue.imag == 0.0:
        return "", "aperiodic", "", half
    return f"{mode.natural_frequency:.3g} rad/s{note}", f"{mode.damping:.3f}", f"{mode.period:.3g} s", half
