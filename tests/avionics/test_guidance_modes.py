"""Modes, arming, stages and failsafes on scripted conditions."""

import math

import pytest
from surrogate_gains import VEHICLE

from avionics.guidance import arming, failsafes, modes, supervisor
from avionics.messages import Failsafe, Mode, Stage
from wingbeat.message import Severity

GAINS = VEHICLE.gains.modes
DT = 0.02
READY = modes.Conditions(
    forward_force=1.5,
    airspeed=0.5,
    altitude=0.0,
    climb_rate=0.0,
    roll=0.0,
    pitch=0.15,
    ground_speed=0.0,
    home_distance=0.0,
    fix_age=0.1,
    battery=1.0,
    settled=1,
    imu_fault=0,
    items=3,
    throttle_stick=0.0,
    requested_stage=Stage.EN_ROUTE,
)
CRUISE = READY._replace(airspeed=7.5, ground_speed=7.5, altitude=40.0, climb_rate=0.1, home_distance=100.0)
FLYING = modes.State(mode=Mode.AUTO, stage=Stage.EN_ROUTE, armed=1)


def run(state: modes.State, observed: modes.Conditions, seconds: float):
    said: list[modes.Notice] = []
    for _ in range(max(1, round(seconds / DT))):
        state, notices = supervisor.step(GAINS, state, DT, observed)
        said += notices
    return state, said


@pytest.mark.parametrize(
    ("observed", "mode", "reason"),
    [
        (READY._replace(settled=0), Mode.AUTO, "attitude"),
        (READY._replace(imu_fault=1), Mode.MANUAL, "IMU"),
        (READY._replace(pitch=1.4), Mode.AUTO, "tilt too large"),
        (READY._replace(battery=0.1), Mode.MANUAL, "battery 10 %"),
        (READY._replace(items=0), Mode.AUTO, "no mission"),
        (READY._replace(fix_age=math.inf), Mode.AUTO, "no GPS"),
        (READY._replace(throttle_stick=0.5), Mode.MANUAL, "throttle stick"),
        (READY, Mode.LAND, "mode LAND: select another mode"),
    ],
)
def test_arming_is_refused_with_its_reason(observed: modes.Conditions, mode: Mode, reason: str) -> None:
    state, notices = arming.arm(GAINS, modes.State(mode=mode), observed)
    assert state.armed == 0
    assert reason in notices[0].text
    assert notices[0].severity == Severity.WARNING


def test_several_reasons_are_all_said() -> None:
    _, notices = arming.arm(GAINS, modes.State(), READY._replace(settled=0, pitch=2.0))
    assert "attitude" in notices[0].text
    assert "tilt too large" in notices[0].text


def test_armed_waits_for_the_launch() -> None:
    state, notices = arming.arm(GAINS, modes.State(mode=Mode.AUTO), READY)
    assert (state.armed, state.stage, notices[0].text) == (1, Stage.WAIT_LAUNCH, "armed")
    state, _ = run(state, READY, 10.0)
    assert state.stage == Stage.WAIT_LAUNCH


DOWN = READY._replace(requested_stage=Stage.FLARE)


def test_touchdown_disarms_after_its_time() -> None:
    flare = FLYING._replace(stage=Stage.FLARE)
    state, _ = run(flare, DOWN, GAINS.touchdown_time - 2 * DT)
    assert state.armed == 1
    state, said = run(state, DOWN, 4 * DT)
    assert (state.stage, state.armed) == (Stage.LANDED, 0)
    assert said[-1].text == "touchdown, disarmed"


def test_a_headwind_on_the_ground_still_is_a_touchdown() -> None:
    state, _ = run(FLYING._replace(stage=Stage.FLARE), DOWN._replace(airspeed=5.0), GAINS.touchdown_time + 0.1)
    assert state.stage == Stage.LANDED


