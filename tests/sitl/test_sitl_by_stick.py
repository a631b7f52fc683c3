"""A pilot with a transmitter flies the simulated bird by stick, seeing it as one does from the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulate import RAVEN, Flight, simulate

from avionics import topics
from avionics.messages import Mode, PilotSource, Stage
from sim_bridge.flight.world import LAUNCH_TIME, Scenario
from sim_bridge.observation import Observation
from sim_bridge.sensors.receiver import Sticks

ARM_TIME = 4.0
TURN = (28.0, 36.0)
"""s; with the stick to the right"""
DOWN_TIME = 38.0
"""s; when the throttle is closed to land"""
HEIGHT = 15.0
"""m; that the pilot keeps"""
HAND = 1.8
"""m; height of the launch above the ground"""


def pilot(observed: Observation) -> Sticks:
    """Takes off, climbs, flies a turn and lands in STABILIZED; looks only at height and climb."""
    time, height, climb = observed.time_us * 1e-6, -observed.position_ned[2], -observed.v_ned[2]
    armed = int(time >= ARM_TIME)
    if time < LAUNCH_TIME + 0.2:
        return Sticks(arm=armed)
    if time >= DOWN_TIME:
        low = height < HAND + 1.0
        return Sticks(pitch=0.5 if low else -0.1, throttle=0.0 if low else _power(-1.0, climb), arm=armed)
    expected = min(0.5 * (HEIGHT - height), 1.5)
    roll = 0.5 if TURN[0] <= time < TURN[1] else 0.0
    return Sticks(roll=roll, pitch=0.4 * expected, throttle=_power(expected, climb), arm=armed)


def _power(expected: float, climb: float) -> float:
    """Throttle that a pilot gives for a climb (m/s), and more or less of it when the bird does not follow."""
    return min(max(0.35 + 0.2 * expected + 0.3 * (expected - climb), 0.0), 1.0)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return simulate(RAVEN, Scenario(seed=1, duration=80.0, pilot=pilot), script=())


@pytest.mark.validate
def test_the_transmitter_arms_it_and_the_throw_is_seen(flight: Flight) -> None:
    assert flight.event_time("mode STABILIZED") < 1.0
    assert flight.event_time("armed") == pytest.approx(ARM_TIME, abs=0.1)
    assert flight.event_time("launched") == pytest.approx(LAUNCH_TIME + 0.4, abs=0.2)
    assert {stick.source for stick in flight.of(topics.PILOT)} == {PilotSource.RECEIVER}
    assert {status.mode for status in flight.of(topics.NAVIGATION)[20:]} == {Mode.STABILIZED}


@pytest.mark.validate
def test_height_is_kept_by_throttle_and_a_turn_is_flown_by_stick(flight: Flight) -> None:
    time, truth = flight.truth["time_us"] * 1e-6, flight.truth
    level = (time > TURN[0] - 4.0) & (time < TURN[1])
    assert np.abs(flight.altitude()[level] - HEIGHT).max() < 4.0
    turning = (time > TURN[0] + 2.0) & (time < TURN[1])
    bank = np.degrees(flight.true_attitude()[0][turning])
    expected = [status.roll_setpoint for status in flight.of(topics.ROLL_LOOP)]
    assert max(expected) > 0.1
    assert bank.mean() == pytest.approx(math.degrees(max(expected)), abs=4.0)
    course = np.unwrap(np.arctan2(truth["v_east"], truth["v_north"]))
    turned = course[np.searchsorted(time, TURN[1])] - course[np.searchsorted(time, TURN[0])]
    assert turned > 1.0


@pytest.mark.validate
def test_it_is_landed_by_stick(flight: Flight) -> None:
    touchdown = flight.touchdown()
    assert 0.0 <= touchdown.sink < 2.0
    assert abs(math.degrees(touchdown.bank)) < 15.0
    assert flight.events()[-1] == "on the ground, disarmed"
    assert flight.of(topics.NAVIGATION)[-1].stage == Stage.LANDED
