"""Named regressors: monomials of signals and constants, such as ``alpha``, ``q*c/2V``, ``alpha^2``, ``alpha*delta``.

A number directly before a name belongs to it more closely than a quotient does, as engineers write it:
``q*c/2V`` is q c / (2 V).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.results import Array
from wingbeat.errors import InputError

TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\.\d+)|(?P<name>[^\W\d][\w.]*)|(?P<sign>[*/^()]))"
)
HIGHEST_POWER = 12
"""-; above it a regressor has no more digits than its noise"""


class Term(NamedTuple):
    """A monomial."""

    name: str
    """-; as it was asked for"""
    scale: float
    """-; its number"""
    powers: Mapping[str, int]
    """-; by symbol"""


def parse(text: str) -> Term:
    """The monomial that ``text`` names.

    Raises:
        InputError: not a product or quotient of names, numbers and whole powers.
    """
    tokens = _tokens(text)
    scale, powers = _product(tokens, text)
    if tokens:
        raise _unreadable(text, f"'{tokens[0][1]}' is not expected there")
    return Term(text, scale, {symbol: power for symbol, power in powers.items() if power})


def _unreadable(text: str, why: str) -> InputError:
    return InputError(f"regressor '{text}': {why}; write products such as alpha, q*c/2V, alpha^2, alpha*delta")


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens, place = [], 0
    while text[place:].strip():
        found = TOKEN.match(text, place)
        if not found or not found.lastgroup:
            raise _unreadable(text, f"'{text[place:].strip()[0]}' is not expected there")
        tokens.append((found.lastgroup, found[found.lastgroup]))
        place = found.end()
    return tokens


def _product(tokens: list[tuple[str, str]], text: str) -> tuple[float, dict[str, int]]:
    """Factors joined by ``*`` and ``/``, up to a closing bracket."""
    scale, powers = _factor(tokens, text)
    while tokens and tokens[0][1] in "*/":
        sign = 1 if tokens.pop(0)[1] == "*" else -1
        more, others = _factor(tokens, text)
        scale *= more**sign
        for symbol, power in others.items():
            powers[symbol] = powers.get(symbol, 0) + sign * power
    return scale, powers


def _factor(tokens: list[tuple[str, str]], text: str) -> tuple[float, dict[str, int]]:
    """A number, a name or a bracket, each with its power; a number before a name goes with it."""
    scale, powers = _atom(tokens, text)
    exponent = _exponent(tokens, text)
    scale, powers = scale**exponent, {symbol: power * exponent for symbol, power in powers.items()}
    if not powers and tokens and (tokens[0][0] == "name" or tokens[0][1] == "("):
        more, powers = _factor(tokens, text)
        scale *= more
    if not scale > 0:
        raise _unreadable(text, "a factor is zero")
    return scale, powers


def _atom(tokens: list[tuple[str, str]], text: str) -> tuple[float, dict[str, int]]:
    if not tokens:
        raise _unreadable(text, "a factor is missing")
    kind, word = tokens.pop(0)
    if kind == "number":
        return float(word), {}
    if kind == "name":
        return 1.0, {word: 1}
    if word != "(":
        raise _unreadable(text, f"'{word}' is not expected there")
    inside = _product(tokens, text)
    if not tokens or tokens.pop(0)[1] != ")":
        raise _unreadable(text, "a bracket is not closed")
    return inside


def _exponent(tokens: list[tuple[str, str]], text: str) -> int:
    if not tokens or tokens[0][1] != "^":
        return 1
    tokens.pop(0)
    kind, word = tokens.pop(0) if tokens else ("", "nothing")
    if kind != "number" or not float(word).is_integer() or not 1 <= float(word) <= HIGHEST_POWER:
        raise _unreadable(text, f"a power is a whole number from 1 to {HIGHEST_POWER}, not {word}")
    return int(float(word))


def evaluate(term: Term, experiment: Experiment, constants: Mapping[str, float]) -> Array:
    """The term (N,) over the experiment, SI; NaN where a signal of it is, or where it would divide by zero.

    A name that is both a signal and a constant is the signal.

    Raises:
        InputError: a name is neither a signal of the experiment nor a constant.
    """
    if term.name in experiment.signals:
        return np.asarray(experiment.signals[term.name], dtype=np.float64)
    values = np.full(len(experiment.time), term.scale)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for symbol, power in term.powers.items():
            values = values * np.asarray(_symbol(symbol, term, experiment, constants), dtype=np.float64) ** power
    values[~np.isfinite(values)] = np.nan
    return values


def _symbol(symbol: str, term: Term, experiment: Experiment, constants: Mapping[str, float]) -> Array | float:
    if symbol in experiment.signals:
        return experiment.signals[symbol]
    if symbol in constants:
        return constants[symbol]
    of = "" if symbol == term.name else f" (of '{term.name}')"
    known = ", ".join([*experiment.signals, *constants])
    raise InputError(f"{experiment.name}: no signal or constant '{symbol}'{of}; it has {known or 'none'}")


def unit_of(term: Term, units: Mapping[str, str]) -> str:
    """The term's SI unit from ``units`` by symbol; a symbol without one has none."""
    if term.name in units:
        return units[term.name]
    return written({unit: power for unit, power in _total(term.powers.items(), units).items() if power})


def quotient(above: str, below: str) -> str:
    """Unit of a quantity in ``above`` for one in ``below``, shortened: of m/s^2 and m/s it is 1/s."""
    total = _total((("a", 1), ("b", -1)), {"a": above, "b": below})
    return written({unit: power for unit, power in total.items() if power})


def _total(powers: Iterable[tuple[str, int]], units: Mapping[str, str]) -> dict[str, int]:
    total: dict[str, int] = {}
    for symbol, power in powers:
        for unit, exponent in _dimensions(units.get(symbol, "-")).items():
            total[unit] = total.get(unit, 0) + power * exponent
    return total


def _dimensions(unit: str) -> dict[str, int]:
    """Base units and their powers in ``m/s^2``, ``N m/A`` or ``-``; in what follows a quotient all is below."""
    found: dict[str, int] = {}
    for index, part in enumerate(unit.replace("(", " ").replace(")", " ").replace("*", " ").split("/")):
        for word in part.split():
            base, _, power = word.partition("^")
            if base not in ("-", "1", "") and power.lstrip("-").isdigit() | (not power):
                found[base] = found.get(base, 0) + (-1 if index else 1) * int(power or 1)
    return found


def written(dimensions: Mapping[str, int]) -> str:
    """Unit text of base units and their powers."""
    above = [_power(unit, power) for unit, power in dimensions.items() if power > 0]
    below = [_power(unit, -power) for unit, power in dimensions.items() if power < 0]
    return "/".join([" ".join(above) or ("1" if below else "-"), *below])


def _power(unit: str, power: int) -> str:
    return unit if power == 1 else f"{unit}^{power}"


def pool(names: Iterable[str], order: int) -> tuple[str, ...]:
    """All products and powers of ``names`` up to total degree ``order``, lowest first: a candidate pool.

    ``pool(("alpha", "q*c/2V"), 2)`` is alpha, q*c/2V, alpha^2, alpha*(q*c/2V), (q*c/2V)^2.
    """
    plain = [name if re.fullmatch(r"[^\W\d][\w.]*", name) else f"({name})" for name in names]
    terms = list(names)
    for degree in range(2, order + 1):
        for chosen in combinations_with_replacement(plain, degree):
            counts = {name: chosen.count(name) for name in chosen}
            terms.append("*".join(_power(name, count) for name, count in counts.items()))
    return tuple(terms)
