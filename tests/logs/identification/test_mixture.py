"""Models of the same data count as it makes them likely, and what they differ by is among the errors."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.estimators.flight.equation_error import DerivativeFit
from logs.identification.estimators.flight.model_averaging import likely, mixed
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread

BEFORE = np.array([10.0, 1.0]) / 11.0


def fit(value: float, error: float, between: Array | None = None) -> DerivativeFit:
    return DerivativeFit(
        ("M_w",), np.array([value]), Spread(np.array([[error**2]]), 50.0, between, 6), np.array([error])
    )


def test_the_flight_decides_against_what_was_likely_before() -> None:
    """GIVEN evidence THEN the odds before times its ratio are the odds after, however small it is."""
    for shift in (0.0, -4000.0, 4000.0):
        shares = likely(np.array([shift, shift + np.log(40.0)]), BEFORE)
        assert shares[1] / shares[0] == pytest.approx(4.0)
        assert np.sum(shares) == pytest.approx(1.0)
    np.testing.assert_allclose(likely(np.zeros(2), BEFORE), BEFORE)


def test_a_model_that_found_no_optimum_counts_nothing() -> None:
    np.testing.assert_array_equal(likely(np.array([-np.inf, -3.0]), BEFORE), [0.0, 1.0])


def test_one_model_that_is_sure_is_found_unchanged() -> None:
    sure = fit(-3.0, 0.2, np.array([[0.09]]))
    found = mixed((sure, fit(5.0, 1.0, np.array([[1.0]]))), np.array([1.0, 0.0]))
    assert found.values == pytest.approx(sure.values)
    assert found.spread.covariance == pytest.approx(sure.spread.covariance)
    assert found.spread.between == pytest.approx(sure.spread.between)
    assert (found.spread.degrees, found.spread.records) == (50.0, 6)


def test_what_undecided_models_differ_by_is_among_the_errors() -> None:
    """GIVEN two normal distributions THEN mean and variance are those of a sample that is drawn from both."""
    rng, shares = np.random.default_rng(1), np.array([0.3, 0.7])
    found = mixed((fit(1.0, 0.2), fit(2.0, 0.4)), shares)
    first = rng.random(200_000) < shares[0]
    drawn = np.where(first, rng.normal(1.0, 0.2, len(first)), rng.normal(2.0, 0.4, len(first)))
    assert found.values[0] == pytest.approx(drawn.mean(), abs=0.01)
    assert found.spread.covariance[0, 0] == pytest.approx(drawn.var(), rel=0.02)
    assert found.spread.between is None


def test_scatter_between_manoeuvres_is_widened_too() -> None:
    found = mixed((fit(1.0, 0.2, np.array([[0.09]])), fit(2.0, 0.2, np.array([[0.25]]))), np.array([0.5, 0.5]))
    assert found.spread.between is not None
    assert found.spread.between[0, 0] == pytest.approx(0.17 + 0.25)
