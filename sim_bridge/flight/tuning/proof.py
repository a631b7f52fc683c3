"""The proof in flight: the same mission in the same gusts with the gains before and after, in numbers.

Errors are against the simulated world's truth; windows begin `SETTLED` after a hold's setpoints, so that both sets of
gains are measured over the same span of their flights.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.gains import FlightGains
from avionics.guidance.mission import ItemKind, Mission, MissionItem
from avionics.messages import Stage
from avionics.missions.script import scripted_start
from avionics.vehicles import FlightVehicle
from sim_bridge import topics as truth_topics
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError
from wingbeat.topic import Topic

SETTLED, MEASURED = 8.0, 18.0
"""s; time from the start of a hold to the evaluation window, and its length"""
HEIGHT, STEP, TURN = 20.0, 3.0, math.radians(90.0)
"""m, m, rad: altitude of the first hold, and steps of altitude and heading to the second"""
MISSION: Mission = (
    MissionItem(ItemKind.TAKEOFF, altitude=HEIGHT),
    MissionItem(ItemKind.HOLD, altitude=HEIGHT, heading=0.0, duration=SETTLED + MEASURED + 1.0),
    MissionItem(ItemKind.HOLD, altitude=HEIGHT + STEP, heading=TURN, duration=SETTLED + MEASURED + 1.0),
)
SCENARIO = Scenario(seed=1, wind_speed=2.0, turbulence="light", duration=120.0)
"""light wind with light gusts, as a disturbance"""
_KEPT = {
    topic.name
    for topic in (topics.NAVIGATION, topics.PITCH_LOOP, topics.ACTUATORS, topics.ALTITUDE_LOOP, topics.POWER)
} | {truth_topics.STATE.name}

Array = NDArray[np.float64]


class FlightQuality(NamedTuple):
    """Quality figures of one flight."""

    completed_legs: int
    """-; number of evaluated windows"""
    airtime: float
    """s; total duration of the windows"""
    touched: bool
    """whether the vehicle touched the ground before their end"""
    altitude_rms: float
    """m; setpoint minus true altitude"""
    heading_rms: float
    """rad; setpoint minus true course over ground"""
    pitch_rms: float
    """rad; pitch setpoint minus estimated pitch"""
    roll_rms: float
    """rad; true bank about its mean"""
    elevator_rate: float
    """rad/s; RMS of the commanded elevator's rate"""
    rudder_rate: float
    """rad/s; RMS of the commanded rudder's rate"""
    throttle_rms: float
    """-; throttle of the climb loop about its mean"""
    power: float
    """W; electrical, mean"""


WORSE, BETTER = 1.05, 0.95
"""-; error ratios between which two flights count as equal"""
ERRORS = ("altitude_rms", "heading_rms", "pitch_rms", "roll_rms")


class Comparison(StrEnum):
    """Result of the comparison of two flights."""

    BETTER = "better"
    SAME = "same"
    WORSE = "worse"


class Proof(NamedTuple):
    """The same flight with the gains before and after."""

    before: FlightQuality
    after: FlightQuality

    @property
    def error_ratio(self) -> float:
        """-; geometric mean of the four tracking error (`ERRORS`) ratios, after over before."""
        ratios = [getattr(self.after, name) / getattr(self.before, name) for name in ERRORS]
        return math.exp(sum(map(math.log, ratios)) / len(ratios))

    @property
    def comparison(self) -> Comparison:
        """Compare the flights: first ground contact and completed legs, then errors."""
        completed = [(not flight.touched, flight.completed_legs) for flight in self]
        if completed[0] != completed[1]:
            return Comparison.BETTER if completed[1] > completed[0] else Comparison.WORSE
        ratio = self.error_ratio
        return Comparison.WORSE if ratio > WORSE else Comparison.BETTER if ratio < BETTER else Comparison.SAME


class _Memory:
    """Recorder of the evaluated topics that detects the end of the mission."""

    def __init__(self) -> None:
        self._rows: dict[str, list[Any]] = defaultdict(list)
        self.over = False

    def publish(self, topic: Topic[Any], message: Any) -> None:
        if topic.name in _KEPT:
            self._rows[topic.name].append(message)
        if topic is topics.NAVIGATION and message.item >= len(MISSION):
            self.over = True

    def column(self, topic: Topic[Any], name: str) -> Array:
        """Return a field (n,); the time in s."""
        values = np.array([getattr(row, name) for row in self._rows[topic.name]], dtype=np.float64)
        return values * 1e-6 if name == "time_us" else values


