"""Stroke averages remove what repeats with the wing and keep what does not."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from logs.identification.data.resampling import averaging_matrix, stroke_average, wing_period
from logs.strokes import interval_mean, stroke_cuts, stroke_means, strokes_of

TIME = np.arange(0, 10, 0.005)


def varying_strokes() -> np.ndarray:
    return np.cumsum(4.0 + 0.4 * np.sin(2 * np.pi * TIME / 8)) * 0.005


def test_a_motion_locked_to_the_wing_vanishes_though_its_rate_varies() -> None:
    strokes = varying_strokes()
    shaking = 30 * np.sin(2 * np.pi * strokes) + 10 * np.cos(6 * np.pi * strokes + 1)
    at = np.arange(1, 9, 0.02)
    left = stroke_average(TIME, shaking, wing_period(TIME, strokes, at), at)
    assert np.max(np.abs(left)) < 0.01 * 30


def test_a_straight_line_is_kept_and_a_constant_too() -> None:
    at = np.arange(1, 9, 0.02)
    period = wing_period(TIME, varying_strokes(), at)
    np.testing.assert_allclose(stroke_average(TIME, 2 + 3 * TIME, period, at), 2 + 3 * at, atol=1e-9)


def test_the_average_commutes_with_a_linear_system() -> None:
    """GIVEN a constant period WHEN input and output of a filter are averaged THEN they still belong together."""
    rng = np.random.default_rng(3)
    entering = rng.normal(size=len(TIME))
    leaving = lfilter([0.1, 0.05], [1, -1.5, 0.6], entering)
    at = TIME[200:-200]
    period = np.full(len(at), 0.25)
    averaged_in, averaged_out = (stroke_average(TIME, signal, period, at) for signal in (entering, leaving))
    again = lfilter([0.1, 0.05], [1, -1.5, 0.6], averaged_in)
    np.testing.assert_allclose(again[200:], averaged_out[200:], atol=1e-6)


def test_the_matrix_is_the_average() -> None:
    rng = np.random.default_rng(4)
    signal, at = rng.normal(size=400), np.arange(0.5, 1.5, 0.013)
    period = np.full(len(at), 0.237)
    direct = stroke_average(TIME[:400], signal, period, at)
    np.testing.assert_allclose(averaging_matrix(TIME[:400], period, at) @ signal, direct, atol=1e-12)


def test_the_period_is_the_time_between_equal_phases_and_unknown_at_the_ends() -> None:
    strokes = 4.0 * TIME
    period = wing_period(TIME, strokes, np.array([0.01, 5.0, 9.99]))
    assert np.isnan(period[[0, 2]]).all()
    np.testing.assert_allclose(period[1], 0.25, atol=1e-9)


def test_phase_unwraps_and_does_not_run_backwards_in_noise() -> None:
    rng = np.random.default_rng(5)
    noisy = 2 * np.pi * 4 * TIME + 0.1 * rng.normal(size=len(TIME))
    strokes = strokes_of(np.mod(noisy, 2 * np.pi))
    assert np.all(np.diff(strokes) >= 0)
    np.testing.assert_allclose(strokes - strokes[0], 4 * TIME, atol=0.1)


def test_means_over_whole_strokes() -> None:
    strokes = 0.3 + 4.0 * TIME
    cuts = stroke_cuts(TIME, strokes)
    np.testing.assert_allclose(np.diff(cuts), 0.25, atol=1e-9)
    means = stroke_means(TIME, 5 + np.sin(2 * np.pi * strokes), cuts)
    np.testing.assert_allclose(means, 5, atol=1e-3)


def test_mean_over_an_interval_between_samples_is_exact_for_a_line() -> None:
    found = interval_mean(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]), np.array([0.25]), np.array([1.5]))
    np.testing.assert_allclose(found, [0.875])
