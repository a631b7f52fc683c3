"""Which terms stepwise regression and orthogonal functions find, and what they tell of the way."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import coefficient_regression
from logs.identification.estimators.model_structure import orthogonal_regression, orthogonalized
from logs.identification.estimators.stepwise import Rules, stepwise_regression
from logs.identification.estimators.terms import pool
from logs.identification.report.subjects import step_table
from logs.pages.document import Chapter
from logs.pages.render import page
from tests.logs.identification.colored_noise import noise, simulated

CANDIDATES = pool(("alpha", "q", "delta"), 2)
NEEDED = {"alpha", "q", "alpha^2"}


def curved(kind: str, seed: int, size: float = 0.3, count: int = 500) -> Experiment:
    """A flight whose coefficient is 1 + 3 alpha - q + 0.8 alpha^2 plus noise."""
    flight = simulated("white", count, seed, 0.0)
    alpha, q = flight.signals["alpha"], flight.signals["q"]
    coefficient = 1 + 3 * alpha - q + 0.8 * alpha**2 + size * noise(kind, count, np.random.default_rng(seed + 999))
    return flight._replace(signals={**flight.signals, "C": coefficient})


@pytest.mark.parametrize("stop", ["F", "PSE"])
def test_stepwise_finds_the_terms(stop: str) -> None:
    found = stepwise_regression((curved("white", 1),), "C", CANDIDATES, Rules(stop))
    assert set(found.terms) == NEEDED
    assert not found.failure
    truth = {"intercept": 1.0, "alpha": 3.0, "q": -1.0, "alpha^2": 0.8}
    assert all(one.contains(truth[one.name]) for one in found.model.estimates)


def test_press_keeps_what_is_needed() -> None:
    found = stepwise_regression((curved("white", 1),), "C", CANDIDATES, Rules("PRESS"))
    assert set(found.terms) >= NEEDED


def test_coloured_residuals_let_no_more_terms_in() -> None:
    """By chance alone one flight in twenty gets a term too many; samples taken for independent give many each."""
    extra = 0
    for seed in range(4):
        found = stepwise_regression((curved("AR 0.9", seed, 0.1),), "C", CANDIDATES)
        extra += len(set(found.terms) - NEEDED)
    assert extra <= 1
    assert found.independent < 250


@pytest.mark.validate
@pytest.mark.parametrize("kind", ["white", "AR 0.9", "flapping"])
def test_a_term_too_many_is_as_rare_as_promised(kind: str) -> None:
    """The response is noise alone: 5 % of the flights may have any term."""
    wrong = 0
    for seed in range(100):
        flight = simulated(kind, 250, seed, 1.0)
        alone = noise(kind, 250, np.random.default_rng(seed + 5000))
        wrong += bool(
            stepwise_regression((flight._replace(signals={**flight.signals, "C": alone}),), "C", CANDIDATES).terms
        )
    sys.stdout.write(f"\n{kind}: {wrong} % with a term that is not there")
    assert wrong <= 10


def test_every_step_tells_its_term_its_reason_and_its_statistics() -> None:
    found = stepwise_regression((curved("white", 2),), "C", CANDIDATES)
    first, *middle, last = found.steps
    assert first.action == "start" and first.terms == ()
    assert first.statistics.r_squared == pytest.approx(0.0)
    assert last.action == "stops" and "limit" in last.why
    assert middle[0].term == "alpha" and middle[0].action == "enters"
    assert last.terms == found.terms
    for step in middle:
        assert np.all(np.isfinite([step.partial_f, step.colored_f, step.probability, *step.statistics]))
    rises = [step.statistics.r_squared for step in found.steps if step.action != "leaves"]
    assert rises == sorted(rises)
    final = middle[-1].statistics
    assert final.variance < final.press < final.pse


def test_a_term_that_became_superfluous_leaves() -> None:
    """The sum of two regressors enters first and leaves when both are there."""
    flight = simulated("white", 400, 3, 0.0)
    alpha, delta = flight.signals["alpha"], flight.signals["delta"]
    both = alpha + delta + 0.3 * noise("white", 400, np.random.default_rng(1))
    response = alpha + delta + 0.02 * noise("white", 400, np.random.default_rng(2))
    signals = {**flight.signals, "both": both, "C": response}
    found = stepwise_regression((flight._replace(signals=signals),), "C", ("alpha", "delta", "both"))
    assert set(found.terms) == {"alpha", "delta"}
    leaving = [step for step in found.steps if step.action == "leaves"]
    assert [step.term for step in leaving] == ["both"]
    assert "probability of its F by chance" in leaving[0].why


def test_statistics_are_the_published_ones_for_white_residuals() -> None:
    """PRESS by leaving out each sample for true; s^2 and partial F by two fits."""
    flight = curved("white", 4, count=60)
    found = stepwise_regression((flight,), "C", ("alpha", "q", "alpha^2"), Rules(always=("alpha", "q", "alpha^2")))
    x = np.column_stack([np.ones(60), flight.signals["alpha"], flight.signals["q"], flight.signals["alpha"] ** 2])
    z = flight.signals["C"]
    errors = []
    for left_out in range(60):
        kept = np.arange(60) != left_out
        errors.append(z[left_out] - x[left_out] @ np.linalg.lstsq(x[kept], z[kept], rcond=None)[0])
    told = found.steps[0].statistics
    rest = z - x @ np.linalg.lstsq(x, z, rcond=None)[0]
    assert told.variance == pytest.approx(rest @ rest / 56)
    assert found.independent == pytest.approx(60, rel=0.35)
    if round(60 / found.independent) == 1:
        assert told.press == pytest.approx(np.mean(np.square(errors)))
    assert told.r_squared == pytest.approx(1 - rest @ rest / np.sum((z - z.mean()) ** 2))


def test_terms_that_are_always_in_stay_and_the_most_is_kept() -> None:
    found = stepwise_regression((curved("white", 5),), "C", CANDIDATES, Rules(always=("delta",), most_terms=2))
    assert found.terms == ("delta", "alpha")
    assert "2 terms are the most" in found.steps[-1].why


def test_dependent_candidates_and_short_records_are_said() -> None:
    flight = curved("white", 6)
    signals = {**flight.signals, "twin": 2 * flight.signals["alpha"], "still": np.ones(500)}
    found = stepwise_regression((flight._replace(signals=signals),), "C", ("alpha", "twin", "still"))
    assert len(found.terms) == 1
    assert "no candidate is left" in found.steps[-1].why
    short = flight._replace(time=flight.time[:4], signals={n: s[:4] for n, s in flight.signals.items()})
    assert "samples with C" in stepwise_regression((short,), "C", CANDIDATES).failure
    assert "samples with C" in orthogonal_regression((short,), "C", CANDIDATES).failure


def test_orthogonal_functions_find_the_terms_and_give_ordinary_coefficients() -> None:
    flight = curved("white", 7)
    found = orthogonal_regression((flight,), "C", CANDIDATES)
    assert set(found.terms) == NEEDED
    plain = coefficient_regression((flight,), "C", found.terms)
    np.testing.assert_allclose(found.model.values, plain.values)
    ordinary = np.array([plain.values[plain.names.index(term)] for term in found.terms])
    np.testing.assert_allclose(np.linalg.solve(found.triangle, found.amplitudes), ordinary, rtol=1e-8)


def test_orthogonal_functions_are_orthonormal_and_sums_of_terms() -> None:
    flight = curved("white", 8)
    found = orthogonal_regression((flight,), "C", CANDIDATES)
    powers = [(term.removesuffix("^2"), 2 if term.endswith("^2") else 1) for term in found.terms]
    terms = np.column_stack([flight.signals[name] ** power for name, power in powers])
    table = (terms - terms.mean(axis=0)) @ np.linalg.inv(found.triangle)
    np.testing.assert_allclose(table.T @ table, np.eye(len(powers)), atol=1e-8)
    response = flight.signals["C"] - flight.signals["C"].mean()
    np.testing.assert_allclose(table.T @ response, found.amplitudes, rtol=1e-6)


def test_orthogonalisation_survives_candidates_that_are_almost_alike() -> None:
    rng = np.random.default_rng(9)
    base = rng.normal(size=200)
    columns = np.column_stack([base, base + 1e-4 * rng.normal(size=200), base, rng.normal(size=200)])
    order, basis, triangle = orthogonalized(columns, base + rng.normal(size=200), 10)
    assert len(order) == 3
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(basis @ triangle, columns[:, order], atol=1e-10)


def test_noise_alone_has_no_structure() -> None:
    flight = simulated("white", 300, 10, 0.0)
    alone = noise("white", 300, np.random.default_rng(11))
    nothing = flight._replace(signals={**flight.signals, "C": alone})
    assert stepwise_regression((nothing,), "C", CANDIDATES).terms == ()
    assert sum(function.gain for function in orthogonal_regression((nothing,), "C", CANDIDATES).functions) < 0.06


def test_a_term_that_adds_too_little_is_told_with_a_raised_two() -> None:
    found = stepwise_regression((curved("white", 6),), "C", CANDIDATES, Rules(least_gain=0.99))
    assert found.steps[-1].why.startswith("R^2 would rise by ")
    text = page("t", (), (Chapter("c", (), (step_table(found.steps),)),))
    assert "<td>R² would rise by " in text