class _World(SimulatedWorld):
    """World that ends with the mission, because the landing is not evaluated."""

    def __init__(self, vehicle: SimulatedVehicle, scenario: Scenario, memory: _Memory) -> None:
        super().__init__(vehicle, scenario, memory.publish)
        self._memory = memory

    @property
    def finished(self) -> bool:
        return self._memory.over or super().finished


def fly_quality(
    world: SimulatedVehicle, vehicle: FlightVehicle, gains: FlightGains, scenario: Scenario = SCENARIO
) -> FlightQuality:
    """Fly `MISSION` with these gains in one process.

    Raises:
        InputError: an invalid scenario or vehicle, or a flight that did not reach its first hold.
    """
    memory = _Memory()
    autopilot = Autopilot(vehicle._replace(gains=gains), MISSION, memory.publish)
    fly(_World(world, scenario, memory), autopilot, scripted_start())
    return _measured(memory)


def _measured(memory: _Memory) -> FlightQuality:
    spans = _windows(memory)
    if not spans:
        raise InputError(f"the flight did not come to its first hold at {HEIGHT:g} m")
    truth, time = _chosen(memory, truth_topics.STATE, spans), memory.column(truth_topics.STATE, "time_us")
    asked_altitude, asked_heading = (
        _level_flight(memory, name, truth("time_us")) for name in ("altitude_setpoint", "heading_setpoint")
    )
    altitude = memory.column(truth_topics.STATE, "down")[0] - truth("down")
    course = np.arctan2(truth("v_east"), truth("v_north"))
    roll, actuators = _roll(truth), _chosen(memory, topics.ACTUATORS, spans)
    on_ground = memory.column(truth_topics.STATE, "on_ground")
    launched = int(np.argmin(on_ground))
    return FlightQuality(
        len(spans),
        float(sum(end - begin for begin, end in spans)),
        bool(np.any(on_ground[launched:][time[launched:] <= spans[-1][1]])),
        _rms(asked_altitude - altitude),
        _rms((asked_heading - course + np.pi) % (2.0 * np.pi) - np.pi),
        _rms(_chosen(memory, topics.PITCH_LOOP, spans)("pitch_error")),
        float(np.std(roll)),
        _rms(_rate(actuators, "elevator")),
        _rms(_rate(actuators, "rudder")),
        float(np.std(_chosen(memory, topics.ALTITUDE_LOOP, spans)("throttle"))),
        float(np.mean(_chosen(memory, topics.POWER, spans)("power"))),
    )


def _windows(memory: _Memory) -> list[tuple[float, float]]:
    """Return start and end (s) of the evaluated window of each hold."""
    time, item = memory.column(topics.NAVIGATION, "time_us"), memory.column(topics.NAVIGATION, "item")
    en_route = memory.column(topics.NAVIGATION, "stage") == Stage.EN_ROUTE
    found = []
    for i, wanted in enumerate(MISSION):
        inside = time[en_route & (item == i)]
        if wanted.kind == ItemKind.HOLD and len(inside) and inside[-1] >= inside[0] + SETTLED + MEASURED - 0.1:
            found.append((float(inside[0]) + SETTLED, float(inside[0]) + SETTLED + MEASURED))
    return found


def _chosen(memory: _Memory, topic: Topic[Any], spans: list[tuple[float, float]]) -> Callable[[str], Array]:
    """Return a function that selects the samples of a topic's fields within the windows."""
    time = memory.column(topic, "time_us")
    inside = np.any([(time >= begin) & (time <= end) for begin, end in spans], axis=0)
    return lambda name: memory.column(topic, name)[inside]


def _level_flight(memory: _Memory, name: str, times: Array) -> Array:
    """Return (n,) setpoints of the navigation at ``times`` in s."""
    places = np.searchsorted(memory.column(topics.NAVIGATION, "time_us"), times, side="right") - 1
    return np.asarray(memory.column(topics.NAVIGATION, name)[np.maximum(places, 0)])


def _roll(truth: Callable[[str], Array]) -> Array:
    w, x, y, z = (truth(f"quaternion_{axis}") for axis in "wxyz")
    return np.asarray(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))


def _rate(actuators: Callable[[str], Array], name: str) -> Array:
    """Return the derivative of a commanded angle in rad/s, without the gap between two windows."""
    steps = np.diff(actuators("time_us"))
    rates = np.diff(actuators(name)) / steps
    return np.asarray(rates[steps < 0.1])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
