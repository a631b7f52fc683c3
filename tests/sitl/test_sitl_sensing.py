"""Energy, battery, stroke phase and frequency over whole flights against the truth, with sensors that err."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest
from memory_log import MemoryLog
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks
from simulate import ARIZONA, RAVEN, Flight

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import ItemKind
from avionics.messages import ActuatorCommand, SensorFrame, Stage
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.sensing import wing_angle
from avionics.sensing.encoders import Counts
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge import topics as truth_topics
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

pytestmark = pytest.mark.validate

LOST, LOST_AT = 12, 60.0
DEAD_FROM = 75.0
"""counts, s; of the left encoder, and when its counter stops; in the hold before, all is well"""

CALM_AIR = Scenario(seed=4)


class ErringWorld:
    """A world that does something to its own sensors at every tick."""

    def __init__(self, world: SimulatedWorld, happens: Callable[[SimulatedWorld, SensorFrame], SensorFrame]) -> None:
        self._world = world
        self._happens = happens
        self.scenario = world.scenario

    @property
    def finished(self) -> bool:
        return self._world.finished

    def step(self, command: ActuatorCommand) -> SensorFrame:
        return self._happens(self._world, self._world.step(command))

    def record(self) -> None:
        self._world.record()


class Failing:
    """Counts lost once by the left encoder, and counters that stop: the left one, or both."""

    def __init__(self, both: bool) -> None:
        self.both = both
        self.fixed: Any = None
        self.lost = False

    def __call__(self, world: SimulatedWorld, frame: SensorFrame) -> SensorFrame:
        now, sample = frame.time_us * 1e-6, frame.encoder
        assert sample is not None
        if now >= LOST_AT and not self.lost:
            world.suite.encoder.left.lose(LOST)
            self.lost = True
        if now < DEAD_FROM:
            return frame
        self.fixed = self.fixed or sample
        if self.both:
            return frame._replace(encoder=self.fixed._replace(time_us=frame.time_us))
        left = {name: getattr(self.fixed, name) for name in sample._fields if name.startswith("left")}
        return frame._replace(encoder=sample._replace(**left))


class FlightResult(NamedTuple):
    flight: Flight
    boot_share: float
    capacity: float


def flight_with_errors(
    vehicle: str,
    offset_sigmas: float,
    boot_share: float,
    both_dead: bool | None,
    scenario: Scenario = CALM_AIR,
) -> FlightResult:
    """A circuit with the current sensor's zero wrong, a battery that is not full, and encoders that fail.

    ``both_dead`` None leaves the encoders whole. The scale errors of the power sensor are left out: what a
    calibration leaves of them goes into the energy.
    """
    log, items = MemoryLog(), load_mission("circuit")
    spec = load_vehicle(vehicle)
    sensor = spec.sections["power_sensor"]
    wrong = sensor.current_zero + offset_sigmas * sensor.current_zero_sigma * sensor.current_sensitivity
    exact = {"divider_sigma": 0.0, "current_scale_sigma": 0.0, "current_zero_sigma": 0.0}
    spec.sections["power_sensor"] = sensor._replace(current_zero=wrong, **exact)
    world = SimulatedWorld(spec, scenario, log.publish)
    world.plant.y[world.plant.layout.charge] = (1.0 - boot_share) * spec.battery.capacity
    autopilot = Autopilot(load_flight_vehicle(vehicle), items, log.publish)
    in_air = world if both_dead is None else ErringWorld(world, Failing(both_dead))
    fly(in_air, autopilot, scripted_start())
    return FlightResult(Flight(log, items), boot_share, spec.battery.capacity)


@pytest.fixture(scope="module")
def raven() -> FlightResult:
    return flight_with_errors(RAVEN, 2.0, 0.6, both_dead=False)


@pytest.fixture(scope="module")
def arizona() -> FlightResult:
    return flight_with_errors(ARIZONA, -2.0, 0.8, both_dead=True)


def true_crossings(flight: Flight) -> Any:
    """Times (s) at which the true mean angle rises through the middle of the bottom and the tops around it."""
    wing = flight.columns(truth_topics.WING)
    time = wing["time_us"] * 1e-6
    fine = np.arange(time[0], time[-1], 2.5e-4)
    angle = CubicSpline(time, 0.5 * (wing["angle_left"] + wing["angle_right"]))(fine)
    tops, bottoms = find_peaks(angle, prominence=0.1)[0], find_peaks(-angle, prominence=0.1)[0]
    crossings = []
    for bottom in bottoms[(bottoms > tops[0]) & (bottoms < tops[-1])]:
        after = np.searchsorted(tops, bottom)
        middle = 0.5 * angle[bottom] + 0.25 * (angle[tops[after]] + angle[tops[after - 1]])
        crossings.append(fine[bottom + np.argmax(angle[bottom : tops[after] + 1] >= middle)])
    return np.array(crossings)


class StrokeErrors(NamedTuple):
    time: Any
    """s; (n,) of the wing states within true strokes"""
    phase_deg: Any
    """(n,) measured less true; the true phase runs in equal times from crossing to crossing"""
    frequency: Any
    """(n,) -; relative"""


def with_valid_encoders(flight: Flight) -> dict[str, Any]:
    """Columns of the wing states that perfect counters on the true wings would have given."""
    true = flight.columns(truth_topics.WING)
    state, states = wing_angle.State(), []
    gains = load_flight_vehicle(RAVEN).gains.wing_angle
    left, right = (np.floor(true[f"angle_{side}"] * 2000.0 / math.tau).tolist() for side in ("left", "right"))
    for time_us, *counts in zip(true["time_us"].tolist(), left, right, strict=True):
        state, message = wing_angle.step(gains, state, Counts(time_us, *counts))
        states.append(message)
    return {name: np.array([message[i] for message in states]) for i, name in enumerate(states[0]._fields)}


def stroke_errors(flight: Flight, stated: Mapping[str, Any] | None = None) -> StrokeErrors:
    """Of every wing state from the second true stroke on since the wings began to beat, while they beat."""
    wing, crossings = stated or flight.columns(topics.WING), true_crossings(flight)
    time = wing["time_us"] * 1e-6
    at = np.searchsorted(crossings, time, side="right") - 1
    periods = np.diff(crossings)
    inside = (at >= 2) & (at < len(periods))
    inside[inside] &= (np.maximum(periods[at[inside]], periods[at[inside] - 1])) < 0.7
    time, at = time[inside], at[inside]
    true = 360.0 * (time - crossings[at]) / periods[at]
    error = (np.degrees(wing["phase"][inside]) - true + 180.0) % 360.0 - 180.0
    return StrokeErrors(time, error, wing["frequency"][inside] * periods[at] - 1.0)


def en_route_phase(flight: Flight) -> tuple[float, float]:
    """When the mission's first HOLD began and ended (s)."""
    index = next(i for i, item in enumerate(flight.mission) if item.kind == ItemKind.HOLD)
    navigation = flight.columns(topics.NAVIGATION)
    recording = (navigation["item"] == index) & (navigation["stage"] == Stage.EN_ROUTE)
    begin, end = navigation["time_us"][recording][[0, -1]] * 1e-6
    return float(begin), float(end)


