"""From tables and their map to everything that the map asks for."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from logs.identification.diagnostics.consistency_checks import check_plausible
from logs.identification.diagnostics.constant_channels import refuse_still, with_still, without_still
from logs.identification.models.modes import ModesResult
from logs.identification.results import Unidentified
from logs.identification.sources.table.columns import Columns, read_columns
from logs.identification.sources.table.config import AeroSection, Map, ModesSection, OutputError, Regression, load_map
from logs.identification.sources.table.constants import read_constants
from logs.identification.sources.table.discontinuities import apart
from logs.identification.sources.table.maneuvers import Cut, cut, file_of
from logs.identification.sources.table.vane import at_centre
from logs.identification.tables import load_cell_tests as stands
from logs.identification.tables.fit_registry import ROOMS
from logs.identification.tables.modes import modes_fit
from logs.identification.tables.output_errors import output_error_fit
from logs.identification.tables.regressions import check_names, regression_fit
from logs.identification.tables.results import TableFit, TableIdentification
from logs.identification.tables.subjects import AERO, ALL, MODES, PATH, SECTIONS, STAND, SUBJECTS
from logs.identification.tables.systems import with_lateral_modes
from wingbeat.errors import InputError

T = TypeVar("T")


def identify_tables(files: Sequence[Path], mapping: Path, what: str = ALL) -> TableIdentification:
    """Identify ``what`` (`SUBJECTS`) from tables by their map.

    Raises:
        InputError: a file or map that cannot be used, or a map that does not ask for ``what``.
    """
    chosen = load_map(mapping)
    _asked(chosen, mapping, what)
    tables = [read_columns(path, chosen.table) for path in files]
    return _of_map(mapping, lambda: _identified(chosen, _cut(tables, chosen), what))


def _cut(tables: list[Columns], chosen: Map) -> Cut:
    return cut(tables, chosen.signals, chosen.time, chosen.manoeuvres, chosen.prepare)


def _asked(chosen: Map, mapping: Path, what: str) -> None:
    if what not in SUBJECTS:
        raise InputError(f"a table gives {', '.join(SUBJECTS)}; {what!r} needs a log")
    wanted = SECTIONS if what == ALL else (what,)
    if all(getattr(chosen, name) is None for name in wanted):
        *others, last = (f"[{name}]" for name in wanted)
        named = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"map {mapping}: it has no section {named} that says what to fit")


def _of_map(mapping: Path, work: Callable[[], T]) -> T:
    try:
        return work()
    except InputError as error:
        raise InputError(f"{error} (map {mapping})") from None


def _identified(chosen: Map, found: Cut, what: str) -> TableIdentification:
    """Each fit for itself: what the one lacks the others may not need.

    Raises:
        InputError: none of them can be had, or a regressor is misspelt.
    """
    constants = read_constants(chosen.constants)
    _check_regressors(chosen, found, constants, what)
    seen = found
    if what in (MODES, AERO, ALL) and (chosen.modes or chosen.aero):
        found = at_centre(apart(found), constants, _flow_angles(chosen, what))
    if what in (MODES, AERO, PATH, ALL) and chosen.stand is None:
        check_plausible((*found.fitted, *found.held_out), constants, _in_radians(chosen))
    missing: list[Unidentified] = []
    fits: list[TableFit] = []
    modes: ModesResult | None = None
    if chosen.modes is not None and what in (MODES, ALL):
        asked = chosen.modes
        told = _attempt("modes", lambda: _modes(asked, found, seen, constants, chosen.time.fill), missing)
        fits, modes = told or ([], None)
    if chosen.aero is not None and what in (AERO, ALL):
        for name, work in _aero(chosen.aero, found, seen, constants, chosen.time.fill):
            one = _attempt(name, work, missing)
            fits += [] if one is None else [one]
    fits += _of_rooms(chosen, seen, constants, what, missing)
    if not fits and modes is None:
        raise InputError("; ".join(dict.fromkeys(one.reason for one in missing)))
    tare = stands.tare_name(chosen.stand, found) if chosen.stand is not None and what == STAND else None
    fitted, held = (tuple(one.name for one in part if one.name != tare) for part in (found.fitted, found.held_out))
    every = (*found.fitted, *found.held_out)
    files = tuple(dict.fromkeys(file_of(one) for one in every))
    return TableIdentification(
        files, fitted, held, tuple(fits), modes, tuple(dict.fromkeys(found.notes)), tuple(missing),
        tuple(one for one in every if one.name != tare), _inputs(chosen), constants,
        found.delays,
    )  # fmt: skip


def _check_regressors(chosen: Map, found: Cut, constants: dict[str, float], what: str) -> None:
    """Refuse words misspelt before anything is fitted.

    Raises:
        InputError: a regressor that nothing tells.
    """
    if chosen.aero is not None and what in (AERO, ALL):
        signals = {name: None for one in found.fitted for name in one.signals}
        for regression in chosen.aero.regressions:
            check_names(regression, signals, constants)


def _of_rooms(
    chosen: Map, found: Cut, constants: dict[str, float], what: str, missing: list[Unidentified]
) -> list[TableFit]:
    """The fits of the sections that have a room of their own."""
    fits: list[TableFit] = []
    for name, room in ROOMS.items():
        asked = getattr(chosen, name)
        if asked is not None and what in (name, ALL):
            fits += _attempt(name, partial(room, asked, found, constants, chosen.time.fill), missing) or []
    return fits


def _flow_angles(chosen: Map, what: str) -> tuple[str, ...]:
    """Those of alpha and beta that what is fitted names, or is made of."""
    words: list[str] = []
    if chosen.modes is not None and what in (MODES, ALL):
        words += (*chosen.modes.inputs, *chosen.modes.outputs)
    if chosen.aero is not None and what in (AERO, ALL):
        for model in chosen.aero.output_error:
            words += (*model.inputs, *model.outputs)
        for one in chosen.aero.regressions:
            words += re.findall(r"\w+", " ".join((one.response, *one.regressors, *one.always)))
    made = {"alpha": {"C_L", "C_D", "u", "w"}, "beta": {"v"}}
    return tuple(
        angle for angle, of in made.items() if any(w == angle or w.startswith(f"{angle}_") or w in of for w in words)
    )


def _inputs(chosen: Map) -> tuple[str, ...]:
    sections = (*((chosen.modes,) if chosen.modes else ()), *(chosen.aero.output_error if chosen.aero else ()))
    return tuple(dict.fromkeys(name for section in sections for name in section.inputs))


def _in_radians(chosen: Map) -> tuple[str, ...]:
    """Inputs that the map calls radians."""
    entries = {name: chosen.signals[name].entry for name in _inputs(chosen) if name in chosen.signals}
    return tuple(name for name, entry in entries.items() if entry.unit == "rad")


def _attempt(name: str, work: Callable[[], T], missing: list[Unidentified]) -> T | None:
    try:
        return work()
    except InputError as error:
        missing.append(Unidentified(name, str(error)))
        return None


def _modes(
    asked: ModesSection, found: Cut, seen: Cut, constants: dict[str, float], fill: float | None
) -> tuple[list[TableFit], ModesResult]:
    refuse_still(asked.outputs, seen.fitted)
    fits, modes = modes_fit(asked, found, constants, fill)
    return [with_still(one, (), asked.outputs, seen.fitted) for one in fits], modes


def _aero(
    section: AeroSection, found: Cut, seen: Cut, constants: dict[str, float], fill: float | None
) -> list[tuple[str, Callable[[], TableFit]]]:
    """What is asked for, by name, and the work; ``seen`` has the signals as they were measured."""
    if not section.regressions and not section.output_error:
        raise InputError("[aero] asks for nothing: write [[aero.regressions]] or [[aero.output_error]]")
    work: list[tuple[str, Callable[[], TableFit]]] = [
        (f"regression of {one.response}", partial(_regression, one, found, seen, constants))
        for one in section.regressions
    ]
    for model in section.output_error:
        work.append((f"output error, {model.model}", partial(_model_fit, model, found, seen, constants, fill)))
    return work


def _regression(asked: Regression, found: Cut, seen: Cut, constants: dict[str, float]) -> TableFit:
    moving, lost = without_still(asked, seen.fitted)
    return with_still(regression_fit(moving, found, constants), lost, asked.regressors, seen.fitted)


def _model_fit(
    asked: OutputError, found: Cut, seen: Cut, constants: dict[str, float], fill: float | None
) -> TableFit:
    refuse_still(asked.outputs, seen.fitted)
    fit = with_lateral_modes(*output_error_fit("aero", asked, found, constants, fill))
    return with_still(fit, (), asked.outputs, seen.fitted)
