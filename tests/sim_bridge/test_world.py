from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from plant_bench import NAMES, vehicle
from scipy.spatial.transform import Rotation

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge import topics
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.environment.dryden import FOOT
from sim_bridge.environment.levels import SMALL_UAV
from sim_bridge.flight import world as launching
from sim_bridge.flight.faults import Fault
from sim_bridge.flight.world import (
    ARMED_TIME,
    LAUNCH_PATIENCE,
    LAUNCH_TIME,
    REST_SPEED,
    REST_TIME,
    Scenario,
    SimulatedWorld,
    Throw,
)
from sim_bridge.messages import TruthState
from wingbeat.errors import InputError
from wingbeat.topic import Topic

Pilot = Callable[[int], ActuatorCommand]
SOON = 1.0
"""s; of a launch where nobody needs the default's time to start"""


def glide(tick: int) -> ActuatorCommand:
    """Wings spread, tail neutral."""
    return ActuatorCommand(tick, 0.2, 0.2, 0.0, 0.1, 0.0, 1)


def flap(tick: int) -> ActuatorCommand:
    angle = 0.2 + 0.4 * math.sin(2.0 * math.pi * 4.0 * tick / 200.0)
    return ActuatorCommand(tick, angle, angle, 0.5, 0.1, 0.05, 1)


def simulate(world: SimulatedWorld, pilot: Pilot, ticks: int) -> list[SensorFrame]:
    return [world.step(pilot(tick)) for tick in range(ticks)]


def contact_depths(world: SimulatedWorld) -> list[float]:
    """m; how deep each contact point is under ground (an overturned vehicle lies on the same points)."""
    plant = world.plant
    return [float(plant.y[2] + plant.scratch.r[2] @ point) for point in plant.parameters.contacts]


def run_out(world: SimulatedWorld, pilot: Pilot, limit: int = 8000) -> list[TruthState]:
    truths: list[TruthState] = []
    while not world.finished and len(truths) < limit:
        world.step(pilot(len(truths)))
        truths.append(world.truth())
    return truths


@pytest.fixture(scope="module", params=NAMES)
def landed(request: pytest.FixtureRequest) -> tuple[SimulatedWorld, list[TruthState]]:
    world = SimulatedWorld(vehicle(request.param), Scenario(launch_time=SOON))
    return world, run_out(world, glide)


def test_it_is_held_thrown_and_then_flies(landed: tuple[SimulatedWorld, list[TruthState]]) -> None:
    world, truths = landed
    launch = world.vehicle.launch
    held = [t for t in truths if t.time_us <= SOON * 1e6]
    assert held and all(t.down == -launch.height and t.airspeed == 0.0 and t.on_ground == 1 for t in held)
    thrown = next(t for t in truths if t.time_us >= (SOON + launch.duration) * 1e6)
    assert thrown.airspeed == pytest.approx(launch.speed, rel=0.02)
    climb, along = -thrown.v_down, thrown.v_north
    assert math.atan2(climb, along) == pytest.approx(launch.pitch, abs=0.02)
    assert any(t.on_ground == 0 for t in truths)


def test_a_throw_may_be_slower_and_askew() -> None:
    one = vehicle("robo_raven_ii_d")
    world = SimulatedWorld(one, Scenario(throw=Throw(speed=0.7, pitch=0.1, bank=-0.2), launch_time=SOON))
    ticks = round((SOON + one.launch.duration) * 200)
    truth = [(world.step(glide(tick)), world.truth())[1] for tick in range(ticks)][-1]
    assert truth.airspeed == pytest.approx(0.7 * one.launch.speed, rel=0.02)
    q = (truth.quaternion_x, truth.quaternion_y, truth.quaternion_z, truth.quaternion_w)
    assert Rotation.from_quat(q).as_euler("ZYX") == pytest.approx((0.0, one.launch.pitch + 0.1, -0.2), abs=1e-6)


def until_launched(world: SimulatedWorld) -> TruthState:
    """The first moment that is not in the launcher's hand."""
    while not world.finished:
        world.step(glide(0))
        truth = world.truth()
        if math.hypot(truth.v_north, truth.v_east, truth.v_down) != 0.0 or not truth.on_ground:
            return truth
    raise AssertionError("it was never thrown")


