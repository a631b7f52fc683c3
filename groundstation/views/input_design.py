"""Report of a designed identification input."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.text import Text

from groundstation.views import wording
from groundstation.views.tables import NUMBER, UNIT, plain_table
from logs.identification.input_design.design import (
    NAMES,
    DesignSpec,
    InputDesign,
    combined_error,
    command_line,
    mission_item,
)
from logs.identification.input_design.prediction import Prior
from sim_bridge.tuning.model import LinearModel

WHITE = "of white sensor noise alone; gusts, and what the wing's shaking leaves after averaging, come on top (--gust)"
SHARE_SHOWN = 10.0
"""-; relative error above which an estimate is not useful"""


def plan_view(
    model: LinearModel, prior: Prior, requested: DesignSpec, designs: InputDesign, steps: str
) -> RenderableType:
    """Show heading, predicted errors, envelope, and the flight instructions.

    Args:
        steps: how the file of another autopilot is flown; empty for Wingbeat's own flight code.
    """
    own = [Text(mission_item(designs.excitation)), Text(command_line(designs.excitation), style="bold")]
    return Group(
        Text.assemble(("predicted errors", "bold"), f", on {model.origin}"),
        _errors(requested, designs),
        Text(_basis(prior, requested, designs), style="dim"),
        _envelope(requested, designs),
        Text(f"{designs.excitation.repeats} x in {designs.flight_time:.0f} s of flight", style="dim"),
        *(Text(line, style="dim") for line in _wanted(requested, designs)),
        Text(),
        *([Text(steps)] if steps else own),
    )


def _errors(requested: DesignSpec, designs: InputDesign) -> RenderableType:
    earlier = (("today", NUMBER), ("together", NUMBER)) if requested.known else ()
    table = plain_table(("", ""), ("value", NUMBER), ("standard error", NUMBER), ("", NUMBER), ("", UNIT), *earlier)
    for one in designs.predicted:
        value, error = wording.significant(one.value, one.standard_error)
        share = one.standard_error / abs(one.value) if one.value else math.inf
        relative = f"{100.0 * share:.2g} %" if share < SHARE_SHOWN else ""
        unit = "" if one.unit == "-" else one.unit
        today = requested.known.get(one.name)
        both = "" if today is None else f"{combined_error(one.standard_error, today):.2g}"
        more = ("" if today is None else f"{today:.2g}", both) if requested.known else ()
        table.add_row(_name(one.name), value, Text(error, style="bold"), relative, unit, *more)
    return table


def _wanted(requested: DesignSpec, designs: InputDesign) -> list[str]:
    """Return a line for each parameter whose accuracy is required."""
    lines = []
    for one in designs.predicted:
        limit = requested.required.get(one.name)
        if limit is None or not one.value:
            continue
        known, percent = requested.known.get(one.name), 100.0 / abs(one.value)
        before = "" if known is None else f", {percent * known:.2g} % today"
        after = percent * combined_error(one.standard_error, known)
        met = "met" if after <= 100.1 * limit else "not met"
        lines.append(f"{_name(one.name)}: {100.0 * limit:.3g} % wanted{before}, {after:.2g} % after it: {met}")
    return lines


def _name(name: str) -> str:
    return wording.words(name) if name.islower() else name


def _basis(prior: Prior, requested: DesignSpec, designs: InputDesign) -> str:
    q, x, z = prior.noise
    sensors = f"noise {q:.2g} rad/s, {x:.2g} and {z:.2g} m/s^2 at {1.0 / prior.step:.0f} Hz"
    if prior.residuals is not None and requested.gust is None:
        return f"errors by the residuals of the flight, and {prior.inflation:.2g} times for differences of maneuvers"
    if requested.gust is None:
        return f"{sensors}: errors {WHITE}"
    gusts = (
        f"gusts of {requested.gust.sigma:g} m/s make the frequency's error {designs.gust_factor:.2g} times as large"
    )
    return f"{sensors}; {gusts}"


def _envelope(requested: DesignSpec, designs: InputDesign) -> RenderableType:
    table = plain_table(("change from the trim", ""), ("reached", NUMBER), ("limit", NUMBER), ("", UNIT))
    for field, (words, unit) in NAMES.items():
        reached, limit = getattr(designs.reached, field), getattr(requested.limits, field)
        style = "bold" if field == designs.bound_by else ("yellow" if reached > limit * 1.001 else "")
        table.add_row(words, Text(_amount(reached, unit), style=style), _amount(limit, unit), _unit(unit))
    return table


def _amount(value: float, unit: str) -> str:
    if math.isinf(value):
        return "none"
    return f"{math.degrees(value):.1f}" if unit == "rad" else f"{value:.2f}"


def _unit(unit: str) -> str:
    return "deg" if unit == "rad" else unit
