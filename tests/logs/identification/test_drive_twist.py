"""Twist damping and frequency from overshoots, peaks and records of the published response."""

from __future__ import annotations

import math

import numpy as np
import pytest
from promised import SEEDS, covered, promise_kept

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.servo import ServoModel
from logs.identification.estimators.twist import (
    damping_from_overshoot,
    damping_from_peaks,
    identify_twist,
    ratio_of,
)
from logs.identification.results import Estimate, Unidentified
from sim_bridge.flight_mechanics.wing_twist import free_twist, overshoot
from wingbeat.errors import InputError

NATURAL = 40.0


def release(seed: int = 0, damping: float = 0.31, noise: float = 0.005, hole: bool = False) -> Experiment:
    """A wing let go at 0.4 rad after a second of rest there, seen by a camera at 500 Hz (Gerdes Eq. 16)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 2.0, 0.002)
    twist = np.where(time < 0.3, 0.4, 0.0) + 0.05
    free = time >= 0.3
    twist[free] = 0.05 + free_twist(time[free] - 0.3, 0.4, 0.0, NATURAL, damping)
    twist = twist + noise * rng.normal(size=len(time))
    held = time >= 0.3
    if hole:
        twist[200:220] = np.nan
    return Experiment("release", time[held], {"twist": twist[held]}, {"twist": "rad"})


def by_name(model: ServoModel) -> dict[str, Estimate]:
    return {found.name: found for found in model.estimates}


@pytest.mark.parametrize(
    ("peak", "steady", "published"),
    [(10.38, 9.37, 0.58), (10.96, 9.12, 0.45), (11.48, 8.41, 0.31), (9.489, 9.47, 0.892)],
)
def test_the_overshoots_of_table_6_give_its_ratios(peak: float, steady: float, published: float) -> None:
    """Wing A by its printed 0.20 %, whose ratio is misprinted as 0.96."""
    found = damping_from_overshoot(peak, steady, 1e-3, 1e-3)
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(published, abs=0.005)
    assert found.low < found.value < found.high


def test_an_overshoot_within_its_error_gives_no_ratio() -> None:
    for peak in (9.49, 9.47, 9.0):
        found = damping_from_overshoot(peak, 9.47, 0.05, 0.05)
        assert isinstance(found, Unidentified)
        assert "within its error" in found.reason
    too_far = damping_from_overshoot(20.0, 9.0, 0.1, 0.1)
    assert isinstance(too_far, Unidentified) and "no damped step" in too_far.reason
    with pytest.raises(InputError, match="standard error"):
        damping_from_overshoot(10.0, 9.0, 0.0, 0.0)
    with pytest.raises(InputError, match="not 0"):
        damping_from_overshoot(10.0, 0.0, 0.1, 0.1)


def test_the_interval_of_an_overshoot_holds_the_truth() -> None:
    rng = np.random.default_rng(3)
    truth, covered, trials = 0.45, 0, 500
    for _ in range(trials):
        peak = 9.0 * (1 + overshoot(truth)) + 0.1 * rng.normal()
        found = damping_from_overshoot(peak, 9.0 + 0.03 * rng.normal(), 0.1, 0.03)
        assert isinstance(found, Estimate)
        covered += found.contains(truth)
    assert 0.92 * trials <= covered <= 0.98 * trials


def test_several_peaks_narrow_the_interval() -> None:
    decrement = math.pi * 0.1 / math.sqrt(1 - 0.01)
    peaks = 1.0 + 0.5 * (-1.0) ** np.arange(8) * np.exp(-decrement * np.arange(8))
    two, many = damping_from_peaks(peaks[:2], 1.0, 0.01), damping_from_peaks(peaks, 1.0, 0.01)
    assert isinstance(two, Estimate) and isinstance(many, Estimate)
    assert many.value == pytest.approx(0.1, rel=1e-6)
    assert many.high - many.low < 0.5 * (two.high - two.low)
    assert ratio_of(decrement) == pytest.approx(0.1)


def test_peaks_that_are_noise_are_refused() -> None:
    assert isinstance(damping_from_peaks(np.array([1.5, 0.99]), 1.0, 0.01), Unidentified)
    assert isinstance(damping_from_peaks(np.array([1.5, 0.5, 1.5]), 1.0, 0.01), Unidentified)
    with pytest.raises(InputError, match="in turn"):
        damping_from_peaks(np.array([1.5, 1.2]), 1.0, 0.01)
    with pytest.raises(InputError, match="two extremes"):
        damping_from_peaks(np.array([1.5]), 1.0, 0.01)


def held(seed: int, amplitude: float, damping: float = 0.02, astray: float = 0.0) -> Experiment:
    """A wing that is held for 0.1 s; one sample of that time is ``astray`` rad."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 0.86, 0.002)
    free = time >= 0.1
    twist = np.full(len(time), amplitude)
    twist[free] = free_twist(time[free] - 0.1, amplitude, 0.0, NATURAL, damping)
    twist = twist + 0.002 * rng.normal(size=len(time))
    twist[5] += 0.05 * amplitude  # the greatest excursion is while it is held
    twist[10] -= astray
    return Experiment("release", time, {"twist": twist}, {"twist": "rad"})