def check_energy(recording: FlightResult) -> None:
    measured, true = recording.flight.energy()
    assert true > 1000.0
    assert measured == pytest.approx(true, rel=0.01)


def check_battery(recording: FlightResult) -> None:
    """Within 3 % of what the battery holds, from a second after boot to the end."""
    power, wing = recording.flight.columns(topics.POWER), recording.flight.columns(truth_topics.WING)
    drawn = np.interp(power["time_us"], wing["time_us"], np.cumsum(wing["current"]) * 0.005)
    true = recording.boot_share - drawn / recording.capacity
    assert np.abs(power["battery_remaining"] - true)[100:].max() < 0.03


def test_energy_of_a_servo_drive_is_within_one_per_cent(raven: FlightResult) -> None:
    """GIVEN PWM, ten bits and a zero 2 sigma off THEN the energy is right: the zero was learned before arming."""
    check_energy(raven)
    assert raven.flight.of(topics.POWER)[-1].current_zero == pytest.approx(0.02, abs=0.003)


def test_energy_of_a_motor_drive_is_within_one_per_cent(arizona: FlightResult) -> None:
    check_energy(arizona)
    assert arizona.flight.of(topics.POWER)[-1].current_zero == pytest.approx(-0.04, abs=0.006)
    assert arizona.flight.of(topics.POWER)[-1].clipped == 0


@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("seed", [4, 5, 6])
def test_energy_in_gusts_is_within_one_per_cent(vehicle: str, seed: int) -> None:
    gusts = Scenario(seed=seed, wind_speed=3.0, wind_from=1.0, turbulence="small_uav_light")
    check_energy(flight_with_errors(vehicle, 2.0, 0.8, both_dead=None, scenario=gusts))


def test_a_battery_not_full_at_boot_is_known(raven: FlightResult, arizona: FlightResult) -> None:
    check_battery(raven)
    check_battery(arizona)


def test_the_batterys_resistance_is_measured(raven: FlightResult, arizona: FlightResult) -> None:
    for recording in (raven, arizona):
        assert recording.flight.of(topics.POWER)[-1].resistance == pytest.approx(0.06, rel=0.05)


