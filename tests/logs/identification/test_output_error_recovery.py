"""Output error finds the truth within its own intervals: every model, gaps, biases, several manoeuvres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from output_error_cases import (
    JET,
    JET_TRUTH,
    LATERAL,
    LATERAL_TRUTH,
    LONGITUDINAL,
    LONGITUDINAL_TRUTH,
    SHORT_PERIOD,
    SHORT_PERIOD_TRUTH,
    covered,
    jet,
    noise,
    parameters,
    pitching,
    simulated,
    steps,
    vector,
)
from promised import covered as held_shares
from promised import promise_kept
from scipy.signal import lsim

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Nuisances, Parameter, Problem, window
from logs.identification.estimators.output_error import Search, output_error
from logs.identification.models.nonlinear_longitudinal import nonlinear_longitudinal

SHORT = ("alpha", "q", "theta", "a_z")


def short_problem(seed: int, pole: float = 0.0) -> Problem:
    return Problem(SHORT_PERIOD, (pitching(seed, pole),), parameters(SHORT_PERIOD_TRUTH), SHORT)


def test_short_period() -> None:
    held = sum(covered(output_error(short_problem(seed)), SHORT_PERIOD_TRUTH) for seed in range(5))
    assert held >= 26  # of 30


def test_longitudinal_with_speed() -> None:
    time = 0.05 * np.arange(600)
    inputs = (steps(time, 1.0, 0.5, 0.05) - 0.01 * ((time > 8) & (time < 14)))[:, None]
    record = simulated(LONGITUDINAL, LONGITUDINAL_TRUTH, inputs, 0.05, 0.03, 1)
    outputs = ("u", "alpha", "q", "theta", "a_x", "a_z")
    fit = output_error(Problem(LONGITUDINAL, (record,), parameters(LONGITUDINAL_TRUTH), outputs))
    assert covered(fit, LONGITUDINAL_TRUTH) >= 7  # of 8


def test_lateral() -> None:
    time = 0.02 * np.arange(600)
    inputs = np.column_stack((steps(time, 5.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = simulated(LATERAL, LATERAL_TRUTH, inputs, 0.02, 0.03, 2)
    outputs = ("beta", "p", "r", "phi", "a_y")
    fit = output_error(Problem(LATERAL, (record,), parameters(LATERAL_TRUTH), outputs))
    assert covered(fit, LATERAL_TRUTH) >= 9  # of 10


def test_nonlinear_jet() -> None:
    assert jets(range(10)) >= 0.85


def jet_problem(seed: int) -> Problem:
    model = nonlinear_longitudinal(JET)
    return Problem(model, (jet(seed),), parameters(JET_TRUTH, 0.8), tuple(model.outputs))


def jets(seeds: range) -> float:
    held = sum(covered(output_error(jet_problem(seed)), JET_TRUTH) for seed in seeds)
    return held / (len(seeds) * len(JET_TRUTH))


def shares_of(
    problem: Callable[[int], Problem], truth: dict[str, float], seeds: range = range(100, 400)
) -> dict[str, float]:
    """Of each parameter, over many seeds; every fit must be whole."""
    fits = [output_error(problem(seed)) for seed in seeds]
    assert all(fit.status == "converged" and not fit.withheld for fit in fits)
    return held_shares([fit.estimates for fit in fits], truth)


@pytest.mark.validate
def test_jet_coverage_of_many() -> None:
    promise_kept("nonlinear jet", shares_of(jet_problem, JET_TRUTH))


def test_several_manoeuvres_with_windows_biases_and_rates_of_their_own() -> None:
    whole, quick = pitching(3), pitching(4, count=1500, step=0.005)
    biased = whole._replace(signals=dict(whole.signals) | {"alpha": whole.signals["alpha"] + 0.1})
    both = (window(biased, 0.5, 8.0), window(quick, 0.5, 7.0))
    nuisances = Nuisances(output_biases=("alpha", "a_z"))
    fit = output_error(Problem(SHORT_PERIOD, both, parameters(SHORT_PERIOD_TRUTH), SHORT, nuisances))
    assert covered(fit, SHORT_PERIOD_TRUTH) >= 5
    assert fit.records[0].output_biases["alpha"] == pytest.approx(0.1, abs=2e-3)
    assert fit.records[1].output_biases["alpha"] == pytest.approx(0.0, abs=2e-3)
    alone = output_error(Problem(SHORT_PERIOD, both[:1], parameters(SHORT_PERIOD_TRUTH), SHORT, nuisances))
    assert fit.estimates[3].standard_error < alone.estimates[3].standard_error


def test_an_input_bias_and_a_local_moment_are_told() -> None:
    record = pitching(5)
    moved = record._replace(signals=dict(record.signals) | {"delta_e": record.signals["delta_e"] - 0.02})
    nuisances = Nuisances(input_biases=("delta_e",))
    fit = output_error(Problem(SHORT_PERIOD, (moved,), parameters(SHORT_PERIOD_TRUTH), SHORT, nuisances))
    assert covered(fit, SHORT_PERIOD_TRUTH) >= 5
    assert fit.records[0].input_biases["delta_e"] == pytest.approx(0.02, abs=1e-3)
    local = parameters(SHORT_PERIOD_TRUTH) | {"M_0": Parameter(0.0, local=True), "Z_0": Parameter(0.0, local=True)}
    fit = output_error(Problem(SHORT_PERIOD, (moved,), local, SHORT))
    assert covered(fit, SHORT_PERIOD_TRUTH) >= 5
    assert fit.records[0].parameters["M_0"] == pytest.approx(-20.0 * 0.02, abs=0.02)


@pytest.mark.parametrize("weighting", ["diagonal", "full"])
def test_gaps_in_outputs_leave_time_in_place(weighting: str) -> None:
    record, gaps = pitching(6), {}
    for name, start, end in (("alpha", 100, 180), ("q", 60, 75), ("a_z", 0, 499)):
        gaps[name] = record.signals[name].copy()
        gaps[name][start:end] = np.nan
    problem = short_problem(6)._replace(experiments=(record._replace(signals=dict(record.signals) | gaps),))
    fit = output_error(problem._replace(weighting="full" if weighting == "full" else "diagonal"))
    assert covered(fit, SHORT_PERIOD_TRUTH) >= 5
    assert np.isnan(fit.histories[0].measured[120, 0])
    assert len(fit.histories[0].time) == 500


def test_a_fixed_parameter_stays_and_helps() -> None:
    free = output_error(short_problem(7))
    fixed = parameters(SHORT_PERIOD_TRUTH) | {"Z_q": Parameter(SHORT_PERIOD_TRUTH["Z_q"], free=False)}
    fit = output_error(short_problem(7)._replace(parameters=fixed))
    assert fit.records[0].parameters["Z_q"] == SHORT_PERIOD_TRUTH["Z_q"]
    assert "Z_q" not in fit.names
    assert fit.estimates[0].standard_error <= free.estimates[0].standard_error * 1.05


def test_correlated_noise_is_found() -> None:
    record = pitching(8)
    common = np.random.default_rng(0).normal(size=500)
    shaken = {name: record.signals[name] + 0.02 * common for name in ("alpha", "q")}
    problem = short_problem(8)._replace(experiments=(record._replace(signals=dict(record.signals) | shaken),))
    full, diagonal = (output_error(problem._replace(weighting=w)) for w in ("full", "diagonal"))
    assert full.noise[0, 1] == pytest.approx(4e-4, rel=0.2)
    assert full.estimates[3].standard_error < diagonal.estimates[3].standard_error


def test_nelder_mead_ends_where_gauss_newton_does() -> None:
    names = ("Z_alpha", "M_alpha", "M_q", "M_delta")
    some = {
        name: Parameter(value * 0.7 if name in names else value, free=name in names)
        for name, value in SHORT_PERIOD_TRUTH.items()
    }
    problem = short_problem(9)._replace(parameters=some)
    newton, simplex = (output_error(problem, Search(method)) for method in ("gauss-newton", "nelder-mead"))
    assert simplex.status == "converged", simplex.failure
    for one, other in zip(newton.estimates, simplex.estimates, strict=True):
        assert other.value == pytest.approx(one.value, abs=0.1 * one.standard_error)
        assert other.standard_error == pytest.approx(one.standard_error, rel=0.02)


def test_several_starts_find_what_one_poor_start_does_not() -> None:
    poor = {name: Parameter(0.0, low=-60.0, high=20.0) for name in SHORT_PERIOD_TRUTH}
    poor["M_alpha"] = Parameter(15.0, low=-60.0, high=20.0)
    problem = short_problem(10)._replace(parameters=poor)
    fit = output_error(problem, Search(starts=12, seed=1))
    assert covered(fit, SHORT_PERIOD_TRUTH) >= 5


def study(seeds: range, pole: float) -> float:
    held = sum(covered(output_error(short_problem(seed, pole)), SHORT_PERIOD_TRUTH) for seed in seeds)
    return held / (len(seeds) * len(SHORT_PERIOD_TRUTH))


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.99])
def test_coverage(pole: float) -> None:
    assert study(range(20), pole) >= 0.85


@pytest.mark.validate
@pytest.mark.parametrize("pole", [0.0, 0.7, 0.9, 0.99])
def test_coverage_of_many(pole: float) -> None:
    """1,000 seeds: the fraction of 300 scatters by 1.7 %, more than its distance from the limit."""
    shares = shares_of(lambda seed: short_problem(seed, pole), SHORT_PERIOD_TRUTH, range(1000))
    promise_kept(f"output error, pole {pole}", shares)


def gusty_problem(seed: int) -> Problem:
    """60 s of the longitudinal motion at 10 Hz in gusts of 0.4 m/s along and of 0.01 rad across, 2.5 s long."""
    step, time = 0.1, 0.1 * np.arange(600)
    delta = steps(time, 2.0, 0.5, 0.05) - 0.01 * ((time > 8) & (time < 14)) + 0.01 * ((time > 30) & (time < 38))
    whole = LONGITUDINAL.matrices(vector(LONGITUDINAL, LONGITUDINAL_TRUTH))
    gusts = noise(seed + 5000, (600, 2), np.array([0.4, 0.01]), 0.96)
    forced = np.column_stack((whole.b[:, :1], whole.a[:, :2]))
    _, _, moved = lsim((whole.a, forced, np.eye(4), np.zeros((4, 3))), np.column_stack((delta, gusts)), time)
    raw = moved + noise(seed, moved.shape, np.array([0.05, 0.001, 0.002, 0.001]))
    signals = dict(zip(("u", "alpha", "q", "theta"), raw.T, strict=True)) | {"delta_e": delta}
    units = {"u": "m/s", "alpha": "rad", "q": "rad/s", "theta": "rad", "delta_e": "rad"}
    record = Experiment(f"gusts {seed}", step * np.arange(600), signals, units)
    return Problem(LONGITUDINAL, (record,), parameters(LONGITUDINAL_TRUTH, 0.8), ("u", "alpha", "q", "theta"))


@pytest.mark.validate
def test_intervals_hold_in_gusts_whose_wander_is_as_slow_as_the_record() -> None:
    """A lag window of a tenth of the record alone held 80 % of these (X_u and X_alpha are seldom told)."""
    fits = [output_error(gusty_problem(seed)) for seed in range(40)]
    shares = held_shares([fit.estimates for fit in fits if not fit.failure], LONGITUDINAL_TRUTH)
    assert np.mean([share for name, share in shares.items() if not name.startswith("X_")]) >= 0.85, shares
