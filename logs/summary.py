"""Flight metrics of a log: altitude hold, energy, flapping, estimates, touchdown.

Where the log carries the simulated world's truth, errors are against it; otherwise they are against the flight
computer's own estimate, and ``against_truth`` is False.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from avionics.messages import Mode, Stage
from logs.columns import Columns
from logs.reader import Log
from sim_bridge import topics as truth_topics
from wingbeat.rotation_arrays import euler_from_quaternions
from wingbeat.topic import Topic

Array = NDArray[np.float64]

HOLD_AT_LEAST = 5.0
"""s; minimum duration of constant setpoints en route that count as a hold"""
CAPTURE_ALTITUDE = 1.0
"""m; altitude error below which a hold is captured"""
CAPTURE_HEADING = 0.15
"""rad; heading error below which a hold is captured, as in the flight computers"""


class Touchdown(NamedTuple):
    """First ground contact of any part."""

    time: float
    """s; since boot"""
    sink: float
    """m/s; positive down"""
    speed: float
    """m/s; over ground"""
    bank: float
    """rad; right wing down is positive"""
    pitch: float
    """rad; nose up is positive"""


class AltitudeHold(NamedTuple):
    """Altitude and heading hold, from the first capture to its end."""

    start: float
    """s; since boot, start of the constant setpoints"""
    settling: float
    """s; from ``start`` to the capture of altitude and heading"""
    duration: float
    """s; from capture to the end"""
    altitude_rms: float
    """m; RMS error between setpoint and flown altitude"""
    heading_rms: float
    """rad; RMS error between setpoint and flown heading"""


class EstimateError(NamedTuple):
    """RMS error of the estimates against the truth between launch and touchdown."""

    roll: float
    """rad"""
    pitch: float
    """rad"""
    yaw: float
    """rad"""
    altitude: float
    """m"""
    airspeed: float
    """m/s"""


class FlightSummary(NamedTuple):
    """Key figures of a flight; None if the log does not contain the data."""

    against_truth: bool
    """-; True if errors are against the truth of the simulated world"""
    log_duration: float
    """s; from the first to the last message"""
    launch: float | None
    """s; since boot"""
    airtime: float | None
    """s; from launch to touchdown, or to the end of the log"""
    hold: AltitudeHold | None
    """the longest hold"""
    highest: float | None
    """m; above the altitude at boot"""
    distance: float | None
    """m; along the ground track"""
    airspeed: float | None
    """m/s; mean in the air"""
    frequency: float | None
    """Hz; mean flapping frequency while flapping"""
    energy: float | None
    """J; drawn in the air"""
    power: float | None
    """W; mean in the air"""
    manoeuvres: int
    """-; number of identification inputs in the flight"""
    estimate: EstimateError | None
    """errors of the flight computer's estimates; None without truth"""
    touchdown: Touchdown | None
    """first contact with the ground; None without truth, or if the flight ended airborne"""
    landed: float | None
    """s; since boot, when the flight computer detected the landing, several seconds after the vehicle came to rest"""


class _Flight(NamedTuple):
    tables: dict[str, Columns]
    launch: float | None
    end: float | None

    def get(self, topic: Topic[Any]) -> Columns | None:
        return self.tables.get(topic.name)

    def in_air(self, topic: Topic[Any]) -> tuple[Columns, NDArray[np.bool_]] | None:
        """Return a topic with the mask of its samples in the air; None without such samples."""
        columns = self.get(topic)
        if columns is None or self.launch is None or self.end is None:
            return None
        inside = (columns.time >= self.launch) & (columns.time <= self.end)
        return (columns, inside) if inside.any() else None


NEEDED = (
    topics.ATTITUDE, topics.POWER, topics.WING, topics.AIR_DATA, topics.ALTITUDE, topics.POSITION,
    topics.NAVIGATION, topics.ALTITUDE_LOOP, topics.HEADING_LOOP, topics.EXCITATION, truth_topics.STATE,
)  # fmt: skip


def summarize(log: Log) -> FlightSummary:
    """Summarize a flight.

    Raises:
        InputError: a part of the file is damaged.
    """
    present = [topic.name for topic in NEEDED if log.is_native(topic)]
    return summary_of(log.tables(present), log.duration)


