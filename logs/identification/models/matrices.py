"""A linear model written as matrices: A, B, C, D whose entries are numbers and sums of named parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from logs.identification.estimators.engine.problem import Named
from logs.identification.models.linear import ONE, LinearModel, Term, Terms, linear_model
from wingbeat.errors import InputError

Entry = float | str
Matrix = Sequence[Sequence[Entry]]
_NUMBER = r"[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+"
_PART = re.compile(rf"([-+]?)(?:({_NUMBER})\*)?(?:([A-Za-z_]\w*)|({_NUMBER}))")


def written_model(
    states: Mapping[str, Named],
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    units: Mapping[str, str],
    matrices: Mapping[str, Matrix],
) -> LinearModel:
    """``x' = A x + B u``, ``y = C x + D u`` from ``matrices`` A, B, C and D (D may be left out).

    An entry is a number, or text such as "Z_alpha", "1 + Z_q" or "-20*Z_alpha". Every name in an entry becomes a
    parameter, its unit from ``units`` (dimensionless where not told). An input named "1" carries constants.

    Raises:
        InputError: a matrix is missing or of the wrong size, or an entry cannot be read.
    """
    n, m, k = len(states), len(outputs), len(inputs)
    columns = (list(states), [*inputs])
    rows: list[Terms] = [()] * (n + m)
    for name, (high, wide) in {"A": (n, n), "B": (n, k), "C": (m, n), "D": (m, k)}.items():
        matrix = _sized(name, matrices, high, wide)
        signals, first = columns[name in "BD"], n if name in "CD" else 0
        for index, row in enumerate(matrix):
            for of, entry in zip(signals, row, strict=True):
                rows[first + index] += _terms(of, entry, name)
    names = dict.fromkeys(term.parameter for row in rows for term in row if term.parameter)
    parameters = {name: Named(units.get(name, "-")) for name in names}
    measured = {name: (unit, rows[n + i]) for i, (name, unit) in enumerate(outputs.items())}
    flown = {name: unit for name, unit in inputs.items() if name != ONE}
    return linear_model(states, flown, parameters, dict(zip(states, rows[:n], strict=True)), measured)


def _sized(name: str, matrices: Mapping[str, Matrix], high: int, wide: int) -> Matrix:
    if name == "D" and name not in matrices:
        return [[0.0] * wide for _ in range(high)]
    if name not in matrices:
        raise InputError(f"the linear model lacks its matrix {name}")
    matrix = matrices[name]
    if len(matrix) != high or any(len(row) != wide for row in matrix):
        raise InputError(f"matrix {name} must have {high} rows of {wide} entries")
    return matrix


def _terms(of: str, entry: Entry, name: str) -> Terms:
    if not isinstance(entry, str):
        return (Term(of, factor=float(entry)),) if entry else ()
    text, terms, at = re.sub(r"\s*([-+*])\s*", r"\1", entry.strip()), [], 0
    while at < len(text):
        part = _PART.match(text, at)
        if part is None or (at > 0 and not part[1]):
            raise InputError(f'matrix {name}: the entry "{entry}" cannot be read; write it like "1 + 2*Z_q"')
        sign = -1.0 if part[1] == "-" else 1.0
        terms.append(Term(of, part[3] or "", sign * float(part[2] or 1.0) * float(part[4] or 1.0)))
        at = part.end()
    if not terms:
        raise InputError(f"matrix {name} has an empty entry")
    return tuple(terms)
