"""The checks of pitot, wings, tail and battery on scripted signals."""

import math
from random import Random

import pytest
from surrogate_gains import VEHICLE

from avionics.messages import Failsafe
from avionics.sensing import airspeed_check, power, tail_check, wing_check
from avionics.sensing.airspeed_check import Motion
from avionics.situation import sensed
from avionics.state import initial_state

DT = 0.02
PITOT = VEHICLE.gains.airspeed_check
WINGS = VEHICLE.gains.wing_check
TAIL = VEHICLE.gains.tail_check
POWER = VEHICLE.gains.power


def fly(state: airspeed_check.State, airspeed: float, motion: Motion | None, seconds: float):
    used = airspeed
    for _ in range(round(seconds / DT)):
        state, used = airspeed_check.step(PITOT, state, DT, airspeed, motion, airborne=True)
    return state, used


@pytest.mark.parametrize("wind", [(0.0, 0.0), (3.0, 0.0), (0.0, -3.0)])
def test_a_blocked_pitot_is_replaced_by_what_ground_velocity_and_wind_make(wind: tuple[float, float]) -> None:
    yaw = 0.7
    motion = Motion(7.0 * math.cos(yaw) + wind[0], 7.0 * math.sin(yaw) + wind[1], yaw)
    state, used = fly(airspeed_check.State(), 7.0, motion, 20.0)
    assert (state.blocked, used) == (0, 7.0)
    state, used = fly(state, 0.0, motion, PITOT.standstill_time + 2 * DT)
    assert state.blocked
    assert used == pytest.approx(7.0, abs=0.05)
    turned = Motion(7.0 * math.cos(-2.0) + wind[0], 7.0 * math.sin(-2.0) + wind[1], -2.0)
    _, used = fly(state, 0.0, turned, 1.0)
    assert used == pytest.approx(7.0, abs=0.05)
    state, used = fly(state, 7.0, motion, PITOT.recovery_time + 2 * DT)
    assert (state.blocked, used) == (0, 7.0)


def test_a_pitot_that_sticks_at_a_speed_is_found_by_its_difference() -> None:
    state, _ = fly(airspeed_check.State(), 7.0, Motion(7.0, 0.0, 0.0), 20.0)
    state, _ = fly(state, 8.0 + PITOT.difference, Motion(7.0, 0.0, 0.0), PITOT.difference_time + 2 * DT)
    assert state.blocked


def test_a_pitot_is_doubted_before_it_is_called_blocked_and_while_it_is() -> None:
    motion = Motion(7.0, 0.0, 0.0)
    good, _ = fly(airspeed_check.State(), 7.0, motion, 20.0)
    assert not airspeed_check.is_inconsistent(good)
    for wrong in (0.0, 8.0 + PITOT.difference):
        doubted, _ = fly(good, wrong, motion, 2 * DT)
        assert airspeed_check.is_inconsistent(doubted) and not doubted.blocked
        blocked, _ = fly(doubted, wrong, motion, PITOT.difference_time)
        assert airspeed_check.is_inconsistent(blocked) and blocked.blocked
    # One sigma of moderate gusts: what ground velocity and remembered wind do not know.
    assert 2.0 < math.sqrt(airspeed_check.variance(PITOT)) < 3.5


def test_a_gust_and_standing_still_on_the_ground_are_no_blocked_pitot() -> None:
    state, _ = fly(airspeed_check.State(), 7.0, Motion(7.0, 0.0, 0.0), 20.0)
    state, _ = fly(state, 8.0 + PITOT.difference, Motion(7.0, 0.0, 0.0), PITOT.difference_time - 0.2)
    state, _ = fly(state, 7.0, Motion(7.0, 0.0, 0.0), 1.0)
    state, _ = fly(state, 0.0, Motion(0.1, 0.0, 0.0), 10.0)
    assert not state.blocked
    for _ in range(200):
        state, _ = airspeed_check.step(PITOT, state, DT, 0.0, Motion(7.0, 0.0, 0.0), airborne=False)
    assert not state.blocked


def learned(wind: float) -> airspeed_check.State:
    """20 s northward at 7 m/s through the air against ``wind`` m/s (negative: before it)."""
    return fly(airspeed_check.State(), 7.0, Motion(7.0 - wind, 0.0, 0.0), 20.0)[0]


@pytest.mark.parametrize("wind", [0.0, 6.0, 8.0, -5.0])
def test_a_blocked_pitot_is_found_and_stays_found_in_any_wind(wind: float) -> None:
    motion = Motion(7.0 - wind, 0.0, 0.0)
    state, used = fly(learned(wind), 0.0, motion, PITOT.standstill_time + 2 * DT)
    assert state.blocked
    assert used == pytest.approx(7.0, abs=0.05)
    for _ in range(20):
        state, _ = fly(state, 0.0, motion, 1.0)
        assert state.blocked


