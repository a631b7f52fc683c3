"""A downward rangefinder on a vehicle of one's own: the flare goes by it, and its failure costs nothing."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from simulate import RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link import sensor_codec
from avionics.link.dialect import mavlink
from avionics.messages import SensorFrame, Stage
from avionics.sensing import rangefinder
from avionics.sensors import SENSORS
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.flight.faults import Fault
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.samples import RangeSample

SECTION = (Path(__file__).parents[1] / "sim_bridge" / "sensors_bench.toml").read_text().partition("[rangefinder]")[2]
HOP = (
    MissionItem(ItemKind.TAKEOFF, altitude=25.0),
    MissionItem(ItemKind.LAND, north=220.0, east=0.0, heading=0.0),
)
DRIFT_COUNTS = 6_000
"""counts of 0.01 Pa; 60 Pa, as of 5 m"""


def sample(time: float, distance: float, quality: int = 100) -> RangeSample:
    return RangeSample(round(time * 1e6), distance, 0.1, 12.0, quality)


def followed(distances: list[float], altitude: float = 8.0, quality: int = 100) -> rangefinder.State:
    """State after readings at 50 Hz in level flight, from a reference of 2 m."""
    state = rangefinder.step(rangefinder.State(), sample(0.0, 2.0), 1.0, 0.0, at_rest=True)
    for i, distance in enumerate(distances):
        state = rangefinder.step(state, sample(0.02 * (i + 1), distance, quality), 1.0, altitude, at_rest=False)
    return state


def test_terrain_is_altitude_less_height() -> None:
    """GIVEN 8 m of altitude over ground 3 m above the launch site WHEN read for 4 s THEN terrain is 3 m."""
    assert followed([7.0] * 200).terrain == pytest.approx(3.0, abs=0.01)


def test_launch_height_is_that_at_boot() -> None:
    """GIVEN 2 m above the ground at boot THEN that is the launch height, the parameter's without a recent reading."""
    state = followed([7.0] * 20)
    assert rangefinder.launch_height(state, state.time_us, 1.5) == pytest.approx(2.0)
    assert rangefinder.launch_height(state, state.time_us + 2_000_000, 1.5) == 1.5


def test_false_reading_moves_the_terrain_by_its_greatest_rate() -> None:
    before, after = followed([10.0] * 100), followed([10.0] * 100 + [0.5])
    assert before.terrain == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < after.terrain <= rangefinder.MAX_RATE * 0.02 + 1e-9


def test_false_readings_after_a_gap_are_not_used() -> None:
    """GIVEN 12 m without an echo WHEN single false readings come THEN the terrain stays that of home."""
    state = followed([0.0] * 200, altitude=10.0, quality=0)
    for i in range(20):
        distance = 1.5 if i % 4 == 0 else 12.0
        state = rangefinder.step(state, sample(4.0 + 0.02 * (i + 1), distance), 1.0, 10.0, at_rest=False)
        assert abs(rangefinder.terrain(state, state.time_us)) < 0.1, i


def test_readings_that_agree_after_a_gap_are_used() -> None:
    state = rangefinder.State(reference=2.0)
    for i in range(rangefinder.CONFIRMING):
        assert rangefinder.terrain(state, state.time_us) == 0.0
        state = rangefinder.step(state, sample(9.0 + 0.02 * i, 7.0), 1.0, 8.0, at_rest=False)
    assert rangefinder.terrain(state, state.time_us) == pytest.approx(3.0)


def test_vehicle_on_the_ground_keeps_its_terrain() -> None:
    """GIVEN a sensor that cannot measure below 0.1 m WHEN the vehicle stands THEN its readings are still used."""
    state = followed([0.05] * 300, altitude=6.0)
    assert rangefinder.terrain(state, state.time_us + 900_000) == pytest.approx(7.9, abs=0.01)


@pytest.mark.parametrize(("distance", "quality"), [(12.5, 100), (7.0, 0)])
def test_reading_out_of_range_or_without_echo_is_not_used(distance: float, quality: int) -> None:
    assert followed([distance] * 50, quality=quality).time_us == 0


def test_tilted_beam_is_not_used() -> None:
    state = rangefinder.State(time_us=0)
    assert rangefinder.step(state, sample(0.02, 7.0), 0.7, 8.0, at_rest=False) is state


