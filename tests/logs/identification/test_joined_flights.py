"""Several flights of one aircraft are one: the same manoeuvres as each alone, in one fit."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, TRUTH, Flight, by_output_error, fly, model_of

from logs.identification.data.flight import FlightData
from logs.identification.data.maneuvers import Maneuver, by_flight, find_maneuvers, reference_of
from logs.identification.diagnostics.agreement import validation
from logs.identification.estimators.flight_modes import (
    FlightProblem,
    fit_derivatives,
    identify_modes,
    results_of,
)
from logs.identification.models.modes import ModesResult, short_period_of
from logs.identification.report.numbers import Identification, document, rows
from logs.identification.report.report import method_results
from logs.identification.results import Array
from logs.identification.sources.topic_table import joined_flights
from wingbeat.errors import InputError

FLIGHTS = tuple(fly(Flight(seed=seed, modulation=0.2)) for seed in (1, 2))
NAMES = ("monday.mcap", "tuesday.mcap", "friday.mcap")
SOFTER = TRUTH | {"M_w": 0.5 * TRUTH["M_w"], "M_q": 0.5 * TRUTH["M_q"]}


def held_out(last: FlightData) -> ModesResult:
    """Output error of two flights, ``last`` held out."""
    together = joined_flights((*FLIGHTS, last), NAMES)
    kept, locked = by_flight(find_maneuvers(together), ("friday.mcap",))
    problem = FlightProblem(kept, reference_of(together, kept), AIRCRAFT)
    results = results_of(problem, fit_derivatives(problem), locked)
    return ModesResult((), None, "", problem.reference, len(kept), 0.25, kept, results, locked, (), problem)


def columns(one: Maneuver) -> Array:
    signals = one.experiment.signals
    return np.column_stack([signals[name] for name in ("delta_e", "q", "a_x", "a_z", "theta")])


def test_the_manoeuvres_are_those_of_each_flight() -> None:
    together = find_maneuvers(joined_flights(FLIGHTS))
    alone = [one for flight in FLIGHTS for one in find_maneuvers(flight)]
    assert [one.number for one in together] == list(range(1, 13))
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(columns(one), columns(other), atol=1e-6)
        assert one.airspeed == pytest.approx(other.airspeed, abs=1e-3)


@pytest.mark.validate
def test_one_fit_of_all_is_tighter_than_that_of_any() -> None:
    true, _ = short_period_of(model_of(Flight()).a)
    flights = tuple(fly(Flight(seed=seed)) for seed in (1, 2, 3))
    together, *alone = (by_output_error(one).frequency for one in (joined_flights(flights), *flights))
    assert together is not None and together.contains(true)
    assert all(one is not None and together.standard_error < one.standard_error for one in alone)


def test_a_manoeuvre_that_the_end_of_a_flight_cuts_holds_nothing_of_the_next() -> None:
    first, second = FLIGHTS
    end = int(np.flatnonzero(first.active)[-1]) - 40
    arrays = {name: getattr(first, name)[:end] for name in first.arrays()}
    cut = first._replace(**arrays)
    shaken = second._replace(pitch_rate=second.pitch_rate + 5.0)
    calm, kicked = (find_maneuvers(joined_flights((cut, one))) for one in (second, shaken))
    assert len(calm) == len(kicked) == 12
    for one, other in zip(calm[:6], kicked[:6], strict=True):
        np.testing.assert_array_equal(columns(one), columns(other))


def test_flights_of_other_rates_are_not_joined() -> None:
    other = FLIGHTS[1]._replace(time=2.0 * FLIGHTS[1].time)
    with pytest.raises(InputError, match=r"sample every 0.005 s and 0.01 s: they must agree"):
        joined_flights((FLIGHTS[0], other))


def test_a_manoeuvre_of_joined_flights_is_named_as_its_own_log_has_it() -> None:
    second = FLIGHTS[1]._replace(time=FLIGHTS[1].time + 100.0)
    together = find_maneuvers(joined_flights((FLIGHTS[0], second), NAMES[:2]))
    alone = [one for flight in (FLIGHTS[0], second) for one in find_maneuvers(flight)]
    assert alone[7].name.startswith("maneuver 2 at 10")
    flights = [name for name in NAMES[:2] for _ in range(6)]
    assert [one.name for one in together] == [
        f"{one.name} of {name}" for one, name in zip(alone, flights, strict=True)
    ]


@pytest.mark.validate
def test_what_a_held_out_flight_holds_moves_no_number_and_is_predicted() -> None:
    """GIVEN a third flight of the same aircraft, and one of a softer one, each held out."""
    same, other = (held_out(fly(Flight(seed=3, truth=truth))) for truth in (TRUTH, SOFTER))
    assert same.results[0].estimates == other.results[0].estimates
    near, far = validation(same), validation(other)
    assert near is not None and far is not None and near.held_out == ("friday.mcap",)
    assert {one.flight for one in near.predictions} == {"friday.mcap"}
    worst = max(one.theil.coefficient for one in near.predictions)
    assert worst < 0.3
    rates = [next(one.theil.coefficient for one in each.predictions if one.output == "q") for each in (near, far)]
    assert rates[1] > 2.0 * rates[0]


@pytest.mark.validate
def test_the_report_draws_a_whole_flight_and_says_so() -> None:
    """GIVEN flights of which none was asked to be held out: those of one are predicted by a second fit."""
    result = held_out(fly(Flight(seed=3)))
    series = tuple(one for one in result.results[0].series if not one.held_out)
    results = (result.results[0]._replace(series=series), *result.results[1:])
    by_request, by_second_fit = (
        method_results(Identification(modes=modes))
        for modes in (result, result._replace(held_out=(), results=results))
    )
    for fits, note in (by_request, by_second_fit):
        names = {one.experiment.rpartition(" of ")[2] for one in fits[0].series if one.held_out}
        assert len(names) == 1 and note.startswith("6 of ")
    predicted = {one.experiment for one in by_second_fit[0][0].series if one.held_out}
    assert not predicted & {m.name for m in result.held_out}


def test_modes_of_joined_flights_tell_theils_coefficient_of_the_one_held_out() -> None:
    found = identify_modes(joined_flights(FLIGHTS, NAMES[:2]), AIRCRAFT, held_out=("tuesday.mcap",))
    assert found.manoeuvres == 6
    assert {one.flight.name for one in found.maneuvers if one.flight} == {"monday.mcap"}
    told = Identification(modes=found)
    note = next(row.note for row in rows(told) if row.name == "held out")
    assert note.startswith("tuesday.mcap (6 maneuvers), predicted and not fitted: Theil's U q 0.")
    entry = document(told)["modes"]["held_out"]
    assert entry["flights"] == ["tuesday.mcap"] and [one["output"] for one in entry["predictions"]] == [
        "q",
        "a_x",
        "a_z",
    ]
    assert all(0.0 < one["theil"]["coefficient"] < 0.3 for one in entry["predictions"])


def test_where_nothing_would_be_left_to_fit_it_is_refused() -> None:
    manoeuvres = find_maneuvers(joined_flights(FLIGHTS, NAMES[:2]))
    with pytest.raises(InputError, match=r"every flight with a usable maneuver is held out"):
        by_flight(manoeuvres, NAMES[:2])
    with pytest.raises(InputError, match=r"friday.mcap is held out and has no complete elevator maneuver"):
        by_flight(manoeuvres, ("friday.mcap",))