def test_energy_per_stroke_is_the_mean_powers(raven: FlightResult) -> None:
    """GIVEN a hold THEN the strokes' energies add up to what was drawn in it."""
    begin, end = en_route_phase(raven.flight)
    power = raven.flight.columns(topics.POWER)
    inside = (power["time_us"] > begin * 1e6) & (power["time_us"] < end * 1e6)
    energy, stroke = power["energy"][inside], power["energy_per_stroke"][inside]
    # A new stroke's energy is told with the burst in which the next one began.
    stated = np.flatnonzero(np.diff(stroke)) + 1
    assert len(stated) > 15
    assert stroke[stated[1:]].sum() == pytest.approx(energy[stated[-1]] - energy[stated[0]], rel=0.02)


def test_phase_and_frequency_in_a_steady_flight(raven: FlightResult) -> None:
    """GIVEN a hold THEN the phase is within 2 degrees and the frequency within 1 % of the true wings'."""
    begin, end = en_route_phase(raven.flight)
    errors = stroke_errors(raven.flight)
    steady = (errors.time > begin + 3.0) & (errors.time < end)
    assert steady.sum() > 1000
    assert np.percentile(np.abs(errors.phase_deg[steady]), 99) < 2.0
    assert np.percentile(np.abs(errors.frequency[steady]), 99) < 0.01


@pytest.mark.parametrize("vehicle", ["raven", "arizona"])
def test_phase_and_frequency_over_the_flight(vehicle: str, request: pytest.FixtureRequest) -> None:
    """Climbs, turns and throttle changes too, until the encoders fail: strokes that differ from one to the next."""
    errors = stroke_errors(request.getfixturevalue(vehicle).flight)
    good = errors.time < DEAD_FROM
    assert np.median(np.abs(errors.phase_deg[good])) < 0.5
    assert np.percentile(np.abs(errors.phase_deg[good]), 95) < 2.0
    assert np.percentile(np.abs(errors.frequency[good]), 90) < 0.01


def test_missed_counts_are_found_in_flight(raven: FlightResult) -> None:
    wing, true = raven.flight.columns(topics.WING), raven.flight.columns(truth_topics.WING)
    when = raven.flight.event_time(f"encoder re-zeroed at its index: {LOST} counts missed, {LOST} since boot")
    assert LOST_AT <= when < LOST_AT + 0.5
    after = (wing["time_us"] > (when + 0.1) * 1e6) & (wing["time_us"] < DEAD_FROM * 1e6)
    angle = np.interp(wing["time_us"][after], true["time_us"], true["angle_left"])
    assert np.abs(wing["angle_left"][after] - angle).max() < 0.01


def test_a_dead_encoder_costs_neither_phase_nor_attitude(raven: FlightResult) -> None:
    """GIVEN the left encoder dead THEN it is said at once, frequency and phase stay, and the flight lands.

    Strokes differ from one to the next here, on the way down: the measure is what two good encoders would have told.
    """
    when = raven.flight.event_time("left encoder rejected: stuck or reversed")
    assert DEAD_FROM <= when < DEAD_FROM + 0.5
    flight = raven.flight
    one, two = stroke_errors(flight), stroke_errors(flight, with_valid_encoders(flight))
    for errors, bound in (("phase_deg", 0.5), ("frequency", 0.001)):
        ours, best = (
            np.percentile(np.abs(getattr(each, errors)[(each.time > when + 1.0) & (each.time < 86.0)]), (50, 90))
            for each in (one, two)
        )
        assert np.all(ours < best + bound), (errors, ours, best)
    check_landed(flight)


def test_without_encoders_the_commanded_frequency_times_the_averages(arizona: FlightResult) -> None:
    """GIVEN both encoders dead THEN flapping is told at the commanded frequency, and the attitude holds."""
    wing, flap = arizona.flight.columns(topics.WING), arizona.flight.columns(topics.FLAP)
    dead = (wing["valid_left"] == 0) & (wing["valid_right"] == 0)
    assert dead.any()
    assert wing["time_us"][dead][0] * 1e-6 < DEAD_FROM + 1.5
    asked = np.interp(wing["time_us"][dead] - 5000, flap["time_us"], flap["frequency"])
    flapping = wing["flapping"][dead] == 1
    assert flapping.mean() > 0.5
    assert np.allclose(wing["frequency"][dead][flapping], asked[flapping])
    check_landed(arizona.flight)


def check_landed(flight: Flight) -> None:
    roll, pitch = flight.attitude_error()
    assert np.degrees(roll) < 2.0
    assert np.degrees(pitch) < 2.0
    touchdown = flight.touchdown()
    assert 0.0 < touchdown.sink < 2.0
    assert abs(np.degrees(touchdown.bank)) < 30.0
