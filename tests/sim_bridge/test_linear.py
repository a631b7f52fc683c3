"""The two linear models of a flight beside each other."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.flight_mechanics.averaged import AveragedModel, short_period_of
from sim_bridge.flight_mechanics.linear import Linearization, averaged_modes, difference, warnings
from sim_bridge.flight_mechanics.modes import SHORT_PERIOD, Mode
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import StrokeInputs, StrokeMeans

MEANS = StrokeMeans(8.0, 0.0, 0.1, 0.1, 1.0, 10.0, 5.0, 0.5, 0.5, 10.0)
SLOW = AveragedModel(
    np.array([[-0.1, 0.2, 0.0, -9.8], [-1.0, -6.0, 8.0, 0.0], [0.0, -8.0, -5.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
    np.array([0.0, 0.0, 50.0, 0.0]),
    np.array([0.0, 0.0, 0.0]),
)


def test_the_modes_of_a_are_named_by_their_speed() -> None:
    found = averaged_modes(SLOW)
    assert [mode.name for mode in found] == ["phugoid", "short period"]
    exact = short_period_of(SLOW)
    assert found[1].natural_frequency == pytest.approx(exact.natural_frequency)
    assert found[1].damping == pytest.approx(exact.damping)


def test_what_four_states_do_not_explain_gets_no_names_and_says_what_to_read_instead() -> None:
    poor = SLOW._replace(unexplained=np.array([0.0, 0.4, 0.0]))
    assert [mode.name for mode in averaged_modes(poor)] == ["", ""]
    orbit = Orbit(np.zeros(0), StrokeInputs(4.0, 0.5, 0.0), MEANS, 0.0)
    (said,) = warnings(Linearization([], poor), orbit)
    assert "40 % of the response" in said and said.endswith("read the modes of the stroke map (Floquet) instead")


def test_what_to_beware_of_is_said() -> None:
    orbit = Orbit(np.zeros(0), StrokeInputs(4.0, 0.5, 0.0), MEANS, 0.0)
    fast = Mode(-5.0 + 12.0j, 1.0, 1.0, 0.0, SHORT_PERIOD)
    slow = Mode(-5.0 + 7.0j, 1.0, 1.0, 0.0, SHORT_PERIOD)
    wings = Mode(-12.0 + 0.5j, 0.01, 0.9)
    assert "may alias" in warnings(Linearization([fast], SLOW), orbit)[0]
    assert warnings(Linearization([slow, wings], SLOW), orbit) == []
    doubtful = SLOW._replace(unexplained=np.array([0.0, 0.1, 0.0]))
    assert "10 % of the response" in warnings(Linearization([slow], doubtful), orbit)[0]
    assert "a mode of the wings at 12 rad/s" in difference(Linearization([slow, wings], SLOW))
    assert difference(Linearization([wings], SLOW)) == ""
