"""Surveys: parallel legs that cover an area."""

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from avionics.guidance import survey
from avionics.guidance.fence import depth
from avionics.guidance.mission import Zone
from avionics.guidance.path import leg

FIELD = ((0.0, 0.0), (120.0, 0.0), (120.0, 80.0), (0.0, 80.0))
courses = st.floats(-math.pi, math.pi)


def test_a_field_is_mown_to_and_fro() -> None:
    flown = survey.legs(FIELD, 20.0, 0.0, 5.0)
    assert [round(begin[1], 6) for begin, _ in flown] == [10.0, 30.0, 50.0, 70.0]
    assert flown[0] == (pytest.approx((-5.0, 10.0)), pytest.approx((125.0, 10.0)))
    assert flown[1] == (pytest.approx((125.0, 30.0)), pytest.approx((-5.0, 30.0)))


@given(course=courses, spacing=st.floats(5, 60), north=st.floats(1, 119), east=st.floats(1, 79))
def test_no_place_of_the_area_is_farther_from_a_leg_than_half_the_spacing(course, spacing, north, east) -> None:
    flown = survey.legs(FIELD, spacing, course, 1000.0)
    nearest = min(abs(leg(begin, end, (north, east)).cross) for begin, end in flown)
    assert nearest <= 0.5 * spacing + 1e-6


@given(course=courses, spacing=st.floats(5, 60))
def test_legs_are_parallel_apart_by_the_spacing_and_alternate(course, spacing) -> None:
    flown = survey.legs(FIELD, spacing, course, 0.0)
    for number, ((begin, end), (later, _)) in enumerate(pairwise(flown)):
        line = leg(begin, end, later)
        assert abs(line.cross) == pytest.approx(spacing, abs=1e-6)
        if line.length > 1e-3:
            turn = math.remainder(line.course - course - math.pi * (number % 2), math.tau)
            assert abs(turn) < 1e-6


@given(course=courses, spacing=st.floats(5, 60))
def test_without_overshoot_legs_end_on_the_border(course, spacing) -> None:
    for places in survey.legs(FIELD, spacing, course, 0.0):
        for place in places:
            assert depth(Zone(1, FIELD), place) == pytest.approx(0.0, abs=1e-6)


def test_a_concave_area_has_a_leg_in_each_arm() -> None:
    outer, notch = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)), ((0.0, 70.0), (70.0, 70.0), (70.0, 30.0))
    arms = (*outer, *notch, (0.0, 30.0))
    flown = survey.legs(arms, 20.0, 0.5 * math.pi, 0.0)
    lengths = sorted(round(math.dist(begin, end)) for begin, end in flown)
    # North of 70 m the area is one piece of 100 m, south of it two of 30 m.
    assert set(lengths) == {30, 100}
    assert lengths.count(30) % 2 == 0


@given(spacing=st.floats(1, 200))
def test_the_number_of_legs_is_the_width_by_the_spacing(spacing) -> None:
    assume(abs(80.0 / spacing - round(80.0 / spacing)) > 1e-6)
    assert len(survey.legs(FIELD, spacing, 0.0, 0.0)) == math.ceil(80.0 / spacing)