def test_who_waits_for_arming_throws_an_armed_vehicle_alone_and_says_so() -> None:
    said: list[tuple[float, str]] = []

    def receive(topic: Topic, message: Any) -> None:
        if topic is topics.EVENTS:
            said.append((message.time_us * 1e-6, message.text))

    scenario = Scenario(waits_for_arming=True, duration=25.0, launch_time=SOON)
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), scenario, receive)
    armed = ((2.0, 4.0), (5.0, math.inf))
    while not world.launched:
        now = world.time_us * 1e-6
        world.step(glide(0) if any(begin <= now < end for begin, end in armed) else NEUTRAL)
    assert [text for _, text in said] == [
        "armed: launch in 5 s",
        "disarmed: launcher waiting",
        "armed: launch in 5 s",
        "released by the launcher",
    ]
    assert [time for time, _ in said] == pytest.approx([2.0, 4.0, 5.0, 5.0 + ARMED_TIME], abs=0.02)


def test_an_unarmed_vehicle_stays_in_the_hand_of_who_waits() -> None:
    scenario = Scenario(waits_for_arming=True, duration=SOON + 2.0, launch_time=SOON)
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), scenario)
    run_out(world, lambda _: NEUTRAL)
    assert world.finished and not world.launched
    assert world.truth().down == -world.vehicle.launch.height


def test_who_waits_for_arming_throws_the_same_throw_when_it_was_armed_before() -> None:
    thrown = []
    for waits in (False, True):
        world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(waits_for_arming=waits))
        thrown.append(until_launched(world))
    assert thrown[0] == thrown[1]
    assert thrown[0].time_us * 1e-6 == pytest.approx(LAUNCH_TIME, abs=0.02)


def test_the_launcher_waits_for_the_wind_in_his_face() -> None:
    waited = []
    for seed in (1, 2, 3, 4):
        scenario = Scenario(seed=seed, wind_speed=3.0, wind_from=0.5, turbulence="moderate", duration=45.0)
        world = SimulatedWorld(vehicle("robo_raven_ii_d"), scenario)
        thrown = until_launched(world)
        ahead = -(thrown.wind_north * math.cos(0.5) + thrown.wind_east * math.sin(0.5))
        waited.append(thrown.time_us * 1e-6 - LAUNCH_TIME)
        assert ahead >= 3.0 - 0.5 or waited[-1] >= 2.0 * LAUNCH_PATIENCE
    assert max(waited) > 0.5 and min(waited) >= 0.0