@pytest.mark.parametrize(
    "moving",
    [DOWN._replace(airspeed=6.0, ground_speed=6.0), DOWN._replace(climb_rate=-1.5)],
)
def test_a_landing_bird_in_the_air_is_not_down(moving: modes.Conditions) -> None:
    state, _ = run(FLYING._replace(stage=Stage.FLARE), moving, 20.0)
    assert state.armed == 1


def test_a_crash_is_seen_later_and_said_louder() -> None:
    state, _ = run(FLYING, READY, GAINS.touchdown_time + 0.5)
    assert state.armed == 1
    state, said = run(state, READY, GAINS.crash_time)
    assert (state.stage, said[-1].severity) == (Stage.LANDED, Severity.CRITICAL)


def test_hovering_against_the_wind_en_route_is_no_crash() -> None:
    state, _ = run(FLYING, CRUISE._replace(ground_speed=0.2), 30.0)
    assert state.armed == 1


def test_disarming_in_the_air_needs_force() -> None:
    state, notices = arming.disarm(FLYING, forced=False)
    assert (state.armed, "in flight" in notices[0].text) == (1, True)
    state, _ = arming.disarm(FLYING, forced=True)
    assert (state.armed, state.stage) == (0, Stage.LANDED)
    state, _ = arming.disarm(modes.State(armed=1, stage=Stage.WAIT_LAUNCH), forced=False)
    assert (state.armed, state.stage) == (0, Stage.ON_GROUND)


@pytest.mark.parametrize(
    ("mode", "observed", "state", "reason"),
    [
        (Mode.AUTO, READY._replace(items=0), FLYING._replace(mode=Mode.MANUAL), "no mission"),
        (Mode.RETURN, CRUISE._replace(fix_age=9.0), FLYING, "no GPS"),
        (Mode.LAND, READY, FLYING._replace(stage=Stage.WAIT_LAUNCH), "not in flight"),
    ],
)
def test_a_mode_is_refused_with_its_reason(mode, observed, state, reason) -> None:
    after, notices = modes.set_mode(GAINS, state, mode, observed)
    assert after == state
    assert reason in notices[0].text


def test_a_pilot_can_break_off_a_landing() -> None:
    state, _ = modes.set_mode(GAINS, FLYING._replace(stage=Stage.FLARE), Mode.ALTITUDE_HOLD, CRUISE)
    assert (state.mode, state.stage) == (Mode.ALTITUDE_HOLD, Stage.EN_ROUTE)


def test_the_stage_follows_the_navigation() -> None:
    state, said = run(FLYING, CRUISE._replace(requested_stage=Stage.APPROACH), 0.1)
    assert (state.stage, [notice.text for notice in said]) == (Stage.APPROACH, ["stage approach"])


def test_link_loss_returns_after_its_delay_once() -> None:
    state, _ = failsafes.set_link(FLYING, lost=True)
    state, _ = run(state, CRUISE, GAINS.link_loss_delay - 0.1)
    assert state.mode == Mode.AUTO
    state, said = run(state, CRUISE, 0.2)
    assert (state.mode, state.failsafe) == (Mode.RETURN, Failsafe.LINK_LOST)
    assert any(notice.severity == Severity.CRITICAL for notice in said)
    state, _ = modes.set_mode(GAINS, state, Mode.AUTO, CRUISE)
    state, _ = run(state, CRUISE, 10.0)
    assert state.mode == Mode.AUTO


def test_a_link_that_comes_back_in_time_changes_nothing() -> None:
    state, _ = failsafes.set_link(FLYING, lost=True)
    state, _ = run(state, CRUISE, GAINS.link_loss_delay - 1.0)
    state, _ = failsafes.set_link(state, lost=False)
    state, said = run(state, CRUISE, 10.0)
    assert (state.mode, state.failsafe, said) == (Mode.AUTO, 0, [])


