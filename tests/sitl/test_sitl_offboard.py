"""OFFBOARD and reposition commands flown by both vehicles: position, course, timeout, altitude, orbit."""

import math
from functools import cache

import numpy as np
import pytest
from simulate import ARIZONA, RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.guidance.setpoint import Path, Setpoint
from avionics.messages import Command, CommandKind, Mode
from avionics.vehicles import load_vehicle
from sim_bridge.flight.world import Scenario

MISSION = (MissionItem(ItemKind.TAKEOFF, altitude=20.0), MissionItem(ItemKind.LOITER, 0.0, 0.0, 20.0))
BEGIN = 12.0
"""s; since boot, in flight"""
PERIOD = 0.1
"""s; between two setpoints of a stream"""


def command(time: float, kind: CommandKind, name: str = "", value: float = 0.0, payload=None) -> Command:
    return Command(round(time * 1e6), kind, name, value, payload, "test")


def stream(begin: float, end: float, setpoint: Setpoint) -> list[Command]:
    """A setpoint every `PERIOD` from ``begin`` to ``end`` (s)."""
    times = np.arange(begin, end, PERIOD)
    return [command(time, CommandKind.SET_SETPOINT, payload=setpoint) for time in times]


def offboard(time: float) -> Command:
    return command(time, CommandKind.SET_MODE, Mode.OFFBOARD.name)


def modes_at(flight: Flight, *times: float) -> list[Mode]:
    navigation = flight.columns(topics.NAVIGATION)
    return [Mode(int(navigation["mode"][np.searchsorted(navigation["time_us"], time * 1e6)])) for time in times]


def window(flight: Flight, begin: float, end: float) -> np.ndarray:
    """Whether a sample of the truth lies from ``begin`` to ``end`` (s)."""
    time = flight.truth["time_us"] * 1e-6
    return (time >= begin) & (time <= end)


def distance(flight: Flight, place: tuple[float, float], begin: float, end: float = math.inf) -> np.ndarray:
    """True distance (m) to ``place`` from ``begin`` to ``end`` (s)."""
    truth = flight.truth
    return np.hypot(truth["north"] - place[0], truth["east"] - place[1])[window(flight, begin, end)]


def bearing_rate(flight: Flight, place: tuple[float, float], begin: float, end: float) -> float:
    """Mean rate (rad/s) of the bearing from ``place`` to the vehicle, positive clockwise."""
    truth, inside = flight.truth, window(flight, begin, end)
    bearing = np.unwrap(np.arctan2(truth["east"][inside] - place[1], truth["north"][inside] - place[0]))
    return float((bearing[-1] - bearing[0]) / (end - begin))


VEHICLES = pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
PLACE, ORBIT = (60.0, 40.0), (20.0, -30.0)
"""m; north and east of home"""


@cache
def course_flight(vehicle: str) -> Flight:
    """A course to the south-west that climbs, from 12 to 24 s; then no more setpoints, in a flight of 40 s."""
    setpoint = Setpoint(Path.COURSE, course=math.radians(-135.0), climb_rate=0.5)
    begin = [*stream(BEGIN - 0.5, BEGIN + 12.0, setpoint), offboard(BEGIN)]
    change = command(35.0, CommandKind.CHANGE_ALTITUDE, value=22.0)
    return simulate(vehicle, Scenario(seed=3, duration=55.0), MISSION, [*begin, change])


@pytest.mark.validate
@VEHICLES
def test_offboard_position_and_orbit_are_circled(vehicle: str) -> None:
    setpoint = Setpoint(Path.CIRCLE_AT, *PLACE, radius=-25.0, altitude=25.0)
    orbit = MissionItem(ItemKind.LOITER, *ORBIT, 25.0, radius=35.0)
    commands = [*stream(11.5, 42.0, setpoint), offboard(BEGIN), command(42.0, CommandKind.LOITER_AT, payload=orbit)]
    flight = simulate(vehicle, Scenario(seed=3, duration=68.0), MISSION, commands)
    assert modes_at(flight, BEGIN - 1.0, BEGIN + 1.0, 41.0) == [Mode.AUTO, Mode.OFFBOARD, Mode.OFFBOARD]
    assert np.abs(distance(flight, PLACE, 33.0, 42.0) - 25.0).max() < 6.0
    assert bearing_rate(flight, PLACE, 33.0, 42.0) < -0.1
    assert np.abs(distance(flight, ORBIT, 59.0, 68.0) - 35.0).max() < 6.0
    assert bearing_rate(flight, ORBIT, 59.0, 68.0) > 0.1
    assert np.abs(flight.altitude()[-1000:] - 25.0).max() < 2.0


