"""The structure of Grauer Eq. 17 to 19 and each coefficient from a flight of the regression aerodynamics."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.estimators.equation_error import coefficient_regression
from logs.identification.estimators.wing_coefficients import (
    AeroResult,
    coefficient_r_squared,
    coefficient_terms,
    identify_coefficients,
    named,
)
from logs.identification.models.inverse_dynamics import (
    LOW_PASS,
    WingCoefficients,
    WingMotion,
    coefficients,
    moved_by_speeds,
)
from logs.identification.motion_capture.coordinates import fit_coordinates
from logs.identification.motion_capture.motion import generalized_speeds
from tests.logs.identification import slow_hawk_flight as hawk
from wingbeat.errors import InputError

NOISE = 0.0013
"""m; of the markers, Grauer IV.A"""
TRUTH = {
    named(name, term): value
    for name, terms in hawk.TRUTH.items()
    for term, value in ({"intercept": hawk.ZEROS[name]} | terms).items()
}


def tracked(
    flight: hawk.SimulatedFlight, noise: float, seed: int, low_pass: float | None = LOW_PASS
) -> WingCoefficients:
    """Coefficients by marker tracking, as in the paper."""
    found = fit_coordinates(hawk.mechanism(), hawk.marked(), hawk.observed(flight, noise, seed))
    speeds = generalized_speeds(flight.time, found, 50.0 if low_pass else 30.0)
    moved = moved_by_speeds(hawk.vehicle(), speeds, (0.0, 0.0, 0.0))
    return coefficients(hawk.vehicle(), WingMotion("flight", flight.time, moved, 1.225), low_pass)


def structure(result: AeroResult) -> dict[str, set[str]]:
    return {model.title: set(coefficient_terms(model)) for model in result.models}


EXPECTED = {name: set(terms) for name, terms in hawk.TRUTH.items()}


def test_structure_and_coefficients_of_a_tracked_flight_are_found() -> None:
    result = identify_coefficients((tracked(hawk.fly(4.0, 2), NOISE, 3),))
    assert structure(result) == EXPECTED
    found = [one for model in result.models for one in model.estimates]
    assert min(coefficient_r_squared(model.steps) for model in result.models) > 0.98
    assert {one.name for one in found} == set(TRUTH)
    assert sum(one.contains(TRUTH[one.name]) for one in found) >= len(TRUTH) - 2
    assert max(abs(one.value - TRUTH[one.name]) / one.standard_error for one in found) < 3.5


def test_three_strokes_tell_the_same_much_worse() -> None:
    errors = []
    for flight in (hawk.fly(4.0, 2), hawk.fly(4.0, 2).cut(0, 254)):
        found = tracked(flight, NOISE, 4, low_pass=None)
        fit = coefficient_regression((found.experiment,), "C_L", tuple(hawk.TRUTH["C_L"]))
        errors.append(np.sqrt(np.diag(fit.covariance)))
    assert (errors[1] / errors[0]).min() > 2.0
    assert (errors[1] / errors[0])[:2].min() > np.sqrt(2000 / 254)


def test_noise_alone_has_no_model() -> None:
    found = tracked(hawk.fly(4.0, 2).cut(0, 600), NOISE, 5)
    random = np.random.default_rng(0)
    signals = dict(found.experiment.signals) | {"C_L": random.normal(size=len(found.experiment.time))}
    result = identify_coefficients((found._replace(experiment=found.experiment._replace(signals=signals)),))
    assert not result.models[0].estimates
    assert "% of its variance" in result.models[0].withheld[0].text


def test_without_a_record_there_is_nothing_to_identify() -> None:
    with pytest.raises(InputError, match="no record"):
        identify_coefficients(())


@pytest.mark.validate
def test_structure_and_intervals_over_many_flights() -> None:
    right, covered, count = dict.fromkeys(EXPECTED, 0), dict.fromkeys(TRUTH, 0), dict.fromkeys(TRUTH, 0)
    seeds = range(24)
    for seed in seeds:
        result = identify_coefficients((tracked(hawk.fly(4.0, seed), NOISE, 100 + seed),))
        for name, terms in structure(result).items():
            right[name] += terms == EXPECTED[name]
        for found in (one for model in result.models for one in model.estimates):
            if found.name in TRUTH:
                count[found.name] += 1
                covered[found.name] += found.contains(TRUTH[found.name])
    print(f"\nstructure right in {right} of {len(seeds)}")  # noqa: T201
    print("coverage", {name: f"{covered[name]}/{count[name]}" for name in TRUTH})  # noqa: T201
    assert min(right.values()) >= 0.9 * len(seeds)
    assert sum(covered.values()) >= 0.85 * sum(count.values())
