"""What large inputs make of the kinematics, and a stroke that modulates, is not taken for the aircraft."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly
from test_short_period_coverage import LIGHT, truth_of

from logs.identification.data.maneuvers import find_manoeuvres, lagged, reference_of
from logs.identification.estimators.equivalent_system import equivalent_system
from logs.identification.estimators.flight.linearization_correction import beyond_small_motions
from logs.identification.estimators.flight.output_error import with_lag_known
from logs.identification.estimators.flight.short_period import FITTED_OUTPUTS, fit_derivatives, records_flown
from logs.identification.estimators.flight.simulation import Problem
from logs.identification.estimators.free_response import free_response
from logs.identification.estimators.records import Records, averaged_records
from logs.identification.models.modes import Mode
from logs.identification.models.stroke_averaged import LONGITUDINAL, TAIL_LAG
from logs.identification.results import Array


def seen(flight: Flight) -> tuple[Records, Records, tuple[float, float]]:
    """Records as measured, records as small motions would have them, and the true frequency and damping."""
    data = fly(flight)
    manoeuvres = find_manoeuvres(data, flight.aircraft)
    reference = reference_of(data, manoeuvres)
    problem = Problem(manoeuvres, reference, flight.aircraft, LONGITUDINAL, FITTED_OUTPUTS)
    _, fit = fit_derivatives(problem)
    true = truth_of(flight, reference)
    pair = true["short_period_frequency"], true["short_period_damping"]
    return averaged_records(manoeuvres), records_flown(problem, fit), pair


def half_widths(mode: Mode) -> Array:
    """Of frequency, as a share, and damping."""
    assert mode.frequency is not None and mode.damping is not None
    frequency, damping = mode.frequency, mode.damping
    return np.array([(frequency.high - frequency.low) / 2 / frequency.value, (damping.high - damping.low) / 2])


def test_a_swing_through_a_quarter_of_a_radian_costs_no_damping() -> None:
    """GIVEN 0.27 rad of pitch to either side THEN the free motion's damping is that of small motions."""
    measured, small, (_, damping) = seen(LIGHT._replace(shaking=0.0, noise=0.1))
    before, after = free_response(measured).damping, free_response(small).damping
    assert before is not None and after is not None
    assert abs(before.value - damping) > 5e-4
    assert abs(after.value - damping) < 2e-4


@pytest.mark.parametrize("flight", [Flight(width=0.4), Flight(modulation=0.3)])
def test_what_a_model_tells_of_large_motions_is_no_noise(flight: Flight) -> None:
    """GIVEN inputs of 0.4 s, or a stroke that modulates THEN the equivalent system knows the damping much better."""
    widths, hits = [], []
    for seed in range(4):
        measured, small, (frequency, damping) = seen(flight._replace(seed=seed))
        before, after = equivalent_system(measured), equivalent_system(small)
        widths.append([half_widths(before), half_widths(after)])
        assert after.frequency is not None and after.damping is not None
        hits += [after.frequency.contains(frequency), after.damping.contains(damping)]
    (_, before_damping), (_, after_damping) = np.median(widths, axis=0)
    assert after_damping < 0.65 * before_damping
    assert sum(hits) >= 7


def test_a_lag_that_is_found_is_in_the_model_that_tells_of_large_motions() -> None:
    """GIVEN a tail of unknown lag THEN what is taken off is as if it had been known."""
    flight = Flight(width=0.4)
    data = fly(flight)
    known = find_manoeuvres(data, AIRCRAFT)
    without = AIRCRAFT._replace(tail_time_constant=None)
    manoeuvres = find_manoeuvres(data, without)
    reference = reference_of(data, manoeuvres)
    _, fit = fit_derivatives(Problem(manoeuvres, reference, without, LONGITUDINAL, FITTED_OUTPUTS))
    assert TAIL_LAG in fit.names
    problem, there = with_lag_known(Problem(manoeuvres, reference, without, LONGITUDINAL, FITTED_OUTPUTS), fit)
    assert problem.aircraft.tail_time_constant == pytest.approx(AIRCRAFT.tail_time_constant, abs=0.01)
    again = lagged(manoeuvres[0], problem.aircraft)
    np.testing.assert_array_equal(problem.manoeuvres[0].tail, again.tail)
    told = beyond_small_motions(problem, there)
    _, right = fit_derivatives(Problem(known, reference, AIRCRAFT, LONGITUDINAL, FITTED_OUTPUTS))
    asked = beyond_small_motions(Problem(known, reference, AIRCRAFT, LONGITUDINAL, FITTED_OUTPUTS), right)
    for one, other in zip(told, asked, strict=True):
        assert np.max(np.abs(one - other), axis=0)[0] < 0.1 * np.max(np.abs(other), axis=0)[0]


def test_a_model_that_flies_without_bound_takes_nothing_off() -> None:
    """GIVEN a fit whose motion diverges THEN records are as they were measured, not lost."""
    data = fly(Flight(doublets=2))
    manoeuvres = find_manoeuvres(data, AIRCRAFT)
    problem = Problem(manoeuvres, reference_of(data, manoeuvres), AIRCRAFT, LONGITUDINAL, FITTED_OUTPUTS)
    _, fit = fit_derivatives(problem)
    values = fit.values.copy()
    values[LONGITUDINAL.index("M_w")] = 2000.0
    diverging = fit._replace(values=values, failure="")
    for one, plain in zip(records_flown(problem, diverging).pieces, averaged_records(manoeuvres).pieces, strict=True):
        np.testing.assert_array_equal(one.outputs, plain.outputs)
