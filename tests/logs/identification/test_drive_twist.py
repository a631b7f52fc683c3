"""Twist damping and frequency from overshoots, peaks and records of the published response."""

from __future__ import annotations

import numpy as np
import pytest
from promised import SEEDS, covered, promise_kept

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.bench import identify_twist
from logs.identification.results import Estimate, EstimationResult
from sim_bridge.flight_mechanics.wing_twist import free_twist
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
    locked = time >= 0.3
    if hole:
        twist[200:220] = np.nan
    return Experiment("release", time[locked], {"twist": twist[locked]}, {"twist": "rad"})


def by_name(model: EstimationResult) -> dict[str, Estimate]:
    return {found.name: found for found in model.estimates}


def locked(seed: int, amplitude: float, damping: float = 0.02, astray: float = 0.0) -> Experiment:
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
        found = by_name(identify_twist(locked(seed, 0.2, astray=astray)))
        assert found["twist_natural_frequency"].value == pytest.approx(NATURAL, rel=1e-3), seed
        held_in += found["twist_natural_frequency"].contains(NATURAL) + found["twist_damping"].contains(0.02)
    assert held_in >= 10


def test_no_swing_is_found_in_noise() -> None:
    looked_at = 0
    for seed in range(10):
        try:
            model = identify_twist(locked(seed, 0.0))
        except InputError as error:
            assert "after its release" in str(error)  # the greatest excursion of noise may be its last sample
            continue
        looked_at += 1
        assert model.estimates == (), (seed, model.estimates)
    assert looked_at >= 7


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
    assert "does not move" in identify_twist(still).withheld[0].text
    rng = np.random.default_rng(1)
    noise = Experiment("noise", time, {"twist": 0.01 * rng.normal(size=len(time))}, {"twist": "rad"})
    assert identify_twist(noise).estimates == ()
    with pytest.raises(InputError, match="no signal 'rate'"):
        identify_twist(still, "rate")
    with pytest.raises(InputError, match="fewer than"):
        identify_twist(Experiment("lost", time, {"twist": np.full_like(time, np.nan)}, {"twist": "rad"}))
