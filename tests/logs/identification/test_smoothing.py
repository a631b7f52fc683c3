"""Smoothers keep what is smooth, tell its slope and the noise, and say how sure they are."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.data.signal_errors import noise_level
from logs.identification.data.smoothing import (
    METHODS,
    Smoothed,
    fourier_smoothing,
    local_quadratic,
    rts,
    smoothed,
    smoothing_spline,
)
from wingbeat.errors import InputError

STEP = 0.02
TIME = STEP * np.arange(500)
RESPONSE = 0.3 * np.exp(-TIME / 4) * np.sin(5 * TIME) + 0.05 * TIME
SLOPE = 0.3 * np.exp(-TIME / 4) * (5 * np.cos(5 * TIME) - np.sin(5 * TIME) / 4) + 0.05
SMOOTHERS: dict[str, Callable[[np.ndarray], Smoothed]] = {
    "local_quadratic": lambda values: local_quadratic(values, STEP, 21),
    "fourier": lambda values: fourier_smoothing(values, STEP).smoothed,
    "spline": lambda values: smoothing_spline(TIME, values),
    "rts": lambda values: rts(values, STEP),
}


def print_result(text: str) -> None:
    sys.stdout.write(text + "\n")


def noisy(seed: int, noise: float = 0.02) -> np.ndarray:
    return RESPONSE + noise * np.random.default_rng(seed).normal(size=len(TIME))


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_noisy_response_is_smoothed_and_differentiated(name: str) -> None:
    """GIVEN noise of 0.02 at 50 Hz THEN a third of it is left, the slope is known to 5 %, and the noise is told."""
    found = SMOOTHERS[name](noisy(1))
    assert np.std(found.values - RESPONSE) < 0.02 * 0.36
    assert np.std((found.rates - SLOPE)[5:-5]) < 0.05 * 1.5
    assert found.noise == pytest.approx(0.02, rel=0.1)


def test_parabolas_keep_parabolas_to_the_ends() -> None:
    values = 1 - 2 * TIME + 0.3 * TIME**2
    found = local_quadratic(values, STEP, 9)
    np.testing.assert_allclose(found.values, values, atol=1e-10)
    np.testing.assert_allclose(found.rates, -2 + 0.6 * TIME, atol=1e-9)
    assert found.noise < 1e-10


@pytest.mark.parametrize("cut_off", [0.5, 5.0])
def test_straight_lines_are_kept_by_fourier_and_spline_at_any_cut_off(cut_off: float) -> None:
    values = 3 - 0.7 * TIME
    for found in (fourier_smoothing(values, STEP, cut_off).smoothed, smoothing_spline(TIME, values)):
        np.testing.assert_allclose(found.values, values, atol=1e-8)
        np.testing.assert_allclose(found.rates, -0.7, atol=1e-7)


@pytest.mark.parametrize("name", ["fourier", "spline"])
def test_the_slope_of_a_sinusoid_without_noise(name: str) -> None:
    wave, slope = np.sin(5 * TIME + 0.3), 5 * np.cos(5 * TIME + 0.3)
    found = SMOOTHERS[name](wave)
    np.testing.assert_allclose(found.values, wave, atol=1e-3)
    np.testing.assert_allclose(found.rates[25:-25], slope[25:-25], atol=0.01)


def estimated_noise(seeds: range, noise: float) -> float:
    return float(np.mean([fourier_smoothing(noisy(seed, noise), STEP).smoothed.noise for seed in seeds]))


@pytest.mark.parametrize("noise", [0.002, 0.02, 0.1])
def test_fourier_smoothing_tells_the_noise(noise: float) -> None:
    assert estimated_noise(range(8), noise) == pytest.approx(noise, rel=0.05)


@pytest.mark.validate
@pytest.mark.parametrize("noise", [0.002, 0.02, 0.1])
def test_fourier_smoothing_tells_the_noise_of_each_of_many(noise: float) -> None:
    found = np.array([estimated_noise(range(seed, seed + 1), noise) for seed in range(300)])
    within = float(np.mean(np.abs(found / noise - 1) < 0.1))
    print_result(
        f"noise {noise}: mean {np.mean(found) / noise:.4f}, spread {np.std(found) / noise:.4f}, within 10 %: {within}"
    )
    assert np.mean(found) == pytest.approx(noise, rel=0.02)
    assert within > 0.97


def test_a_cut_off_may_be_given_and_is_told() -> None:
    assert fourier_smoothing(noisy(3), STEP, 1.5).cut_off == pytest.approx(1.5)
    assert 0.8 < fourier_smoothing(noisy(3), STEP).cut_off < 5


def test_noise_level_without_a_model() -> None:
    levels = np.array([[noise_level(noisy(seed, noise)) for seed in range(20)] for noise in (0.002, 0.02)])
    np.testing.assert_allclose(np.mean(levels, axis=1), [0.002, 0.02], rtol=0.04)
    np.testing.assert_allclose(levels / [[0.002], [0.02]], 1.0, atol=0.2)


def test_noise_level_of_a_smooth_signal_is_next_to_nothing() -> None:
    assert noise_level(RESPONSE) < 1e-6


def test_rts_bridges_a_gap() -> None:
    values = noisy(5)
    values[100:130] = np.nan
    found = rts(values, STEP)
    assert found.noise == pytest.approx(0.02, rel=0.2)
    outside = np.r_[0:95, 135:500]
    assert np.all(np.abs(found.values - RESPONSE)[outside] < 5 * 0.02)
    assert np.sqrt(np.mean((found.values - RESPONSE)[outside] ** 2)) < 0.5 * 0.02
    assert np.max(np.abs(found.values - RESPONSE)[100:130]) < 0.2 * np.ptp(RESPONSE)


def test_the_spline_takes_uneven_time_and_gaps_and_does_not_extrapolate() -> None:
    rng = np.random.default_rng(6)
    time = np.sort(rng.uniform(0, 10, 400))
    values = np.sin(time) + 0.05 * rng.normal(size=400)
    values[:10], values[200:215] = np.nan, np.nan
    found = smoothing_spline(time, values)
    assert np.all(np.isnan(found.values[:10]))
    assert np.std((found.values - np.sin(time))[10:]) < 0.02
    assert found.noise == pytest.approx(0.05, rel=0.12)


def test_every_method_by_name_on_an_experiment() -> None:
    strokes = 4 * TIME
    signals = {"q": noisy(7), "a_z": np.full(500, 3.0), "strokes": strokes}
    experiment = Experiment("flight", TIME, signals, {"q": "rad/s", "a_z": "m/s^2", "strokes": "-"})
    for method in METHODS:
        found = smoothed(experiment, ["q"], method)
        middle = slice(60, -60)
        assert np.std((found.experiment.signals["q"] - RESPONSE)[middle]) < 0.02
        assert found.experiment.units["q_dot"] == "rad/s/s"
        assert np.corrcoef(found.experiment.signals["q_dot"][middle], SLOPE[middle])[0, 1] > 0.8
        assert found.experiment.signals["a_z"] is signals["a_z"]
        assert 0.01 < found.noise["q"] < 0.04


def test_a_stroke_average_has_the_slope_of_what_does_not_flap() -> None:
    time = 0.005 * np.arange(2000)
    strokes = np.cumsum(4.0 + 0.4 * np.sin(2 * np.pi * time / 8)) * 0.005
    slow = 0.2 * np.sin(0.8 * time)
    shaken = slow + 5 * np.sin(2 * np.pi * strokes)
    experiment = Experiment("flight", time, {"q": shaken, "strokes": strokes}, {"q": "rad/s", "strokes": "-"})
    found = smoothed(experiment, ["q"], "stroke")
    inside = np.isfinite(found.experiment.signals["q"])
    assert 0.9 < np.mean(inside) < 0.99
    np.testing.assert_allclose(found.experiment.signals["q"][inside], slow[inside], atol=0.05)
    numerical = np.gradient(found.experiment.signals["q"], 0.005)
    np.testing.assert_allclose(found.experiment.signals["q_dot"][inside][1:-1], numerical[inside][1:-1], atol=0.03)
    assert found.noise["q"] == pytest.approx(5 / np.sqrt(2), rel=0.05)


@pytest.mark.parametrize("name", ["local_quadratic", "fourier"])
def test_missing_samples_are_refused_in_a_line(name: str) -> None:
    values = noisy(8)
    values[40:45] = np.nan
    with pytest.raises(InputError, match="5 of the signal's 500 samples are missing"):
        SMOOTHERS[name](values)


def test_what_cannot_be_smoothed_is_refused() -> None:
    with pytest.raises(InputError, match="too short"):
        fourier_smoothing(TIME[:10], STEP)
    with pytest.raises(InputError, match="half the sampling rate"):
        fourier_smoothing(RESPONSE, STEP, 30.0)
    with pytest.raises(InputError, match="odd"):
        local_quadratic(RESPONSE, STEP, 6)
    with pytest.raises(InputError, match="without a gap to estimate the noise"):
        rts(np.where(np.arange(500) % 10 < 5, RESPONSE, np.nan), STEP)
    with pytest.raises(InputError, match="no method 'median'"):
        smoothed(Experiment("flight", TIME, {"q": RESPONSE}, {"q": "rad/s"}), ["q"], "median")
    with pytest.raises(InputError, match="flight, q: no signal strokes"):
        smoothed(Experiment("flight", TIME, {"q": RESPONSE}, {"q": "rad/s"}), ["q"], "stroke")


def test_slow_noise_is_told_as_signal_and_not_as_noise() -> None:
    """GIVEN noise with a correlation of a second THEN only what is left above the cut-off counts."""
    slow = lfilter([0.2], [1, -0.98], np.random.default_rng(9).normal(size=500))
    assert fourier_smoothing(RESPONSE + slow, STEP).smoothed.noise < 0.5 * np.std(slow)