def summary_of(tables: dict[str, Columns], duration: float) -> FlightSummary:
    """Summarize ``tables`` of the topics `NEEDED`, by their names; ``duration`` s is that of the log."""
    launch, end = _airborne(tables)
    flight = _Flight(tables, launch, end)
    truth = flight.get(truth_topics.STATE)
    return FlightSummary(
        against_truth=truth is not None,
        log_duration=duration,
        launch=launch,
        airtime=None if launch is None or end is None else end - launch,
        hold=_longest_altitude_hold(flight),
        highest=_highest(flight),
        distance=_distance(flight),
        airspeed=_mean_in_air(flight, topics.AIR_DATA, "airspeed"),
        frequency=_frequency(flight),
        energy=_energy(flight),
        power=_mean_in_air(flight, topics.POWER, "power"),
        manoeuvres=_manoeuvres(flight),
        estimate=_estimate_error(flight),
        touchdown=None if truth is None else _touchdown(truth),
        landed=_landed(flight),
    )


# --- launch and touchdown -----------------------------------------------------------------------------------


def _airborne(tables: dict[str, Columns]) -> tuple[float | None, float | None]:
    truth = tables.get(truth_topics.STATE.name)
    if truth is not None:
        return _contact_times(truth)
    navigation = tables.get(topics.NAVIGATION.name)
    if navigation is None:
        return None, None
    stage, time = navigation["stage"], navigation.time
    flying = (stage >= Stage.CLIMB_OUT) & (stage < Stage.LANDED)
    if not flying.any():
        return None, None
    return float(time[flying][0]), float(time[flying][-1])


def _contact_times(truth: Columns) -> tuple[float | None, float | None]:
    """Launch, and touchdown or the last sample."""
    first, last = _air_indices(truth)
    if first is None or last is None:
        return None, None
    return float(truth.time[first]), float(truth.time[last])


def _air_indices(truth: Columns) -> tuple[int | None, int | None]:
    """First sample in the air, and the last before the first contact after it."""
    free = np.flatnonzero(truth["on_ground"] == 0)
    if not len(free):
        return None, None
    touching = np.flatnonzero(truth["on_ground"][free[0] :] != 0)
    last = int(free[0] + touching[0] - 1) if len(touching) else len(truth.time) - 1
    return int(free[0]), last


def _touchdown(truth: Columns) -> Touchdown | None:
    _, last = _air_indices(truth)
    if last is None or last >= len(truth.time) - 1:
        return None
    roll, pitch, _ = _euler(truth, slice(last, last + 1))
    speed = float(np.hypot(truth["v_north"][last], truth["v_east"][last]))
    return Touchdown(
        float(truth.time[last + 1]), float(truth["v_down"][last]), speed, float(roll[0]), float(pitch[0])
    )


def _landed(flight: _Flight) -> float | None:
    navigation = flight.get(topics.NAVIGATION)
    if navigation is None or flight.launch is None:
        return None
    selected = np.flatnonzero((navigation["stage"] == Stage.LANDED) & (navigation.time > flight.launch))
    return float(navigation.time[selected[0]]) if len(selected) else None


# --- the hold ------------------------------------------------------------------------------------------------


def _longest_altitude_hold(flight: _Flight) -> AltitudeHold | None:
    navigation = flight.get(topics.NAVIGATION)
    if navigation is None:
        return None
    spans = _constant_spans(navigation)
    holds = [one for start, end in spans if (one := _altitude_hold(flight, navigation, start, end)) is not None]
    return max(holds, key=lambda one: one.duration, default=None)