def test_what_the_wind_blows_along_the_ground_has_a_good_pitot() -> None:
    state, _ = fly(learned(-5.0), 0.5, Motion(5.0, 0.0, 0.0), 10.0)
    assert not state.blocked


def test_agreement_that_comes_and_goes_is_not_believed() -> None:
    motion = Motion(7.0, 0.0, 0.0)
    state, _ = fly(learned(0.0), 0.0, motion, 1.0)
    for _ in range(10):
        state, _ = fly(state, 7.0 + 0.6 * PITOT.difference, motion, 0.5)
        state, _ = fly(state, 7.0, motion, PITOT.recovery_time - 0.5)
        assert state.blocked
    state, used = fly(state, 7.0 + 0.4 * PITOT.difference, motion, PITOT.recovery_time + 2 * DT)
    assert (state.blocked, used) == (0, 7.0 + 0.4 * PITOT.difference)


def test_moderate_gusts_are_no_blocked_pitot_and_one_that_is_blocked_in_them_is_found() -> None:
    """Airspeed off the expected one as measured in 4 m/s with moderate Dryden gusts: 1.8 m/s RMS, slow and quick."""
    random, gust, state, motion = Random(4), 0.0, learned(4.0), Motion(3.0, 0.0, 0.0)
    time, length = 0.0, 3.0
    while time < 600.0:
        gust += -gust * DT / length + 1.8 * math.sqrt(2.0 * DT / length) * random.gauss(0.0, 1.0)
        state, _ = airspeed_check.step(PITOT, state, DT, max(7.0 + gust, 0.0), motion, airborne=True)
        time += DT
        assert not state.blocked
    state, _ = fly(state, 0.0, motion, PITOT.standstill_time + 2 * DT)
    assert state.blocked


def test_without_fixes_a_blocked_pitot_gives_the_cruise() -> None:
    state = airspeed_check.State(blocked=1)
    assert airspeed_check.step(PITOT, state, DT, 0.0, None, airborne=True)[1] == PITOT.cruise
    assert airspeed_check.step(PITOT, airspeed_check.State(), DT, 5.0, None, airborne=True)[1] == 5.0


def test_without_fixes_a_standstill_on_beating_wings_is_a_blocked_pitot() -> None:
    def stationary(aloft: airspeed_check.Aloft, seconds: float) -> tuple[airspeed_check.State, float]:
        state, used = learned(0.0), 0.0
        for _ in range(round(seconds / DT)):
            state, used = airspeed_check.step(PITOT, state, DT, 0.3, None, aloft)
        return state, used

    state, used = stationary(airspeed_check.Aloft.HIGH, PITOT.standstill_time + 2 * DT)
    assert (state.blocked, used) == (1, PITOT.cruise)
    state, used = stationary(airspeed_check.Aloft.HIGH, PITOT.standstill_time - 2 * DT)
    assert (state.blocked, used) == (0, 0.3)
    state, used = stationary(airspeed_check.Aloft.LOW, 30.0)
    assert (state.blocked, used) == (0, 0.3), "it may have touched down"


@pytest.mark.parametrize("disturbed", [0, 1])
def test_the_attitude_alone_tells_a_disturbed_field(disturbed: int) -> None:
    state = initial_state(VEHICLE.gains, ())
    state.attitude = state.attitude._replace(magnetometer_disturbed=disturbed)
    assert sensed(state) == disturbed * Failsafe.MAG_DISTURBED


BEATING = wing_check.CheckInputs(4.0, -4.0, 2.4, 0.02, 1)


def watch(state: wing_check.State, inputs: wing_check.CheckInputs, seconds: float) -> wing_check.State:
    for _ in range(round(seconds / DT)):
        state = wing_check.step(WINGS, state, DT, inputs)
    return state


@pytest.mark.parametrize(("stationary", "flag"), [({"rate_left": 0.0}, 1), ({"rate_right": 0.0}, 2)])
def test_a_wing_that_stands_still_alone_has_a_dead_encoder(stationary: dict[str, float], flag: int) -> None:
    state = watch(wing_check.State(), BEATING, 5.0)
    assert (state.lost, state.jammed) == (0, 0)
    state = watch(state, BEATING._replace(valid=3 - flag, **stationary), 3.0)
    assert (state.lost, state.jammed) == (flag, 0)
    state = watch(state, BEATING, 0.5)
    assert (state.lost, state.jammed) == (0, 0)


@pytest.mark.parametrize("sign", [{"current": 5.0}, {"roll_rate": -3.0}])
def test_a_wing_that_stands_still_and_is_pulled_at_or_rocks_the_body_is_jammed(sign: dict[str, float]) -> None:
    state = watch(wing_check.State(), BEATING, 5.0)
    state = watch(state, BEATING._replace(rate_left=0.0, valid=wing_check.RIGHT, **sign), 1.5)
    assert (state.lost, state.jammed) == (0, wing_check.LEFT)


