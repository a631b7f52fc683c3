"""How well altitude and track are held, in still air and in wind, against the truth (``make validate``)."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from memory_log import MemoryLog
from simulate import RAVEN, Flight, Underway, rms

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

pytestmark = pytest.mark.validate

SEEDS = (1, 2, 3, 4)
ALTITUDE = 40.0
CORNERS = ((150.0, 0.0), (150.0, 150.0), (0.0, 150.0), (0.0, 0.0))
"""m; north and east, of a square flown once"""
SQUARE = (
    MissionItem(ItemKind.TAKEOFF, altitude=ALTITUDE),
    *(MissionItem(ItemKind.WAYPOINT, north=north, east=east, altitude=ALTITUDE) for north, east in CORNERS),
)
ONTO_THE_LEG = 5.0
"""s; of a turn onto a leg that are not counted, and of a climb into a hold"""
WIND = 3.0
"""m/s"""
AIRTIME = 67.0
"""s; of a climb and a hold, however long the launcher has waited"""
LONG_AIRTIME = 100.0
"""s; the same where air that sinks for long may stretch the climb to half a minute"""
CLIMB = 1.5
"""m/s; through the air, the greatest that `wingbeat trim` finds: a larger stroke gives no more thrust"""
TRUTH_PERIOD = 0.005
"""s"""


class Track(NamedTuple):
    """Distances from the straight legs of one flight."""

    true: Any
    """m; (N,)"""
    estimated: Any
    """m; (N,) as the flight computer has it"""


@cache
def track(wind: float, seed: int, slow_error: bool = True) -> Track:
    """Of the square, with the receiver of the data sheet or with one that tells its place without a slow error."""
    vehicle = load_vehicle(RAVEN)
    if not slow_error:
        vehicle.sections["gps"] = vehicle.sections["gps"]._replace(horizontal_sigma=0.01)
    log = MemoryLog()
    scenario = Scenario(seed=seed, wind_speed=wind, wind_from=1.3 * seed, duration=130.0)
    world = SimulatedWorld(vehicle, scenario, log.publish)
    fly(world, Autopilot(load_flight_vehicle(RAVEN), SQUARE, log.publish), scripted_start())
    legs = [_leg(Flight(log, SQUARE), item) for item in (2, 3, 4)]
    assert sum(len(leg.true) for leg in legs) > 4000
    return Track(*(np.concatenate(columns) for columns in zip(*legs, strict=True)))


def _leg(flight: Flight, item: int) -> Track:
    truth, navigation = flight.truth, flight.columns(topics.NAVIGATION)
    flown_item = navigation["item"][np.searchsorted(navigation["time_us"], truth["time_us"], side="right") - 1]
    on = np.flatnonzero(flown_item == item)
    on = on[truth["time_us"][on] > truth["time_us"][on[0]] + ONTO_THE_LEG * 1e6]
    (north, east), (to_north, to_east) = CORNERS[item - 2], CORNERS[item - 1]
    course = math.atan2(to_east - east, to_north - north)
    across = (truth["east"][on] - east) * math.cos(course) - (truth["north"][on] - north) * math.sin(course)
    told = np.interp(truth["time_us"][on], navigation["time_us"], navigation["cross_track"])
    return Track(across, told)


@pytest.mark.parametrize(("wind", "bound"), [(0.0, 2.0), (WIND, 4.0)])
def test_straight_legs_are_held_where_the_receiver_has_no_slow_error(wind: float, bound: float) -> None:
    assert rms(np.concatenate([track(wind, seed, slow_error=False).true for seed in SEEDS])) < bound


@pytest.mark.parametrize(("wind", "bound"), [(0.0, 2.0), (WIND, 4.0)])
def test_straight_legs_are_held_with_the_receiver_of_the_data_sheet(wind: float, bound: float) -> None:
    tracks = [track(wind, seed) for seed in SEEDS]
    estimated = rms(np.concatenate([each.estimated for each in tracks]))
    true = rms(np.concatenate([each.true for each in tracks]))
    print(f"cross-track at {wind:.0f} m/s: {true:.2f} m, as the flight computer sees it {estimated:.2f} m")  # noqa: T201
    assert estimated < bound
    assert true < bound


class Precision(NamedTuple):
    """One hold, from 5 s after 39 m on; empty when that height was not reached."""

    error: Any
    """m; (N,) altitude against the truth"""
    sinking: Any
    """m/s; (N,) of the air, positive down"""


@cache
def altitude_hold(wind: float, turbulence: str, seed: int, airtime: float = AIRTIME) -> Precision:
    """What came of a climb and a hold."""
    heading = math.radians((60 * seed) % 360 - 180)
    mission = (
        MissionItem(ItemKind.TAKEOFF, altitude=ALTITUDE),
        MissionItem(ItemKind.HOLD, altitude=ALTITUDE, heading=heading, duration=200.0),
    )
    scenario = Scenario(seed=seed, wind_speed=wind, wind_from=1.3 * seed, turbulence=turbulence)
    underway = Underway(RAVEN, scenario, mission)
    while not underway.world.launched:
        underway.until(underway.world.time_us * 1e-6 + 1.0)
    underway.until(underway.world.time_us * 1e-6 + airtime)
    flight = underway.flight()
    time, altitude = flight.truth["time_us"] * 1e-6, flight.altitude()
    begun, ended = flight.air_time()
    reached = np.flatnonzero((time > begun) & (altitude > ALTITUDE - 1.0))
    if not len(reached):
        return Precision(np.empty(0), np.empty(0))
    inside = (time > time[reached[0]] + ONTO_THE_LEG) & (time < ended)
    return Precision(altitude[inside] - ALTITUDE, flight.truth["wind_down"][inside])


def out_of_reach(sinking: Any) -> Any:
    """Altitude errors (N,) m of a perfect hold that climbs through the air as fast as this vehicle can, no faster."""
    errors = np.empty(len(sinking))
    error = 0.0
    for i, down in enumerate(sinking):
        error = min(error + (CLIMB - float(down)) * TRUTH_PERIOD, 0.0)
        errors[i] = error
    return errors


def test_altitude_in_still_air() -> None:
    errors = [altitude_hold(0.0, "none", seed).error for seed in SEEDS]
    assert min(map(len, errors)) > 4000
    assert max(map(rms, errors)) < 0.5


def long_flights(level: str) -> list[Precision]:
    """Eight long ones in 3 m/s of wind and gusts of a level, none of which ended early."""
    flights = [altitude_hold(WIND, level, seed, LONG_AIRTIME) for seed in range(1, 9)]
    print(f"altitude in {level}:", *(f"{rms(each.error):.2f}" for each in flights))  # noqa: T201
    assert min(len(each.error) for each in flights) > 4000
    return flights


def test_altitude_in_wind_and_light_gusts_of_small_aircraft() -> None:
    assert rms(np.concatenate([each.error for each in long_flights("small_uav_light")])) < 1.5


def test_altitude_in_wind_and_moderate_gusts_of_small_aircraft_beside_what_no_climb_can_hold() -> None:
    """Air that sinks faster than the vehicle climbs takes it down; the rest of the error is the flight computer's."""
    flights = long_flights("small_uav_moderate")
    ideal = [out_of_reach(each.sinking) for each in flights]
    left = np.concatenate([each.error - errors for each, errors in zip(flights, ideal, strict=True)])
    print(f"a perfect hold: {rms(np.concatenate(ideal)):.2f} m, beside it {rms(left):.2f} m")  # noqa: T201
    assert float(np.median([rms(each.error) for each in flights])) < 1.5
    assert rms(left) < 1.5


@pytest.mark.xfail(strict=True, reason="4.3 m; of a perfect hold that climbs 1.5 m/s at most 3.8 m")
def test_altitude_in_wind_and_moderate_gusts_of_small_aircraft() -> None:
    assert rms(np.concatenate([each.error for each in long_flights("small_uav_moderate")])) < 1.5


@pytest.mark.xfail(strict=True, reason="2.2 m: it climbs 1.5 m/s at most, and gusts go down with 1.5 m/s RMS")
def test_altitude_in_wind_and_moderate_gusts() -> None:
    """Of the holds that lasted (0.9, 1.0, 1.0, 1.3, 4.5 m): gusts of a 30 kt wind end some flights at the launch."""
    errors = [
        errors
        for errors in (altitude_hold(WIND, "moderate", seed).error for seed in range(1, 9))
        if len(errors) > 4000
    ]
    print(f"altitude in moderate gusts, {len(errors)} of 8 holds:", *(f"{rms(e):.2f}" for e in errors))  # noqa: T201
    assert len(errors) >= 3
    assert rms(np.concatenate(errors)) < 1.5
