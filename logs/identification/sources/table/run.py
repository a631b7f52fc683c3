"""From tables and their map to the results of everything that the map requests."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.signals import joined, measured, moves
from logs.identification.diagnostics.table import diagnose
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.modes import ModesResult
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.table import bench
from logs.identification.sources.table.columns import read_columns
from logs.identification.sources.table.config import (
    ALL,
    FORMER_SUBJECTS,
    SECTIONS,
    SUBJECTS,
    AeroSection,
    Map,
    ModesSection,
    load_map,
)
from logs.identification.sources.table.derived import SLOPES, at_center_of_mass
from logs.identification.sources.table.maneuvers import DataSplit, data_split, files_of, split_at_discontinuities
from logs.identification.sources.table.model_fit import METHODS, fit_by_row, model_fit
from logs.identification.sources.table.modes import modes_fit, with_lateral_modes
from logs.identification.sources.table.path import path_fit
from logs.identification.sources.table.prepare import stroke_averaged
from logs.identification.sources.table.quantities import read_constants
from logs.identification.sources.table.regression import check_names, regression_fit
from logs.identification.sources.table.stand import stand_fits, tare_of
from logs.identification.sources.table.stroke import stroke_fits
from wingbeat.errors import InputError


class TableIdentification(NamedTuple):
    """Everything that was identified from one or several tables."""

    files: tuple[str, ...]
    experiments: tuple[str, ...]
    """-; names of the maneuvers that were fitted"""
    held_out: tuple[str, ...]
    """-; names of those that were only predicted"""
    fits: tuple[EstimationResult, ...]
    modes: ModesResult | None
    """by every method; None if not requested"""
    findings: tuple[Finding, ...] = ()
    """on the data and on the results together"""
    missing: tuple[Finding, ...] = ()
    """sections or fits of the map (subject) without a result"""
    records: tuple[Experiment, ...] = ()
    """the maneuvers, fitted ones first"""
    inputs: tuple[str, ...] = ()
    """-; signals that the map calls inputs"""
    constants: Mapping[str, float] = {}
    """SI; of the map"""
    delays: tuple[Estimate, ...] = ()
    """s; measured delays of signals, by name"""


T = TypeVar("T")
DYNAMIC = ("modes", "path", "stroke", "load_cell", "twist")
"""sections that need samples in their order"""
UNCORRELATED = 1.0
"""-; mean square of the differences between rows over the variance (von Neumann's ratio: 2 of independent readings,
near 0 of a sampled motion), above which rows without a time are steady readings"""
SectionFit = Callable[[Any, DataSplit], list[EstimationResult]]
SECTION_FITS: Mapping[str, SectionFit] = {
    "path": path_fit,
    "stroke": stroke_fits,
    "load_cell": stand_fits,
    "torque_speed": bench.torque_speed_fit,
    "twist": bench.twist_fits,
    "servo": bench.servo_fit,
    "power": bench.power_fit,
}
"""(section, data) -> results, by section; [modes] and [aero] have several fits each"""

register({
    "unusable": Entry("{reason}", "A section or fit of the map cannot be computed from these tables."),
    "steady_readings": Entry(
        "rows have no time and are not correlated: taken as steady readings",
        "Independent readings of a bench; set [experiment] kind to state it.",
    ),
})  # fmt: skip


def identify_tables(
    files: Sequence[Path], mapping: Path, what: str = ALL, method: str | None = None
) -> TableIdentification:
    """Identify ``what`` (`SUBJECTS`) from tables by their map, the modes by ``method`` instead of the map's.

    Raises:
        InputError: a file or map that cannot be used, or a map without a section for ``what``.
    """
    config, what = load_map(mapping), FORMER_SUBJECTS.get(what, what)
    if what not in SUBJECTS:
        raise InputError(f"a table gives {', '.join(SUBJECTS)}; {what!r} needs a log")
    requested = [name for name in (SECTIONS if what == ALL else (what,)) if getattr(config, name) is not None]
    if not requested:
        *others, last = (f"[{name}]" for name in (SECTIONS if what == ALL else (what,)))
        names = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"map {mapping}: it has no section {names} that says what to fit")
    if method is not None:
        if config.modes is None or "modes" not in requested:
            raise InputError(f"map {mapping}: --method is of [modes], which is not identified")
        config = config._replace(modes=config.modes._replace(method=method))
    dynamic = [name for name in DYNAMIC if name in requested]
    if dynamic and config.experiment.kind == "steady":
        raise InputError(f"map {mapping}: [{dynamic[0]}] needs a motion, not steady readings ([experiment] kind)")
    tables = [read_columns(path, config.table) for path in files]
    try:
        data = data_split(tables, config.signals, config.time, config.maneuvers, config.prepare)
        data = data._replace(constants=read_constants(config.constants))
        return _identified(config, requested, _with_kind(data, config, requested))
    except InputError as error:
        raise InputError(f"{error} (map {mapping})") from None


def _with_kind(data: DataSplit, config: Map, requested: Sequence[str]) -> DataSplit:
    """The data marked as steady readings if the map says so, or if rows without a time are not correlated."""
    kind = config.experiment.kind
    sections = [getattr(config, name) for name in requested]
    used = _words(*(str(value) for section in sections for value in section))
    derivatives = any(
        one.domain != "time" or SLOPES.keys() & _words(one.response, *one.regressors)
        for section in sections
        for one in getattr(section, "regressions", ())
    )
    simulated = any(getattr(section, "output_error", ()) for section in sections)
    motion = derivatives or simulated or any(name in DYNAMIC for name in requested)
    if kind is None and config.time.column is None and not motion:
        parts = [
            (values / float(np.nanmax(np.abs(values))))
            for one in data.fitted
            for name, values in one.signals.items()
            if name in used and moves(values)
        ]
        if any(np.nanmean(np.diff(part) ** 2) > UNCORRELATED * np.nanvar(part) for part in parts):
            kind = "steady"
            data = data._replace(findings=(*data.findings, Finding("steady_readings", "info")))
    return data.map(lambda one: one._replace(steady=True)) if kind == "steady" else data


def _identified(config: Map, requested: Sequence[str], raw: DataSplit) -> TableIdentification:
    """Each fit separately: one that cannot be computed does not prevent the others.

    Raises:
        InputError: none of them can be computed, or a regressor is misspelt.
    """
    modes_section = config.modes if "modes" in requested else None
    aero = config.aero if "aero" in requested else None
    if aero is not None:
        _check(aero, raw)
    inputs = _inputs(modes_section, aero)
    data = raw
    if modes_section is not None or aero is not None:
        separate = raw if raw.fitted[0].steady else split_at_discontinuities(raw)
        data = at_center_of_mass(separate, _flow_angles(modes_section, aero))
    findings = [*data.findings]
    if config.load_cell is None and {"modes", "aero", "path"} & set(requested):
        findings += diagnose("data", Context(data.all, raw.constants, inputs))
    missing: list[Finding] = []
    fits: list[EstimationResult] = []
    modes: ModesResult | None = None
    if modes_section is not None:
        setting = None if config.prepare is None else config.prepare.stroke_average
        averaged = stroke_averaged(data, modes_section.inputs, modes_section.outputs, setting)
        findings += averaged.findings[len(data.findings) :]
        fits, modes = _attempt("modes", partial(_modes, modes_section, averaged, raw), missing) or ([], None)
    for name, work in _aero_fits(aero, data, raw) if aero is not None else ():
        one = _attempt(name, work, missing)
        fits += [] if one is None else [one]
    for name, fit in SECTION_FITS.items():
        if name in requested:
            fits += _attempt(name, partial(fit, getattr(config, name), raw), missing) or []
    if not fits and modes is None:
        raise InputError("; ".join(dict.fromkeys(one.text for one in missing)))
    every_input = _inputs(config.modes, config.aero)
    findings += diagnose("comparison", Context(data.fitted, raw.constants, every_input, results=tuple(fits)))
    tare = tare_of(config.load_cell, data) if config.load_cell is not None and requested == ["load_cell"] else None
    fitted, held = ([one for one in part if one is not tare] for part in (data.fitted, data.held_out))
    return TableIdentification(
        tuple(dict.fromkeys(one.file for one in (*fitted, *held))),
        tuple(one.name for one in fitted), tuple(one.name for one in held), tuple(fits), modes,
        tuple(findings), tuple(missing), (*fitted, *held), every_input, raw.constants, raw.delays,
    )  # fmt: skip


def _check(aero: AeroSection, data: DataSplit) -> None:
    """Reject an empty section and misspelt regressors before anything is fitted.

    Raises:
        InputError: a regressor that is neither a signal nor computed from one, or a section without a fit.
    """
    if not aero.regressions and not aero.output_error:
        raise InputError("[aero] has no fit: write [[aero.regressions]] or [[aero.output_error]]")
    signals = dict.fromkeys(name for one in data.fitted for name in one.signals)
    for regression in aero.regressions:
        check_names(regression, signals, data.constants)


def _words(*expressions: str) -> set[str]:
    return set(re.findall(r"\w+", " ".join(expressions)))


def _flow_angles(modes: ModesSection | None, aero: AeroSection | None) -> tuple[str, ...]:
    """Those of alpha and beta that the fits use, or compute a signal from."""
    words: set[str] = set()
    for section in (*((modes,) if modes else ()), *(aero.output_error if aero else ())):
        words |= {*section.inputs, *section.outputs}
    for one in aero.regressions if aero else ():
        words |= _words(one.response, *one.regressors, *one.forced_terms)
    contained = {"alpha": {"C_L", "C_D", "u", "w"}, "beta": {"v"}}
    return tuple(
        angle
        for angle, names in contained.items()
        if any(word == angle or word.startswith(f"{angle}_") or word in names for word in words)
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


def _check_outputs(names: Sequence[str], data: DataSplit) -> None:
    """Reject constant outputs, on which no search converges.

    Raises:
        InputError: one of them is constant in all maneuvers.
    """
    for name in names:
        values = joined(name, data.fitted)
        if measured(values) and not moves(values):
            raise InputError(
                f"{name} is constant in {files_of(data.fitted)}: leave it out, or is it the wrong column?"
            )


def _modes(
    section: ModesSection, data: DataSplit, raw: DataSplit
) -> tuple[list[EstimationResult], ModesResult | None]:
    _check_outputs(section.outputs, raw)
    return modes_fit(section, data)


def _aero_fits(
    section: AeroSection, data: DataSplit, raw: DataSplit
) -> Iterator[tuple[str, Callable[[], EstimationResult]]]:
    """Every fit of the section by name."""
    for one in section.regressions:
        yield f"regression of {one.response}", partial(regression_fit, one, data)
    for model in section.output_error:

        def fit(model: Any = model) -> EstimationResult:
            _check_outputs(model.outputs, raw)
            if model.method not in METHODS:
                return fit_by_row("aero", model, data)
            return with_lateral_modes(model_fit("aero", model, data))

        yield f"output error, {model.model}", fit
