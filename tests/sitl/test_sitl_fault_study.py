"""The study of failures (``make validate``; some minutes on two cores) and the page that it wrote."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from fault_study import Result, page, soft, study
from simulate import ARIZONA, RAVEN

import avionics

pytestmark = pytest.mark.validate

PAGE = Path(avionics.__file__).parents[1] / "docs" / "validation" / "faults.md"


@cache
def results() -> tuple[list[Result], list[Result], list[Result]]:
    return study()


def outcomes(text: str) -> list[tuple[str, str]]:
    """Faults and outcome of every row of the tables of faults and pairs."""
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines() if line.startswith("| `")]
    return [(row[1], row[4]) for row in rows]


@pytest.mark.parametrize("gusts", [False, True])
def test_jammed_tail_in_any_phase_lands_softly(gusts: bool) -> None:
    """GIVEN a Robo Raven WHEN the tail jams in climb-out, level-off or level flight THEN 9 of 10 land softly.

    In still air, and in 3 m/s of wind with light gusts.
    """
    flights = [one for one in results()[2] if one.case.vehicle == RAVEN and one.case.gusts == gusts]
    assert soft(flights) >= 0.9 * len(flights)


def test_jammed_tail_of_equal_wings_lands_softly() -> None:
    """GIVEN an Arizona with equal wings in still air WHEN the tail jams in any phase THEN 9 of 10 land softly."""
    flights = [one for one in results()[2] if not one.case.vibration]
    assert {one.case.vehicle for one in flights} == {ARIZONA} and soft(flights) >= 0.9 * len(flights)


def test_validation_page_has_the_outcomes_of_the_study() -> None:
    assert outcomes(PAGE.read_text(encoding="utf-8")) == outcomes(page(*results(), "today"))