def _constant_spans(navigation: Columns) -> list[tuple[int, int]]:
    """First and last sample of every stretch en route with unmoved setpoints and closed loops."""
    steady = (navigation["stage"] == Stage.EN_ROUTE) & (navigation["frozen"] == 0)
    steady &= np.isin(navigation["mode"], (Mode.AUTO, Mode.ALTITUDE_HOLD))
    same = (np.diff(navigation["altitude_setpoint"]) == 0) & (np.diff(navigation["heading_setpoint"]) == 0)
    same &= np.diff(navigation["item"]) == 0
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (same & steady[:-1] & steady[1:]).astype(int), [0]))))
    spans = [(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]
    time = navigation.time
    return [(start, end) for start, end in spans if time[end] - time[start] >= HOLD_AT_LEAST]


def _altitude_hold(flight: _Flight, navigation: Columns, start: int, end: int) -> AltitudeHold | None:
    begin, finish = float(navigation.time[start]), min(float(navigation.time[end]), flight.end or math.inf)
    wanted = float(navigation["altitude_setpoint"][start]), float(navigation["heading_setpoint"][start])
    flown = _flight_path(flight)
    if flown is None:
        return None
    time, altitude, course = flown
    inside = (time >= begin) & (time <= finish)
    altitude_error = wanted[0] - altitude[inside]
    heading_error = _wrapped(wanted[1] - course[inside])
    captured = (np.abs(altitude_error) < CAPTURE_ALTITUDE) & (np.abs(heading_error) < CAPTURE_HEADING)
    if not captured.any():
        return None
    first = int(np.argmax(captured))
    since = float(time[inside][first])
    return AltitudeHold(
        begin, since - begin, finish - since, _rms(altitude_error[first:]), _rms(heading_error[first:])
    )


def _flight_path(flight: _Flight) -> tuple[Array, Array, Array] | None:
    """Time (s), altitude above the altitude at boot (m) and course over ground (rad) on one time base."""
    truth = flight.get(truth_topics.STATE)
    if truth is not None:
        return truth.time, truth["down"][0] - truth["down"], np.arctan2(truth["v_east"], truth["v_north"])
    altitude, heading = flight.get(topics.ALTITUDE), flight.get(topics.HEADING_LOOP)
    if altitude is None or heading is None:
        return None
    course = np.interp(altitude.time, heading.time, np.unwrap(heading["heading"]))
    return altitude.time, altitude["altitude"], course


# --- the rest -------------------------------------------------------------------------------------------------


def _highest(flight: _Flight) -> float | None:
    flown = _flight_path(flight)
    return None if flown is None or flight.launch is None else float(np.max(flown[1]))


def _distance(flight: _Flight) -> float | None:
    selected = flight.in_air(truth_topics.STATE) or flight.in_air(topics.POSITION)
    if selected is None:
        return None
    columns, inside = selected
    return float(np.sum(np.hypot(np.diff(columns["north"][inside]), np.diff(columns["east"][inside]))))


def _mean_in_air(flight: _Flight, topic: Topic[Any], name: str) -> float | None:
    selected = flight.in_air(topic)
    return None if selected is None else float(np.mean(selected[0][name][selected[1]]))


def _frequency(flight: _Flight) -> float | None:
    selected = flight.in_air(topics.WING)
    if selected is None:
        return None
    columns, inside = selected
    flapping = columns["frequency"][inside & (columns["flapping"] == 1)]
    return float(np.mean(flapping)) if len(flapping) else None


def _energy(flight: _Flight) -> float | None:
    selected = flight.in_air(topics.POWER)
    if selected is None:
        return None
    energy = selected[0]["energy"][selected[1]]
    return float(energy[-1] - energy[0])


def _manoeuvres(flight: _Flight) -> int:
    columns = flight.get(topics.EXCITATION)
    if columns is None:
        return 0
    return len(np.unique(columns["manoeuvre"][columns["active"] == 1]))


def _estimate_error(flight: _Flight) -> EstimateError | None:
    truth, selected = flight.get(truth_topics.STATE), flight.in_air(topics.ATTITUDE)
    altitude, air = flight.in_air(topics.ALTITUDE), flight.in_air(topics.AIR_DATA)
    if truth is None or selected is None or altitude is None or air is None:
        return None
    attitude, inside = selected
    roll, pitch, yaw = (
        _rms(_wrapped(attitude[name][inside] - np.interp(attitude.time[inside], truth.time, np.unwrap(true))))
        for name, true in zip(("roll", "pitch", "yaw"), _euler(truth, slice(None)), strict=True)
    )
    return EstimateError(
        roll=roll,
        pitch=pitch,
        yaw=yaw,
        altitude=_difference(altitude, "altitude", truth.time, truth["down"][0] - truth["down"]),
        airspeed=_difference(air, "airspeed", truth.time, truth["airspeed"]),
    )


def _difference(selected: tuple[Columns, NDArray[np.bool_]], name: str, time: Array, true: Array) -> float:
    columns, inside = selected
    return _rms(columns[name][inside] - np.interp(columns.time[inside], time, true))


def _euler(truth: Columns, part: slice) -> tuple[Array, Array, Array]:
    """Roll, pitch and yaw (rad) of r_ned_from_frd."""
    return euler_from_quaternions(*(truth[f"quaternion_{axis}"][part] for axis in "wxyz"))


def _wrapped(angle: Any) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi, np.float64)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