@pytest.mark.parametrize(
    ("wind", "gust", "timeout"),
    [
        (0.0, (0.0, 0.0, 0.0), 0.0),
        (3.0, (-2.0, 0.9, -0.9), 0.0),
        (3.0, (-2.0, 1.1, 0.0), 1.0),
        (3.0, (-2.0, 0.0, -1.1), 1.0),
        (3.0, (2.0, 0.0, 0.0), 2.0),
        (1.9, (2.0, 0.0, 0.0), 5.0),
    ],
)
def test_how_long_the_launcher_waits_for_what_the_air_does(
    wind: float, gust: tuple[float, float, float], timeout: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a north wind and a gust (NED) that stays THEN thrown after so many times his patience."""
    monkeypatch.setattr(launching, "LAUNCH_PATIENCE", 0.4)
    monkeypatch.setattr(launching, "LONGEST_WAIT", 2.0)
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(wind_speed=wind, launch_time=0.1))
    world.inputs.gust[:3] = gust
    waited = until_launched(world).time_us * 1e-6 - 0.1
    assert waited == pytest.approx(0.4 * timeout, abs=0.02)


@pytest.mark.parametrize("seed", [3, 4])
def test_also_in_a_calm_a_lull_ends_for_who_waits(seed: int) -> None:
    """Gusts that only the wind carries past the launcher would blow on for ever where there is none."""
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(seed=seed, turbulence="moderate", launch_time=1000.0))
    north = []
    for _ in range(30 * 5):
        world.advance(NEUTRAL, 0.2)
        north.append(world.truth().wind_north)
    assert min(north) < 0.0 < max(north)


def test_it_is_over_once_it_has_lain_still(landed: tuple[SimulatedWorld, list[TruthState]]) -> None:
    world, truths = landed
    assert world.finished
    assert truths[-1].time_us * 1e-6 < world.scenario.duration
    rest = [t for t in truths if t.time_us > truths[-1].time_us - (REST_TIME - 0.01) * 1e6]
    assert all(math.hypot(t.v_north, t.v_east, t.v_down) < REST_SPEED and t.on_ground for t in rest)
    depths = contact_depths(world)
    assert max(depths) == pytest.approx(0.0, abs=0.01) and min(depths) > -0.05


def test_the_time_is_up_at_the_latest() -> None:
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(duration=0.098))
    truths = run_out(world, glide)
    assert [t.time_us for t in truths] == [5000 * (i + 1) for i in range(20)]


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_frames_and_another_seed_others(name: str) -> None:
    scenarios = [Scenario(seed=seed, launch_time=SOON) for seed in (7, 7, 8)]
    first, second, other = (SimulatedWorld(vehicle(name), scenario) for scenario in scenarios)
    frames = simulate(first, flap, 600)
    assert first.launched and frames == simulate(second, flap, 600)
    assert frames[:200] != simulate(other, flap, 200)
    assert first.truth() == second.truth()


def test_everything_true_is_published() -> None:
    observed: dict[str, list[int]] = {}
    world = SimulatedWorld(
        vehicle("robo_raven_ii_d"), Scenario(), lambda topic, m: observed.setdefault(topic.name, []).append(m.time_us)
    )
    simulate(world, flap, 40)
    world.record()
    world.record()  # once is enough
    assert observed[topics.STATE.name] == observed[topics.WING.name] == [5000 * (i + 1) for i in range(40)]
    assert len(observed[topics.LOADS.name]) == 20


def _differential(frames: list[SensorFrame]) -> float:
    counts = [frame.pressures.differential_counts for frame in frames if frame.pressures]
    return sum(counts) / len(counts)


@pytest.mark.parametrize("direction", [0.0, 2.1])
def test_a_wind_is_felt_by_the_pitot_in_the_launchers_hand(direction: float) -> None:
    still = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario())
    windy = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(wind_speed=6.0, wind_from=direction))
    calm, blown = simulate(still, glide, 200), simulate(windy, glide, 200)
    spec = windy.vehicle.sections["pitot"]
    pressure = (_differential(blown) - _differential(calm)) * 2.0 * spec.range / (spec.counts_high - spec.counts_low)
    assert pressure == pytest.approx(0.5 * 1.22 * 36.0, rel=0.15)
    truth = windy.truth()
    assert truth.airspeed == pytest.approx(6.0)
    assert math.hypot(truth.v_north, truth.v_east) == 0.0
    assert math.atan2(-truth.wind_east, -truth.wind_north) == pytest.approx(direction)


def _gusty(seed: int, level: str = "moderate") -> list[TruthState]:
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(seed=seed, wind_speed=3.0, turbulence=level))
    return run_out(world, glide)


def test_gusts_blow_about_the_steady_wind_and_move_what_flies_in_them() -> None:
    gusty, calm = _gusty(1), _gusty(1, "none")
    north = [truth.wind_north for truth in gusty]
    assert {truth.wind_north for truth in calm} == {-3.0}
    # Held near the ground, where moderate turbulence is some 2 m/s across.
    spread = math.sqrt(sum((speed + 3.0) ** 2 for speed in north) / len(north))
    assert 0.3 < spread < 5.0
    assert len(set(north)) > 2000
    assert max(abs(truth.east) for truth in gusty) > 0.1 + max(abs(truth.east) for truth in calm)


def test_the_gusts_that_are_published_have_the_strength_of_their_level() -> None:
    """About the wind, over many seeds, where the launcher holds the vehicle: below 10 ft, the ground is near."""
    level, observed = "small_uav_moderate", list[tuple[float, ...]]()
    for seed in range(80):
        scenario = Scenario(seed=seed, wind_speed=3.0, turbulence=level)
        world = SimulatedWorld(vehicle("robo_raven_ii_d"), scenario, lambda topic, m: _keep_wind(observed, topic, m))
        world.advance(NEUTRAL, 0.005)
        world.record()
    wind, (_, _, level_intensity, down_intensity) = np.array(observed), SMALL_UAV[level]
    down_intensity *= world.vehicle.launch.height / (10.0 * FOOT)
    assert len(observed) == 80
    assert wind.mean(axis=0) == pytest.approx((-3.0, 0.0, 0.0), abs=0.3 * level_intensity)
    assert wind.std(axis=0) == pytest.approx((level_intensity, level_intensity, down_intensity), rel=0.25)


def _keep_wind(observed: list[tuple[float, ...]], topic: Topic, message: Any) -> None:
    if topic is topics.STATE:
        observed.append((message.wind_north, message.wind_east, message.wind_down))


@pytest.mark.validate
def test_the_seed_is_the_gusts() -> None:
    one, again, other = _gusty(5), _gusty(5), _gusty(6)
    assert one[::40] == again[::40]
    assert [truth.wind_north for truth in one] != [truth.wind_north for truth in other]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1e300])
def test_a_command_that_is_no_number_does_not_end_the_world(name: str, wrong: float) -> None:
    world = SimulatedWorld(vehicle(name), Scenario())
    simulate(world, lambda _: ActuatorCommand(0, wrong, wrong, wrong, wrong, wrong, 1), 50)
    truth = world.truth_wing()
    assert all(math.isfinite(part) for part in (*truth, *world.plant.y.tolist()))
    assert abs(truth.elevator) <= world.vehicle.tail_servo.travel


def test_a_vehicle_that_is_not_armed_does_not_move_its_wings() -> None:
    for name in NAMES:
        world = SimulatedWorld(vehicle(name), Scenario())
        simulate(world, lambda tick: flap(tick)._replace(armed=0), 200)
        wing = world.truth_wing()
        assert abs(wing.rate_left) < 0.05 and abs(wing.rate_right) < 0.05


def test_loads_and_power_agree_with_each_other() -> None:
    world = SimulatedWorld(vehicle("robo_raven_ii_d"), Scenario(wind_speed=7.0))
    simulate(world, flap, 230)
    wing, loads = world.truth_wing(), world.truth_loads()
    assert 0.9 * wing.current * wing.voltage < wing.electrical_power < 1.001 * wing.current * wing.voltage
    assert loads.wing_force_y == pytest.approx(0.0, abs=1e-9)
    assert loads.wing_moment_x == pytest.approx(0.0, abs=1e-9)
    assert abs(loads.wing_force_z) > 0.1


@pytest.mark.parametrize(
    ("scenario", "text"),
    [
        (Scenario(duration=0.0), "duration"),
        (Scenario(duration=math.nan), "duration"),
        (Scenario(wind_speed=-1.0), "wind speed"),
        (Scenario(wind_speed=51.0), "0 to 50"),
        (Scenario(wind_from=math.inf), "wind direction"),
        (Scenario(turbulence="breezy"), "severe, small_uav_light or small_uav_moderate"),
        (Scenario(seed=-1), "seed"),
    ],
)
def test_a_scenario_out_of_range_is_refused(scenario: Scenario, text: str) -> None:
    with pytest.raises(InputError, match=text):
        SimulatedWorld(vehicle("robo_raven_ii_d"), scenario)


def test_before_the_first_command_nothing_moves() -> None:
    world = SimulatedWorld(vehicle("arizona_100cm"), Scenario())
    simulate(world, lambda _: NEUTRAL, 20)
    assert world.truth().down == -world.vehicle.launch.height


@pytest.mark.parametrize(("faults", "received"), [((), 0), ((Fault("receiver_lost", 0.09),), 5)])
def test_somebody_stands_by_with_a_transmitter_that_is_to_be_lost(faults: tuple[Fault, ...], received: int) -> None:
    world = SimulatedWorld(vehicle(NAMES[0]), Scenario(faults=faults))
    frames = simulate(world, glide, 40)
    assert sum(frame.receiver is not None for frame in frames) == received
