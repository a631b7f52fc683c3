"""Manoeuvres that were written one behind the other under one running time, and records that only look like it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.sources.table.maneuvers import DataSplit, split_at_discontinuities
from tests.logs.identification.test_tables_identified import assert_truth, flight
from tests.logs.identification.test_tables_strangers import THETA, identified, texts_of

STEP = 0.04
TIME = np.arange(0.0, 12.0, STEP)


NOISE = {"alpha": 0.002, "q": 0.003, "a_z": 0.1, "theta": 0.002}


def with_pitch(seed: int) -> dict[str, np.ndarray]:
    """The flight with the angle that its pitch rate adds up to, and noise of its own."""
    rng, columns = np.random.default_rng(seed), flight(noise=0.0)
    pitch = np.concatenate(([0.0], np.cumsum((columns["q"][1:] + columns["q"][:-1]) * STEP / 2.0)))
    whole = {**columns, "theta": 0.07 + pitch}
    return {name: values + rng.normal(0.0, NOISE.get(name, 0.0), len(values)) for name, values in whole.items()}


def test_two_manoeuvres_under_one_running_time_are_cut_where_the_motion_jumps(tmp_path: Path) -> None:
    """GIVEN another trim and the end of a doublet before the second's start THEN it has a start of its own."""
    first, second = with_pitch(6), with_pitch(7)
    kept = first["t"] < 5.0  # the first is broken off while it still moves
    shifted = {"t": second["t"] + 5.0, "alpha": second["alpha"] - 0.01, "theta": second["theta"] - 0.05}
    joined = {name: np.concatenate((first[name][kept], (second | shifted)[name])) for name in first}
    found = identified(tmp_path, joined, THETA)
    assert "jump at 5 s; cut there" in texts_of(found)
    assert found.experiments == ("maneuver 1, part 1 of run.csv", "maneuver 1, part 2 of run.csv")
    assert found.files == ("run.csv",)
    assert_truth(found.fits[0])


def cut_of(signals: dict[str, np.ndarray]) -> DataSplit:
    one = Experiment("maneuver 1 of a.csv", TIME, signals, {}, file="a.csv", number=1)
    return split_at_discontinuities(DataSplit((one,), ()))


def noisy(values: np.ndarray, size: float = 0.001) -> np.ndarray:
    return values + np.random.default_rng(2).normal(0.0, size, len(values))


def test_an_angle_that_is_elsewhere_and_stays_there_is_cut() -> None:
    """GIVEN a shift of a tenth of what the angle moves THEN the pieces end and begin on its two sides."""
    alpha = noisy(0.1 * np.sin(TIME)) + np.where(TIME >= 6.0 - 1e-9, 0.03, 0.0)
    found = cut_of({"alpha": alpha})
    assert [len(one.time) for one in found.fitted] == [150, 150]
    assert found.fitted[1].time[0] == pytest.approx(6.0)
    assert "alpha jump at 6 s" in found.findings[0].text


@pytest.mark.parametrize(
    "signals",
    [
        {"q": noisy(np.where(TIME > 6.0, 0.3 * np.sin(5.0 * (TIME - 6.0)), 0.0))},
        {"alpha": noisy(0.1 * np.sin(TIME)) + np.where(np.arange(len(TIME)) == 150, 0.3, 0.0)},
        {"theta": np.round(0.1 * np.sin(0.3 * TIME), 2)},
        {"theta": np.repeat(0.1 * np.sin(TIME[::25]), 25)},
        {"phi": noisy((TIME % 6.0) / 6.0 * 2.0 * np.pi - np.pi)},
        {"a_z": noisy(np.where(TIME > 6.0, 5.0, 0.0)), "V": noisy(np.where(TIME > 6.0, 90.0, 100.0))},
    ],
    ids=["a motion that begins", "a spike", "told coarsely", "told seldom", "a turn around", "no angle or rate"],
)
def test_what_no_joint_is_is_left_whole(signals: dict[str, np.ndarray]) -> None:
    found = cut_of(signals)
    assert len(found.fitted) == 1 and not found.findings
