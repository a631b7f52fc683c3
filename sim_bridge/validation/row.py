"""One row of the table of published figures: what is printed, what comes out, and what to think of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

WITHIN, SHORT, FITTED, UNREPRODUCIBLE, COMPARED = "within", "falls short", "fitted", "not reproducible", "compared"
OUTCOMES = {
    WITHIN: "within its limit",
    SHORT: "farther off than its limit",
    FITTED: "a chosen value was fitted to it: no validation",
    UNREPRODUCIBLE: "the paper does not print what it hangs on, or contradicts itself",
    COMPARED: "two models of ours beside each other, neither measured: no validation",
}


class Figure(NamedTuple):
    """A published figure."""

    where: str
    """table, figure, equation or section of the paper"""
    quantity: str
    unit: str
    """"-" for none"""
    low: float
    """least value printed"""
    high: float
    """greatest value printed; the same for a single number"""


class Row(NamedTuple):
    """A published figure beside ours."""

    figure: Figure
    computed: float | None
    """none where nothing can be computed"""
    limit: float | None
    """greatest difference allowed, in the figure's unit"""
    outcome: str
    """one of `OUTCOMES`"""
    why: str
    """what has to be said of it"""
    share: float | None = None
    """-; the limit as the share of the published value that it was told as; none where it was told in its unit"""

    @property
    def difference(self) -> float | None:
        """Ours less what is printed, in the figure's unit; 0 inside of a printed range; none without a number."""
        if self.computed is None or math.isnan(self.figure.low):
            return None
        return self.computed - nearest(self.figure, self.computed)


class Check(NamedTuple):
    """Rows that are computed together."""

    title: str
    rows: Callable[[], list[Row]]
    slow: bool = False
    """whether it takes more than some seconds"""


class Study(NamedTuple):
    """Rows that take minutes, computed when they are asked for by name."""

    title: str
    rows: Callable[[Callable[[float, str], None]], list[Row]]
    """takes what hears which share is done, and of what"""


class Paper(NamedTuple):
    """One line of the table of papers."""

    title: str
    checks: tuple[Check, ...]
    studies: tuple[Study, ...] = ()


def figure(where: str, quantity: str, unit: str, printed: float, upto: float | None = None) -> Figure:
    """A printed number, or a printed range."""
    return Figure(where, quantity, unit, printed, printed if upto is None else upto)


def nearest(printed: Figure, computed: float) -> float:
    """The printed value nearest to ours."""
    return min(max(computed, printed.low), printed.high)


def compare(printed: Figure, computed: float, limit: float = 0.0, why: str = "") -> Row:
    """A row judged by the greatest difference allowed, in the figure's unit."""
    outcome = WITHIN if abs(computed - nearest(printed, computed)) <= limit else SHORT
    return Row(printed, computed, limit, outcome, why)


def compare_share(printed: Figure, computed: float, share: float, why: str = "") -> Row:
    """A row judged by the greatest difference allowed as a share of the printed value nearest to ours."""
    return compare(printed, computed, share * abs(nearest(printed, computed)), why)._replace(share=share)


def fitted(printed: Figure, computed: float, why: str) -> Row:
    """A row that a chosen value was fitted to."""
    return Row(printed, computed, None, FITTED, why)


def unreproducible(printed: Figure, computed: float | None, why: str) -> Row:
    """A row that cannot follow from what the paper prints; ours, if any, is for comparison."""
    return Row(printed, computed, None, UNREPRODUCIBLE, why)


def compared(other: Figure, computed: float, why: str) -> Row:
    """A row that sets one model of ours beside an ``other`` one, with no limit that either would have to meet."""
    return Row(other, computed, None, COMPARED, why)
