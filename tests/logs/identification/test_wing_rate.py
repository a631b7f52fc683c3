"""How hard the wings flap, from a log's wing topic: exact where it is told, unknown where it is not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly

from avionics import topics
from logs.identification.data.flight_segments import stretches
from logs.identification.data.maneuvers import find_manoeuvres
from logs.identification.results import Array
from logs.identification.sources.flight import RATE_UNKNOWN, flight_data
from wingbeat.topic import Topic

RATE, AMPLITUDE, LASTS = 4.0, 0.5, 8.0
"""Hz, rad, s"""
MEAN = (2.0 * np.pi * RATE * AMPLITUDE) ** 2 / 2.0
"""rad^2/s^2; over a stroke"""


class Flapped:
    """A log of wings that flap evenly, whose topic tells the samples at ``wing`` (N,), s."""

    def __init__(self, wing: Array) -> None:
        steady = np.arange(0.0, LASTS, 0.005)
        phase = 2.0 * np.pi * RATE * wing
        angle = AMPLITUDE * np.sin(phase)
        ones = np.zeros(len(steady))
        active = np.where((steady > 2.0) & (steady < 4.0), 1.0, 0.0)
        self._tables: dict[str, dict[str, Array]] = {
            topics.WING.name: {"time": wing, "phase": phase % (2 * np.pi), "angle_left": angle, "angle_right": angle},
            topics.IMU.name: {
                "time": steady, **dict.fromkeys(("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"), ones),
                "accel_z": ones - 9.8,
            },
            topics.ATTITUDE.name: {
                "time": steady, **dict.fromkeys(("roll", "pitch", "bias_x", "bias_y", "bias_z"), ones)
            },
            topics.ALTITUDE.name: {"time": steady, "climb_rate": ones},
            topics.AIR_DATA.name: {"time": steady, "airspeed": ones + 7.0},
            topics.ACTUATORS.name: {"time": steady, "elevator": ones},
            topics.EXCITATION.name: {
                "time": steady, "active": active, "manoeuvre": active, "elevator": ones, "aborted": ones
            },
        }  # fmt: skip

    def columns(self, topic: Topic) -> Mapping[str, Any]:
        table = dict(self._tables[topic.name])
        return {"time_us": np.round(table.pop("time") * 1e6).astype(np.int64), **table}


def squared(wing: Array) -> tuple[Array, Array]:
    data = flight_data(Flapped(wing))
    return data.time, data.wing_rate_squared


def test_the_square_of_the_wings_rate_is_theirs() -> None:
    time, found = squared(np.arange(0.0, LASTS, 0.005))
    true = 2.0 * MEAN * np.cos(2.0 * np.pi * RATE * time) ** 2
    assert not flight_data(Flapped(np.arange(0.0, LASTS, 0.005))).notes
    inside = slice(5, -5)
    np.testing.assert_allclose(found[inside], true[inside], atol=0.01 * MEAN)


@pytest.mark.parametrize("gap", [0.02, 0.05, 0.12])
def test_in_a_gap_it_is_unknown_and_beside_it_no_false_peak(gap: float) -> None:
    wing = np.arange(0.0, LASTS, 0.005)
    time, found = squared(wing[(wing < 3.0) | (wing > 3.0 + gap)])
    assert np.isnan(found[(time > 3.0) & (time < 3.0 + gap)]).all()
    assert np.isfinite(found[(time < 2.99) | (time > 3.01 + gap)]).all()
    assert np.nanmax(found) < 2.1 * MEAN


@pytest.mark.parametrize("step", [0.04, 0.1])
def test_of_few_samples_a_stroke_it_is_unknown(step: float) -> None:
    data = flight_data(Flapped(np.arange(0.0, LASTS, step)))
    assert np.isnan(data.wing_rate_squared).all() and RATE_UNKNOWN in data.notes


def test_a_stroke_of_which_it_is_unknown_ends_a_stretch() -> None:
    """GIVEN a flight that tells the wings' rate but for a moment THEN no stroke passes for one at the mean."""
    data = fly(Flight(seed=1, flapping=(1.0, 1.0, -6.0)))
    manoeuvres = find_manoeuvres(data, AIRCRAFT)
    (whole,) = stretches(data, manoeuvres, 0.0)
    middle = float(whole.edges[len(whole.edges) // 2])
    told = np.where(np.abs(data.time - middle - 0.1) < 0.03, np.nan, data.wing_rate_squared)
    parts = stretches(data._replace(wing_rate_squared=told), manoeuvres, 0.0)
    assert len(parts) == 2
    assert sum(len(part.averages) for part in parts) == len(whole.averages) - 1
    kept = np.concatenate([part.wing_rate_squared for part in parts])
    assert np.isin(np.round(kept, 9), np.round(whole.wing_rate_squared, 9)).all()
    never = stretches(data._replace(wing_rate_squared=np.full(len(data.time), np.nan)), manoeuvres, 0.0)
    assert [len(part.averages) for part in never] == [len(whole.averages)]
    assert not np.any(never[0].wing_rate_squared)
