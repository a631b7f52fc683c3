"""Arguments that are unpacked once reach kernels as those that are unpacked at every call do."""

from __future__ import annotations

import copy
import gc
import pickle
from typing import Any

import numpy as np
import pytest

from sim_bridge.compiled import Bound, bound_values, kernel


@kernel
def total(bound: Bound) -> float:
    ((table, marks), on, factor, column), shift = bound_values(bound)
    return float(factor * table[marks[0], marks[1]] + column.sum() + shift) if on else 0.0


@kernel
def fill(bound: Bound, value: float) -> None:
    (_, _, _, column), _ = bound_values(bound)
    column[:] = value


def values(on: bool = True, factor: float = 2.0) -> tuple[Any, ...]:
    """A table of 0 to 11 and a place in it, 9.0; a switch; a factor; a column with gaps whose sum is 2.5."""
    table = np.arange(12.0).reshape(3, 4)
    return (table, np.array([2, 1])), on, factor, np.linspace(0.0, 1.0, 9)[::2]


def test_a_kernel_sees_nested_tuples_flags_and_strided_arrays() -> None:
    assert total(Bound((values(), 0.5))) == pytest.approx(2.0 * 9.0 + 2.5 + 0.5)
    assert total(Bound((values(on=False), 0.5))) == 0.0


def test_what_is_written_to_an_array_is_seen_on_both_sides() -> None:
    shared = values()
    bound = Bound((shared, 0.0))
    shared[0][0][2, 1] = -1.0
    fill(bound, 3.0)
    assert total(bound) == pytest.approx(-2.0 + 15.0) and set(shared[3]) == {3.0}


def test_the_arrays_live_as_long_as_what_was_made_of_them() -> None:
    bound = Bound((values(), 0.0))
    gc.collect()
    others = [np.full((3, 4), 77.0) for _ in range(50)]
    assert total(bound) == pytest.approx(20.5) and len(others) == 50


def test_a_copy_has_arrays_of_its_own_which_are_those_of_what_was_copied_with_it() -> None:
    shared = values()
    whole = [shared[0][0], Bound((shared, 0.0))]
    table, bound = copy.deepcopy(whole)
    table[2, 1] = -1.0
    assert total(bound) == pytest.approx(-2.0 + 2.5) and total(whole[1]) == pytest.approx(20.5)
    assert total(pickle.loads(pickle.dumps(bound))) == pytest.approx(0.5)


def test_other_types_are_another_kernel_not_a_wrong_number() -> None:
    assert total(Bound((values(factor=2), 1))) == pytest.approx(2.0 * 9.0 + 2.5 + 1.0)
