"""Results of tables as rows for people and as a JSON document."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from logs.identification.findings import Finding, of_severity
from logs.identification.models.lateral_modes import DUTCH_ROLL, LATERAL_PHUGOID, ROLL, SPIRAL
from logs.identification.report.numbers import Identification, document, step_entries
from logs.identification.results import Estimate, EstimationResult, OutputFit
from logs.identification.sources.table.results import TableIdentification
from logs.identification.statistics.collinearity import Pair, strong_pairs
from logs.identification.statistics.fit_quality import output_fits

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
    lines += map(finding_line, result.warnings)
    lines += correlation_lines(correlated(result))
    if result.fixed:
        lines.append("fixed: " + ", ".join(f"{name} = {value:.6g}" for name, value in result.fixed.items()))
    colored = [one.output for one in output_fits(result.series) if one.white is False and not one.held_out]
    if colored:
        lines.append(f"residuals of {', '.join(dict.fromkeys(colored))} are colored; the intervals allow for it")
    lines += map(finding_line, of_severity(result.findings, "info"))
    return (*lines, *(f"stepwise: {one.term} {one.action}, {one.why}" for one in result.steps if one.term))


def correlation_lines(pairs: Sequence[Pair]) -> list[str]:
    """A line for each of the strongest correlations, and the number of the others."""
    strongest = sorted(pairs, key=lambda pair: -abs(pair[2]))
    lines = [
        f"{first} and {second} are correlated by {value:+.2f}" for first, second, value in strongest[:MOST_PAIRS]
    ]
    rest = len(pairs) - MOST_PAIRS
    return [*lines, f"{rest} more correlations above the limit (--json: correlated)"] if rest > 0 else lines


def finding_line(finding: Finding) -> str:
    """The subject, text and remedy of a finding; the subject of a withheld one stands elsewhere."""
    remedy = finding.remedy
    text = f"{finding.text}; {remedy}" if remedy and finding.severity != "info" else finding.text
    named = not finding.subject or finding.subject in text or finding.severity == "withheld"
    return text if named else f"{finding.subject}: {text}"


def withheld_lines(withheld: Sequence[Finding]) -> list[str]:
    """A line for each reason with all parameters that have it."""
    groups: dict[str, list[str]] = {}
    for one in withheld:
        groups.setdefault(finding_line(one), []).append(one.subject)
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
