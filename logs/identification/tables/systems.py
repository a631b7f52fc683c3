"""Modes that a map's fitted linear model has: its matrix as a function of what was found."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Fit
from logs.identification.models.lateral_modes import DUTCH_ROLL, LateralModes, lateral_modes
from logs.identification.report.document import Bar, Chapter, Intervals
from logs.identification.results import Array, Unidentified
from logs.identification.statistics.parameter_uncertainty import Spread
from logs.identification.tables.models import Chosen
from logs.identification.tables.results import EXPLAINS_LITTLE, LITTLE, TableFit

LATERAL = "lateral"
TITLE = "Lateral modes"


class System(NamedTuple):
    """The matrix of a fitted model, or why its modes may not be told."""

    of: Callable[[Array], Array]
    """from the free parameters (p,) to A (n, n)"""
    failure: str
    """-; empty where they may"""


def fitted_system(table: TableFit, fit: Fit, chosen: Chosen) -> System:
    """What the modes of a linear model's ``fit`` are told from."""
    held = {name: one.fixed for name, one in chosen.parameters.items() if one.fixed is not None}
    base = {name: one.value for name, one in chosen.model.parameters.items()} | held

    def of(values: Array) -> Array:
        return chosen.system(base | dict(zip(fit.names, values.tolist(), strict=True)))

    if fit.failure:
        return System(of, fit.failure)
    if all(one.r_squared < LITTLE for one in table.outputs if not one.held_out):
        return System(of, EXPLAINS_LITTLE)
    lost = [one for one in table.fitted.unidentified if one.name in fit.names and _share(of, fit, one.name) > 0]
    return System(of, f"{lost[0].name} is not identified: {lost[0].reason}" if lost else "")


def _share(system: Callable[[Array], Array], fit: Fit, name: str) -> float:
    """How much a parameter moves the system."""
    place = fit.names.index(name)
    moved = fit.values.copy()
    moved[place] += max(abs(float(moved[place])), 1.0)
    return float(abs(system(moved) - system(fit.values)).sum())


def with_lateral_modes(table: TableFit, fit: Fit, chosen: Chosen) -> TableFit:
    """A lateral model's fit with its modes beside the numbers; any other's as it is."""
    if table.model != LATERAL or fit.failure:
        return table
    system = fitted_system(table, fit, chosen)
    if system.failure:
        found = LateralModes((), (Unidentified(DUTCH_ROLL, system.failure),))
    else:
        found = lateral_modes(system.of, fit.values, Spread(np.asarray(fit.covariance), fit.degrees))
    notes = tuple(f"{one.name} not identified: {one.reason}" for one in found.unidentified)
    bars = tuple(Bar(one.name, one) for one in found.estimates)
    chapter = Chapter(TITLE, notes, plots=(Intervals("", bars),) if bars else ())
    return table._replace(modes=found.estimates, lost=found.unidentified, chapters=(*table.chapters, chapter))