@pytest.mark.validate
@VEHICLES
def test_offboard_velocity_gives_course_and_climb_rate(vehicle: str) -> None:
    truth = course_flight(vehicle).truth
    late = (truth["time_us"] >= 20e6) & (truth["time_us"] <= 24e6)
    course = np.degrees(np.arctan2(truth["v_east"], truth["v_north"]))[late]
    assert course.mean() == pytest.approx(-135.0, abs=10.0)
    climb = -np.asarray(truth["v_down"])[late].mean()
    assert climb == pytest.approx(0.5, abs=0.2)


@VEHICLES
def test_offboard_timeout_changes_to_loiter(vehicle: str) -> None:
    flight = course_flight(vehicle)
    timeout = load_vehicle(vehicle).gains.navigation.offboard_timeout
    changed = flight.event_time("offboard: setpoints timed out, LOITER")
    last = max(each.time_us for each in stream(BEGIN - 0.5, BEGIN + 12.0, Setpoint(Path.KEEP))) * 1e-6
    assert changed - last == pytest.approx(timeout, abs=0.1)
    assert modes_at(flight, changed - 0.2, changed + 0.2, 54.0) == [Mode.OFFBOARD, Mode.LOITER, Mode.LOITER]
    truth = flight.truth
    north, east = (np.interp(changed * 1e6, truth["time_us"], truth[name]) for name in ("north", "east"))
    assert distance(flight, (north, east), changed).max() < 4.0 * load_vehicle(vehicle).gains.navigation.loiter_radius


@VEHICLES
def test_change_altitude_keeps_the_circle(vehicle: str) -> None:
    flight = course_flight(vehicle)
    truth, radius = flight.truth, load_vehicle(vehicle).gains.navigation.loiter_radius
    time = truth["time_us"] * 1e-6
    before, after = (int(np.searchsorted(time, t)) for t in (34.9, 54.5))
    assert flight.altitude()[before] < 19.0
    assert flight.altitude()[after] == pytest.approx(22.0, abs=1.5)
    turn = math.tau * radius / truth["airspeed"][before:].mean()
    late = time >= 54.9 - turn
    center = (truth["north"][late].mean(), truth["east"][late].mean())
    assert np.abs(distance(flight, center, 35.0) - radius).max() < 0.3 * radius


def test_offboard_attitude_is_flown_within_limits() -> None:
    setpoint = Setpoint(Path.ATTITUDE, roll=0.25, pitch=0.2, throttle=0.7)
    flight = simulate(
        RAVEN, Scenario(seed=3, duration=18.0), MISSION, [*stream(11.5, 18.0, setpoint), offboard(BEGIN)]
    )
    late = flight.truth["time_us"] >= 15e6
    roll, _, _ = flight.true_attitude()
    assert roll[late].mean() == pytest.approx(0.25, abs=0.1)
    throttle = flight.columns(topics.ALTITUDE_LOOP)["throttle"]
    assert throttle[-50:] == pytest.approx(0.7, abs=1e-6)


def test_offboard_is_denied_without_a_setpoint_stream() -> None:
    old = command(BEGIN - 1.5, CommandKind.SET_SETPOINT, payload=Setpoint(Path.CIRCLE_HERE))
    flight = simulate(RAVEN, Scenario(seed=3, duration=13.0), MISSION, [offboard(10.4), old, offboard(BEGIN)])
    assert flight.events().count("mode OFFBOARD denied: no recent setpoint") == 2
    assert modes_at(flight, 12.9) == [Mode.AUTO]


def test_setpoints_on_the_ground_are_preparation_only() -> None:
    prepared = [*stream(0.5, 3.0, Setpoint(Path.CIRCLE_HERE)), offboard(1.5)]
    flight = simulate(RAVEN, Scenario(seed=3, duration=3.0), MISSION, prepared)
    assert "mode OFFBOARD denied: not in flight" in flight.events()
    assert modes_at(flight, 2.9) == [Mode.AUTO]
