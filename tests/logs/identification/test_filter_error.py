"""Filter error of linear models: derivatives of an aircraft in turbulence, within their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from output_error_cases import (
    LATERAL,
    SHORT_PERIOD,
    SHORT_PERIOD_TRUTH,
    covered,
    measured,
    parameters,
    pitching,
    steps,
    vector,
)
from scipy.linalg import solve_discrete_are

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Nuisances, Parameter, Prior, Problem
from logs.identification.estimators.filter_error import PREFIX, discrete_noise, filter_error, riccati, steady_gain
from logs.identification.estimators.output_error import output_error
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.models.actuators import actuated
from wingbeat.errors import InputError

STEP, COUNT, FINE = 0.02, 500, 10
STRENGTHS = {"alpha": 0.02, "q": 0.15}
NOISE = np.array([0.002, 0.004, 0.002, 0.01, 0.2, 0.02])
OUTPUTS = ("alpha", "q", "a_z")


def turbulent(seed: int, gaps: bool = False, scale: float = 1.0, delay: int = 0) -> Experiment:
    """Short period driven by a 3-2-1-1 elevator input and by white process noise."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(COUNT)
    elevator = steps(time, 1.0, 0.4, 0.06)
    acting = np.concatenate((np.zeros(delay), elevator[: COUNT - delay]))
    system = SHORT_PERIOD.matrices(vector(SHORT_PERIOD, SHORT_PERIOD_TRUTH))
    strengths = scale * np.array([STRENGTHS.get(name, 0.0) for name in SHORT_PERIOD.states])
    dt, x, states = STEP / FINE, np.zeros(3), np.zeros((COUNT, 3))
    for k in range(COUNT):
        states[k] = x
        for _ in range(FINE):
            x = x + dt * (system.a @ x + system.b[:, 0] * acting[k]) + np.sqrt(dt) * strengths * rng.normal(size=3)
    outputs = states @ system.c.T + np.outer(acting, system.d[:, 0]) + NOISE * rng.normal(size=(COUNT, len(NOISE)))
    if gaps:
        outputs[200:215] = np.nan
        outputs[300:310, 1] = np.nan
    return measured(f"turbulent {seed}", time, SHORT_PERIOD, outputs, elevator[:, None])


def problem_of(*experiments: Experiment) -> Problem:
    return Problem(
        SHORT_PERIOD, experiments, parameters(SHORT_PERIOD_TRUTH), OUTPUTS, Nuisances(output_biases=OUTPUTS)
    )


@pytest.mark.validate
def test_filter_error_in_turbulence_covers_the_truth() -> None:
    """GIVEN records in turbulence, one with gaps WHEN fitted THEN intervals cover, narrower than output error's."""
    hits, ratios = 0, []
    for seed in range(8):
        problem = problem_of(turbulent(2 * seed), turbulent(2 * seed + 1, gaps=True))
        fit, plain = filter_error(problem), output_error(problem)
        assert not fit.failure
        found = {one.name: one for one in fit.estimates}
        hits += sum(found[name].contains(value) for name, value in SHORT_PERIOD_TRUTH.items())
        widths = {one.name: one.standard_error for one in plain.estimates}
        ratios.append([found[name].standard_error / widths[name] for name in ("Z_alpha", "M_q")])
        assert found[PREFIX + "alpha"].value == pytest.approx(STRENGTHS["alpha"], rel=0.35)
    assert hits >= 0.85 * 8 * len(SHORT_PERIOD_TRUTH)
    assert np.median(ratios, axis=0)[0] < 0.4
    assert np.median(ratios, axis=0)[1] < 0.9


def test_filter_error_in_calm_air_equals_output_error() -> None:
    problem = Problem(SHORT_PERIOD, (pitching(1), pitching(2)), parameters(SHORT_PERIOD_TRUTH), OUTPUTS)
    plain, found = output_error(problem), {one.name: one for one in filter_error(problem).estimates}
    assert covered(plain, SHORT_PERIOD_TRUTH) >= 5
    for one in plain.estimates:
        assert found[one.name].value == pytest.approx(one.value, abs=one.standard_error)


def test_filter_error_through_an_actuator_finds_the_delay() -> None:
    model = actuated(SHORT_PERIOD, ("delta_e",))._replace(zoh_inputs=("delta_e",))
    free = parameters(SHORT_PERIOD_TRUTH) | {"delay_delta_e": Parameter(0.0, low=-0.2, high=0.2)}
    problem = problem_of(turbulent(3, delay=3), turbulent(4, delay=3))._replace(model=model, parameters=free)
    found = {one.name: one for one in filter_error(problem).estimates}
    assert found["delay_delta_e"].value == pytest.approx(3 * STEP, abs=0.01)


def test_prior_shrinks_an_estimate_and_its_interval() -> None:
    """GIVEN a prior as wide as the standard error THEN the estimate is halfway and the variance half."""
    problem = problem_of(turbulent(5, scale=0.0))
    plain = {one.name: one for one in output_error(problem).estimates}["M_q"]
    mean = plain.value + 2.0 * plain.standard_error
    prior = Prior(mean, plain.standard_error)
    free = dict(problem.parameters) | {"M_q": Parameter(plain.value, prior=prior)}
    found = {one.name: one for one in output_error(problem._replace(parameters=free)).estimates}["M_q"]
    assert found.value == pytest.approx((plain.value + mean) / 2, abs=0.6 * plain.standard_error)
    assert found.standard_error == pytest.approx(plain.standard_error / np.sqrt(2), rel=0.2)


def test_riccati_and_gain_equal_scipys() -> None:
    system = LATERAL.matrices(np.linspace(-2.0, 1.0, len(LATERAL.parameters)))
    density, noise = np.diag([0.1, 0.5, 0.2, 0.0]), np.diag([0.1, 0.2, 0.3])
    transition, covariance = discrete_noise(system.a, density, 0.05)
    c = system.c[:3]
    expected = solve_discrete_are(transition.T, c.T, covariance, noise)
    np.testing.assert_allclose(riccati(transition, c, covariance, noise), expected, rtol=1e-7, atol=1e-10)
    gain = expected @ c.T @ np.linalg.inv(c @ expected @ c.T + noise)
    found, innovations = steady_gain(system.a, c, density, noise, 0.05)
    np.testing.assert_allclose(found, gain, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(innovations, c @ expected @ c.T + noise, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", ["output_error", "filter_error"])
def test_registry_rows_return_results(method: str) -> None:
    request = Request((turbulent(1),), (turbulent(2),), ("delta_e",), OUTPUTS, (), SHORT_PERIOD, SHORT_PERIOD_TRUTH)
    result = ESTIMATORS[method].estimate(request)
    assert result.method == method and result.status == "converged"
    assert result.covariance is not None and result.covariance.shape == 2 * (len(result.estimates),)
    assert {one.held_out for one in result.series} == {False, True}
    assert result.value("M_alpha") == pytest.approx(SHORT_PERIOD_TRUTH["M_alpha"], rel=0.3)


def test_filter_error_needs_a_known_state() -> None:
    with pytest.raises(InputError, match="no state V"):
        filter_error(problem_of(turbulent(1)), ("V",))
