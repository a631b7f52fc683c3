"""Data held back: whole flights, the same for the same seed, never shared with what is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.data.maneuvers import excited, split
from wingbeat.errors import InputError


def manoeuvre(name: str) -> Experiment:
    return Experiment(name, np.arange(3.0), {}, {})


FLIGHTS = {f"flight {n}": [manoeuvre(f"flight {n}, manoeuvre {k}") for k in range(3)] for n in range(6)}


@pytest.mark.parametrize("seed", range(5))
def test_no_flight_is_on_both_sides(seed: int) -> None:
    parts = split(FLIGHTS, seed=seed)
    sides = [{e.name.split(",")[0] for e in part} for part in (parts.training, parts.validation)]
    assert not sides[0] & sides[1]
    assert [len(side) for side in sides] == [4, 2]
    assert len(parts.training) + len(parts.validation) == 18
    assert (len(parts.held_out), parts.groups, parts.kind) == (2, 6, "flights")


def test_the_seed_decides_and_the_order_does_not() -> None:
    backwards = dict(reversed(FLIGHTS.items()))
    assert split(FLIGHTS, seed=3) == split(backwards, seed=3)
    assert len({split(FLIGHTS, seed=seed).held_out for seed in range(20)}) > 3


def test_of_one_flight_whole_manoeuvres_are_held_back_and_it_is_said() -> None:
    parts = split({"flight 0": FLIGHTS["flight 0"], "empty": []})
    assert (len(parts.training), len(parts.validation)) == (2, 1)
    assert (parts.groups, parts.kind) == (3, "maneuvers")


def test_what_cannot_be_split_is_refused() -> None:
    with pytest.raises(InputError, match="single maneuver"):
        split({"flight": [manoeuvre("one")]})
    with pytest.raises(InputError, match="between 0 and 1"):
        split(FLIGHTS, fraction=1.0)


def flight(numbers: list[float], aborted: float = 0.0) -> Experiment:
    """Twenty samples, one a second, of each number in turn; 0 for none."""
    number = np.repeat(numbers, 20)
    signals = {
        "active": (number > 0).astype(float),
        "manoeuvre": number,
        "aborted": ((number == aborted) & (number > 0)).astype(float),
    }
    return Experiment("flight 7", np.arange(len(number), dtype=float), signals, dict.fromkeys(signals, "-"))


def test_manoeuvres_are_cut_by_the_logged_excitation() -> None:
    """GIVEN 1, a pause, 2 and at once 3, which the record's end cuts, THEN 1 and 2 are whole."""
    found = excited(flight([0, 1, 0, 2, 3]), lead=5.0, tail=30.0)
    assert [e.name for e in found] == ["flight 7, maneuver 1", "flight 7, maneuver 2"]
    assert [(e.time[0], e.time[-1]) for e in found] == [(15.0, 59.0), (55.0, 79.0)]


def test_an_aborted_manoeuvre_is_left_out() -> None:
    assert [e.name[-1] for e in excited(flight([0, 1, 0, 2, 0], aborted=1.0))] == ["2"]
    with pytest.raises(InputError, match="no complete maneuver"):
        excited(flight([0, 1, 0], aborted=1.0))
    with pytest.raises(InputError, match="has no signal active"):
        excited(Experiment("flight", np.arange(3.0), {}, {}))