def test_link_loss_on_the_hand_only_is_said() -> None:
    state, _ = failsafes.set_link(modes.State(mode=Mode.AUTO, stage=Stage.WAIT_LAUNCH, armed=1), lost=True)
    state, _ = run(state, READY, GAINS.link_loss_delay + 1.0)
    assert (state.mode, state.failsafe) == (Mode.AUTO, Failsafe.LINK_LOST)


@pytest.mark.parametrize(
    ("observed", "flag"),
    [
        (CRUISE._replace(battery=GAINS.battery_return - 0.01), Failsafe.BATTERY_LOW),
        (CRUISE._replace(home_distance=GAINS.fence_radius + 1.0), Failsafe.FENCE),
        (CRUISE._replace(altitude=GAINS.fence_altitude + 1.0), Failsafe.FENCE),
    ],
)
def test_battery_and_fence_return(observed: modes.Conditions, flag: Failsafe) -> None:
    state, _ = run(FLYING, observed, 0.1)
    assert (state.mode, state.failsafe) == (Mode.RETURN, flag)


def test_an_empty_battery_and_a_lost_position_land() -> None:
    state, _ = run(FLYING, CRUISE._replace(battery=GAINS.battery_land - 0.01), 0.1)
    assert state.mode == Mode.LAND
    lost = CRUISE._replace(fix_age=GAINS.gps_loss_delay + GAINS.gps_land_delay + 1.0)
    state, _ = run(FLYING, lost, 0.1)
    assert state.mode == Mode.LAND


def test_a_lost_position_keeps_the_mode_and_hinders_a_return() -> None:
    blind = CRUISE._replace(fix_age=GAINS.gps_loss_delay + 1.0, battery=GAINS.battery_return - 0.01)
    state, _ = run(FLYING, blind, 1.0)
    assert state.mode == Mode.AUTO
    assert state.failsafe == Failsafe.GPS_LOST | Failsafe.BATTERY_LOW
    state, _ = run(state, blind._replace(fix_age=0.1), 0.1)
    assert state.mode == Mode.RETURN


LINKLESS = FLYING._replace(link_lost=1, link_time=2.0 * GAINS.link_loss_delay)
BLIND = CRUISE._replace(fix_age=GAINS.gps_loss_delay + 1.0, pilot_lost=1)
NO_STICKS = CRUISE._replace(pilot_lost=1, sensed=int(Failsafe.RECEIVER_LOST))


def test_a_link_lost_on_the_hand_hinders_arming_and_is_answered_above_the_floor() -> None:
    grounded, _ = run(LINKLESS._replace(armed=0, stage=Stage.ON_GROUND), READY, 1.0)
    _, notices = arming.arm(GAINS, grounded, READY)
    assert notices[0].text == "arming denied: ground link lost"
    low = CRUISE._replace(altitude=2.0, return_floor=15.0, requested_stage=Stage.CLIMB_OUT)
    state, _ = run(LINKLESS._replace(stage=Stage.CLIMB_OUT), low, 5.0)
    assert (state.mode, state.stage) == (Mode.AUTO, Stage.CLIMB_OUT)
    landing, _ = run(state, low._replace(battery=0.01), 0.1)
    assert landing.mode == Mode.LAND
    state, _ = run(state, low._replace(altitude=16.0), 0.1)
    assert (state.mode, state.rescued) == (Mode.RETURN, 1)


def test_a_second_stop_of_the_flapping_lands_again() -> None:
    state, _ = run(FLYING, CRUISE._replace(sensed=int(Failsafe.WING_JAMMED)), 0.1)
    state, _ = modes.set_mode(GAINS, state, Mode.STABILIZED, CRUISE)
    state, said = run(state, CRUISE._replace(sensed=int(Failsafe.WING_JAMMED), imu_fault=1), 0.1)
    assert (state.mode, state.cut) == (Mode.LAND, 1)
    assert "failsafe: flapping stopped, IMU samples rejected" in [notice.text for notice in said]


