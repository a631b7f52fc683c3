"""One row of the table of published figures: what is printed, what comes out, and what to think of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

WITHIN, SHORT, FITTED, UNREPRODUCIBLE, COMPARED = "within", "falls short", "fitted", "not reproducible", "compared"
FIT_SHARE = 0.15
"""-; relative difference up to which a fitted figure counts as met, without a limit of its own"""
OUTCOMES = {
    WITHIN: "within its limit",
    SHORT: "farther off than its limit",
    FITTED: "within its limit, but a chosen value was fitted to it: no validation",
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
    """lower limit of the printed range"""
    high: float
    """upper limit of the printed range; equal to ``low`` for a single number"""


class Row(NamedTuple):
    """Published figure with the computed value."""

    figure: Figure
    computed: float | None
    """None if it cannot be computed"""
    limit: float | None
    """maximum difference, in the figure's unit"""
    outcome: str
    """one of `OUTCOMES`"""
    why: str
    """remark"""
    share: float | None = None
    """-; the limit relative to the published value; None if it is given in the figure's unit"""

    @property
    def difference(self) -> float | None:
        """Computed less published value, in the figure's unit; 0 inside of a printed range; None without a number."""
        if self.computed is None or math.isnan(self.figure.low):
            return None
        return self.computed - nearest(self.figure, self.computed)


class Check(NamedTuple):
    """Rows that are computed together."""

    title: str
    rows: Callable[[], list[Row]]
    slow: bool = False
    """whether it takes more than several seconds"""


class Study(NamedTuple):
    """Rows that take minutes, computed on request by name."""

    title: str
    rows: Callable[[Callable[[float, str], None]], list[Row]]
    """function of a progress callback, which is called with the completed fraction and its subject"""


class Paper(NamedTuple):
    """Row of the table of papers."""

    title: str
    checks: tuple[Check, ...]
    studies: tuple[Study, ...] = ()


def figure(where: str, quantity: str, unit: str, printed: float, upto: float | None = None) -> Figure:
    """Return a printed number, or a printed range."""
    return Figure(where, quantity, unit, printed, printed if upto is None else upto)


def nearest(printed: Figure, computed: float) -> float:
    """Return the printed value nearest to the computed one."""
    return min(max(computed, printed.low), printed.high)


def compare(printed: Figure, computed: float, limit: float = 0.0, why: str = "") -> Row:
    """Build a row with a maximum difference in the figure's unit."""
    outcome = WITHIN if abs(computed - nearest(printed, computed)) <= limit else SHORT
    return Row(printed, computed, limit, outcome, why)


def compare_share(printed: Figure, computed: float, share: float, why: str = "") -> Row:
    """Build a row with a maximum difference relative to the nearest printed value."""
    return compare(printed, computed, share * abs(nearest(printed, computed)), why)._replace(share=share)


def fitted(printed: Figure, computed: float, why: str, limit: float | None = None) -> Row:
    """Build a row to which a chosen value was fitted; it falls short if it misses the figure.

    ``limit`` in the figure's unit; by default `FIT_SHARE` of the nearest printed value.
    """
    row = (
        compare_share(printed, computed, FIT_SHARE, why) if limit is None else compare(printed, computed, limit, why)
    )
    return row if row.outcome == SHORT else row._replace(outcome=FITTED)


def unreproducible(printed: Figure, computed: float | None, why: str) -> Row:
    """Build a row that the paper's data do not determine; a computed value is for comparison only."""
    return Row(printed, computed, None, UNREPRODUCIBLE, why)


def compared(other: Figure, computed: float, why: str) -> Row:
    """Build a row that compares a model with an ``other`` one, without a limit."""
    return Row(other, computed, None, COMPARED, why)
