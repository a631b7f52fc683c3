"""One even time base: lines stay lines, gaps stay gaps, nothing is folded, nothing is made up."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import (
    Channel,
    cut,
    down_sampled,
    even,
    experiment_of,
    filled,
    interpolated,
    measured_pieces,
    whole_records,
)
from wingbeat.errors import InputError


def test_uneven_samples_of_a_line_stay_on_it_and_end_with_it() -> None:
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.008, 0.012, 300))
    at = np.arange(-0.5, 4.0, 0.01)
    found = interpolated(time, 2 - 3 * time, at)
    inside = (at >= time[0]) & (at <= time[-1])
    np.testing.assert_allclose(found[inside], 2 - 3 * at[inside], atol=1e-12)
    assert np.all(np.isnan(found[~inside]))


def test_short_gaps_are_bridged() -> None:
    values = np.array([np.nan, 1.0, np.nan, 3.0, np.nan, np.nan, np.nan, 7.0, np.nan])
    np.testing.assert_allclose(filled(values, 1), [np.nan, 1, 2, 3, np.nan, np.nan, np.nan, 7, np.nan])
    np.testing.assert_allclose(filled(values, 3), [np.nan, 1, 2, 3, 4, 5, 6, 7, np.nan])


def test_a_gap_is_bridged_up_to_the_limit_only() -> None:
    time = np.arange(0, 2, 0.1)
    values = np.where((time > 0.45) & (time < 1.05), np.nan, time)
    at = np.arange(0, 1.9, 0.05)
    open_, closed = interpolated(time, values, at, 0.5), interpolated(time, values, at, 0.75)
    np.testing.assert_array_equal(np.isnan(open_), (at > 0.41) & (at < 1.09))
    np.testing.assert_allclose(closed, at, atol=1e-12)


@pytest.mark.parametrize("factor", [3, 10])
def test_down_sampling_keeps_what_is_slow_and_folds_nothing(factor: int) -> None:
    """GIVEN a slow wave and one that would be folded onto it THEN the slow one alone comes through."""
    time = np.arange(0, 20, 0.005)
    new = 0.005 * factor
    half = 0.5 / new
    slow = np.sin(2 * np.pi * 0.4 * half * time)
    fast = np.sin(2 * np.pi * 1.6 * half * time)
    for wave, wanted in ((slow, slow), (fast, np.zeros_like(fast))):
        at = np.arange(0, 19.9, new)
        found = even(Channel("q", "rad/s", time, wave), at, 0.0)
        inside = np.isfinite(found)
        assert 0.95 < np.mean(inside) < 1
        np.testing.assert_allclose(found[inside], np.interp(at, time, wanted)[inside], atol=2e-3)


def test_the_filter_loses_its_reach_around_a_gap() -> None:
    time = np.arange(0, 20, 0.005)
    values = np.where((time > 10) & (time < 10.5), np.nan, 1.0)
    found = even(Channel("q", "rad/s", time, values), np.arange(0, 20, 0.05), 0.0)
    missing = np.arange(0, 20, 0.05)[np.isnan(found)]
    assert np.all((missing < 0.5) | (missing > 19.5) | ((missing > 9.7) & (missing < 10.8)))
    np.testing.assert_allclose(found[np.isfinite(found)], 1.0, atol=2e-3)


def test_channels_of_several_rates_become_one_experiment() -> None:
    fast, slow = np.arange(0, 5, 0.005), np.arange(0.3, 4.5, 0.04)
    made = experiment_of(
        "flight", [Channel("q", "rad/s", fast, np.sin(fast)), Channel("V", "m/s", slow, 7 + slow)], 0.01, 0.1
    )
    assert made.step == pytest.approx(0.01)
    assert made.time[0] == 0
    assert np.all(np.isnan(made.signals["V"][made.time < 0.299]))
    inside = np.isfinite(made.signals["V"])
    np.testing.assert_allclose(made.signals["V"][inside], 7 + made.time[inside], atol=1e-9)
    assert made.units == {"q": "rad/s", "V": "m/s"}


def test_a_record_is_split_at_long_gaps_and_bridged_at_short_ones() -> None:
    time = np.arange(0, 10, 0.01)
    q, pitch = time.copy(), np.ones(1000)
    q[100:105], q[500:600], pitch[950:] = np.nan, np.nan, np.nan
    flight = Experiment(
        "flight", time, {"q": q, "pitch": pitch, "odd": q}, {"q": "rad/s", "pitch": "rad", "odd": "-"}
    )
    pieces = whole_records(flight, ["q", "pitch"], 0.06, 1.0)
    assert [(p.name, p.time[0], round(p.time[-1], 6)) for p in pieces] == [
        ("flight, part 1", 0.0, 4.99),
        ("flight, part 2", 6.0, 9.49),
    ]
    np.testing.assert_allclose(pieces[0].signals["q"], pieces[0].time, atol=1e-12)
    assert np.isnan(pieces[0].signals["odd"][102])
    assert [p.name for p in whole_records(flight, ["q"], 2.0, 1.0)] == ["flight"]
    assert measured_pieces(flight, ["q"], 1001) == ()


def test_an_experiment_is_down_sampled() -> None:
    time = np.arange(0, 10, 0.005)
    flight = Experiment("flight", time, {"q": np.sin(time)}, {"q": "rad/s"})
    slower = down_sampled(flight, 0.02)
    assert slower.step == pytest.approx(0.02)
    inside = np.isfinite(slower.signals["q"])
    np.testing.assert_allclose(slower.signals["q"][inside], np.sin(slower.time[inside]), atol=2e-3)
    with pytest.raises(InputError, match="shorter than the measured"):
        down_sampled(flight, 0.001)


def test_what_cannot_be_resampled_is_refused() -> None:
    time = np.array([0.0, 0.1, 0.1, 0.2])
    with pytest.raises(InputError, match="q: time must rise"):
        experiment_of("flight", [Channel("q", "rad/s", time, time)], 0.1, 0.0)
    with pytest.raises(InputError, match="each name once"):
        experiment_of("flight", [], 0.1, 0.0)
    flight = Experiment("flight", np.arange(9.0), {"q": np.full(9, np.nan)}, {"q": "rad/s"})
    with pytest.raises(InputError, match="nowhere measured together"):
        whole_records(flight, ["q"], 0.0, 1.0)
    with pytest.raises(InputError, match="has no signal theta"):
        whole_records(flight, ["q", "theta"], 0.0, 1.0)
    for samples in range(2):
        with pytest.raises(InputError, match="nowhere measured together"):
            whole_records(cut(flight, slice(samples)), ["q"], 0.0, 1.0)
