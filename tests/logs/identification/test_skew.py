"""The skew between two recorders is found within its own error, or not at all."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from promised import SEEDS, promise_kept
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.data.signal_errors import shifted, skew_between
from logs.identification.findings import Finding
from logs.identification.results import Estimate
from wingbeat.errors import InputError

STEP = 0.02
FINE = 10
"""-; steps of the true motion in a sample"""


def print_result(text: str) -> None:
    sys.stdout.write(text + "\n")


def skewed(seed: int, noise: float = 0.1, samples: int = 1000) -> tuple[np.ndarray, np.ndarray, float]:
    """Two noisy signals of one motion and the true skew in s, up to 0.6 s either way."""
    rng = np.random.default_rng(seed)
    motion = rng.normal(size=samples * FINE + 2000)
    for pole in (0.99, 0.98):
        motion = lfilter([1.0], [1.0, -pole], motion)
    motion = motion / np.std(motion)
    late = int(rng.integers(-300, 300))
    at = 1000 + FINE * np.arange(samples)
    white = rng.normal(size=(2, samples))
    return motion[at] + noise * white[0], 0.7 * motion[at - late] + 0.3 + noise * white[1], late * STEP / FINE


def covered(seeds: range, noise: float) -> tuple[float, float]:
    """Share of intervals that hold the truth and root mean square error in samples."""
    hits, errors = [], []
    for seed in seeds:
        first, second, truth = skewed(seed, noise)
        found = skew_between(first, second, STEP, 1.0)
        if isinstance(found, Estimate):
            hits.append(found.contains(truth))
            errors.append((found.value - truth) / STEP)
    assert len(hits) >= 0.95 * len(seeds)  # in noise of 0.4 a few shifts do not converge and are refused
    return float(np.mean(hits)), float(np.sqrt(np.mean(np.square(errors))))


def test_the_skew_is_found_within_its_error() -> None:
    share, error = covered(range(8), 0.1)
    assert share >= 0.8
    assert error < 0.1


@pytest.mark.validate
@pytest.mark.parametrize("noise", [0.02, 0.1, 0.4])
def test_the_skew_of_many(noise: float) -> None:
    share, error = covered(SEEDS, noise)
    promise_kept(f"skew, noise {noise}, error {error:.3f} samples", {"skew": share})


def test_without_noise_the_skew_is_exact_between_the_samples() -> None:
    time = STEP * np.arange(600)
    pulses = [np.exp(-(((time - at - late) / 0.4) ** 2)) for late in (0, 0.0137) for at in (6.0,)]
    found = skew_between(pulses[0], pulses[1], STEP, 1.0)
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(0.0137, abs=1e-5)


def test_a_periodic_motion_is_ambiguous() -> None:
    time = STEP * np.arange(500)
    noise = 0.05 * np.random.default_rng(1).normal(size=(2, 500))
    found = skew_between(np.sin(6 * time) + noise[0], np.sin(6 * time - 0.3) + noise[1], STEP, 2.0)
    assert isinstance(found, Finding)
    assert "ambiguous" in found.text


def test_signals_that_do_not_belong_together_have_no_skew() -> None:
    noise = np.random.default_rng(2).normal(size=(2, 500))
    found = skew_between(noise[0], noise[1], STEP, 2.0)
    assert isinstance(found, Finding)
    still = skew_between(noise[0], np.zeros(500), STEP, 2.0)
    assert isinstance(still, Finding)
    assert still.text == "a signal does not change"


def test_a_skew_beyond_the_search_is_not_told() -> None:
    time = STEP * np.arange(600)
    first, second = (np.exp(-(((time - at) / 0.8) ** 2)) for at in (5.0, 6.5))
    found = skew_between(first, second, STEP, 0.5)
    assert isinstance(found, Finding)
    assert "longest skew" in found.text


def test_a_late_signal_is_moved_back_and_nothing_is_made_up() -> None:
    time = STEP * np.arange(500)
    signals = {"q": np.sin(time), "late": np.sin(time - 0.05)}
    moved = shifted(Experiment("flight", time, signals, dict.fromkeys(signals, "rad/s")), ("late",), 0.05)
    np.testing.assert_allclose(moved.signals["late"][:490], np.sin(time)[:490], atol=1e-4)
    assert np.all(np.isnan(moved.signals["late"][-2:]))


def test_signals_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(InputError, match="resample them first"):
        skew_between(np.zeros(100), np.zeros(99), STEP, 0.5)
    with pytest.raises(InputError, match="cannot be estimated"):
        skew_between(np.zeros(100), np.zeros(100), STEP, 1.5)
