"""A manoeuvre is cut so that nothing else is in it: neither another input nor what the loops do behind its end."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import STEP, Flight, by_output_error, fly, model_of

from logs.identification.data.flight import FlightData
from logs.identification.data.maneuvers import find_maneuvers
from logs.identification.models.modes import short_period_of

KICKED = 0.2
"""s; behind the end of each manoeuvre"""


def kicked(data: FlightData, size: float) -> FlightData:
    """The flight with loops that take over when a manoeuvre ends, and move the aircraft by the throttle."""
    ends = np.flatnonzero(np.diff(data.active) < 0) + 1
    since = np.full(len(data.time), np.inf)
    for end in ends:
        since[end:] = STEP * np.arange(len(data.time) - end)
    push = np.where(since < KICKED, size * np.sin(np.pi * np.minimum(since, KICKED) / KICKED), 0.0)
    return data._replace(
        pitch_rate=data.pitch_rate + push, accel_x=data.accel_x + 2 * push, accel_z=data.accel_z - 20 * push
    )


@pytest.mark.parametrize("width", [0.2, 0.4])
def test_what_happens_behind_the_end_of_a_manoeuvre_is_no_part_of_it(width: float) -> None:
    data = fly(Flight(seed=3, width=width, modulation=0.2))
    before, after = (find_maneuvers(one) for one in (data, kicked(data, 1.0)))
    assert len(before) == len(after) == 6
    for one, other in zip(before, after, strict=True):
        for name, values in one.experiment.signals.items():
            np.testing.assert_array_equal(values, other.experiment.signals[name])
        assert one.experiment.time[-1] + one.period / 2 == pytest.approx(
            data.time[np.flatnonzero(data.manoeuvre * data.active == one.number)[-1]], abs=0.03
        )


def test_wings_that_slow_down_within_an_input_take_the_averages_as_far_back_as_they_reach() -> None:
    """GIVEN wings that all but stop a fifth of a second into an input THEN no average lacks samples at its beginning.

    Of a flight in gusts, whose height hold glided, an average began before the first one did.
    """
    data = fly(Flight(seed=2, doublets=2))
    begin = data.time[np.flatnonzero(np.diff(data.active) > 0)[0] + 1] + 0.2
    rate = np.where((data.time > begin) & (data.time < begin + 2.0), 0.3, 4.0)
    one, other = find_maneuvers(data._replace(strokes=np.cumsum(rate) * STEP))
    for maneuver in (one, other):
        assert all(np.all(np.isfinite(values)) for values in maneuver.experiment.signals.values())
    assert one.experiment.time[0] < other.experiment.time[0]


def test_loops_that_fly_again_do_not_move_the_frequency() -> None:
    """GIVEN short settling times, loops that take over while the response dies away THEN nothing depends on it."""
    flight = Flight(seed=5, settle=0.9, modulation=0.2)
    true, _ = short_period_of(model_of(flight).a)
    data = fly(flight)
    with_loops, without = (by_output_error(one).frequency for one in (kicked(data, 1.0), data))
    assert with_loops is not None and without is not None
    assert with_loops.value == pytest.approx(without.value, rel=1e-3)
    assert with_loops.contains(true)
