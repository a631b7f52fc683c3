"""Altitude, climb and heading loops, and the excitation: signs, limits, anti-windup, freezing, envelope."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics.guidance import altitude, excitation, heading
from avionics.guidance.mission import Channel, Excitation, Shape

ALTITUDE = altitude.Gains(
    proportional=0.5,
    climb_max=1.5,
    sink_max=1.0,
    climb_rate_limit=2.0,
    throttle_trim=0.5,
    throttle_climb=0.1,
    throttle_error=0.1,
    throttle_integral=0.05,
    integral_max=0.2,
    throttle_min=0.2,
    throttle_max=1.0,
    throttle_rate=2.0,
    pitch_trim=0.3,
    pitch_climb=0.05,
    pitch_error=0.0,
    pitch_min=0.0,
    pitch_max=0.6,
    pitch_rate=0.5,
    airspeed_min=5.0,
    airspeed_pitch=0.1,
    headwind=4.0,
    headwind_pitch=0.02,
    headwind_pitch_max=0.06,
    trim_time=1.0,
)
HEADING = heading.Gains(
    proportional=0.8, integral=0.05, integral_max=0.1, roll_max=0.5, roll_rate=1.0, course_speed=2.0
)
EXCITE = excitation.Gains(
    recovery=0.5,
    spread=0.25,
    fade=1.0,
    pitch_max=0.4,
    roll_max=0.8,
    airspeed_min=4.0,
    airspeed_max=12.0,
    altitude_max=8.0,
    altitude_floor=10.0,
)
DT = 0.02


def level(alt: float = 40.0, climb: float = 0.0, airspeed: float = 7.5) -> altitude.Measured:
    return altitude.Measured(alt, climb, airspeed)


def fly(setpoint: float, measured: altitude.Measured, seconds: float, state: altitude.State | None = None):
    state = state or altitude.initial(ALTITUDE, ALTITUDE.throttle_trim)
    for _ in range(round(seconds / DT)):
        state, status = altitude.step(ALTITUDE, state, 0, DT, setpoint, measured)
    return state, status


def test_too_low_means_more_flapping_and_nose_up() -> None:
    _, low = fly(42.0, level(), 1.0)
    _, high = fly(38.0, level(), 1.0)
    assert low.altitude_error == 2.0
    assert low.throttle > ALTITUDE.throttle_trim > high.throttle
    assert low.pitch_setpoint > ALTITUDE.pitch_trim > high.pitch_setpoint


def test_level_at_the_setpoint_keeps_the_trim() -> None:
    _, status = fly(40.0, level(), 5.0)
    assert (status.throttle, status.pitch_setpoint) == (ALTITUDE.throttle_trim, ALTITUDE.pitch_trim)


def test_a_gust_down_lifts_the_nose_by_the_climb_error() -> None:
    gains = ALTITUDE._replace(pitch_error=0.1, pitch_rate=10.0)
    sinking = level(climb=-1.0)
    _, status = altitude.step(gains, altitude.initial(gains, gains.throttle_trim), 0, 0.5, 40.0, sinking)
    assert status.climb_error == 1.0
    assert status.pitch_setpoint == pytest.approx(gains.pitch_trim + 0.1)


@given(setpoint=st.floats(-100, 200), climb=st.floats(-5, 5), airspeed=st.floats(0, 15))
def test_altitude_loop_respects_its_limits(setpoint: float, climb: float, airspeed: float) -> None:
    _, status = fly(setpoint, level(climb=climb, airspeed=airspeed), 3.0)
    assert -ALTITUDE.sink_max <= status.climb_setpoint <= ALTITUDE.climb_max
    assert ALTITUDE.throttle_min <= status.throttle <= ALTITUDE.throttle_max
    assert ALTITUDE.pitch_min - 1e-12 <= status.pitch_setpoint <= ALTITUDE.pitch_max + 1e-12
    assert abs(status.integral) <= ALTITUDE.integral_max


def test_setpoints_and_throttle_move_at_their_rates() -> None:
    state = altitude.initial(ALTITUDE, 0.0)
    state, status = altitude.step(ALTITUDE, state, 0, DT, 100.0, level())
    assert status.climb_setpoint == pytest.approx(ALTITUDE.climb_rate_limit * DT)
    assert status.throttle == pytest.approx(ALTITUDE.throttle_rate * DT)


def test_throttle_integral_rests_at_the_limit() -> None:
    state, status = fly(100.0, level(climb=-3.0), 20.0)
    assert status.saturated == 0 or status.integral < ALTITUDE.integral_max
    strong = ALTITUDE._replace(throttle_error=0.5)
    state = altitude.initial(strong, 0.5)
    for _ in range(500):
        state, status = altitude.step(strong, state, 0, DT, 100.0, level(climb=-3.0))
    assert status.saturated == 1
    assert state.integral == 0.0


def test_slow_flight_lowers_the_nose() -> None:
    _, slow = fly(40.0, level(airspeed=3.0), 5.0)
    assert slow.pitch_setpoint == pytest.approx(ALTITUDE.pitch_trim - 0.2)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_thrust_is_given_up_on_the_side_and_nowhere_else(side: float) -> None:
    assert altitude.righting(ALTITUDE, side * altitude.STEEP) == ALTITUDE
    banks = np.linspace(altitude.STEEP, 3.1, 50)
    most = [altitude.righting(ALTITUDE, side * bank).throttle_max for bank in banks]
    assert np.all(np.diff(most) <= 0.0)
    assert all(value == ALTITUDE.throttle_min for value in most[int(np.argmax(banks >= altitude.STEEPEST)) :])
    given_up = altitude.righting(ALTITUDE, side * 1.2)
    state = altitude.initial(given_up, 0.5)
    for _ in range(100):
        state, status = altitude.step(given_up, state, 0, DT, 60.0, level(climb=-4.0))
    assert status.throttle == pytest.approx(ALTITUDE.throttle_min)
    assert state.integral <= 0.0, "nothing is stored for the moment it is level again"


def test_only_a_strong_headwind_lowers_the_trim_pitch_and_not_without_end() -> None:
    for wind in (-9.0, 0.0, ALTITUDE.headwind):
        assert altitude.penetrating(ALTITUDE, wind) == ALTITUDE
    faster = altitude.penetrating(ALTITUDE, ALTITUDE.headwind + 2.0)
    assert faster.pitch_trim == pytest.approx(ALTITUDE.pitch_trim - 2.0 * ALTITUDE.headwind_pitch)
    fastest = altitude.penetrating(ALTITUDE, 50.0)
    assert fastest.pitch_trim == ALTITUDE.pitch_trim - ALTITUDE.headwind_pitch_max


def test_calm_gains_leave_the_pitch_at_its_trim_and_move_the_throttle_half_as_far() -> None:
    gusty = ALTITUDE._replace(pitch_error=0.08)
    calm = altitude.calm(gusty)
    settled = altitude.initial(ALTITUDE, ALTITUDE.throttle_trim)
    for measured in (level(39.0), level(41.0), level(40.0, climb=-0.5), level(40.0, climb=0.5)):
        states = [settled, settled]
        for _ in range(25):
            states = [
                altitude.step(gains, state, 0, DT, 40.0, measured)[0]
                for gains, state in zip((gusty, calm), states, strict=True)
            ]
        quick, slow = states
        assert slow.pitch_setpoint == ALTITUDE.pitch_trim
        assert quick.pitch_setpoint != ALTITUDE.pitch_trim
        moved, less = (state.throttle - ALTITUDE.throttle_trim for state in (quick, slow))
        assert 0.0 < less / moved <= altitude.CALM_SHARE
    at_trim, status = altitude.step(calm, settled, 0, DT, 40.0, level())
    assert (at_trim.throttle, status.pitch_setpoint) == (ALTITUDE.throttle_trim, ALTITUDE.pitch_trim)


def test_calm_gains_keep_every_limit_and_hold_an_altitude() -> None:
    """A bird whose climb follows the throttle within half a second comes to its altitude and stays."""
    calm = altitude.calm(ALTITUDE)
    assert {name for name in calm._fields if getattr(calm, name) != getattr(ALTITUDE, name)} <= {
        "proportional", "throttle_climb", "throttle_error", "throttle_integral", "pitch_climb", "pitch_error",
    }  # fmt: skip
    state, height, climb = altitude.initial(ALTITUDE, ALTITUDE.throttle_trim), 38.0, 0.0
    for _ in range(round(60.0 / DT)):
        state, _ = altitude.step(calm, state, 0, DT, 40.0, level(height, climb))
        climb += (5.0 * (state.throttle - ALTITUDE.throttle_trim - 0.02) - climb) * DT / 0.5
        height += climb * DT
    assert height == pytest.approx(40.0, abs=0.1)
    assert climb == pytest.approx(0.0, abs=0.02)


def test_frozen_altitude_loop_holds_the_mean_throttle_and_goes_on_without_a_jump() -> None:
    state, _ = fly(41.0, level(), 10.0)
    held, status = altitude.hold_trim(state, 0, 41.0, level(45.0, 2.0))
    assert status.throttle == state.throttle_mean
    assert held.integral == state.integral
    _, resumed = altitude.step(ALTITUDE, held, 0, DT, 41.0, level())
    assert abs(resumed.throttle - status.throttle) <= ALTITUDE.throttle_rate * DT + 1e-12


def moving(course: float, speed: float = 7.5, yaw: float | None = None, valid: int = 1) -> heading.Measured:
    return heading.Measured(course if yaw is None else yaw, speed * math.cos(course), speed * math.sin(course), valid)


@given(course=st.floats(-math.pi, math.pi), error=st.floats(0.01, 3.0))
def test_heading_loop_banks_toward_the_shorter_side(course: float, error: float) -> None:
    _, right = heading.step(HEADING, heading.State(), 0, DT, course + error, moving(course))
    _, left = heading.step(HEADING, heading.State(), 0, DT, course - error, moving(course))
    assert right.roll_setpoint > 0.0 > left.roll_setpoint


def test_heading_bank_is_limited_and_its_integral_rests() -> None:
    state = heading.State()
    for _ in range(500):
        state, status = heading.step(HEADING, state, 0, DT, 2.5, moving(0.0))
    assert status.roll_setpoint == HEADING.roll_max
    assert (status.saturated, state.integral) == (1, 0.0)


@pytest.mark.parametrize(("speed", "valid"), [(1.0, 1), (7.5, 0)])
def test_yaw_is_steered_while_slow_or_without_a_position(speed: float, valid: int) -> None:
    assert heading.course(HEADING, moving(1.0, speed, yaw=-0.5, valid=valid)) == -0.5
    assert heading.course(HEADING, moving(1.0, yaw=-0.5)) == pytest.approx(1.0)


DOUBLET = Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.1, 0.2, 0.5, 2)
FLOWN = excitation.EnvelopeState(0.3, 0.0, 7.5, 40.0)


def excite(requested: Excitation, seconds: float, envelope: excitation.EnvelopeState = FLOWN, dt: float = 0.01):
    state, statuses = excitation.start(excitation.State(), requested), []
    for i in range(round(seconds / dt)):
        state, status = excitation.step(EXCITE, state, round(i * dt * 1e6), dt, True, envelope)
        statuses.append(status)
    return state, statuses


@pytest.mark.parametrize("width", [0.1, 0.13, 0.2, 0.4])
def test_doublet_has_no_mean_and_its_width(width: float) -> None:
    _, statuses = excite(DOUBLET._replace(width=width), 10.0)
    up = sum(status.elevator > 0 for status in statuses)
    down = sum(status.elevator < 0 for status in statuses)
    assert up == down == 2 * round(width / 0.01)
    assert {status.elevator for status in statuses} == {0.1, 0.0, -0.1}


def test_3211_steps() -> None:
    shape = DOUBLET._replace(shape=Shape.MULTISTEP_3211, repeats=1, channel=Channel.RUDDER)
    _, statuses = excite(shape, 6.0)
    signs = [status.rudder for status in statuses if status.rudder]
    expected = [0.1] * 60 + [-0.1] * 40 + [0.1] * 20 + [-0.1] * 20
    assert signs == expected
    assert all(status.elevator == 0.0 for status in statuses)


def test_a_manoeuvre_is_frozen_before_and_after_and_counted() -> None:
    state, statuses = excite(DOUBLET, 10.0)
    assert state.finished == 1
    assert max(status.manoeuvre for status in statuses) == 2
    for number in (1, 2):
        active = [s for s in statuses if s.active and s.manoeuvre == number]
        first = next(i for i, s in enumerate(active) if s.elevator)
        last = max(i for i, s in enumerate(active) if s.elevator)
        assert first >= 50
        assert len(active) - last - 1 >= 49
    assert any(not s.active for s in statuses if s.manoeuvre == 1)


def test_starts_are_spread_over_the_stroke() -> None:
    _, statuses = excite(DOUBLET._replace(repeats=8), 30.0)
    starts = [b.time_us for a, b in itertools.pairwise(statuses) if b.elevator > 0 >= a.elevator]
    phases = sorted(start * 1e-6 * 4.0 % 1.0 for start in starts)
    assert len(starts) == 8
    assert max(b - a for a, b in zip(phases, [*phases[1:], phases[0] + 1.0], strict=True)) < 0.5


@pytest.mark.parametrize(
    "outside",
    [
        FLOWN._replace(pitch=0.9),
        FLOWN._replace(roll=-1.0),
        FLOWN._replace(airspeed=3.0),
        FLOWN._replace(airspeed=13.0),
        FLOWN._replace(altitude=31.0),
        FLOWN._replace(altitude=49.0),
    ],
)
def test_leaving_the_envelope_aborts_and_releases(outside: excitation.EnvelopeState) -> None:
    state, _ = excite(DOUBLET, 1.5)
    assert excitation.frozen(state)
    state, status = excitation.step(EXCITE, state, 0, 0.01, True, outside)
    assert (status.aborted, status.active, status.elevator) == (1, 0, 0.0)
    assert state.finished == 1
    state, status = excitation.step(EXCITE, state, 0, 0.01, True, FLOWN)
    assert status.active == 0


def test_an_excitation_that_is_no_longer_asked_for_stops() -> None:
    state, _ = excite(DOUBLET, 1.5)
    state, status = excitation.step(EXCITE, state, 0, 0.01, False, FLOWN)
    assert (status.active, state.finished, status.aborted) == (0, 1, 0)


def test_before_the_wind_the_same_turn_of_the_course_takes_more_bank() -> None:
    banks = []
    for measured in (moving(0.0), moving(0.0, 10.5)._replace(drift=1.4)):
        state = heading.State()
        for _ in range(200):
            state, status = heading.step(HEADING, state, 0, 0.02, 0.2, measured)
        banks.append(status.roll_setpoint - state.integral)
    assert banks[1] == pytest.approx(1.4 * banks[0])


def test_the_bank_of_a_circle_is_flown_without_an_error() -> None:
    state = heading.State()
    for _ in range(200):
        state, status = heading.step(HEADING, state, 0, 0.02, 0.0, moving(0.0)._replace(bank=-0.2))
    assert (status.heading_error, status.roll_setpoint) == (0.0, pytest.approx(-0.2))
