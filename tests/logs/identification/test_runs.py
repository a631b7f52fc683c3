"""The stretches on which a mask holds: each as long as it goes, those at the ends too."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from logs.identification.data.experiment import longest_run, runs


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ([], []),
        ([False], []),
        ([True], [slice(0, 1)]),
        ([False, False, False], []),
        ([True, True, True], [slice(0, 3)]),
        ([True, False, False], [slice(0, 1)]),
        ([False, False, True], [slice(2, 3)]),
        ([True, False, True, True, False, False, True], [slice(0, 1), slice(2, 4), slice(6, 7)]),
    ],
)
def test_runs_are_found_up_to_both_ends(mask: list[bool], expected: list[slice]) -> None:
    assert runs(np.array(mask, bool)) == expected


@given(st.lists(st.booleans(), max_size=40))
def test_runs_hold_every_true_sample_once_and_do_not_touch(mask: list[bool]) -> None:
    found = runs(np.array(mask, bool))
    assert [place for run in found for place in range(run.start, run.stop)] == [
        place for place, true in enumerate(mask) if true
    ]
    assert all(before.stop < after.start for before, after in pairwise(found))


def test_of_the_longest_runs_the_first_is_taken() -> None:
    assert longest_run(np.array([True, False, True, True, False, True, True])) == slice(2, 4)


@pytest.mark.parametrize("mask", [[], [False, False]])
def test_where_nothing_holds_the_longest_run_is_empty(mask: list[bool]) -> None:
    assert longest_run(np.array(mask, bool)) == slice(0, 0)
