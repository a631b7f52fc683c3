"""Strokes cut by the wing's phase, and what signals did in them."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from recorded import flight, record

from avionics import messages as m
from avionics import topics
from avionics.state import zero
from logs.reader import open_log
from logs.strokes import Strokes, cut_strokes, strokes
from wingbeat.errors import InputError

TIME = np.arange(0, 10, 0.005)


def turns(time: np.ndarray) -> np.ndarray:
    """Strokes since 0 s of a wing at 4 Hz, give or take a tenth."""
    return 0.3 + 4.0 * time + 0.4 * (1 - np.cos(2 * np.pi * time / 8)) * 8 / (2 * np.pi)


def cut(time: np.ndarray, flapping: np.ndarray | None = None) -> Strokes:
    phase = 2 * np.pi * np.mod(turns(time), 1.0)
    flaps = np.ones(len(time), np.int64) if flapping is None else flapping
    return cut_strokes(time, phase, np.floor(turns(time)).astype(np.int64), flaps)


def test_strokes_begin_and_end_at_whole_turns() -> None:
    found = cut(TIME)
    assert np.allclose(turns(found.begin), np.round(turns(found.begin)), atol=1e-3)
    assert np.array_equal(found.begin[1:], found.end[:-1])
    assert found.number.tolist() == list(range(1, 1 + len(found.number)))
    assert len(found.number) == int(turns(TIME[-1])) - 1
    assert np.array_equal(found.period, found.end - found.begin) and np.all(found.period < 0.31)


def test_no_stroke_reaches_into_a_pause_or_a_glide() -> None:
    """GIVEN half a second without messages and a second of gliding THEN the strokes at their edges are not whole."""
    kept = TIME[(TIME < 3.0) | (TIME > 3.5)]
    gliding = (kept > 6.0) & (kept < 7.0)
    found = cut(kept, (~gliding).astype(np.int64))
    assert not np.any((found.begin < 3.5) & (found.end > 3.0))
    assert not np.any((found.begin < 7.0) & (found.end > 6.0))
    whole = cut(TIME)
    outside = [
        (b, e) for b, e in zip(whole.begin, whole.end, strict=True) if e < 3.0 or (b > 3.5 and e < 6.0) or b > 7.0
    ]
    assert np.allclose(found.begin, [b for b, _ in outside], atol=1e-9)
    assert np.array_equal(found.number, np.floor(turns(found.begin) + 0.5))


def test_samples_that_repeat_or_are_no_number_make_no_strokes() -> None:
    time = np.repeat(TIME, 2)
    phase = 2 * np.pi * np.mod(turns(time), 1.0)
    phase[1000:1002] = np.nan
    found = cut_strokes(time, phase, np.floor(turns(time)).astype(np.int64), np.ones(len(time), np.int64))
    assert np.allclose(found.begin, cut(TIME).begin, atol=1e-4)


def test_means_remove_what_repeats_with_the_wing() -> None:
    found = cut(TIME)
    shaking = 30 * np.sin(2 * np.pi * turns(TIME))
    means = found.means(TIME, np.column_stack((5 + shaking, TIME)))
    assert np.max(np.abs(means[:, 0] - 5)) < 0.01 * 30
    assert np.allclose(means[:, 1], (found.begin + found.end) / 2, atol=1e-9)
    assert found.means(TIME, TIME).shape == (len(found.begin),)


def test_every_stroke_has_the_same_phases() -> None:
    found = cut(TIME)
    at = np.arange(0, 10, 0.002)
    rows = found.resampled(at, np.sin(2 * np.pi * turns(at)), 40)
    assert rows.shape == (len(found.begin), 40)
    assert np.max(np.abs(rows - np.sin(2 * np.pi * np.arange(40) / 40))) < 0.03


def test_slices_share_no_sample_and_lose_none() -> None:
    found = cut(TIME)
    slices = found.slices(TIME)
    assert all(before.stop == after.start for before, after in itertools.pairwise(slices))
    for stroke, begin, end in zip(slices, found.begin, found.end, strict=True):
        assert np.all((TIME[stroke] >= begin) & (TIME[stroke] < end)) and stroke.stop - stroke.start > 40


def test_a_stroke_that_a_signal_does_not_span_has_no_mean() -> None:
    found = cut(TIME)
    part = TIME[((TIME > 2.0) & (TIME < 4.0)) | (TIME > 5.0)]
    for values in (found.means(part, part), found.resampled(part, part, 8)[:, 0]):
        unknown = (found.begin < part[0]) | ((found.end > 4.0) & (found.begin < 5.0))
        assert np.array_equal(np.isnan(values), unknown)
    assert np.isnan(found.means(np.empty(0), np.empty(0))).all()
    assert np.isnan(found.resampled(np.empty(0), np.empty(0))).all()


def test_no_stroke_at_all() -> None:
    still = cut(TIME, np.zeros(len(TIME), np.int64))
    assert len(still.begin) == len(still.number) == 0 and still.slices(TIME) == []
    assert still.means(TIME, TIME).shape == (0,) and still.resampled(TIME, TIME, 5).shape == (0, 5)
    assert len(cut(TIME[:0]).begin) == len(cut(TIME[:1]).begin) == 0


def test_strokes_of_a_log(tmp_path: Path) -> None:
    wing = [
        (topics.WING, zero(m.WingState)._replace(
            time_us=round(time * 1e6), phase=2 * np.pi * (turns(time) % 1.0), strokes=int(turns(time)), flapping=1,
        )) for time in TIME.tolist()
    ]  # fmt: skip
    log = open_log(record(tmp_path / "a.mcap", wing))
    assert np.allclose(strokes(log).begin, cut(TIME).begin)
    part = strokes(log, 2.0, 4.0)
    assert np.all((part.begin >= 2.0) & (part.end < 4.0)) and len(part.begin) in range(6, 9)
    other = open_log(record(tmp_path / "b.mcap", flight(0.1, (topics.IMU,))))
    with pytest.raises(InputError, match="no topic /main/wing"):
        strokes(other)
