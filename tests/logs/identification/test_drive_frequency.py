"""Flapping frequency against throttle from records whose law is known."""

from __future__ import annotations

import numpy as np
import pytest
from promised import SEEDS, covered, promise_kept

from logs.identification.estimators.flapping_frequency import (
    FrequencyResult,
    ThrottleData,
    frequency_truth,
    identify_frequency,
    steady_segments,
)
from logs.identification.results import Estimate
from wingbeat.errors import InputError

LEVELS = (0.0, 0.1, 0.3, 0.45, 0.6, 0.75, 0.9, 0.35, 0.7, 0.5)
HELD = 4.0


def record(
    seed: int = 0,
    curvature: float = 0.0,
    per_volt: float = 0.0,
    jitter: float = 0.02,
    levels: tuple[float, ...] = LEVELS,
) -> ThrottleData:
    """A motor that follows the throttle with 0.15 s and turns from a throttle of 0.2 on."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, HELD * len(levels), 0.005)
    throttle = np.repeat(levels, int(HELD / 0.005))[: len(time)]
    sag = np.repeat(rng.normal(0, 0.4, len(levels)), int(HELD / 0.005))[: len(time)]
    wanted = np.where(throttle < 0.2, 0.0, 4.0 + 8.0 * (throttle - 0.5) + curvature * (throttle - 0.5) ** 2)
    wanted = wanted + np.where(throttle < 0.2, 0.0, per_volt * sag)
    rate = np.zeros_like(time)
    for k in range(1, len(time)):
        rate[k] = rate[k - 1] + 0.005 / 0.15 * (wanted[k] - rate[k - 1])
    knots = np.arange(0, time[-1] + 1, 0.5)
    wander = np.interp(time, knots, rng.normal(0, jitter, len(knots)))
    strokes = np.cumsum(np.maximum(rate * (1 + wander), 0.0)) * 0.005
    slow = slice(None, None, 2)
    return ThrottleData(time, throttle, time, strokes, time[slow], 8.0 + sag[slow])


def by_name(model: FrequencyResult) -> dict[str, Estimate]:
    return {found.name: found for found in model.result.estimates}


def test_the_slope_is_found_and_nothing_is_made_of_noise() -> None:
    slopes = [identify_frequency(record(seed)) for seed in range(20)]
    assert sum(by_name(model)["throttle_slope"].contains(8.0) for model in slopes) >= 17
    assert sum("throttle_curvature" in by_name(model) for model in slopes) <= 4
    model = slopes[0]
    centre = by_name(model)["flapping_frequency"]
    assert centre.value == pytest.approx(4.0 + 8.0 * (model.result.fixed["T_c"] - 0.5), abs=0.1)


@pytest.mark.validate
def test_intervals_of_the_slope_over_many_records() -> None:
    found = [identify_frequency(record(seed)).result.estimates for seed in SEEDS]
    promise_kept("flapping against throttle", covered(found, {"throttle_slope": 8.0}))


def test_curvature_and_voltage_are_taken_up_where_they_are() -> None:
    bent = by_name(identify_frequency(record(1, curvature=-6.0, jitter=0.005)))
    assert bent["throttle_curvature"].contains(-6.0)
    assert bent["throttle_curvature"].high < 0
    fed = by_name(identify_frequency(record(2, per_volt=0.5, jitter=0.005)))
    assert fed["voltage_slope"].contains(0.5)


def test_the_dead_zone_lies_between_what_was_seen() -> None:
    dead = by_name(identify_frequency(record()))["dead_zone"]
    assert (dead.low, dead.high) == pytest.approx((0.1, 0.3))
    refused = {entry.subject: entry.text for entry in identify_frequency(record(levels=LEVELS[2:])).result.withheld}
    assert "wings stood still" in refused["dead_zone"]


def test_stretches_are_settled_and_count_whole_strokes() -> None:
    segments = steady_segments(record(jitter=0.0))
    assert len(segments) == len(LEVELS)
    for segment in segments:
        assert segment.end - segment.begin < HELD
        if segment.frequency:
            assert segment.frequency == pytest.approx(4.0 + 8.0 * (segment.throttle - 0.5), rel=0.02)


def test_a_throttle_that_never_rests_is_refused() -> None:
    data = record()
    moving = data._replace(throttle=0.5 + 0.3 * np.sin(data.throttle_time))
    with pytest.raises(InputError, match="stands still in"):
        identify_frequency(moving)
    with pytest.raises(InputError, match="does not move"):
        identify_frequency(data._replace(throttle=np.full_like(data.throttle, 0.5)))
    nothing = np.zeros(0)
    with pytest.raises(InputError, match="needs both"):
        identify_frequency(data._replace(wing_time=nothing, strokes=nothing))


def test_without_voltage_the_rest_is_found() -> None:
    nothing = np.zeros(0)
    model = identify_frequency(record()._replace(voltage_time=nothing, voltage=nothing))
    assert "throttle_slope" in by_name(model)
    assert {entry.subject: entry.text for entry in model.result.withheld}[
        "voltage_slope"
    ] == "the voltage was not measured"


def test_holes_in_the_throttle_are_passed_over() -> None:
    data = record()
    holed = data.throttle.copy()
    holed[1000:1010] = np.nan
    assert by_name(identify_frequency(data._replace(throttle=holed)))["throttle_slope"].contains(8.0)


def test_the_truth_is_the_same_fit_on_the_true_law() -> None:
    model = identify_frequency(record(jitter=0.0))
    throttles = np.linspace(0.0, 1.0, 11)
    truth = frequency_truth(model, throttles, np.where(throttles < 0.2, 0.0, 4.0 + 8.0 * (throttles - 0.5)))
    assert truth["throttle_slope"] == pytest.approx(8.0, rel=1e-3)
    assert set(truth) <= set(by_name(model))
