"""From tables and their map to the results of everything that the map requests."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from logs.identification.diagnostics.context import Context
from logs.identification.diagnostics.signals import joined, measured, moves
from logs.identification.diagnostics.table import diagnose
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.modes import ModesResult
from logs.identification.results import EstimationResult
from logs.identification.sources.table.columns import read_columns
from logs.identification.sources.table.config import AeroSection, Map, ModesSection, OutputError, load_map
from logs.identification.sources.table.constants import read_constants
from logs.identification.sources.table.discontinuities import apart
from logs.identification.sources.table.maneuvers import Cut, cut, file_of
from logs.identification.sources.table.prepare import stroke_averaged
from logs.identification.sources.table.vane import at_centre
from logs.identification.tables.fit_registry import SECTION_FITS
from logs.identification.tables.load_cell_tests import tare_name
from logs.identification.tables.modes import modes_fit, with_lateral_modes
from logs.identification.tables.output_errors import model_fit
from logs.identification.tables.regressions import check_names, regression_fit
from logs.identification.tables.results import TableIdentification
from logs.identification.tables.subjects import AERO, ALL, MODES, PATH, SECTIONS, STAND, STROKE, SUBJECTS, TWIST
from wingbeat.errors import InputError

T = TypeVar("T")
DYNAMIC = (MODES, PATH, STROKE, STAND, TWIST)
"""sections that need samples in their order"""
register({"unusable": Entry("{reason}", "A section or fit of the map cannot be computed from these tables.")})


def identify_tables(files: Sequence[Path], mapping: Path, what: str = ALL) -> TableIdentification:
    """Identify ``what`` (`SUBJECTS`) from tables by their map.

    Raises:
        InputError: a file or map that cannot be used, or a map without a section for ``what``.
    """
    chosen = load_map(mapping)
    if what not in SUBJECTS:
        raise InputError(f"a table gives {', '.join(SUBJECTS)}; {what!r} needs a log")
    wanted = SECTIONS if what == ALL else (what,)
    if all(getattr(chosen, name) is None for name in wanted):
        *others, last = (f"[{name}]" for name in wanted)
        named = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"map {mapping}: it has no section {named} that says what to fit")
    tables = [read_columns(path, chosen.table) for path in files]
    if chosen.experiment.kind == "steady":
        dynamic = [name for name in DYNAMIC if getattr(chosen, name) is not None and what in (name, ALL)]
        if dynamic:
            raise InputError(f"map {mapping}: [{dynamic[0]}] needs a motion, not steady readings ([experiment] kind)")
    try:
        maneuvers = cut(tables, chosen.signals, chosen.time, chosen.manoeuvres, chosen.prepare)
        smoothed = {} if chosen.prepare is None else chosen.prepare.smooth
        steady = chosen.experiment.kind == "steady"
        fitted, held_out = (
            tuple(one._replace(smoothed=smoothed, steady=steady) for one in part)
            for part in (maneuvers.fitted, maneuvers.held_out)
        )
        maneuvers = maneuvers._replace(fitted=fitted, held_out=held_out)
        return _identified(chosen, maneuvers, what)
    except InputError as error:
        raise InputError(f"{error} (map {mapping})") from None


def _identified(chosen: Map, raw: Cut, what: str) -> TableIdentification:
    """Each fit on its own: one that cannot be computed does not prevent the others.

    Raises:
        InputError: none of them can be computed, or a regressor is misspelt.
    """
    constants = read_constants(chosen.constants)
    modes_section = chosen.modes if what in (MODES, ALL) else None
    aero = chosen.aero if what in (AERO, ALL) else None
    _check(aero, raw, constants)
    prepared = raw
    if modes_section is not None or aero is not None:
        separate = raw if chosen.experiment.kind == "steady" else apart(raw)
        prepared = at_centre(separate, constants, _flow_angles(modes_section, aero))
    findings: list[Finding] = []
    if what in (MODES, AERO, PATH, ALL) and chosen.stand is None:
        every = (*prepared.fitted, *prepared.held_out)
        findings += diagnose("data", Context(every, constants, _inputs(modes_section, aero)))
    missing: list[Finding] = []
    fits: list[EstimationResult] = []
    modes: ModesResult | None = None
    fill = chosen.time.fill
    if modes_section is not None:
        section, averaged = modes_section, _averaged(modes_section, prepared, chosen, findings)
        maneuvers = _attempt("modes", lambda: _modes(section, averaged, raw, constants, fill), missing)
        fits, modes = maneuvers or ([], None)
    for name, work in _aero_fits(aero, prepared, raw, constants, fill) if aero is not None else ():
        one = _attempt(name, work, missing)
        fits += [] if one is None else [one]
    for name, section_fit in SECTION_FITS.items():
        asked = getattr(chosen, name)
        if asked is not None and what in (name, ALL):
            fits += _attempt(name, partial(section_fit, asked, raw, constants, fill), missing) or []
    if not fits and modes is None:
        raise InputError("; ".join(dict.fromkeys(one.text for one in missing)))
    inputs = _inputs(chosen.modes, chosen.aero)
    findings += diagnose("comparison", Context(prepared.fitted, constants, inputs, results=tuple(fits)))
    tare = tare_name(chosen.stand, prepared) if chosen.stand is not None and what == STAND else None
    records = tuple(one for one in (*prepared.fitted, *prepared.held_out) if one.name != tare)
    fitted, held = (tuple(o.name for o in part if o.name != tare) for part in (prepared.fitted, prepared.held_out))
    return TableIdentification(
        tuple(dict.fromkeys(map(file_of, records))), fitted, held, tuple(fits), modes,
        (*prepared.findings, *findings), tuple(missing), records, inputs, constants, prepared.delays,
    )  # fmt: skip


def _check(aero: AeroSection | None, maneuvers: Cut, constants: dict[str, float]) -> None:
    """Reject misspelt regressors before anything is fitted.

    Raises:
        InputError: a regressor that is neither a signal nor computed from one, or a section without a fit.
    """
    if aero is None:
        return
    if not aero.regressions and not aero.output_error:
        raise InputError("[aero] asks for nothing: write [[aero.regressions]] or [[aero.output_error]]")
    signals = {name: None for one in maneuvers.fitted for name in one.signals}
    for regression in aero.regressions:
        check_names(regression, signals, constants)


def _flow_angles(modes: ModesSection | None, aero: AeroSection | None) -> tuple[str, ...]:
    """Those of alpha and beta that the fits use, or compute a signal from."""
    words: list[str] = []
    for section in (*((modes,) if modes else ()), *(aero.output_error if aero else ())):
        words += (*section.inputs, *section.outputs)
    for one in aero.regressions if aero else ():
        words += re.findall(r"\w+", " ".join((one.response, *one.regressors, *one.always)))
    used = {"alpha": {"C_L", "C_D", "u", "w"}, "beta": {"v"}}
    return tuple(
        angle for angle, of in used.items() if any(w == angle or w.startswith(f"{angle}_") or w in of for w in words)
    )


def _inputs(modes: ModesSection | None, aero: AeroSection | None) -> tuple[str, ...]:
    sections = (*((modes,) if modes else ()), *(aero.output_error if aero else ()))
    return tuple(dict.fromkeys(name for section in sections for name in section.inputs))


def _attempt(name: str, work: Callable[[], T], missing: list[Finding]) -> T | None:
    try:
        return work()
    except InputError as error:
        missing.append(Finding("unusable", "withheld", name, details={"reason": str(error)}))
        return None


def _averaged(section: ModesSection, maneuvers: Cut, chosen: Map, findings: list[Finding]) -> Cut:
    """The maneuvers averaged over the stroke if the map says so or a vibration dominates an output."""
    setting = None if chosen.prepare is None else chosen.prepare.stroke_average
    averaged, more = stroke_averaged(maneuvers, section.inputs, section.outputs, setting)
    findings += more
    return averaged


def _check_outputs(names: Sequence[str], maneuvers: Cut) -> None:
    """Reject constant outputs, on which no search converges.

    Raises:
        InputError: one of them is constant in all maneuvers.
    """
    for name in names:
        values = joined(name, maneuvers.fitted)
        if measured(values) and not moves(values):
            files = ", ".join(dict.fromkeys(map(file_of, maneuvers.fitted)))
            raise InputError(f"{name} is constant in {files}: leave it out, or is it the wrong column?")


def _modes(
    section: ModesSection, maneuvers: Cut, raw: Cut, constants: dict[str, float], fill: float | None
) -> tuple[list[EstimationResult], ModesResult]:
    _check_outputs(section.outputs, raw)
    return modes_fit(section, maneuvers, constants, fill)


def _aero_fits(
    section: AeroSection, maneuvers: Cut, raw: Cut, constants: dict[str, float], fill: float | None
) -> list[tuple[str, Callable[[], EstimationResult]]]:
    """Every fit of the section by name."""
    work: list[tuple[str, Callable[[], EstimationResult]]] = [
        (f"regression of {one.response}", partial(regression_fit, one, maneuvers, constants))
        for one in section.regressions
    ]
    for model in section.output_error:

        def fit(model: OutputError = model) -> EstimationResult:
            _check_outputs(model.outputs, raw)
            return with_lateral_modes(model_fit("aero", model, maneuvers, constants, fill))

        work.append((f"output error, {model.model}", fit))
    return work
