"""Position and wind: circles in wind, loss of GPS, wrong fixes, the flat earth."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.estimation import position
from avionics.estimation.geodesy import to_geodetic, to_local
from avionics.messages import GpsFix, Position

GAINS = position.Gains()
HOME = (math.radians(38.99), math.radians(-76.94))
AIRSPEED = 8.0
TURN = 0.2
DELAY = 0.15


def fix(time_us: int, north: float, east: float, v_north: float = 0.0, v_east: float = 0.0, kind: int = 3) -> GpsFix:
    latitude, longitude = to_geodetic(HOME, north, east)
    return GpsFix(time_us, latitude, longitude, 0.0, v_north, v_east, 0.0, 3.0, 4.0, kind, 8)


def truth(t: float, wind: tuple[float, float]) -> tuple[float, float, float, float, float]:
    """North, east, ground velocity and heading of a circle flown through the air."""
    yaw = TURN * t
    north = AIRSPEED / TURN * math.sin(yaw) + wind[0] * t
    east = AIRSPEED / TURN * (1.0 - math.cos(yaw)) + wind[1] * t
    return north, east, AIRSPEED * math.cos(yaw) + wind[0], AIRSPEED * math.sin(yaw) + wind[1], yaw


class Flight:
    """Circles in a steady wind, GPS at 5 Hz with noise and delay, lost from ``lost`` s on."""

    def __init__(self, seconds: float, wind: tuple[float, float], lost: float = math.inf, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        state = position.State()
        self.messages: list[Position] = []
        self.truth: list[tuple[float, float, float, float, float]] = []
        for k in range(round(50 * seconds)):
            t = k / 50.0
            true = truth(t, wind)
            received = None
            if k % 10 == 0 and t < lost:
                old = truth(max(0.0, t - DELAY), wind)
                noise = rng.normal(0.0, (1.0, 1.0, 0.1, 0.1))
                received = fix(20000 * k, *(o + n for o, n in zip(old[:4], noise, strict=True)))
            airspeed = AIRSPEED + rng.normal(0.0, 0.2)
            motion = position.Motion(20000 * k, airspeed, true[4], 0.0)
            state, message = position.step(GAINS, state, motion, received)
            self.messages.append(message)
            self.truth.append(true)
        self.state = state
        estimate = np.array([m[1:5] for m in self.messages])
        self.error = estimate - np.array(self.truth)[:, :4]


def test_position_velocity_and_wind_in_circles() -> None:
    """GIVEN 3 m/s of wind WHEN flying circles THEN place, ground velocity and wind are found."""
    flight = Flight(60.0, (2.0, -2.0))
    last = flight.messages[-1]
    assert (last.wind_north, last.wind_east) == pytest.approx((2.0, -2.0), abs=0.4)
    home_error = flight.error[0, :2]
    settled = flight.error[500:]
    assert np.sqrt(np.mean((settled[:, :2] - home_error) ** 2)) < 2.0
    assert np.sqrt(np.mean(settled[:, 2:] ** 2)) < 0.4
    assert last.valid == 1


def test_dead_reckoning_with_growing_variance() -> None:
    """GIVEN no GPS after 30 s THEN the place is within three sigma 30 s later, and the sigma has grown."""
    flight = Flight(60.0, (1.0, 2.0), lost=30.0)
    variances = [m.position_variance for m in flight.messages[1500:]]
    assert all(later > earlier for earlier, later in itertools.pairwise(variances[10:]))
    assert np.abs(flight.error[-1, :2]).max() < 3.0 * math.sqrt(variances[-1])
    assert np.abs(flight.error[-1, :2]).max() < 20.0


def test_variance_covers_the_error() -> None:
    squares, variances = [], []
    for seed in range(6):
        flight = Flight(40.0, (1.0, 0.0), seed=seed)
        squares.append(np.mean(flight.error[500:, :2] ** 2))
        variances.append(flight.messages[-1].position_variance)
    assert 0.05 < np.mean(squares) / np.mean(variances) < 1.5


def test_no_fix_is_not_valid() -> None:
    state = position.State()
    for k in range(100):
        state, message = position.step(GAINS, state, position.Motion(20000 * k, 8.0, 0.0, 0.0))
    assert (message.valid, message.latitude, message.longitude) == (0, 0.0, 0.0)
    assert message.v_north == pytest.approx(8.0)


def test_home_needs_three_dimensions() -> None:
    motion = position.Motion(20000, 0.0, 0.0, 0.0)
    state, message = position.step(GAINS, position.State(), motion, fix(20000, 5.0, 5.0, kind=2))
    assert message.valid == 0
    state, message = position.step(GAINS, state, motion._replace(time_us=40000), fix(40000, 5.0, 5.0))
    assert message.valid == 1
    assert (message.north, message.east) == pytest.approx((0.0, 0.0), abs=0.01)
    assert (message.latitude, message.longitude) == pytest.approx(to_geodetic(HOME, 5.0, 5.0), abs=1e-9)


def test_wrong_fixes_are_refused_until_they_last() -> None:
    state = position.State()
    for k in range(600):
        off = 200.0 if k >= 300 else 0.0
        received = fix(20000 * k, off, 0.0) if k % 10 == 0 else None
        state, message = position.step(GAINS, state, position.Motion(20000 * k, 0.0, 0.0, 0.0), received)
        if k == 400:
            assert abs(message.north) < 1.0
    assert message.north == pytest.approx(200.0, abs=3.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_fix_that_is_not_finite_is_passed_over(bad: float) -> None:
    motion = position.Motion(0, 0.0, 0.0, 0.0)
    _, message = position.step(GAINS, position.State(), motion, fix(0, 0.0, 0.0)._replace(v_north=bad))
    assert message.valid == 0
    assert all(math.isfinite(value) for value in message)


def test_same_fix_counts_once() -> None:
    motion = position.Motion(0, 0.0, 0.0, 0.0)
    one = fix(0, 0.0, 0.0)
    state, _ = position.step(GAINS, position.State(), motion, one)
    again, _ = position.step(GAINS, state, motion, one)
    assert again == state


def test_state_survives_json() -> None:
    state = Flight(3.0, (1.0, 1.0)).state
    plain = json.loads(json.dumps(state))
    assert tuple(plain[1]) == state.x
    assert tuple(tuple(row) for row in plain[2]) == state.p


@given(
    latitude=st.floats(-1.4, 1.4),
    longitude=st.floats(-3.14, 3.14),
    north=st.floats(-5000.0, 5000.0),
    east=st.floats(-5000.0, 5000.0),
)
@settings(max_examples=200, deadline=None)
def test_flat_earth_comes_back(latitude: float, longitude: float, north: float, east: float) -> None:
    home = (latitude, longitude)
    assert to_local(home, *to_geodetic(home, north, east)) == pytest.approx((north, east), abs=1e-5)


def test_a_minute_of_latitude_is_a_nautical_mile() -> None:
    north, east = to_local(HOME, HOME[0] + math.radians(1.0 / 60.0), HOME[1])
    assert (north, east) == pytest.approx((1850.0, 0.0), abs=5.0)
