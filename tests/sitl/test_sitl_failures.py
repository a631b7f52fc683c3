"""Flights on which something fails: wind, the link, the GPS, the IMU."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fault_study import THERE_AND_BACK
from promises import LEVEL, PHASES, PROMISES, Promise, table
from simulate import ARIZONA, RAVEN, Flight, Underway, differing, rms, simulate

import avionics
from avionics import topics
from avionics.guidance.mission import Fence, ItemKind, MissionItem, Zone
from avionics.messages import Breach, Command, CommandKind, Mode, SensorFrame, Stage
from sim_bridge import topics as truth_topics
from sim_bridge.flight.faults import FAULTS, Fault, Place, parse_fault
from sim_bridge.flight.world import Scenario
from sim_bridge.observation import Observation
from sim_bridge.sensors.receiver import Sticks

STRAIGHT = (
    MissionItem(ItemKind.TAKEOFF, altitude=15.0),
    MissionItem(ItemKind.HOLD, altitude=15.0, heading=0.0, duration=600.0),
)
FAILS_AT = PHASES[LEVEL]
FLIGHT = Scenario(seed=1, vibration=1.0)
"""with the vibration of the vehicle file, as `wingbeat fly`"""
LOW_HOLD = (
    MissionItem(ItemKind.TAKEOFF, altitude=15.0),
    MissionItem(ItemKind.HOLD, altitude=15.0, heading=0.5, duration=60.0),
)


def check_upright(flight: Flight, bank: float = 45.0) -> None:
    """In the air to the end, within a bank in deg."""
    launch, end = flight.air_time()
    time = flight.truth["time_us"] * 1e-6
    assert end == time[-1], f"on the ground at {end} s"
    inside = time >= launch
    assert np.degrees(np.abs(flight.true_attitude()[0][inside])).max() < bank
    assert flight.altitude()[inside].min() > -1.5


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
def test_in_a_wind_of_three_metres_a_second_altitude_and_course_are_held(vehicle: str) -> None:
    flight = simulate(vehicle, FLIGHT._replace(wind_speed=3.0, wind_from=1.2, duration=40.0), LOW_HOLD)
    check_upright(flight)
    altitude_hold = flight.altitude_hold()
    assert altitude_hold.duration > 10.0
    assert altitude_hold.altitude_rms < 1.0
    assert math.degrees(altitude_hold.course_rms) < 5.0


@pytest.mark.validate
def test_the_wind_is_estimated() -> None:
    flight = simulate(RAVEN, FLIGHT._replace(wind_speed=3.0, wind_from=0.0, duration=35.0), LOW_HOLD)
    position, truth = flight.columns(topics.POSITION), flight.truth
    last = position["time_us"] > 30_000_000
    for axis in ("north", "east"):
        assert np.abs(position[f"wind_{axis}"][last].mean() - truth[f"wind_{axis}"][-1]) < 1.0


def without_gps(since_us: int) -> Callable[[SensorFrame], SensorFrame]:
    return lambda frame: frame._replace(gps=None) if frame.time_us >= since_us else frame


@pytest.mark.validate
def test_without_gps_it_flies_on_by_compass_and_says_so() -> None:
    flight = simulate(RAVEN, FLIGHT._replace(duration=42.0), LOW_HOLD, alter=without_gps(14_000_000))
    check_upright(flight)
    assert flight.event_time("failsafe: GPS position lost") == pytest.approx(16.0, abs=0.3)
    last = flight.of(topics.NAVIGATION)[-1]
    assert (last.mode, last.stage) == (Mode.AUTO, Stage.EN_ROUTE)
    late = flight.truth["time_us"] > 34_000_000
    assert rms(15.0 - flight.altitude()[late]) < 1.0
    yaw_error = np.unwrap(flight.true_attitude()[2])[late] - LOW_HOLD[1].heading
    assert math.degrees(rms(yaw_error)) < 10.0


IMPOSSIBLE = (math.nan, math.inf, -math.inf, 1e9)
FIELDS = ("accel_x", "accel_z", "gyro_y", "gyro_x", "mag_z")


def broken_imu(frame: SensorFrame) -> SensorFrame:
    """From 12 s on, every fifth sample cannot be: another field and another value each time."""
    number = (frame.time_us - 12_000_000) // 5_000
    if number < 0 or number % 5:
        return frame
    field, value = FIELDS[number // 5 % len(FIELDS)], IMPOSSIBLE[number // 5 % len(IMPOSSIBLE)]
    return frame._replace(imu=frame.imu._replace(**{field: value}))


def test_imu_samples_that_cannot_be_are_refused_counted_and_flown_through() -> None:
    flight = simulate(RAVEN, FLIGHT._replace(duration=22.0), alter=broken_imu)
    check_upright(flight)
    given = flight.columns(topics.IMU)
    numbers = np.stack([given[name] for name in FIELDS])
    impossible = ~(np.abs(numbers) < 1e6).all(axis=0)
    health = flight.of(topics.HEALTH)[-1]
    assert health.rejected_samples == impossible[given["time_us"] <= health.time_us].sum() > 350
    assert any(text.startswith("IMU sample rejected") for text in flight.events())
    assert health.failsafe == 0
    roll, pitch = flight.attitude_error()
    assert max(math.degrees(roll), math.degrees(pitch)) < 3.0
    for topic in (topics.ATTITUDE, topics.ALTITUDE, topics.POSITION, topics.ACTUATORS):
        assert all(math.isfinite(sum(message)) for message in flight.of(topic))


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
def test_after_a_lost_link_it_comes_home_circles_and_lands(vehicle: str) -> None:
    lost = Command(20_000_000, CommandKind.LINK_LOST, source="test")
    flight = simulate(vehicle, FLIGHT._replace(duration=300.0), commands=[lost])
    touchdown = flight.touchdown()
    assert 0.0 < touchdown.sink < 2.0
    assert abs(math.degrees(touchdown.bank)) < 30.0
    assert flight.events()[-1] == "touchdown, disarmed"
    assert np.hypot(flight.truth["north"][-1], flight.truth["east"][-1]) < 400.0


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
def test_after_a_minute_without_gps_it_has_landed(vehicle: str) -> None:
    flight = simulate(vehicle, FLIGHT._replace(duration=200.0), alter=without_gps(20_000_000))
    assert flight.event_time("failsafe: landing, no position") == pytest.approx(52.0, abs=0.5)
    assert abs(math.degrees(flight.touchdown().bank)) < 30.0
    assert flight.of(topics.NAVIGATION)[-1].armed == 0


def safety_pilot(observed: Observation) -> Sticks:
    """Has opened the throttle by the time that somebody may want him to take over."""
    return Sticks(throttle=0.0 if observed.time_us < 20_000_000 else 0.5)


@functools.cache
def underway(vehicle: str, vibration: float = 1.0) -> Underway:
    """The flight up to the failure, which all share."""
    scenario = FLIGHT._replace(duration=FAILS_AT + 120.0, pilot=safety_pilot, vibration=vibration)
    flight = Underway(vehicle, scenario, STRAIGHT)
    flight.until(FAILS_AT - 0.1)
    return flight


def failed(vehicle: str, name: str, phase: str = LEVEL, vibration: float = 1.0) -> Flight:
    at = PHASES[phase]
    if phase == LEVEL:
        branch = underway(vehicle, vibration).branch(parse_fault(f"{name}@{at}"))
    else:
        scenario = FLIGHT._replace(duration=at + 120.0, faults=(parse_fault(f"{name}@{at}"),), vibration=vibration)
        branch = Underway(vehicle, scenario, STRAIGHT)
    branch.until(at + PROMISES[name].follow_time)
    return branch.flight()


def check_event_once(flight: Flight, promise: Promise, at: float = FAILS_AT) -> float:
    """When the words were said (s): within their time, and once."""
    said = [event.time_us * 1e-6 for event in flight.of(topics.EVENTS) if event.text.startswith(promise.reports)]
    assert len(said) == 1, f"{promise.reports!r} among {flight.events()}"
    assert at - 0.02 <= said[0] <= at + promise.within
    return said[0]


def check_flight(flight: Flight, promise: Promise, at: float = FAILS_AT) -> None:
    """Bank, altitude and touchdown as they were, from the failure on."""
    time, (_, end) = flight.truth["time_us"] * 1e-6, flight.air_time()
    inside = (time >= at) & (time <= end)
    assert np.degrees(np.abs(flight.true_attitude()[0][inside])).max() < promise.bank
    if promise.altitude is not None:
        assert end == time[-1], f"on the ground at {end} s"
        change = flight.altitude()[inside] - flight.altitude()[inside][0]
        low, high = promise.altitude
        assert low < change.min()
        assert change.max() < high
    if promise.touchdown:
        touchdown = flight.touchdown()
        assert abs(math.degrees(touchdown.bank)) < 30.0
        assert touchdown.sink < 2.0


def check_stopped(flight: Flight, since: float) -> None:
    """The wings rest from a second after that time (s) on."""
    wing = flight.columns(truth_topics.WING)
    late = wing["time_us"] > (since + 1.0) * 1e6
    for side in ("left", "right"):
        # What moves still is the spring of the drives under the air's load.
        assert np.ptp(wing[f"angle_{side}"][late]) < 0.35
        assert np.abs(wing[f"rate_{side}"][late]).mean() < 0.3


ALWAYS = {"imu_frozen", "battery_critical", "tail_jammed", "wing_left_jammed"}
IN_FLIGHT = [name for name, kind in FAULTS.items() if name != "sim_silent" and not kind.needs]


def test_every_fault_has_its_promise_and_the_readme_tells_it() -> None:
    assert sorted(PROMISES) == sorted(name for name, kind in FAULTS.items() if not kind.needs)
    reference = Path(avionics.__file__).parents[1] / "docs" / "reference" / "avionics.md"
    assert "\n".join(table()) in reference.read_text(encoding="utf-8")


def in_time(name: str) -> Any:
    """Those whose answers differ are flown always, the others by `make validate`."""
    return name if name in ALWAYS else pytest.param(name, marks=pytest.mark.validate)


@pytest.mark.parametrize("name", [in_time(name) for name in IN_FLIGHT])
def test_what_is_promised_for_a_failure_is_kept(name: str) -> None:
    flight, promise = failed(RAVEN, name), PROMISES[name]
    since = check_event_once(flight, promise)
    if FAULTS[name].place is not Place.FLIGHT:
        assert [event.text for event in flight.of(truth_topics.EVENTS)] == [f"fault {name}: {FAULTS[name].text}"]
    check_flight(flight, promise)
    if promise.stops:
        check_stopped(flight, since)


OTHER_PHASES = [(name, phase) for name, promise in PROMISES.items() for phase in promise.phases if phase != LEVEL]


@pytest.mark.validate
@pytest.mark.parametrize(("name", "phase"), OTHER_PHASES)
def test_promise_holds_in_other_phases(name: str, phase: str) -> None:
    flight, promise, at = failed(RAVEN, name, phase), PROMISES[name], PHASES[phase]
    check_event_once(flight, promise, at)
    check_flight(flight, promise, at)


def soft_landings_with_a_jammed_tail(vehicle: str, seed: int, times: tuple[float, ...]) -> int:
    """Number of soft landings in 3 m/s of wind with light gusts; the tail jams ``times`` (s) after the launch."""
    air = FLIGHT._replace(wind_speed=3.0, wind_from=math.radians(57.0), turbulence="small_uav_light")
    gusty = Underway(vehicle, air._replace(seed=seed, duration=600.0), THERE_AND_BACK)
    while not gusty.world.launched:
        gusty.until(gusty.world.time_us * 1e-6 + 0.1)
    launched, soft = gusty.world.time_us * 1e-6, 0
    for after in times:
        gusty.until(launched + after - 0.1)
        branch = gusty.branch(Fault("tail_jammed", launched + after))
        while not branch.world.finished and branch.log.messages[topics.NAVIGATION.name][-1].stage != Stage.LANDED:
            branch.until(branch.world.time_us * 1e-6 + 1.0)
        branch.until(branch.world.time_us * 1e-6 + 5.0)  # against the wind it may find itself at rest before contact
        touchdown = branch.flight().touchdown()
        soft += touchdown.sink < 2.0 and abs(math.degrees(touchdown.bank)) < 30.0
    return soft


@pytest.mark.validate
def test_tail_jammed_in_gusts_lands_softly() -> None:
    """GIVEN a jam in a turn 9 s after the launch THEN the wings keep the Robo Raven upright."""
    assert soft_landings_with_a_jammed_tail(RAVEN, 2, (9.0,)) == 1


@pytest.mark.validate
def test_tail_jammed_in_gusts_lands_softly_in_nine_of_ten() -> None:
    """Robo Raven only: with one motor for both wings nothing rolls the Arizona against its rudder."""
    times = tuple(float(after) for after in range(6, 14))
    soft = sum(soft_landings_with_a_jammed_tail(RAVEN, seed, times) for seed in (1, 2))
    assert soft >= 0.9 * 2 * len(times)


@pytest.mark.validate
def test_encoder_lost_in_the_hand_does_not_stop_the_flight() -> None:
    """GIVEN an encoder that fails before the throw WHEN it climbs THEN the wing is not taken for jammed."""
    scenario = FLIGHT._replace(duration=30.0, faults=(parse_fault("encoder_left_lost@3"),))
    flight = simulate(RAVEN, scenario, STRAIGHT)
    check_upright(flight)
    assert flight.altitude()[-1] == pytest.approx(15.0, abs=2.0)
    flight.event_time("failsafe: left wing encoder lost")


def test_with_a_frozen_imu_the_altitude_is_the_barometers() -> None:
    """The last acceleration before it, of somewhere in a stroke, told 400 m of a bird at 29 m."""
    flight = failed(RAVEN, "imu_frozen")
    told = flight.columns(topics.ALTITUDE)
    in_the_air = told["time_us"] < flight.air_time()[1] * 1e6
    true = np.interp(told["time_us"], flight.truth["time_us"], flight.altitude())
    assert np.abs(told["altitude"] - true)[in_the_air].max() < 2.0
    assert "failsafe: barometer rejected" not in flight.events()


OWN_PHYSICS = ["imu_frozen", "imu_saturated", "battery_critical", "tail_jammed", "wing_left_jammed"]
EQUAL_WINGS = {"tail_jammed"}
"""flown without vibration: nothing but the rudder rolls unequal wings, see docs/validation/faults.md"""


@pytest.mark.validate
@pytest.mark.parametrize("name", OWN_PHYSICS)
def test_what_is_promised_holds_with_a_crank_too(name: str) -> None:
    flight, promise = failed(ARIZONA, name, vibration=float(name not in EQUAL_WINGS)), PROMISES[name]
    since = check_event_once(flight, promise)
    if promise.stops:  # with both wings where the crank stopped, nothing is promised of the glide
        check_stopped(flight, since)
    else:
        check_flight(flight, promise)


def test_a_receiver_lost_in_a_flight_by_stick_brings_it_home() -> None:
    taken_over = Command(round(FAILS_AT * 1e6), CommandKind.SET_MODE, name="STABILIZED", source="test")
    branch = underway(RAVEN).branch(parse_fault(f"receiver_lost@{FAILS_AT + 1.0}"), [taken_over])
    branch.until(FAILS_AT + 9.0)
    flight = branch.flight()
    check_flight(flight, PROMISES["link_lost"])
    assert flight.event_time("failsafe: receiver lost") == pytest.approx(FAILS_AT + 1.5, abs=0.2)
    assert flight.event_time("failsafe: LOITER, manual control lost") == pytest.approx(FAILS_AT + 1.5, abs=0.2)
    returning = flight.event_time("failsafe: returning, manual control lost")
    assert returning == pytest.approx(FAILS_AT + 6.5, abs=0.3)
    before = flight.columns(topics.PILOT)
    assert before["throttle"][-1] == pytest.approx(0.5, abs=0.05)
    assert before["time_us"][-1] <= (FAILS_AT + 1.0) * 1e6


def test_a_lost_link_brings_it_home() -> None:
    lost = Command(round(FAILS_AT * 1e6), CommandKind.LINK_LOST, source="test")
    branch = underway(RAVEN).branch(None, [lost])
    branch.until(FAILS_AT + 16.0)  # before it circles above home
    flight = branch.flight()
    check_upright(flight)
    assert flight.event_time("failsafe: returning, ground link lost") == pytest.approx(FAILS_AT + 5.0, abs=0.1)
    assert flight.of(topics.NAVIGATION)[-1].mode == Mode.RETURN
    truth = flight.truth
    distance = np.hypot(truth["north"], truth["east"])
    velocity = truth["v_north"][-1], truth["v_east"][-1]
    homeward = -(truth["north"][-1] * velocity[0] + truth["east"][-1] * velocity[1]) / distance[-1]
    assert distance[-1] < distance.max() - 15.0
    assert homeward > 3.0


def test_outside_the_fence_it_turns_home() -> None:
    home = Zone(keep_in=1, places=((0.0, 0.0),), radius=130.0)
    fenced = Command(round(FAILS_AT * 1e6), CommandKind.SET_FENCE, payload=Fence((home,)), source="test")
    branch = underway(RAVEN).branch(None, [fenced])
    branch.until(FAILS_AT + 14.0)
    flight = branch.flight()
    check_upright(flight)
    said = flight.event_time("failsafe: returning, outside the fence")
    truth = flight.truth
    distance, time = np.hypot(truth["north"], truth["east"]), truth["time_us"] * 1e-6
    assert np.interp(said, time, distance) == pytest.approx(130.0, abs=5.0)
    assert distance.max() < 150.0
    assert distance[-1] < 125.0
    told = flight.of(topics.FENCE)[-1]
    assert (told.breaches, told.kind, told.since) == (1, Breach.BORDER, pytest.approx(said, abs=0.05))


@pytest.mark.validate
def test_a_copied_flight_is_the_flight() -> None:
    one = underway(RAVEN)
    twin, other = (one.branch(parse_fault(f"gps_lost@{FAILS_AT + 1.0}")) for _ in range(2))
    twin.until(FAILS_AT + 2.0)
    other.until(FAILS_AT + 2.0)
    assert differing(twin.log, other.log) == []
    assert len(one.log.messages[topics.GPS.name]) <= len(twin.log.messages[topics.GPS.name])


def test_a_failure_that_ends_is_said_to_be_over() -> None:
    branch = underway(RAVEN).branch(parse_fault(f"gps_lost@{FAILS_AT}-{FAILS_AT + 4.0}"))
    branch.until(FAILS_AT + 6.0)
    flight = branch.flight()
    assert flight.event_time("failsafe cleared: GPS position lost") == pytest.approx(FAILS_AT + 4.2, abs=0.4)
    assert [event.text for event in flight.of(truth_topics.EVENTS)][-1] == "fault gps_lost ended"


@pytest.mark.validate
def test_a_healthy_flight_in_a_wind_has_no_alarm() -> None:
    flight = Underway(
        RAVEN, FLIGHT._replace(seed=2, wind_speed=3.0, wind_from=1.2, turbulence="light", duration=40.0), LOW_HOLD
    )
    flight.until(40.0)
    assert [text for text in flight.flight().events() if "failsafe" in text or "refused" in text] == []


@pytest.mark.validate
def test_a_pitot_blocked_after_the_fixes_were_lost_is_found_and_flown_without() -> None:
    branch = underway(RAVEN).branch(parse_fault(f"gps_lost@{FAILS_AT}"))
    branch.until(FAILS_AT + 4.0)
    both = branch.branch(parse_fault(f"pitot_blocked@{FAILS_AT + 4.1}"))
    both.until(FAILS_AT + 24.0)
    flight = both.flight()
    check_upright(flight, 20.0)
    assert flight.event_time("failsafe: airspeed invalid") < FAILS_AT + 6.5
    late = flight.truth["time_us"] > (FAILS_AT + 4.0) * 1e6
    assert np.abs(flight.altitude()[late] - 15.0).max() < 5.0


def wrong_pitot(counts: int) -> Callable[[SensorFrame], SensorFrame]:
    def alter(frame: SensorFrame) -> SensorFrame:
        if frame.pressures is None or frame.time_us < 20_000_000:
            return frame
        return frame._replace(pressures=frame.pressures._replace(differential_counts=counts))

    return alter


@pytest.mark.validate
@pytest.mark.parametrize(("counts", "result"), [(8192, 21.0), (16383, 23.5)])
def test_a_blocked_or_pressurised_pitot_never_goes_through(counts: int, result: float) -> None:
    """GIVEN a tube at static pressure or at the sensor's end THEN the airspeed in use stays within 3 sigma."""
    flight = simulate(RAVEN, FLIGHT._replace(duration=32.0), LOW_HOLD, alter=wrong_pitot(counts))
    check_upright(flight)
    assert flight.event_time("failsafe: airspeed invalid") == pytest.approx(result, abs=0.7)
    air, truth = flight.columns(topics.AIR_DATA), flight.truth
    late = air["time_us"] > 19_000_000
    off = air["airspeed"][late] - np.interp(air["time_us"][late], truth["time_us"], truth["airspeed"])
    assert np.abs(off).max() < 1.5
    assert (np.abs(off) / np.sqrt(air["airspeed_variance"][late])).max() < 3.0


@pytest.mark.validate
def test_a_wing_that_jams_after_its_encoder_died_is_found() -> None:
    branch = underway(RAVEN).branch(parse_fault(f"encoder_left_lost@{FAILS_AT}"))
    branch.until(FAILS_AT + 5.0)
    both = branch.branch(parse_fault(f"wing_left_jammed@{FAILS_AT + 5.1}"))
    both.until(FAILS_AT + 12.0)
    flight = both.flight()
    said = flight.event_time("failsafe: flapping stopped, wing jammed")
    assert FAILS_AT + 5.1 < said < FAILS_AT + 10.0
    check_stopped(flight, said)
