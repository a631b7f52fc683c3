"""What methods differ by counts among the errors of each derivative, where it tells anything."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.diagnostics.model_structure_error import CALM, lacking, with_coarseness, with_differences
from logs.identification.estimators.flight.equation_error import DerivativeFit, failed
from logs.identification.statistics.parameter_uncertainty import Spread

NAMES = ("Z_w", "M_w")
ERRORS = np.array([0.3, 0.4])


def fit(*values: float) -> DerivativeFit:
    within = np.array([[0.09, 0.06], [0.06, 0.16]])
    return DerivativeFit(NAMES, np.array(values), Spread(within, 50.0, within / 2.0, 6), ERRORS)


def test_filter_error_may_be_wrong_by_the_way_to_output_error_in_each_derivative() -> None:
    """GIVEN calm air THEN variances grow by a third of the squared way, covariances not at all."""
    by_filter = fit(-8.0, -10.0)
    wider = with_coarseness(by_filter, fit(-7.0, -13.0))
    grown = wider.spread.covariance - by_filter.spread.covariance
    np.testing.assert_allclose(grown, np.diag([1.0, 9.0]) / 3.0)
    np.testing.assert_array_equal(wider.values, by_filter.values)
    assert wider.spread.between is not None and by_filter.spread.between is not None
    np.testing.assert_allclose(wider.spread.between - by_filter.spread.between, grown)


def test_what_the_speed_does_is_off_by_one_way_of_all_its_derivatives() -> None:
    """GIVEN derivatives that make the phugoid THEN they keep what they are off by together."""
    by_filter, by_output = (fit(*values)._replace(names=("Z_u", "M_u")) for values in ((-0.5, 1.0), (-0.2, 0.4)))
    grown = with_coarseness(by_filter, by_output).spread.covariance - by_filter.spread.covariance
    np.testing.assert_allclose(grown, np.array([[0.09, -0.18], [-0.18, 0.36]]) / 3.0, atol=1e-12)
    lack = np.array([0.3, -0.6])
    np.testing.assert_allclose(
        lacking(by_filter, lack).spread.covariance - by_filter.spread.covariance, np.outer(lack, lack)
    )


def test_what_a_model_lacks_moves_the_short_periods_derivatives_together_or_each_alone() -> None:
    known = fit(-8.0, -10.0)
    grown = lacking(known, np.array([1.0, -2.0])).spread.covariance - known.spread.covariance
    np.testing.assert_allclose(grown, [[1.0, -1.0], [-1.0, 4.0]])
    assert lacking(known, np.zeros(0)) is known


def test_output_error_tells_nothing_of_filter_error_in_gusts_or_where_it_failed() -> None:
    by_filter = fit(-8.0, -10.0)
    for other in (fit(-7.0, -13.0)._replace(explained=CALM - 0.01), failed(NAMES, "lost")):
        assert with_coarseness(by_filter, other) is by_filter
    assert with_coarseness(failed(NAMES, "too short"), fit(-7.0, -13.0)).failure == "too short"


def test_a_derivative_that_is_not_fitted_by_both_is_as_sure_as_before() -> None:
    by_filter = fit(-8.0, -10.0)
    other = DerivativeFit(("M_w",), np.array([-13.0]), Spread(np.array([[0.1]]), 50.0), ERRORS[:1])
    grown = with_coarseness(by_filter, other).spread.covariance - by_filter.spread.covariance
    np.testing.assert_allclose(grown, np.diag([0.0, 3.0]))


@pytest.mark.parametrize(("apart", "grown"), [(0.5, 0.0), (6.0, 3.0)])
def test_equation_and_output_error_differ_by_noise_or_by_what_the_model_lacks(apart: float, grown: float) -> None:
    both = with_differences(fit(-8.0, -10.0), fit(-8.0, -10.0 + apart), 6)
    for one in both:
        np.testing.assert_allclose(one.spread.covariance - fit(0.0, 0.0).spread.covariance, np.diag([0.0, grown]))
