"""The table of published figures: its verdicts, and that every row says what it must."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import cache

import pytest

from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.row import (
    COMPARED,
    FITTED,
    OUTCOMES,
    SHORT,
    UNREPRODUCIBLE,
    WITHIN,
    Row,
    compare,
    compare_share,
    compared,
    figure,
    fitted,
    unreproducible,
)

CHECKS = {f"{name}-{check.title}": check for name, paper in PAPERS.items() for check in paper.checks}


@cache
def rows_of(check: str) -> list[Row]:
    return CHECKS[check].rows()


@pytest.mark.parametrize(
    ("computed", "difference", "outcome"), [(1.9, 0.0, WITHIN), (2.08, 0.08, WITHIN), (0.85, -0.15, SHORT)]
)
def test_a_range_is_met_inside_and_near_its_ends(computed: float, difference: float, outcome: str) -> None:
    row = compare(figure("Table 1", "a range", "m", 1.0, 2.0), computed, 0.1)
    assert row.outcome == outcome
    assert row.difference == pytest.approx(difference)


def test_a_limit_as_a_share_is_of_the_printed_value() -> None:
    negative = figure("Table 1", "a number", "m", -4.0)
    assert compare_share(negative, -4.3, 0.1).outcome == WITHIN
    assert compare_share(negative, -4.5, 0.1).outcome == SHORT
    assert compare_share(negative, -4.5, 0.1).limit == pytest.approx(0.4)


def test_not_a_number_is_never_within() -> None:
    assert compare(figure("Table 1", "a number", "m", 1.0), math.nan, 0.1).outcome == SHORT


def test_fitted_and_unreproducible_rows() -> None:
    number = figure("Table 1", "a number", "m", 1.0)
    assert fitted(number, 1.0, "to it").outcome == FITTED
    assert fitted(number, 1.2, "to it").outcome == SHORT and fitted(number, 1.2, "to it", 0.3).outcome == FITTED
    row = unreproducible(number, None, "it is not printed")
    assert (row.outcome, row.difference, row.limit) == (UNREPRODUCIBLE, None, None)
    other = compared(number, 1.5, "two models")
    assert (other.outcome, other.difference, other.limit) == (COMPARED, 0.5, None)
    blank = figure("Fig. 1", "a curve", "m", math.nan)
    assert unreproducible(blank, 1.0, "it has no scale").difference is None


LONG = {
    "han-hawkmoth in free flight",
    "lattice-an impulsive start",
    "lattice-heave and pitch",
    "lattice-lift over a stroke (Yeo, Atkins, Shyy 2011)",
    "lattice-a hawkmoth's stroke beside the quasi-steady model",
}
"""checks of several seconds no row of which falls short"""


@pytest.mark.parametrize(
    "check", [pytest.param(check, marks=pytest.mark.validate) if check in LONG else check for check in CHECKS]
)
def test_every_row_says_where_it_is_from_and_why_it_is_not_met(check: str) -> None:
    rows = rows_of(check)
    assert rows and len({(row.figure.where, row.figure.quantity) for row in rows}) == len(rows)
    for row in rows:
        assert row.figure.where and row.figure.quantity and row.figure.unit
        assert row.outcome in OUTCOMES
        assert row.outcome == WITHIN or row.why
        assert row.computed is None or math.isfinite(row.computed)


def short_of(checks: Iterable[str]) -> set[str]:
    """The quantities that fall short, of whichever wing."""
    short = [row.figure.quantity for check in checks for row in rows_of(check) if row.outcome == SHORT]
    return {re.sub(r",? (of )?wing [A-D]", "", quantity) for quantity in short}


def test_the_rows_that_fall_short_are_the_known_ones() -> None:
    assert short_of(check for check in CHECKS if check not in LONG) == {
        "mean lift",
        "mean lift over weight, quasi_steady",
        "mean lift over weight, strip_theory",
        "area by Eq. 1",
        "greatest reduced frequency",
        "least Reynolds number",
        "C_L at 9.2 m/s against level flight's",
        "heave speed that carries the weight",
        "altitude, peak to peak",
        "stroke in flight, vehicle file",
        "power in flight, vehicle file",
        "stroke in flight, one set",
        "power in flight, one set",
        "torque constant",
        "damping ratio by Eq. 17",
        "power of the coupled model",
        "torque of the coupled model",
        "mean torque",
        "mean current",
        "current by Eq. 12",
        "current by motor and resistance",
        "mean thrust",
        "incidence",
        "overshoot",
        "lift of the stroke held",
        "thrust of the stroke held",
        "power of the stroke held",
        "torque of the stroke held",
        "short period: damping ratio",
        "short period: time to half",
    }


@pytest.mark.validate
def test_no_row_of_the_long_checks_falls_short() -> None:
    assert short_of(LONG) == set()