@pytest.mark.parametrize("astray", [0.0, 0.02, 0.05])
def test_a_sample_astray_does_not_let_a_held_wing_go(astray: float) -> None:
    held_in = 0
    for seed in range(6):
        found = by_name(identify_twist(held(seed, 0.2, astray=astray)))
        assert found["twist_natural_frequency"].value == pytest.approx(NATURAL, rel=1e-3), seed
        held_in += found["twist_natural_frequency"].contains(NATURAL) + found["twist_damping"].contains(0.02)
    assert held_in >= 10


def test_no_swing_is_found_in_noise() -> None:
    looked_at = 0
    for seed in range(10):
        try:
            model = identify_twist(held(seed, 0.0))
        except InputError as error:
            assert "after its release" in str(error)  # the greatest excursion of noise may be its last sample
            continue
        looked_at += 1
        assert model.estimates == (), (seed, model.estimates)
    assert looked_at >= 7


def test_a_swing_of_three_times_the_noise_is_found_from_where_the_wing_is_free() -> None:
    hits = 0
    for seed in range(5):
        found = by_name(identify_twist(held(seed, 0.006, damping=0.1)))
        assert found["twist_natural_frequency"].value == pytest.approx(NATURAL, rel=0.06), seed
        hits += found["twist_natural_frequency"].contains(NATURAL) + found["twist_damping"].contains(0.1)
    assert hits >= 8


@pytest.mark.parametrize("damping", [0.1, 0.31, 0.58])
def test_a_release_gives_frequency_and_damping(damping: float) -> None:
    hits = {"twist_natural_frequency": 0, "twist_damping": 0}
    for seed in range(6):
        found = by_name(identify_twist(release(seed, damping)))
        hits["twist_natural_frequency"] += found["twist_natural_frequency"].contains(NATURAL)
        hits["twist_damping"] += found["twist_damping"].contains(damping)
        assert found["twist_damping"].value == pytest.approx(damping, rel=0.05)
    assert min(hits.values()) >= 4


@pytest.mark.validate
def test_intervals_over_many_releases() -> None:
    found = [identify_twist(release(seed)).estimates for seed in SEEDS]
    promise_kept("twist", covered(found, {"twist_natural_frequency": NATURAL, "twist_damping": 0.31}))


def test_what_was_not_measured_is_left_out() -> None:
    found = by_name(identify_twist(release(hole=True)))
    assert found["twist_natural_frequency"].value == pytest.approx(NATURAL, rel=0.02)


def test_a_wing_that_does_not_swing_is_refused() -> None:
    time = np.arange(0, 2.0, 0.002)
    creeping = Experiment("creep", time, {"twist": 0.4 * np.exp(-time / 0.3)}, {"twist": "rad"})
    assert identify_twist(creeping).estimates == ()
    still = Experiment("still", time, {"twist": np.full_like(time, 0.1)}, {"twist": "rad"})
    assert "does not move" in identify_twist(still).unidentified[0].reason
    rng = np.random.default_rng(1)
    noise = Experiment("noise", time, {"twist": 0.01 * rng.normal(size=len(time))}, {"twist": "rad"})
    assert identify_twist(noise).estimates == ()
    with pytest.raises(InputError, match="no signal 'rate'"):
        identify_twist(still, "rate")
    with pytest.raises(InputError, match="fewer than"):
        identify_twist(Experiment("lost", time, {"twist": np.full_like(time, np.nan)}, {"twist": "rad"}))
