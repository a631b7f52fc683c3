"""Regressors beside a slope over several samples go through the average that the slope is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter
from test_tables_identified import TRUTH, flight, identified, numbers

from logs.identification.estimators.regressors import LINE, SMOOTH, average_of_slope, averaged
from logs.identification.statistics.fit_quality import output_fits

MAPPED = """
[time]
column = "t"
[signals]
alpha = { column = "alpha", unit = "rad" }
q = { column = "q", unit = "rad/s" }
delta_e = { column = "delta_e", unit = "rad" }
[maneuvers]
windows = [[0, 8], [8.1, 15]]
validate = [2]
[constants]
V = 100
rho = 1.225
S = 1.0
c = 1.0
I_y = 6125.0
[[aero.regressions]]
response = "RESPONSE"
regressors = ["alpha", "q", "delta_e"]
domain = "DOMAIN"
"""


def mapped(domain: str, response: str = "C_m") -> str:
    """6125 kg m^2 over 6125 N m: the coefficient is the angular acceleration, its derivatives those of `TRUTH`."""
    return MAPPED.replace("DOMAIN", domain).replace("RESPONSE", response)


# Of the step's square times the curvature, 27 here, a twelfth; of a cubic 11/720 of its fourth power times 243.
@pytest.mark.parametrize(("mean", "off"), [(LINE, 27.0 * 0.01**2 / 12.0), (SMOOTH, 243.0 * 0.01**4 * 11.0 / 720.0)])
@pytest.mark.parametrize("width", [5, 21])
def test_a_slope_is_the_derivative_averaged_by_these_weights(width: int, mean: tuple[float, ...], off: float) -> None:
    t = 0.01 * np.arange(400)
    angle, rate = np.sin(3.0 * t) + 0.3 * t**2, 3.0 * np.cos(3.0 * t) + 0.6 * t
    weights = average_of_slope(savgol_coeffs(width, 2, deriv=1, use="dot"), mean)
    slopes = savgol_filter(angle, width, 2, deriv=1, delta=0.01)
    half = width // 2 + 1
    found = averaged(rate, weights)
    assert weights.sum() == pytest.approx(1.0) and weights == pytest.approx(weights[::-1])
    assert np.all(np.isnan(found[:half])) and np.all(np.isnan(found[-half:]))
    assert found[half:-half] == pytest.approx(slopes[half:-half], abs=1.1 * off)


def test_what_was_not_measured_is_lost_with_its_neighbours() -> None:
    """But for what a straight line bridges: samples that lack a signal here and there leave the others."""
    values = np.arange(20.0)
    values[[4, 9, 10, 11]] = np.nan
    found = averaged(values, np.array([0.1, 0.25, 0.3, 0.25, 0.1]))
    assert np.flatnonzero(np.isnan(found)).tolist() == [0, 1, 4, 7, 8, 9, 10, 11, 12, 13, 18, 19]
    assert found[[2, 3, 5, 6, 14, 15]] == pytest.approx([2.0, 3.0, 5.0, 6.0, 14.0, 15.0])
    assert np.all(np.isnan(averaged(np.arange(4.0), np.full(5, 0.2))))


@pytest.mark.parametrize("domain", ["time", "frequency"])
@pytest.mark.parametrize(("rate", "bound"), [(10.0, 0.03), (25.0, 0.006), (50.0, 0.002), (200.0, 0.001)])
def test_moments_without_angular_acceleration_have_the_derivatives(
    tmp_path: Path, domain: str, rate: float, bound: float
) -> None:
    """GIVEN steps of 0.36 s without noise THEN M_q, 14 to 59 % small beside regressors as measured, is the truth."""
    (fit,) = identified(tmp_path, flight(rate, noise=0.0), mapped(domain), "aero").fits
    found = numbers(fit)
    for name, derivative in (("alpha", "M_alpha"), ("q", "M_q"), ("delta_e", "M_delta")):
        assert found[name].value == pytest.approx(TRUTH[derivative], rel=bound), name
    (held,) = [one for one in output_fits(fit.series) if one.held_out]
    assert held.theil < 0.03


@pytest.mark.parametrize("response", ["C_m", pytest.param("q_dot", marks=pytest.mark.validate)])
def test_noise_leaves_the_truth_inside(tmp_path: Path, response: str) -> None:
    columns = flight(50.0, noise=0.0)
    hits = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noisy = {"alpha": columns["alpha"] + 0.002 * rng.normal(size=len(columns["t"]))}
        noisy["q"] = columns["q"] + 0.003 * rng.normal(size=len(columns["t"]))
        found = numbers(identified(tmp_path, {**columns, **noisy}, mapped("time", response), "aero").fits[0])
        pairs = (("alpha", "M_alpha"), ("q", "M_q"), ("delta_e", "M_delta"))
        hits += [found[name].contains(TRUTH[derivative]) for name, derivative in pairs]
        assert all(found[n].high - found[n].low < 0.2 * abs(TRUTH[d]) for n, d in pairs)
    assert sum(hits) >= 53  # of 60: 57 are expected where 95 % is promised


def test_a_measured_acceleration_is_regressed_as_it_is(tmp_path: Path) -> None:
    columns = flight(50.0, noise=0.0)
    pairs = (("alpha", "M_alpha"), ("q", "M_q"), ("delta_e", "M_delta"))
    columns["qd"] = np.sum([TRUTH[d] * (columns[n] - columns[n][0]) for n, d in pairs], axis=0)
    mapping = mapped("time").replace("[maneuvers]", 'q_dot = { column = "qd", unit = "rad/s^2" }\n[maneuvers]')
    (fit,) = identified(tmp_path, columns, mapping, "aero").fits
    assert numbers(fit)["q"].value == pytest.approx(TRUTH["M_q"], rel=1e-9)
    assert fit.samples == np.count_nonzero(columns["t"] <= 8.0)


@pytest.mark.parametrize("rate", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("actuator", [0.05, pytest.param(0.15, marks=pytest.mark.validate)])
def test_a_control_behind_an_actuator_leaves_the_truth_inside(tmp_path: Path, actuator: float, rate: float) -> None:
    """GIVEN little noise and an actuator that samples hardly show THEN the intervals know; M_q is up to 12 % off."""
    columns = flight(rate, noise=0.0, actuator=actuator)
    (fit,) = identified(tmp_path, columns, mapped("time"), "aero").fits
    for name, derivative in (("alpha", "M_alpha"), ("q", "M_q"), ("delta_e", "M_delta")):
        assert numbers(fit)[name].contains(TRUTH[derivative]), name
    said = [one for one in fit.findings if one.code == "sampling"]
    assert len(said) == (rate * actuator < 5.0)
    if not said:
        assert all(one.high - one.low < 0.06 * abs(one.value) for n, one in numbers(fit).items() if n != "intercept")


@pytest.mark.parametrize("method", ["local_quadratic", pytest.param("spline", marks=pytest.mark.validate)])
def test_smoothing_before_differentiation_does_not_bias_silently(tmp_path: Path, method: str) -> None:
    """GIVEN a pitch rate smoothed in [prepare] THEN the truth is inside, or a finding names the derivative."""
    mapping = mapped("time", "q_dot").replace("[constants]", f'[prepare]\nsmooth = {{ q = "{method}" }}\n[constants]')
    hits, columns = [], flight(25.0, noise=0.0)
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(size=(2, len(columns["t"])))
        noisy = {"alpha": columns["alpha"] + 5e-4 * noise[0], "q": columns["q"] + 2e-3 * noise[1]}
        (fit,) = identified(tmp_path, {**columns, **noisy}, mapping, "aero").fits
        if method == "spline":
            assert "smoothed_derivative" in [one.code for one in fit.findings]
            continue
        found = numbers(fit)
        pairs = (("alpha", "M_alpha"), ("q", "M_q"), ("delta_e", "M_delta"))
        hits += [found[name].contains(TRUTH[derivative]) for name, derivative in pairs]
        assert found["q"].standard_error < 0.1 * abs(TRUTH["M_q"])
    assert not hits or np.mean(hits) >= 0.88
