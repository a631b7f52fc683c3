"""Samples that stand for nothing are named; what a model lacks, which follows the motion, is not."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest

from logs.identification.diagnostics.signals import outlier_flags

TIME = 0.04 * np.arange(500)
MOTION = np.sin(2.0 * TIME)


def outliers(measured: np.ndarray, model: np.ndarray) -> int:
    """How many samples are outliers."""
    return int(outlier_flags(measured, measured - model).sum())


def noise(size: float) -> np.ndarray:
    return np.random.default_rng(4).normal(0.0, size, 500)


@pytest.mark.parametrize("size", [1e-6, 0.01])
@pytest.mark.parametrize("places", [(100,), (100, 103), (100, 101, 102), tuple(range(200, 208))])
def test_samples_apart_from_their_neighbours_are_spikes(size: float, places: tuple[int, ...]) -> None:
    measured = MOTION + noise(size)
    assert outliers(measured, MOTION) == 0
    measured[list(places)] += 0.6
    assert outliers(measured, MOTION) == len(places)


@pytest.mark.parametrize("size", [1e-6, 0.01])
@pytest.mark.parametrize("places", [(1,), (2,), (-2,), (-3,), (1, -2), (1, 2), (-3, -2)])
def test_spikes_beside_an_end_are_named(size: float, places: tuple[int, ...]) -> None:
    measured = MOTION + noise(size)
    measured[list(places)] += 0.6
    assert outliers(measured, MOTION) == len(places)


def test_thousands_of_samples_far_off_in_a_long_record_take_no_time() -> None:
    rng, time = np.random.default_rng(0), 0.01 * np.arange(100_000)
    off = np.zeros(len(time))
    off[rng.choice(len(time), 2000, replace=False)] = 1.0
    off[20_000:23_000] = 1.0
    measured = np.sin(time) + rng.normal(0.0, 0.01, len(time)) + off
    begin = perf_counter()
    outlier_flags(measured, measured - np.sin(time))
    assert perf_counter() - begin < 1.0


def test_a_channel_that_froze_is_named_and_a_coarse_one_is_not() -> None:
    measured = MOTION + noise(0.005)
    measured[40:80] = measured[40]
    assert outliers(measured, MOTION) == 40
    dropped = MOTION + noise(0.005)
    dropped[300:340] = 0.0
    assert outliers(dropped, MOTION) == 40
    lacking = np.where((TIME > 4.0) & (TIME < 5.0), 0.5 * MOTION, MOTION)
    assert outliers(np.round(MOTION / 0.05) * 0.05, lacking + 0.2 * noise(0.05)) == 0


@pytest.mark.parametrize("size", [1e-6, 0.01])
def test_what_a_model_lacks_while_a_control_moves_is_no_spike(size: float) -> None:
    """GIVEN a model that misses a part of the motion THEN tens of samples are far off, and none is called a spike."""
    answer = np.where((TIME > 8.0) & (TIME < 9.0), np.sin(2 * np.pi * (TIME - 8.0)) ** 2, 0.0)
    measured = MOTION + answer + noise(size)
    assert np.count_nonzero(np.abs(measured - MOTION) > 0.1) > 15
    assert outliers(measured, MOTION) == 0


def test_buffet_is_no_spike() -> None:
    shaken = (TIME > 12.0) & (TIME < 15.0)
    measured = MOTION + noise(0.01) + np.where(shaken, np.random.default_rng(1).normal(0.0, 0.3, 500), 0.0)
    assert np.count_nonzero(np.abs(measured - MOTION) > 0.1) > 40
    assert outliers(measured, MOTION) <= 3, "at most at its edges"