def test_terrain_is_that_of_home_without_recent_reading() -> None:
    state = followed([7.0] * 100)
    last = state.time_us
    assert rangefinder.terrain(state, last + round(rangefinder.HOLD_TIME * 1e6)) == state.terrain
    assert rangefinder.terrain(state, last + round(rangefinder.HOLD_TIME * 1e6) + 1) == 0.0
    assert rangefinder.terrain(rangefinder.State(), 5) == 0.0


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("vehicle") / "ranging_raven.toml"
    path.write_text(
        f'name = "ranging_raven"\ntitle = "Robo Raven with a rangefinder"\nbase = "{RAVEN}"\n[rangefinder]{SECTION}'
    )
    return str(path)


def drifted(frame: SensorFrame) -> SensorFrame:
    """The static pressure falls by 60 Pa from 20 s on: the altitude is 5 m too high."""
    if frame.pressures is None or frame.time_us < 20_000_000:
        return frame
    counts = frame.pressures.static_counts - round(min((frame.time_us - 20e6) * 1e-7, 1.0) * DRIFT_COUNTS)
    return frame._replace(pressures=frame.pressures._replace(static_counts=counts))


@cache
def hop(vehicle: str, *faults: Fault) -> Flight:
    return simulate(vehicle, Scenario(seed=1, duration=120.0, faults=faults), HOP, alter=drifted, avionics=RAVEN)


def flare_height(flight: Flight) -> float:
    """True altitude above that at boot (m) at which the flare begins."""
    navigation, truth = flight.columns(topics.NAVIGATION), flight.truth
    begin = navigation["time_us"][navigation["stage"] == Stage.FLARE][0]
    return float(np.interp(begin, truth["time_us"], flight.altitude()))


@pytest.mark.validate
def test_flare_begins_at_the_measured_height(vehicle: str) -> None:
    """GIVEN a barometer that drifts by 5 m WHEN the vehicle lands THEN only with a rangefinder it flares in time."""
    with_it, without = hop(vehicle), hop(RAVEN)
    wanted = load_flight_vehicle(RAVEN).gains.navigation.flare_altitude
    assert abs(flare_height(with_it) - wanted) < abs(flare_height(without) - wanted) - 2.0
    assert with_it.touchdown().sink < without.touchdown().sink
    frames = len(with_it.of(topics.IMU))
    assert len(with_it.of(topics.RANGE)) == pytest.approx(frames / 4, abs=1)


@pytest.mark.validate
def test_lost_rangefinder_flies_as_without(vehicle: str) -> None:
    lost, without = hop(vehicle, Fault("rangefinder_lost", 15.0)), hop(RAVEN)
    assert lost.touchdown().sink == pytest.approx(without.touchdown().sink, abs=0.2)


def test_fault_of_a_missing_rangefinder_is_rejected() -> None:
    with pytest.raises(InputError, match=r"rangefinder_lost: the vehicle file has no section \[rangefinder\]"):
        SimulatedWorld(load_vehicle(RAVEN), Scenario(faults=(Fault("rangefinder_lost", 5.0),)))


def test_ground_station_receives_distance_sensor() -> None:
    sensor = next(each for each in SENSORS if each.field == "rangefinder")
    message = sensor_codec.message(sensor, sample(1.5, 7.25))
    assert message.get_type() == "DISTANCE_SENSOR"
    assert (message.time_boot_ms, message.current_distance, message.min_distance, message.max_distance) == (
        1500,
        725,
        10,
        1200,
    )
    assert message.orientation == 25 and message.signal_quality == 100


def test_sensor_that_does_not_look_down_is_ignored() -> None:
    forward = mavlink.MAVLink_distance_sensor_message(5, 10, 1200, 300, 0, 0, 0, 255)
    down = mavlink.MAVLink_distance_sensor_message(5, 10, 1200, 300, 0, 0, 25, 255)
    codec, sender = sensor_codec.CODECS["rangefinder"], mavlink.MAVLink(None, 1, 1)
    payloads = [each.pack(sender)[10:-2] for each in (forward, down)]
    assert codec.decode(payloads[0]) is None
    assert codec.decode(payloads[1]) == RangeSample(5000, 3.0, 0.1, 12.0, 255), "no quality reported: it is used"