@pytest.mark.parametrize(
    "failing", [CRUISE._replace(battery=0.01), CRUISE._replace(sensed=int(Failsafe.WING_JAMMED))]
)
@pytest.mark.parametrize("then", [NO_STICKS, CRUISE._replace(fence_clearance=-1.0)])
def test_who_was_to_land_does_nothing_else_by_itself(failing, then) -> None:
    state, _ = run(FLYING, failing, 0.1)
    state, _ = modes.set_mode(GAINS, state, Mode.STABILIZED, CRUISE)
    state, _ = run(state, then._replace(battery=failing.battery, sensed=then.sensed | failing.sensed), 0.1)
    assert state.mode == Mode.LAND


def test_only_the_line_down_keeps_a_return_from_being_flown() -> None:
    approach = CRUISE._replace(requested_stage=Stage.APPROACH, battery=GAINS.battery_return - 0.01)
    state, _ = run(FLYING._replace(stage=Stage.APPROACH), approach, 0.1)
    assert state.mode == Mode.RETURN
    state, _ = run(FLYING._replace(stage=Stage.APPROACH), approach._replace(final=1), 0.1)
    assert state.mode == Mode.AUTO


@pytest.mark.parametrize(
    ("mode", "observed"),
    [
        (Mode.STABILIZED, BLIND),
        (Mode.ALTITUDE_HOLD, BLIND._replace(battery=GAINS.battery_return - 0.01)),
        (Mode.ALTITUDE_HOLD, BLIND._replace(battery=GAINS.battery_return - 0.01, fix_age=math.inf)),
    ],
)
def test_a_return_without_a_position_becomes_a_landing(mode: Mode, observed: modes.Conditions) -> None:
    state, _ = run(FLYING._replace(mode=mode), observed, GAINS.gps_land_delay - 1.0)
    assert state.mode == Mode.ALTITUDE_HOLD
    state, _ = run(state, observed, 2.0)
    assert state.mode == Mode.LAND
    flown, _ = run(FLYING._replace(mode=mode), observed._replace(pilot_lost=0), GAINS.gps_land_delay + 10.0)
    assert flown.mode == mode


def test_a_mode_chosen_without_sticks_is_not_left_for_them_later() -> None:
    state, _ = run(FLYING._replace(mode=Mode.STABILIZED), NO_STICKS, 1.0)
    assert (state.mode, state.rescued) == (Mode.LOITER, 1)
    for mode in (Mode.AUTO, Mode.LOITER):
        state, _ = modes.set_mode(GAINS, state, mode, NO_STICKS)
        state, _ = run(state, NO_STICKS, 60.0)
        assert (state.mode, state.rescued) == (mode, 0)


def test_a_battery_about_its_threshold_takes_the_mission_away_once() -> None:
    low, high = (CRUISE._replace(battery=GAINS.battery_return + by) for by in (-0.001, 0.001))
    state, _ = run(FLYING, low, 0.1)
    state, _ = modes.set_mode(GAINS, state, Mode.AUTO, CRUISE)
    for observed in (high, low, high, low):
        state, said = run(state, observed, 0.5)
        assert (state.mode, said) == (Mode.AUTO, [])
    state, said = run(state, CRUISE._replace(battery=GAINS.battery_return + 0.051), 0.1)
    assert [notice.text for notice in said] == ["failsafe cleared: battery low"]


def test_a_pilot_on_the_receiver_does_not_miss_the_ground_link() -> None:
    state, _ = run(LINKLESS._replace(mode=Mode.STABILIZED), CRUISE._replace(by_receiver=1), 10.0)
    assert state.mode == Mode.STABILIZED
    state, _ = run(LINKLESS._replace(mode=Mode.STABILIZED), CRUISE, 1.0)
    assert state.mode == Mode.RETURN
    state, _ = run(LINKLESS, CRUISE._replace(by_receiver=1), 1.0)
    assert state.mode == Mode.RETURN


