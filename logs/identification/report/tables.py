"""Results of a map as text, JSON and report page."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from logs.identification.findings import Finding, of_severity
from logs.identification.models.lateral import DUTCH_ROLL, LATERAL_PHUGOID, ROLL, SPIRAL
from logs.identification.report.methods import intervals, method_chapter, remarks
from logs.identification.report.numbers import Identification, document, step_entries
from logs.identification.report.report import SUMMARY, modal_summary, model_chapter, modes_chapter
from logs.identification.report.subjects import step_table
from logs.identification.results import Estimate, EstimationResult, OutputFit
from logs.identification.sources.table.quantities import UNITS
from logs.identification.sources.table.run import TableIdentification
from logs.identification.statistics.fit_quality import Pair, output_fits, strong_pairs
from logs.pages.document import MEASURED, Chapter, Plot, Series, Table
from logs.pages.labels import capitalized, number, sentence, unit
from logs.pages.render import write_page
from wingbeat.text import pluralize

HELD_OUT = "Held-out maneuvers are predicted by the model of the others, with initial state and biases of their own."
NONE_HELD_OUT = "No maneuver was held out; maneuvers.validate of the map names those that are only predicted."


class Source(NamedTuple):
    """Input file."""

    name: str
    sha256: str
    """-; of its bytes, in hexadecimal digits"""


def write_tables_report(path: Path, sources: tuple[Source, ...], results: TableIdentification) -> int:
    """Write the page of the results from ``sources``, including the map; return its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    names = tuple(one.name for one in sources)
    more = len(results.files) - 1
    title = f"{names[0]}{f' and {more} more' if more > 0 else ''}: identification"
    return write_page(path, title, names, table_chapters(sources, results), signed=True)


def table_chapters(sources: tuple[Source, ...], results: TableIdentification) -> tuple[Chapter, ...]:
    """Return the report: the summary, the data, the model and a chapter for each fit."""
    modes = modes_chapter(results.modes, {}) if results.modes is not None else None
    every = (
        _summary(results),
        _data(sources, results),
        modes,
        _model(results),
        *map(_fit_chapter(results), results.fits),
    )
    return tuple(chapter for chapter in every if chapter is not None)


def _fit_chapter(results: TableIdentification) -> Callable[[EstimationResult], Chapter]:
    """Return the function that makes the chapter of one fit, with its start values, steps and own parts."""

    def chapter(fit: EstimationResult) -> Chapter:
        note = (HELD_OUT if results.held_out else NONE_HELD_OUT) if fit.estimates else ""
        whole = method_chapter(fit, {}, results.inputs, note)
        steps = (Chapter("Stepwise regression", tables=(step_table(fit.steps),)),) if fit.steps else ()
        return whole._replace(tables=_search(fit), parts=(*steps, *fit.chapters, *whole.parts))

    return chapter


def _model(results: TableIdentification) -> Chapter | None:
    """Return the equations with their fixed parameters, and the constants."""
    if not results.fits:
        return None
    whole = model_chapter(results.fits, None)
    parts = tuple(
        part._replace(notes=(*part.notes, *_fixed_values(results.fits, part.notes))) for part in whole.parts
    )
    return whole._replace(tables=_constants(results), parts=parts)


def _fixed_values(fits: tuple[EstimationResult, ...], equations: tuple[str, ...]) -> tuple[str, ...]:
    """Return the fixed parameters of fits of these ``equations``: one line if they are equal, else one for each."""
    texts = [_not_estimated(fit) for fit in fits if fit.equations == equations]
    if len(set(texts)) == 1:
        return (f"Fixed, not estimated: {texts[0]}.",) if texts[0] else ()
    return tuple(f"Fixed, not estimated, in fit {i} of these: {one or 'none'}." for i, one in enumerate(texts, 1))


def _not_estimated(fit: EstimationResult) -> str:
    return ", ".join(f"{name} = {number(value)}" for name, value in (dict(fit.unnamed) | dict(fit.fixed)).items())


def _summary(results: TableIdentification) -> Chapter:
    """Return the estimates of the modes by the first method that has them and of every fit, and all findings."""
    notes, parts = [], list[Chapter]()
    if results.modes is not None:
        method, estimates = modal_summary(results.modes)
        if estimates:
            parts.append(Chapter(f"Modes by {method}", plots=intervals(estimates)))
        notes.append(sentence(results.modes.statement))
    for fit in results.fits:
        notes.append(sentence(f"{heading(fit)}: {fit.failure.text if fit.failure else _extent(fit)}"))
        plots = intervals(fit.estimates, controls=results.inputs)
        parts += [Chapter(capitalized(fit.title), plots=plots)] if plots else []
    warnings = (one for fit in results.fits for one in fit.warnings)
    findings = remarks((*results.missing, *results.findings, *warnings))
    return Chapter(SUMMARY, tuple(notes), parts=tuple(parts), findings=findings)