@pytest.mark.parametrize(("stationary", "flag"), [({"rate_left": 0.0}, 1), ({"rate_right": 0.0}, 2)])
def test_a_wing_that_jams_after_its_encoder_died_is_told_by_the_rocking(
    stationary: dict[str, float], flag: int
) -> None:
    dead = BEATING._replace(valid=3 - flag, **stationary)
    state = watch(watch(wing_check.State(), BEATING, 5.0), dead, 3.0)
    gust = watch(state, dead._replace(roll_rate=3.0), 0.5 * WINGS.fault_confirmation_time)
    assert watch(gust, dead, 5.0).jammed == 0
    assert watch(state, dead._replace(current=4.5), 10.0).jammed == 0, "a climb"
    jammed = watch(state, dead._replace(roll_rate=3.0, current=3.0), WINGS.fault_confirmation_time + 0.5)
    assert jammed.jammed == flag


@pytest.mark.parametrize(("encoder", "flag"), [({"rate_left": 0.0}, 1), ({"rate_right": 0.0}, 2)])
def test_encoder_lost_before_the_first_stroke_is_no_jam(encoder: dict[str, float], flag: int) -> None:
    """GIVEN no usual current WHEN a climb draws a strong one THEN one wing is not jammed, two are."""
    climb = BEATING._replace(current=5.0, valid=3 - flag, **encoder)
    state = watch(wing_check.State(), climb, 10.0)
    assert (state.lost, state.jammed) == (flag, 0)
    both = watch(wing_check.State(), climb._replace(rate_left=0.0, rate_right=0.0, valid=0), 1.5)
    assert both.jammed == 3


def test_wings_that_were_not_told_to_flap_may_rest() -> None:
    state = watch(wing_check.State(), wing_check.CheckInputs(0.0, 0.0, 9.0, 3.0, 0), 10.0)
    assert (state.lost, state.jammed) == (0, 0)


def pitching(
    seconds: float, effect: float, elevator=lambda t: 0.15 * math.sin(5.0 * t), gust: float = 0.0, error: float = 0.1
) -> tail_check.State:
    """Pitch of a tail with ``effect`` (rad/m^2) at 7 m/s in gusts (rad/s^2, RMS); the check after so many seconds."""
    noise, state, rate, push = Random(1), tail_check.State(), 0.0, 0.0
    for i in range(round(seconds / DT)):
        push += (gust * math.sqrt(2.0 * DT / 0.3) * noise.gauss(0.0, 1.0)) - push * DT / 0.3
        rate += (effect * 49.0 * elevator(i * DT) - TAIL.damping * rate + push) * DT
        state = tail_check.step(
            TAIL, state, DT, tail_check.CheckInputs(error, elevator(i * DT), rate, 7.0), closed=True
        )
    return state


@pytest.mark.parametrize(
    ("share", "gust", "jammed"),
    [(2.0, 3.0, 0), (2.0, 0.0, 0), (0.8, 0.0, 0), (0.2, 0.0, 1), (0.2, 3.0, 1), (0.0, 0.0, 1), (0.0, 3.0, 1)],
)
def test_tail_check_detects_elevator_below_half_effect(share: float, gust: float, jammed: int) -> None:
    assert pitching(60.0, share * TAIL.effect, gust=gust).jammed == jammed


def test_tail_check_after_jam_detects_within_two_seconds() -> None:
    """GIVEN a tail that worked for 20 s WHEN it jams THEN what came before does not delay the test."""
    state, rate = tail_check.State(), 0.0
    for i in range(round(22.0 / DT)):
        elevator = 0.15 * math.sin(5.0 * i * DT)
        rate += (TAIL.effect * 49.0 * (elevator if i * DT < 20.0 else 0.0) - TAIL.damping * rate) * DT
        state = tail_check.step(TAIL, state, DT, tail_check.CheckInputs(0.1, elevator, rate, 7.0), closed=True)
        assert not state.jammed or i * DT > 20.0
    assert state.jammed


def test_tail_check_needs_elevator_motion_error_and_grace() -> None:
    assert not pitching(60.0, 0.0, lambda t: 0.3, gust=3.0, error=0.5).jammed
    assert not pitching(60.0, 0.0, error=0.5 * TAIL.error).jammed
    assert not pitching(TAIL.grace - DT, 0.0).jammed
    opened = tail_check.step(TAIL, pitching(20.0, 0.0), DT, tail_check.CheckInputs(0.0, 0.0, 0.0, 7.0), closed=False)
    assert opened == tail_check.State(jammed=1)


@pytest.mark.parametrize("current", [0.0, 3.0])
def test_the_voltage_alone_tells_a_failing_battery_within_seconds(current: float) -> None:
    empty, full = POWER.open_circuit
    sag, low, state = POWER.resistance * current, empty + 0.1 * (full - empty), power.Battery()
    for i in range(5000):
        state = power.watched(POWER, state, i * power.BATTERY_US, 0.0, (full if i < 4800 else low) - sag, current)
    assert state.by_voltage == pytest.approx(0.1, abs=0.03)
    assert state.remaining > state.by_voltage