def test_a_dead_pitot_without_a_fix_is_no_crash_in_the_air() -> None:
    feigned = CRUISE._replace(airspeed=0.0, fix_age=20.0, return_floor=15.0)
    state, _ = run(FLYING._replace(mode=Mode.ALTITUDE_HOLD), feigned, GAINS.crash_time + 10.0)
    assert state.armed == 1
    down, _ = run(FLYING._replace(mode=Mode.ALTITUDE_HOLD), feigned._replace(altitude=1.0), GAINS.crash_time + 0.5)
    assert down.armed == 0


def test_the_stage_of_the_mode_before_is_not_taken() -> None:
    stale = CRUISE._replace(requested_stage=Stage.CLIMB_OUT, navigated=int(Mode.AUTO))
    state, said = run(FLYING._replace(mode=Mode.RETURN), stale, 0.1)
    assert (state.stage, said) == (Stage.EN_ROUTE, [])


def test_no_first_fix_is_no_failure_by_hand() -> None:
    state, said = run(modes.State(), READY._replace(fix_age=math.inf), 10.0)
    assert (state.failsafe, said) == (0, [])


@pytest.mark.parametrize("failure", failsafes.FAILURES, ids=lambda failure: failure.flag.name)
def test_each_failure_is_said_once_answered_once_and_said_to_be_over(failure: failsafes.Failure) -> None:
    state, said = run(FLYING, CRUISE._replace(sensed=int(failure.flag)), 5.0)
    texts = [notice.text for notice in said]
    assert texts.count(f"failsafe: {failure.text}") == 1
    mode = {failsafes.Action.CARRY_ON: Mode.AUTO, failsafes.Action.RETURN: Mode.RETURN}.get(failure.action, Mode.LAND)
    assert (state.mode, state.cut) == (mode, int(failure.action == failsafes.Action.CUT))
    assert sum(notice.severity == Severity.CRITICAL and "failsafe: " in notice.text for notice in said) <= 2
    state, said = run(state, CRUISE, failure.clear + 0.1)
    assert [notice.text for notice in said] == [f"failsafe cleared: {failure.text}"]
    assert (state.failsafe, state.pending) == (0, ())


def test_a_failure_that_flickers_is_said_once() -> None:
    fence, state, said = CRUISE._replace(altitude=GAINS.fence_altitude + 1.0), FLYING, []
    for _ in range(20):
        for observed in (fence, CRUISE):
            state, notices = run(state, observed, 0.5)
            said += notices
    assert [notice.text for notice in said if notice.text.endswith("outside the fence")] == [
        "failsafe: outside the fence",
        "failsafe: returning, outside the fence",
    ]


def test_the_gravest_of_several_failures_is_answered() -> None:
    both = int(Failsafe.WING_JAMMED | Failsafe.TAIL_JAMMED | Failsafe.BATTERY_LOW)
    state, said = run(FLYING, CRUISE._replace(sensed=both), 1.0)
    assert (state.mode, state.cut) == (Mode.LAND, 1)
    assert "failsafe: flapping stopped, wing jammed" in [notice.text for notice in said]


def test_on_the_ground_a_failure_is_said_and_hinders_arming() -> None:
    bad = READY._replace(sensed=int(Failsafe.MAG_DISTURBED), unready=("no encoder samples",))
    state, said = run(modes.State(mode=Mode.AUTO), bad, 1.0)
    assert (state.mode, [notice.text for notice in said]) == (Mode.AUTO, ["failsafe: magnetic field disturbed"])
    state, notices = arming.arm(GAINS, state, bad)
    assert state.armed == 0
    assert "magnetic field disturbed; no encoder samples" in notices[0].text


def test_turning_the_vehicle_hinders_arming() -> None:
    state, notices = arming.arm(GAINS, modes.State(), READY._replace(turn_rate=GAINS.arm_turn + 0.1))
    assert (state.armed, "vehicle is turning" in notices[0].text) == (0, True)