def _extent(fit: EstimationResult) -> str:
    numbers = pluralize(len(fit.estimates), "number")
    return (
        f"{numbers} from {pluralize(fit.samples, 'sample')}{'' if fit.status == 'converged' else ', not converged'}"
    )


def _data(sources: tuple[Source, ...], results: TableIdentification) -> Chapter:
    """Return the files, the maneuvers, the signals and the inputs."""
    files = Table(("file", "SHA-256"), tuple((one.name, one.sha256) for one in sources))
    notes = tuple(map(sentence, _absent(results))) or ("All samples are measured.",)
    return Chapter("Data", notes, (files, _maneuvers(results), _signals(results)), _inputs(results))


def _absent(results: TableIdentification) -> list[str]:
    """Return the missing samples of each signal and maneuver."""
    return [
        f"{one.name}: {int(lost)} of {pluralize(len(values), 'sample')} of {name} not measured"
        for one in results.records
        for name, values in one.signals.items()
        if (lost := np.count_nonzero(~np.isfinite(values)))
    ]


def _maneuvers(results: TableIdentification) -> Table:
    rows = tuple(
        (
            one.name, "held out" if one.name in results.held_out else "fitted", round(float(one.time[0]), 6),
            float(one.time[-1] - one.time[0]), float(len(one.time)), 1.0 / one.step,
        )
        for one in results.records
    )  # fmt: skip
    caption = f"{pluralize(len(results.experiments), 'maneuver')} fitted, {len(results.held_out)} held out."
    return Table(("maneuver", "use", "start (s)", "length (s)", "samples", "rate (Hz)"), rows, caption)


def _signals(results: TableIdentification) -> Table:
    """Return the range of every signal over all maneuvers, and the measured fraction."""
    rows = []
    for name in results.records[0].signals if results.records else ():
        values = np.concatenate([one.signals[name] for one in results.records])
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (math.nan, math.nan)
        rows.append(
            (name, unit(results.records[0].units.get(name, "")), low, high, 100.0 * len(finite) / len(values))
        )
    columns = ("signal", "unit", "minimum", "maximum", "measured (%)")
    return Table(columns, tuple(rows), "Signals over all maneuvers, in SI units.")


def _inputs(results: TableIdentification) -> tuple[Plot, ...]:
    return tuple(
        Plot(
            f"{name} of all maneuvers", "time since the start", "s", name, results.records[0].units.get(name, ""),
            tuple(Series("", one.time - one.time[0], one.signals[name], MEASURED) for one in results.records),
        )
        for name in results.inputs
        if results.records and name in results.records[0].signals
    )  # fmt: skip


def _constants(results: TableIdentification) -> tuple[Table, ...]:
    rows = tuple((name, value, unit(UNITS.get(name, ""))) for name, value in results.constants.items() if name != "g")
    return (Table(("constant", "value", "unit"), rows, "Constants of the map, in SI units."),) if rows else ()


def _search(fit: EstimationResult) -> tuple[Table, ...]:
    """Return start and end values of a search."""
    values = {one.name: one.value for one in fit.estimates}
    rows = [(name, start, values[name], "estimated") for name, start in fit.initial.items() if name in values]
    rows += [(name, value, value, "fixed by the map") for name, value in fit.fixed.items()]
    return (Table(("parameter", "start", "end", ""), tuple(rows), "Start values of the search."),) if rows else ()


LATERAL_MODES = (DUTCH_ROLL, ROLL, SPIRAL, LATERAL_PHUGOID)
"""subjects that are modes, not parameters"""
MOST_PAIRS = 5
"""-; correlations that a text lists"""


class NumberRow(NamedTuple):
    """One number of a result."""

    name: str
    estimate: Estimate
    start: float | None
    """as the estimate; start value of the search, None without a search"""


def finite(value: float | None) -> float | None:
    """The number for JSON: None if it is not finite."""
    return float(value) if value is not None and math.isfinite(value) else None


def number_rows(result: EstimationResult) -> tuple[NumberRow, ...]:
    """Every estimate with its start value, then the derived numbers."""
    every = (*result.estimates, *result.derived)
    return tuple(NumberRow(one.name, one, result.initial.get(one.name)) for one in every)


