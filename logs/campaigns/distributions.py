"""Distributions of drawn values as quantile functions."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

from wingbeat.errors import InputError

LEAST = 2.0**-53
"""-; least probability: the ends of a normal distribution are at infinity"""


class Kind(NamedTuple):
    """Row of the table of distributions."""

    text: str
    """format of its list of numbers"""
    check: Callable[[Sequence[Any]], str]
    """error of the list, empty if valid"""
    at: Callable[[Sequence[Any], float], Any]
    """quantile function of the probability from 0 to 1"""
    corners: Callable[[Sequence[Any]], Sequence[Any]]
    """extreme values, which are checked before the first flight"""


class Distribution(NamedTuple):
    """Distribution of one key."""

    kind: str
    """-; name of a row of `KINDS`"""
    numbers: tuple[Any, ...]
    """parameters as in the file"""
    within: tuple[float, float] | None = None
    """limits of a normal distribution; values outside are not drawn"""

    @property
    def corners(self) -> Sequence[Any]:
        """Return the extreme values, which are checked before the first flight."""
        return self.within or KINDS[self.kind].corners(self.numbers)

    def at(self, share: float) -> Any:
        """Return the quantile at a probability from 0 to 1."""
        if self.within is None:
            return KINDS[self.kind].at(self.numbers, share)
        low, high = (NormalDist(*self.numbers).cdf(end) for end in self.within)
        value = _normal(self.numbers, low + (high - low) * share)
        return min(max(value, self.within[0]), self.within[1])


def drawn(seed: int, draw: int, key: str, distribution: Distribution) -> Any:
    """Draw the value of ``key``; it depends on the arguments only, not on other keys."""
    return distribution.at(random.Random(f"{seed}/{draw}/{key}").random())


def read_distribution(where: str, table: Mapping[str, Any]) -> Distribution:
    """Read a table such as ``{ normal = [0.29, 0.01], within = [0.27, 0.31] }``.

    Raises:
        InputError: unknown distribution, or invalid parameters.
    """
    named = [name for name in table if name in KINDS]
    if len(named) != 1 or not set(table) <= {*named, "within"}:
        raise InputError(f"{where} must be one of {', '.join(f'{n} = {kind.text}' for n, kind in KINDS.items())}")
    name, numbers = named[0], table[named[0]]
    if not isinstance(numbers, list):
        raise InputError(f"{where}: {name} must be a list: {KINDS[name].text}")
    wrong = KINDS[name].check(numbers)
    if wrong:
        raise InputError(f"{where}: {name} = {numbers}: {wrong}")
    return Distribution(name, tuple(numbers), _within(where, name, numbers, table.get("within")))


def _within(where: str, name: str, numbers: Sequence[Any], within: Any) -> tuple[float, float] | None:
    if within is None:
        return None
    if name != "normal":
        raise InputError(f"{where}: within goes with normal alone")
    wrong = _wrong_range(within) if isinstance(within, list) else "must be [least, greatest]"
    if wrong:
        raise InputError(f"{where}: within = {within}: {wrong}")
    bell = NormalDist(*numbers)
    if not bell.cdf(within[1]) > bell.cdf(within[0]):
        raise InputError(f"{where}: within = {within}: no part of the distribution is in this range")
    return float(within[0]), float(within[1])


def _numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in values)


def _wrong_range(values: Sequence[Any]) -> str:
    if len(values) != 2 or not _numbers(values):
        return "must be two numbers"
    return "" if values[0] < values[1] else "the first must be below the second"


def _wrong_positive(values: Sequence[Any]) -> str:
    return _wrong_range(values) or ("" if values[0] > 0 else "both must be above 0")


def _wrong_whole(values: Sequence[Any]) -> str:
    return _wrong_range(values) or ("" if all(isinstance(v, int) for v in values) else "must be whole numbers")


def _wrong_normal(values: Sequence[Any]) -> str:
    if len(values) != 2 or not _numbers(values):
        return "must be two numbers"
    return "" if values[1] > 0 else "the standard deviation must be above 0"


def _wrong_choice(values: Sequence[Any]) -> str:
    return "" if values else "has nothing to choose from"


def _uniform(ends: Sequence[Any], share: float) -> float:
    return float(ends[0] + (ends[1] - ends[0]) * share)


def _log_uniform(ends: Sequence[Any], share: float) -> float:
    return float(math.exp(_uniform([math.log(end) for end in ends], share)))


def _whole(ends: Sequence[Any], share: float) -> int:
    return int(ends[0]) + int(share * (ends[1] - ends[0] + 1))


def _normal(bell: Sequence[Any], share: float) -> float:
    return NormalDist(*bell).inv_cdf(min(max(share, LEAST), 1.0 - LEAST))


def _choice(values: Sequence[Any], share: float) -> Any:
    return values[int(share * len(values))]


KINDS: dict[str, Kind] = {
    "uniform": Kind("[least, greatest]", _wrong_range, _uniform, tuple),
    "log_uniform": Kind("[least, greatest]", _wrong_positive, _log_uniform, tuple),
    "integer": Kind("[least, greatest]", _wrong_whole, _whole, tuple),
    "normal": Kind("[mean, standard deviation]", _wrong_normal, _normal, lambda bell: bell[:1]),
    "choice": Kind("[one, another, ...]", _wrong_choice, _choice, tuple),
}
