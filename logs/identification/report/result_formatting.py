"""What was identified from tables, as rows for people and as a JSON document."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

from logs.identification.report.numbers import Identification, document, step_entries
from logs.identification.results import Estimate, Information, Unidentified
from logs.identification.tables.results import LITTLE, OutputFit, TableFit, TableIdentification, finite


class NumberRow(NamedTuple):
    """One number of a fit."""

    name: str
    estimate: Estimate
    start: float | None
    """as the estimate; where its search began, None where it had no search"""


def number_rows(fit: TableFit) -> tuple[NumberRow, ...]:
    """Every estimate with where its search began, then the modes that a lateral model has."""
    return tuple(NumberRow(one.name, one, fit.starts.get(one.name)) for one in (*fit.fitted.estimates, *fit.modes))


def notes_of(fit: TableFit) -> tuple[str, ...]:
    """What must be said beside the numbers, a line each: first what doubts them, then what only tells of them."""
    lines = [fit.failure] if fit.failure else []
    lines += _refused([one for one in fit.fitted.unidentified if one.reason != fit.failure])
    lines += _refused(fit.lost)
    lines += _poor(fit)
    lines += [note for note in fit.fitted.notes if not isinstance(note, Information)]
    lines += [f"{first} and {second} are correlated by {value:+.2f}" for first, second, value in fit.correlated]
    if fit.fixed:
        lines.append("held: " + ", ".join(f"{name} = {value:.6g}" for name, value in fit.fixed.items()))
    coloured = [one for one in fit.outputs if one.white is False and not one.held_out]
    if coloured:
        names = ", ".join(dict.fromkeys(one.output for one in coloured))
        lines.append(f"residuals of {names} are not white: the intervals allow for their colour")
    lines += [note for note in fit.fitted.notes if isinstance(note, Information)]
    return (*lines, *(f"stepwise: {one.term} {one.action}, {one.why}" for one in fit.steps if one.term))


def _refused(lost: Sequence[Unidentified]) -> list[str]:
    """A line for each reason, with all that it is the reason of."""
    reasons = dict.fromkeys(one.reason for one in lost)
    return [
        f"{', '.join(one.name for one in lost if one.reason == reason)} not identified: {reason}"
        for reason in reasons
    ]


def _poor(fit: TableFit) -> list[str]:
    """A line for each manoeuvre with outputs of which the model explains little."""
    poor = [one for one in fit.outputs if one.r_squared < LITTLE]
    return [
        f"the model explains {', '.join(f'{100 * max(one.r_squared, 0):.0f} % of {one.output}' for one in group)}"
        f" in {name}"
        for name, group in groupby(poor, key=lambda one: one.experiment)
    ]


def heading(fit: TableFit) -> str:
    """A fit's method, and whether there is anything."""
    state = "" if not fit.failure else ": no numbers"
    return f"{fit.fitted.method}{state}"


def table_document(found: TableIdentification) -> dict[str, Any]:
    """The result as a JSON document; a number that is not finite is null."""
    modes = None if found.modes is None else document(Identification(modes=found.modes))["modes"]
    return {
        "files": list(found.files),
        "manoeuvres": {"fitted": list(found.experiments), "held_out": list(found.held_out)},
        "fits": [_fit(fit) for fit in found.fits],
        "modes": modes,
        "missing": [one._asdict() for one in found.missing],
        "delays": [_numbers(one) for one in found.delays],
        "notes": list(found.notes),
    }


def _fit(fit: TableFit) -> dict[str, Any]:
    return {
        "subject": fit.subject,
        "method": fit.fitted.method,
        "equations": list(fit.fitted.equations),
        "converged": fit.converged,
        "failure": fit.failure or None,
        "estimates": [_estimate(row) for row in number_rows(fit) if row.estimate not in fit.modes],
        "modes": {
            "estimates": [_numbers(one) for one in fit.modes],
            "unidentified": [one._asdict() for one in fit.lost],
        },
        "unidentified": [one._asdict() for one in fit.fitted.unidentified],
        "fixed": dict(fit.fixed),
        "correlated": [{"first": a, "second": b, "correlation": value} for a, b, value in fit.correlated],
        "outputs": [_output(one) for one in fit.outputs],
        "samples": fit.samples,
        "steps": step_entries(fit.steps),
        "notes": list(fit.fitted.notes),
    }


def _estimate(row: NumberRow) -> dict[str, Any]:
    return _numbers(row.estimate) | {"start": finite(row.start)}


def _numbers(one: Estimate) -> dict[str, Any]:
    return {key: value if isinstance(value, str) else finite(value) for key, value in one._asdict().items()}


def _output(one: OutputFit) -> dict[str, Any]:
    return {key: finite(value) if isinstance(value, float) else value for key, value in one._asdict().items()}