def heading(result: EstimationResult) -> str:
    """The title of a result, and whether there is any number."""
    return f"{result.title}{': no numbers' if result.failure is not None else ''}"


def correlated(result: EstimationResult) -> tuple[Pair, ...]:
    """Pairs of estimates with strongly correlated errors."""
    if result.correlation is None:
        return ()
    return strong_pairs(tuple(one.name for one in result.estimates), result.correlation)


def notes_of(result: EstimationResult) -> tuple[str, ...]:
    """Lines below the numbers: what is withheld, what casts doubt on them, what was done."""
    lines = [result.failure.text] if result.failure is not None else []
    lines += withheld_lines(result.withheld)
    lines += (one.line for one in result.warnings)
    lines += correlation_lines(correlated(result))
    if result.fixed:
        lines.append("fixed: " + ", ".join(f"{name} = {value:.6g}" for name, value in result.fixed.items()))
    colored = [one.output for one in output_fits(result.series) if one.white is False and not one.held_out]
    if colored:
        lines.append(f"residuals of {', '.join(dict.fromkeys(colored))} are colored; the intervals allow for it")
    lines += (one.line for one in of_severity(result.findings, "info"))
    return (*lines, *(f"stepwise: {one.term} {one.action}, {one.why}" for one in result.steps if one.term))


def correlation_lines(pairs: Sequence[Pair]) -> list[str]:
    """A line for each of the strongest correlations, and the number of the others."""
    strongest = sorted(pairs, key=lambda pair: -abs(pair[2]))
    lines = [
        f"{first} and {second} are correlated by {value:+.2f}" for first, second, value in strongest[:MOST_PAIRS]
    ]
    rest = len(pairs) - MOST_PAIRS
    return [*lines, f"{rest} more correlations above the limit (--json: correlated)"] if rest > 0 else lines


def withheld_lines(withheld: Sequence[Finding]) -> list[str]:
    """A line for each reason with all parameters that have it."""
    groups: dict[str, list[str]] = {}
    for one in withheld:
        groups.setdefault(one.line, []).append(one.subject)
    return [f"{', '.join(names)} not identified: {reason}" for reason, names in groups.items()]


def table_document(identified: TableIdentification) -> dict[str, Any]:
    """The result as a JSON document; a number that is not finite is null."""
    modes = None if identified.modes is None else document(Identification(modes=identified.modes))["modes"]
    return {
        "files": list(identified.files),
        "manoeuvres": {"fitted": list(identified.experiments), "held_out": list(identified.held_out)},
        "fits": [_fit(fit) for fit in identified.fits],
        "modes": modes,
        "missing": [_reason(one) for one in identified.missing],
        "delays": [_numbers(one) for one in identified.delays],
        "notes": [one.text for one in identified.findings],
        "findings": [one.document() for one in (*identified.findings, *identified.missing)],
    }


def _fit(fit: EstimationResult) -> dict[str, Any]:
    notes = [one.text for one in fit.findings if one.severity != "withheld"]
    lost = [one for one in fit.withheld if one.subject not in LATERAL_MODES]
    return {
        "subject": fit.subject,
        "method": fit.title,
        "equations": list(fit.equations),
        "converged": fit.status == "converged",
        "failure": None if fit.failure is None else fit.failure.text,
        "estimates": [_numbers(one) | {"start": finite(fit.initial.get(one.name))} for one in fit.estimates],
        "modes": {
            "estimates": [_numbers(one) for one in fit.derived],
            "unidentified": [_reason(one) for one in fit.withheld if one.subject in LATERAL_MODES],
        },
        "unidentified": [_reason(one) for one in lost],
        "fixed": dict(fit.fixed),
        "correlated": [{"first": a, "second": b, "correlation": value} for a, b, value in correlated(fit)],
        "outputs": [_output(one) for one in output_fits(fit.series)],
        "samples": fit.samples,
        "steps": step_entries(fit.steps),
        "notes": notes,
        "findings": [one.document() for one in fit.findings],
    }


def _reason(one: Finding) -> dict[str, str]:
    return {"name": one.subject, "reason": one.text}


def _numbers(one: Estimate) -> dict[str, Any]:
    return {key: value if isinstance(value, str) else finite(value) for key, value in one._asdict().items()}


def _output(one: OutputFit) -> dict[str, Any]:
    return {key: finite(value) if isinstance(value, float) else value for key, value in one._asdict().items()}
