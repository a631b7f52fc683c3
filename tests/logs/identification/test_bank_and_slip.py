"""What a flight does to the sides: read from its log, and what filter error makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, REFERENCE, TRUTH, Flight, fly
from test_identification_report import RecordedTopics, motion_topics

from avionics import topics
from logs.identification.data.flight import FlightData, ImuCalibration
from logs.identification.data.flight_segments import stretches
from logs.identification.data.maneuvers import find_manoeuvres
from logs.identification.estimators.flight.gust_ekf_data import Task, averaged_strokes
from logs.identification.estimators.flight.gusts import NUISANCES, Air, flown, prior, system
from logs.identification.results import Array
from logs.identification.sources.flight import SIDEWAYS_UNKNOWN, flight_data
from wingbeat.constants import STANDARD_GRAVITY

SLIPPING = Flight(seed=3, slip=1.0, doublets=2)
SIDEWAYS = ("roll", "roll_rate", "yaw_rate", "accel_y")


def recorded(flight: FlightData) -> RecordedTopics:
    return RecordedTopics(motion_topics(flight))


def test_a_log_tells_bank_and_slip() -> None:
    """GIVEN gyroscopes with biases that the attitude filter knows, and an accelerometer with scale and offset."""
    flight = fly(SLIPPING)
    source = recorded(flight)
    imu = dict(source.tables[topics.IMU.name])
    imu["accel_y"] = imu["accel_y"] / 1.1 + 0.4
    wrong = RecordedTopics({**source.tables, topics.IMU.name: imu})
    read = flight_data(wrong, ImuCalibration(accel_offset=(0.0, 0.4, 0.0), accel_scale=(1.0, 1.1, 1.0)))
    assert not read.notes
    for name in SIDEWAYS:
        np.testing.assert_allclose(getattr(read, name), getattr(flight, name), atol=1e-9)


def test_where_a_log_does_not_tell_the_slip_nothing_is_made_up() -> None:
    """GIVEN no side force for half of the flight, or none at all THEN it is not known there, and a note says so."""
    source = recorded(fly(SLIPPING))
    imu = dict(source.tables[topics.IMU.name])
    half = len(imu["accel_y"]) // 2
    imu["accel_y"] = np.concatenate((imu["accel_y"][:half], np.full(len(imu["accel_y"]) - half, np.nan)))
    torn = flight_data(RecordedTopics({**source.tables, topics.IMU.name: imu}))
    assert np.isnan(torn.accel_y[half:]).all() and np.isfinite(torn.accel_y[: half - 1]).all()
    assert np.isfinite(torn.yaw_rate).all() and torn.notes == (SIDEWAYS_UNKNOWN,)
    (whole,) = stretches(torn, find_manoeuvres(torn, AIRCRAFT), 0.0)
    known = np.interp(whole.time, torn.time, np.isfinite(torn.accel_y)) > 0.0
    assert np.any(known) and not np.any(whole.sideways[~known, :4])
    del imu["accel_y"]
    untold = flight_data(RecordedTopics({**source.tables, topics.IMU.name: imu}))
    assert np.isnan(untold.accel_y).all() and np.isfinite(untold.roll).all() and untold.notes == (SIDEWAYS_UNKNOWN,)


def turned(data: FlightData, slip: float) -> Array:
    """What bank and slip add to u', w', q' and theta' (K, 4, s), by the filter's inputs and what they do."""
    cut = stretches(data, find_manoeuvres(data, AIRCRAFT), 0.0)
    inputs = averaged_strokes(Task(cut, REFERENCE, AIRCRAFT, tuple(TRUTH)), None).inputs
    nuisances = prior(REFERENCE, AIRCRAFT, Air(True, True))
    nuisances[NUISANCES.index("slip")] = np.log(slip)
    model = flown(tuple(TRUTH), REFERENCE, AIRCRAFT, Air(True, True))
    found = system(model, np.array(list(TRUTH.values()))[:, None], nuisances[:, None])
    np.testing.assert_array_equal(found.d[:, 3:], 0.0)
    return np.einsum("ij,kjs->kis", found.b[:, 3:, 0], inputs[:, 3:])


def test_bank_and_slip_turn_the_motion_as_the_kinematics_say() -> None:
    """GIVEN a steady bank, rates and side force THEN r v, -p v, gravity's share and the turn are added, no moment."""
    data, slip = fly(Flight(seed=3, doublets=2)), 0.6
    steady = dict(zip(SIDEWAYS, (0.3, 0.5, -0.4, 2.0), strict=True))
    banked = data._replace(**{name: np.full(len(data.time), value) for name, value in steady.items()})
    roll, p, r, v = 0.3, 0.5, -0.4, -2.0 * slip
    found = turned(banked, slip)
    np.testing.assert_allclose(found[:, 0], r * v)
    gravity = STANDARD_GRAVITY * np.cos(REFERENCE.pitch) * (np.cos(roll) - 1.0)
    np.testing.assert_allclose(found[:, 1], -p * v + gravity)
    np.testing.assert_array_equal(found[:, 2], 0.0)
    (stretch,) = stretches(banked, find_manoeuvres(banked, AIRCRAFT), 0.0)
    q = np.interp(stretch.edges[:-1], data.time, data.pitch_rate)
    np.testing.assert_allclose(found[:, 3, 0], q * (np.cos(roll) - 1.0) - r * np.sin(roll), atol=1e-9)


def test_left_is_as_right() -> None:
    data = fly(SLIPPING)
    mirrored = data._replace(**{name: -getattr(data, name) for name in SIDEWAYS})
    found = turned(data, 0.6)
    assert np.std(found[:, 1]) > 0.5
    assert found == pytest.approx(turned(mirrored, 0.6))
