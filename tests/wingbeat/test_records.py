"""Constructors of NamedTuples: as the class, but faster."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from wingbeat.records import constructor


class Sample(NamedTuple):
    time_us: int
    value: float
    valid: int = 1


new_sample = constructor(Sample)


def test_constructor_equals_class() -> None:
    made = new_sample(3, 0.5)
    assert made == Sample(3, 0.5) and type(made) is Sample
    assert new_sample(value=0.5, time_us=3, valid=0) == Sample(3, 0.5, 0)


@pytest.mark.parametrize("values", [(), (1,), (1, 2.0, 3, 4)])
def test_constructor_wrong_number_of_fields_raises(values: tuple[float, ...]) -> None:
    with pytest.raises(TypeError):
        new_sample(*values)  # type: ignore[arg-type]


def test_constructor_unknown_name_raises() -> None:
    with pytest.raises(TypeError):
        new_sample(1, 2.0, other=1)  # type: ignore[call-arg]
