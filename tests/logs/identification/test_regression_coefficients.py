"""Regressions on named regressors: truth recovered, what cannot be told refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import in_band, transform
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Settings,
    coefficient_regression,
    predict,
)
from logs.identification.results import Estimate
from tests.logs.identification.colored_noise import TRUTH, noise, simulated
from wingbeat.errors import InputError

NAMES = ("alpha", "q", "delta")


def by_name(result: CoefficientRegression) -> dict[str, Estimate]:
    return {one.name: one for one in result.estimates}


def with_signals(experiment: Experiment, **signals: np.ndarray) -> Experiment:
    return experiment._replace(signals={**experiment.signals, **signals})


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_truth_without_noise_is_found_exactly(domain: str) -> None:
    result = coefficient_regression((simulated("white", 300, 1, 0.0),), "C", NAMES, domain)
    for name, one in by_name(result).items():
        assert one.value == pytest.approx(TRUTH[name], abs=1e-9)
    assert np.nanstd(np.concatenate(result.residuals)) < 1e-6


def test_units_follow_from_the_signals() -> None:
    settings = Settings(constants={"c": 0.2, "V": 8.0}, units={"c": "m", "V": "m/s"})
    found = coefficient_regression((simulated("white", 200, 2),), "C", ("alpha", "q*c/2V", "delta"), "time", settings)
    plain = coefficient_regression((simulated("white", 200, 2),), "C", NAMES)
    assert {n: one.unit for n, one in by_name(found).items()} == {
        "intercept": "-",
        "alpha": "1/rad",
        "q*c/2V": "1/rad",
        "delta": "1/rad",
    }
    assert by_name(found)["q*c/2V"].value == pytest.approx(by_name(plain)["q"].value * 16 / 0.2)


def test_several_manoeuvres_share_coefficients_and_narrow_the_intervals() -> None:
    flights = tuple(simulated("AR 0.9", 200, seed, name=f"flight {seed}") for seed in range(6))
    one, all_ = coefficient_regression(flights[:1], "C", NAMES), coefficient_regression(flights, "C", NAMES)
    for name, found in by_name(all_).items():
        assert found.contains(TRUTH[name])
        assert found.standard_error < by_name(one)[name].standard_error
    assert [len(part) for part in all_.residuals] == [200] * 6


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_each_manoeuvre_may_have_its_own_intercept(domain: str) -> None:
    flights = [simulated("white", 300, seed, 0.1, f"flight {seed}") for seed in range(2)]
    flights[1] = with_signals(flights[1], C=flights[1].signals["C"] + 5.0)
    found = by_name(coefficient_regression(tuple(flights), "C", NAMES, domain, Settings(intercept="each")))
    assert found["intercept of flight 0"].contains(TRUTH["intercept"])
    assert found["intercept of flight 1"].contains(TRUTH["intercept"] + 5.0)
    assert found["alpha"].contains(TRUTH["alpha"])


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_a_trend_of_the_manoeuvre_is_taken_out(domain: str) -> None:
    flight = simulated("white", 400, 3, 0.1)
    drifting = with_signals(flight, C=flight.signals["C"] + 0.8 * flight.time)
    found = by_name(coefficient_regression((drifting,), "C", NAMES, domain, Settings(trend=1)))
    assert all(found[name].contains(TRUTH[name]) for name in NAMES)
    assert "t^1 of flight" not in found


def test_missing_samples_are_left_out_in_time() -> None:
    hits = []
    for seed in range(20):
        flight = simulated("AR 0.5", 300, seed)
        alpha = flight.signals["alpha"].copy()
        alpha[[10, 50, 51]] = np.nan
        alpha[100:160] = np.nan
        found = coefficient_regression((with_signals(flight, alpha=alpha),), "C", NAMES)
        assert found.samples == 237
        assert np.isnan(found.residuals[0]).sum() == 63
        hits += [by_name(found)[name].contains(TRUTH[name]) for name in TRUTH]
    assert np.mean(hits) >= 0.88


def test_frequency_domain_bridges_short_gaps_and_refuses_long_ones() -> None:
    flight = simulated("white", 500, 5, 0.1)
    alpha = flight.signals["alpha"].copy()
    alpha[[0, 1, 200, 201, 202]] = np.nan
    found = coefficient_regression((with_signals(flight, alpha=alpha),), "C", NAMES, "frequency")
    assert by_name(found)["alpha"].value == pytest.approx(TRUTH["alpha"], abs=0.05)
    assert np.isnan(found.residuals[0]).sum() == 2
    alpha[300:340] = np.nan
    with pytest.raises(InputError, match=r"flight: 40 samples in a row from 6 s after its start lack a signal"):
        coefficient_regression((with_signals(flight, alpha=alpha),), "C", NAMES, "frequency")


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_dependent_regressors_are_named_and_the_others_keep_their_numbers(domain: str) -> None:
    flight = simulated("white", 300, 6, 0.1)
    twin = 2 * flight.signals["alpha"] - 3 * flight.signals["delta"]
    still = np.full(300, 8.0)
    result = coefficient_regression((with_signals(flight, twin=twin, V=still),), "C", (*NAMES, "twin", "V"), domain)
    reasons = {one.subject: one.text for one in result.withheld}
    assert set(reasons) == {"alpha", "delta", "twin", "V"}
    assert "depends linearly on alpha, delta" in reasons["twin"]
    assert "does not vary" in reasons["V"]
    assert by_name(result)["q"].contains(TRUTH["q"])


def test_collinear_regressors_have_wide_intervals_and_a_warning() -> None:
    flight = simulated("white", 300, 7, 0.5)
    copy = flight.signals["alpha"] + 1e-4 * noise("white", 300, np.random.default_rng(1))
    result = coefficient_regression((with_signals(flight, copy=copy),), "C", ("alpha", "copy", "q", "delta"))
    (finding,) = result.findings
    assert (finding.code, finding.severity) == ("collinearity", "warning")
    assert "alpha, copy" in finding.text
    assert by_name(result)["alpha"].contains(TRUTH["alpha"]) and by_name(result)["copy"].contains(0.0)
    assert by_name(result)["alpha"].standard_error > 10.0 * by_name(result)["q"].standard_error


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_too_few_samples_are_a_failure_not_a_number(domain: str) -> None:
    flight = simulated("white", 300, 8)
    short = flight._replace(time=flight.time[:6], signals={name: s[:6] for name, s in flight.signals.items()})
    result = coefficient_regression((short,), "C", NAMES, domain)
    assert not result.estimates
    assert "6 samples for" in result.failure
    empty = coefficient_regression((with_signals(flight, C=np.full(300, np.nan)),), "C", NAMES)
    assert empty.failure == "no sample has C and all regressors"
    stuck = coefficient_regression((with_signals(flight, C=np.full(300, 0.2)),), "C", NAMES, domain)
    assert stuck.failure == "C is 0.2 throughout"
    one = coefficient_regression((flight,), "C", NAMES, "frequency", Settings(frequencies=np.array([0.5])))
    assert {each.subject for each in one.withheld} == set(NAMES)


@pytest.mark.parametrize(
    ("regressors", "message"),
    [
        (("alpha", "beta"), "flight: no signal or constant 'beta'; it has alpha, q, delta, C"),
        (("alpha*beta",), r"'beta' \(of 'alpha\*beta'\)"),
        (("alpha", "2*alpha"), "are the same but for a number"),
        (("3",), "is a constant"),
        (("alpha+q",), r"'\+' is not expected there"),
        (("alpha^0.5",), "a power is a whole number"),
        (("(alpha",), "a bracket is not closed"),
        (("",), "a factor is missing"),
    ],
)
def test_bad_regressors_are_one_clear_line(regressors: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        coefficient_regression((simulated("white", 50, 9),), "C", regressors)


def test_bad_records_are_one_clear_line() -> None:
    one, other = simulated("white", 200, 1, name="one"), simulated("white", 100, 1, name="other")
    with pytest.raises(InputError, match=r"one has a step of 0.05 s, other of 0.1 s"):
        coefficient_regression((one, other), "C", NAMES)
    uneven = one._replace(time=np.sort(np.random.default_rng(1).uniform(0, 10, 200)))
    with pytest.raises(InputError, match="not equally spaced"):
        coefficient_regression((uneven,), "C", NAMES)
    with pytest.raises(InputError, match="frequencies must lie between 0 and half the sampling rate, 10 Hz"):
        coefficient_regression((one,), "C", NAMES, "frequency", Settings(frequencies=np.array([1.0, 12.0])))


def test_chirp_transform_is_the_plain_sum_and_its_way_back_keeps_a_signal_of_the_band() -> None:
    rng, step = np.random.default_rng(3), 0.02
    columns, even = rng.normal(size=(150, 2)), np.arange(0.4, 3.0, 0.13)
    uneven = np.append(even, 4.0)
    direct = np.exp(-2j * np.pi * np.outer(even, np.arange(150) * step)) @ columns * step
    np.testing.assert_allclose(transform(columns, even, step), direct, atol=1e-12)
    np.testing.assert_allclose(transform(columns, uneven, step)[:-1], direct, atol=1e-12)
    kernel = np.exp(2j * np.pi * np.outer(np.arange(150) * step, even))
    np.testing.assert_allclose(in_band(columns, even, step), (kernel @ direct).real * 2 / 3.0, atol=1e-12)
    wave = np.sin(2 * np.pi * 2 / 3.0 * np.arange(150) * step)[:, None]
    np.testing.assert_allclose(in_band(wave, np.arange(1, 6) / 3.0, step), wave, atol=1e-12)


def test_frequency_domain_is_grauers_equation_21() -> None:
    flight = simulated("AR 0.9", 300, 11)
    found = coefficient_regression((flight,), "C", NAMES, "frequency", Settings(trend=0))
    table = np.column_stack([flight.signals[name] for name in (*NAMES, "C")])
    spectrum = transform(table - table.mean(axis=0), found.frequencies, flight.step)
    x, z = spectrum[:, :3], spectrum[:, 3]
    expected = np.linalg.solve((x.conj().T @ x).real, (x.conj().T @ z).real)
    np.testing.assert_allclose([by_name(found)[name].value for name in NAMES], expected, rtol=1e-8)


def test_a_band_without_the_disturbance_narrows_the_intervals() -> None:
    flight = simulated("flapping", 250, 12)
    time = coefficient_regression((flight,), "C", NAMES, "time", Settings(covariance="white"))
    band = coefficient_regression((flight,), "C", NAMES, "frequency", Settings(frequencies=np.arange(0.1, 3.0, 0.1)))
    for name in NAMES:
        assert by_name(band)[name].contains(TRUTH[name])
        assert by_name(band)[name].standard_error < by_name(time)[name].standard_error


def test_a_held_out_manoeuvre_is_predicted() -> None:
    result = coefficient_regression((simulated("white", 400, 13, 0.1),), "C", NAMES)
    other = simulated("white", 300, 14, 0.0)
    np.testing.assert_allclose(predict(result, other), other.signals["C"], atol=0.1)
    gap = other.signals["alpha"].copy()
    gap[7] = np.nan
    assert np.isnan(predict(result, with_signals(other, alpha=gap))[7])


@pytest.mark.parametrize("domain", ["time", "frequency"])
def test_instruments_from_the_input_remove_the_bias_of_disturbances(domain: str) -> None:
    """x' = -3 x + 2 u + d with a colored d that moves x: correlated with x, not with its response to u."""
    step, seconds = 0.02, 60.0
    time = np.arange(0.0, seconds, step)
    u = np.sign(np.sin(2.0 * np.pi * 0.35 * time + np.sin(time)))
    d = lfilter([1.0], [1.0, -0.9], np.random.default_rng(4).normal(size=len(time)))

    def recorded(disturbance: np.ndarray) -> Experiment:
        x_dot, x = np.zeros(len(time)), np.zeros(len(time))
        for k in range(len(time)):
            x_dot[k] = -3.0 * x[k] + 2.0 * u[k] + disturbance[k]
            x[k + 1 :] = x[k] + step * x_dot[k]
        units = {"x": "m", "x_dot": "m/s", "u": "m/s"}
        return Experiment("flight", time, {"x": x, "x_dot": x_dot, "u": u}, units)

    flight, response = recorded(d), recorded(np.zeros(len(time)))
    least, instrumental = (
        by_name(coefficient_regression((flight,), "x_dot", ("x", "u"), domain, responses=instruments))
        for instruments in ((), (response,))
    )
    assert not least["x"].contains(-3.0) and least["x"].value > -2.5
    assert instrumental["x"].contains(-3.0) and instrumental["u"].contains(2.0)
