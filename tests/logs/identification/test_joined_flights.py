"""Several flights of one aircraft are one: the same manoeuvres as each alone, in one fit."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, by_output_error, fly, model_of

from avionics.quantities import BadInput
from logs.identification.modes.mode import short_period_of
from logs.identification.preparing.manoeuvre import find_manoeuvres
from logs.identification.preparing.stretches import stretches
from logs.identification.sources.joined import joined_flights

FLIGHTS = tuple(fly(Flight(seed=seed, modulation=0.2)) for seed in (1, 2))


def test_the_manoeuvres_are_those_of_each_flight() -> None:
    together = find_manoeuvres(joined_flights(FLIGHTS), AIRCRAFT)
    alone = [one for flight in FLIGHTS for one in find_manoeuvres(flight, AIRCRAFT)]
    assert [one.number for one in together] == list(range(1, 13))
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.averages, other.averages, atol=1e-6)
        assert one.airspeed == pytest.approx(other.airspeed, abs=1e-3)


def test_one_fit_of_all_is_tighter_than_that_of_any() -> None:
    true, _ = short_period_of(model_of(Flight()).a)
    flights = tuple(fly(Flight(seed=seed)) for seed in (1, 2, 3))
    together, *alone = (by_output_error(one).frequency for one in (joined_flights(flights), *flights))
    assert together is not None and together.contains(true)
    assert all(one is not None and together.standard_error < one.standard_error for one in alone)


def test_a_manoeuvre_that_the_end_of_a_flight_cuts_holds_nothing_of_the_next() -> None:
    first, second = FLIGHTS
    end = int(np.flatnonzero(first.active)[-1]) - 40
    arrays = {name: getattr(first, name)[:end] for name in first._fields if name != "notes"}
    cut = first._replace(**arrays)
    shaken = second._replace(pitch_rate=second.pitch_rate + 5.0)
    calm, kicked = (find_manoeuvres(joined_flights((cut, one)), AIRCRAFT) for one in (second, shaken))
    assert len(calm) == len(kicked) == 12
    for one, other in zip(calm[:6], kicked[:6], strict=True):
        np.testing.assert_array_equal(one.averages, other.averages)
        np.testing.assert_array_equal(one.averaging_to_end @ one.raw, other.averaging_to_end @ other.raw)


def test_no_stretch_of_strokes_goes_from_one_flight_into_another() -> None:
    """GIVEN flights that begin and end within a second of a manoeuvre."""
    together = joined_flights(FLIGHTS)
    found = stretches(together, find_manoeuvres(together, AIRCRAFT), 0.0)
    alone = [stretches(one, find_manoeuvres(one, AIRCRAFT), 0.0) for one in FLIGHTS]
    assert len(found) == sum(len(each) for each in alone) == 2
    for one, other in zip(found, (each[0] for each in alone), strict=True):
        assert abs(len(one.averages) - len(other.averages)) <= 1


def test_flights_of_other_rates_are_not_joined() -> None:
    other = FLIGHTS[1]._replace(time=2.0 * FLIGHTS[1].time)
    with pytest.raises(BadInput, match=r"sample every 0.005 s and 0.01 s: they must agree"):
        joined_flights((FLIGHTS[0], other))
