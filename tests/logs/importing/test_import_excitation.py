"""Identification inputs of other programs' logs."""

from __future__ import annotations

import numpy as np

from logs.importing.excitation import excitation_topic
from logs.importing.source import Series


def doublets(time: np.ndarray) -> np.ndarray:
    """Return two doublets of 0.4 s at 5 and 8 s."""
    values = np.zeros(len(time))
    for at in (5.0, 8.0):
        values[(time >= at) & (time < at + 0.2)] = 0.4
        values[(time >= at + 0.2) & (time < at + 0.4)] = -0.4
    return values


def test_maneuvers_of_a_topic_that_is_logged_all_along() -> None:
    """GIVEN two doublets in a topic of 50 Hz WHEN imported THEN two maneuvers with their settling times."""
    time = np.arange(0.0, 12.0, 0.02)
    stamps = np.rint(time * 1e6).astype(np.int64)
    made = excitation_topic({"excitation": Series("excitation", stamps, {"pitch": doublets(time)}, {})}, {})
    assert made is not None
    columns, at = made.series.columns, made.series.time_us * 1e-6
    assert columns["manoeuvre"].max() == 2 and columns["elevator"].max() == 0.2
    edges = np.flatnonzero(np.diff(columns["active"]))
    assert np.abs(at[edges] - np.array((4.0, 6.58, 7.0, 9.58))).max() < 0.05


def test_maneuvers_of_a_topic_that_is_logged_during_inputs_only() -> None:
    """GIVEN SIDD rows during two inputs WHEN imported THEN the maneuvers reach beyond them."""
    time = np.concatenate([np.arange(at, at + 0.4, 0.02) for at in (5.0, 8.0)])
    series = Series("SIDD", np.rint(time * 1e6).astype(np.int64), {"Time": time, "Targ": doublets(time)}, {})
    made = excitation_topic({"SIDD": series}, {"SID_AXIS": 11.0})
    assert made is not None
    active = made.series.time_us[made.series.columns["active"] > 0.0] * 1e-6
    assert active.min() == 4.0 and active.max() > 8.3
    assert made.series.columns["manoeuvre"].max() == 2


def test_no_input_no_maneuver() -> None:
    """GIVEN a log without such a topic, or with one that is zero WHEN imported THEN none."""
    stamps = np.arange(0, 1_000_000, 20_000, dtype=np.int64)
    zero = Series("excitation", stamps, {"pitch": np.zeros(len(stamps))}, {})
    assert excitation_topic({"ATT": zero}, {}) is None
    assert excitation_topic({"excitation": zero}, {}) is None


def test_inputs_of_another_axis_and_settings_are_no_maneuvers() -> None:
    """GIVEN a sweep in roll, or a constant amplitude beside the output WHEN imported THEN pitch alone counts."""
    time = np.arange(0.0, 12.0, 0.02)
    stamps = np.rint(time * 1e6).astype(np.int64)
    roll = Series("SIDD", stamps, {"Targ": doublets(time)}, {})
    assert excitation_topic({"SIDD": roll}, {"SID_AXIS": 1.0}) is None
    assert excitation_topic({"roll_chirp": roll._replace(name="roll_chirp")}, {}) is None
    both = Series("chirp", stamps, {"amplitude": np.full(len(time), 0.3), "output": doublets(time)}, {})
    made = excitation_topic({"chirp": both}, {})
    assert made is not None and made.series.columns["manoeuvre"].max() == 2
    rate = excitation_topic({"SIDD": roll}, {"SID_AXIS": 8.0})
    assert rate is not None and rate.series.columns["elevator"].max() < 0.01
