"""Position and wind: circles in wind, loss of GPS, wrong fixes, the flat earth."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics.estimation import position
from avionics.estimation.geodesy import to_geodetic, to_local
from avionics.estimation.kalman import filterpy
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


@pytest.mark.parametrize("jump", [0.0, 200.0], ids=["accepted", "after the gate timeout"])
def test_the_filter_is_that_of_filterpy(jump: float) -> None:
    """GIVEN flights with and without a jump of the receiver WHEN it runs THEN it is filterpy's of four states."""
    random, state, dt = np.random.default_rng(3), position.State(), 0.02
    f, b = np.eye(4), np.zeros((4, 2))
    f[0, 2] = f[1, 3] = b[0, 0] = b[1, 1] = dt
    place = max(0.5 * 3.0**2 * GAINS.new_share**2, GAINS.least_position_noise**2)
    r = np.diag([place, place, *2 * [GAINS.gps_velocity_noise**2]])
    inflated = updates = 0
    for tick in range(500):
        yaw, received, before = TURN * tick * dt, None, state
        if tick % 10 == 5:
            north, east = 5.0 * tick * dt + random.normal(0.0, 0.1, 2) + (jump if tick > 200 else 0.0)
            received = fix(20000 * tick, north, east, 9.0 + random.normal(0.0, 0.1), 3.0 + random.normal(0.0, 0.1))
        state, _ = position.step(GAINS, before, position.Motion(20000 * tick, AIRSPEED, yaw, 0.0), received)
        if not before.valid:
            continue
        walk = max(before.walk, GAINS.wind_walk**2) * dt
        q, air = np.diag([*2 * [GAINS.air_velocity_noise**2 * dt], walk, walk]), (math.cos(yaw), math.sin(yaw))
        x, p = np.array(before.x), np.array(before.p)
        x, p = filterpy().predict(x, p, F=f, Q=q, u=AIRSPEED * np.array(air), B=b)
        if received is not None and state.refused_since_us < 0:
            squares = np.square(state.innovation)
            if (squares > GAINS.gate**2 * np.array(state.expected)).any():
                p = p + np.diag(squares)
                inflated += 1
            x, p = filterpy().update(x, p, x + state.innovation, r, H=np.eye(4))
            updates += 1
        np.testing.assert_allclose(state.x, x, rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(state.p, p, rtol=1e-8, atol=1e-12)
    assert updates > 20 and inflated == (jump > 0.0)


def test_dead_reckoning_with_growing_variance() -> None:
    """GIVEN no GPS after 30 s THEN the place is within three sigma 30 s later, and the sigma has grown."""
    flight = Flight(60.0, (1.0, 2.0), lost=30.0)
    variances = [m.position_variance for m in flight.messages[1500:]]
    assert all(later > earlier for earlier, later in itertools.pairwise(variances[10:]))
    assert np.abs(flight.error[-1, :2]).max() < 3.0 * math.sqrt(variances[-1])
    assert np.abs(flight.error[-1, :2]).max() < 20.0


class Gusty:
    """Circles in wind whose gusts, of standard deviation ``gusts`` m/s, last 3 s, with the data sheet's receiver.

    Its slow error (2.1 m, 60 s) is in every fix, 0.2 m are new in each; the velocity's noise is 0.1 m/s. The airspeed
    is wrong by 0.2 m/s for the whole flight, and says so. There is no sideslip, and the filter knows it.
    """

    def __init__(self, seed: int, gusts: float, seconds: float = 30.0) -> None:
        rng = np.random.default_rng(seed)
        state, place = position.State(), np.zeros(2)
        gust, slow = gusts * rng.normal(size=2), 2.1 * rng.normal(size=2)
        wrong, arriving, rows, tests = 0.2 * rng.normal(), [], [], []
        for k in range(round(50 * seconds)):
            yaw = TURN * k / 50.0
            gust += -gust * 0.02 / 3.0 + gusts * math.sqrt(2.0 * 0.02 / 3.0) * rng.normal(size=2)
            wind = np.array([2.0, -1.0]) + gust
            v = AIRSPEED * np.array([math.cos(yaw), math.sin(yaw)]) + wind
            place = place + 0.02 * v
            received = None
            if k % 10 == 0:
                slow += -slow * 0.2 / 60.0 + 2.1 * math.sqrt(2.0 * 0.2 / 60.0) * rng.normal(size=2)
                arriving.append((*(place + slow + rng.normal(0.0, 0.2, 2)), *(v + rng.normal(0.0, 0.1, 2))))
            if k % 10 == 8 and k > 10:
                received = fix(20000 * k, *arriving[-1])
            airspeed = AIRSPEED + wrong + rng.normal(0.0, 0.05)
            motion = position.Motion(20000 * k, airspeed, yaw, 0.0, variance=0.5 * 0.2**2)
            state, m = position.step(GAINS._replace(sideslip=0.0), state, motion, received)
            if k < 500:
                continue
            # Home is where the receiver said; the earth's place is told by latitude and longitude.
            told = to_local(HOME, m.latitude, m.longitude)
            off = np.array([*told, m[3], m[4], m[5], m[6]]) - [*place, *v, *wind]
            sizes = np.repeat([m.position_variance, m.velocity_variance, m.wind_variance], 2)
            rows.append((off**2 / sizes).reshape(3, 2).mean(axis=1))
            if received:
                expected = np.repeat([m.place_innovation_variance, m.velocity_innovation_variance], 2)
                tests.append((np.square(m[12:16]) / expected).reshape(2, 2).mean(axis=1))
        self.errors, self.innovations = np.mean(rows, axis=0), np.mean(tests, axis=0)


@pytest.mark.parametrize(("gusts", "flights"), [(0.1, 6), pytest.param(1.0, 6, marks=pytest.mark.validate)])
def test_variances_of_place_velocity_wind_and_innovations_are_honest(gusts: float, flights: int) -> None:
    """GIVEN calm air or gusts THEN errors and innovations have the size that is told: half or twice would fail."""
    flown = [Gusty(seed, gusts) for seed in range(flights)]
    place, velocity = np.mean([each.innovations for each in flown], axis=0)
    assert 0.35 < place < 1.4
    assert 0.5 < velocity < 1.6
    # The slow error is one draw a flight and axis.
    place, velocity, wind = np.mean([each.errors for each in flown], axis=0)
    assert 0.3 < place < 2.5
    assert 0.3 < velocity < 1.8
    assert 0.4 < wind < 1.8


def test_a_gust_that_lasts_opens_the_gate_and_one_wrong_velocity_does_not() -> None:
    """GIVEN calm air WHEN the wind changes by 4 m/s THEN it is found in a second; one fix alone moves nothing."""
    state = position.State()
    for k in range(1200):
        v = 4.0 if k >= 800 or k == 500 else 0.0
        received = fix(20000 * k, 0.0, 0.0, v, 0.0) if k % 10 == 0 else None
        state, message = position.step(GAINS, state, position.Motion(20000 * k, 0.0, 0.0, 0.0), received)
        if k == 505:
            assert abs(message.wind_north) < 0.1
            assert message.innovation_v_north == pytest.approx(4.0, abs=0.1)
        if k == 860:
            assert message.wind_north == pytest.approx(4.0, abs=0.5)


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
def test_flat_earth_comes_back(latitude: float, longitude: float, north: float, east: float) -> None:
    home = (latitude, longitude)
    assert to_local(home, *to_geodetic(home, north, east)) == pytest.approx((north, east), abs=1e-5)


def test_a_minute_of_latitude_is_a_nautical_mile() -> None:
    north, east = to_local(HOME, HOME[0] + math.radians(1.0 / 60.0), HOME[1])
    assert (north, east) == pytest.approx((1850.0, 0.0), abs=5.0)
