"""The flight path of a log: `wingbeat identify FLIGHT.mcap path`.

The attitude in a log is a filter's estimate from the IMU whose errors are estimated: taken as measured, it would give
the filter's own bias estimates, with intervals that do not contain its slow error. So the errors come from the ground
velocities of the GPS (`estimators.gps_aided`). A log without these gives the motion by its attitude, and numbers only
if that is a sensor's own, with a sigma of 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from avionics import topics
from logs.identification.data.experiment import Experiment, longest_run, runs
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import excited
from logs.identification.data.resampling import bridged, cut, whole_records
from logs.identification.estimators.flight_path import FlightPath, PathOptions, reconstruct
from logs.identification.estimators.gps_aided import (
    ATTITUDE,
    AidedFit,
    AidedFlight,
    aided_fit,
    aided_result,
    ned_from_frd,
)
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.rigid_body import INPUTS, WINDS, SensorPositions
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.topic_table import LONGEST_GAP, ColumnSource, TopicTable, whole_flight
from sim_bridge import topics as truth
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

QUATERNION = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")

FLIGHT_SPEED, SPEED_QUANTILE = 0.5, 0.9
"""-; fraction of this quantile of the speed, below which it is on the ground"""
LEAD = 5.0
"""s; after a launch, left out"""
MAX_PAUSE = 2.0
"""s; without a fix, at which the segment ends"""
MIN_DURATION, MAX_DURATION = 10.0, 180.0
"""s; of a segment with fixes"""
MAX_AGE = 0.4
"""s; largest age of a fix that is tried"""
PIECE, MIN_PIECE, MAX_PIECES = 30.0, 5.0, 8
"""s; length of a record without maneuvers, in which the wind is taken as steady; shortest; -; number"""
UNUSED = ("north", "east")
"""without a sideslip sensor an attitude filter's small error of bank is a large one of the wind"""
TITLE = "flight path"

register({
    "attitude_filter": Entry(
        "only the attitude filter of the same IMU determines it",
        "Without GPS velocities the only attitude is estimated from the same IMU.",
        "record the velocities of the GPS",
    ),
    "wind_not_estimated": Entry(
        "without a sideslip sensor the bank error would determine it",
        "The wind of a log is not estimated.",
    ),
    "by_attitude": Entry("motion by the recorded attitude, as {reason}", "The log has no velocities of the GPS."),
})  # fmt: skip


class PathResult(NamedTuple):
    """Flight path of a log."""

    result: EstimationResult
    records: tuple[str, ...]
    """-; what it was taken from"""
    spans: tuple[tuple[float, float], ...]
    """s; start and end of each record, since boot"""
    by_velocities: tuple[AidedFlight, AidedFit] | None = None
    by_attitude: tuple[tuple[Experiment, ...], FlightPath] | None = None


def identify_path(source: ColumnSource, aircraft: Aircraft) -> PathResult:
    """Errors of the IMU and the motion, by the velocities of the GPS or, without them, by the attitude.

    Raises:
        InputError: the log lacks the IMU, or both GPS and airspeed, or has no flight that is long enough.
    """
    flight = whole_flight(source, "flight", aircraft.imu)
    try:
        aided = aided_flight(source, flight, aircraft)
    except InputError as reason:
        return _by_attitude(flight, aircraft, str(reason), _is_filtered(source))
    fit = aided_fit(aided)
    if fit is None:
        raise InputError("flight path: the path by IMU and GPS does not converge; fly longer, with turns")
    first, last = (float(aided.time[aided.at[place]]) for place in (0, -1))
    result = aided_result(aided, fit)._replace(title=TITLE)
    return PathResult(result, (f"flight, {first:.1f} s to {last:.1f} s",), ((first, last),), (aided, fit))


def _is_filtered(source: ColumnSource) -> bool:
    """Whether the attitude has an error of its own, or none is recorded."""
    try:
        return bool(np.any(np.asarray(source.columns(topics.ATTITUDE)["tilt_sigma"], dtype=np.float64) != 0.0))
    except (KeyError, InputError):
        return True


def _by_attitude(flight: Experiment, aircraft: Aircraft, reason: str, filtered: bool) -> PathResult:
    """The motion by the recorded attitude, without numbers if that is ``filtered``; ``reason``: why not by GPS.

    Raises:
        InputError: the log has no airspeed, no flight that is long enough, or determines no path.
    """
    if "airspeed" not in flight.signals:
        raise InputError(f"a flight path needs velocities of the GPS ({reason}) or the airspeed (/main/air_data)")
    flight = flight._replace(signals={name: one for name, one in flight.signals.items() if name not in UNUSED})
    records = _pieces(flight)
    positions = SensorPositions(imu=(aircraft.imu_x, 0.0, aircraft.imu_z))
    path = reconstruct(records, PathOptions(positions=positions))
    if path.result.status != "converged":
        raise InputError(f"flight path: {path.result.withheld[-1].text}; by the attitude, as {reason}")
    result = _without_filter_errors(path.result, reason, filtered)._replace(title=TITLE)
    names = tuple(f"{one.name}, {one.time[0]:.1f} s to {one.time[-1]:.1f} s" for one in records)
    spans = tuple((float(one.time[0]), float(one.time[-1])) for one in records)
    return PathResult(result, names, spans, by_attitude=(records, path))


def _without_filter_errors(result: EstimationResult, reason: str, filtered: bool) -> EstimationResult:
    """The result without numbers that rest on an attitude filter."""
    findings = [one for one in result.findings if one.subject not in WINDS]
    findings += [Finding("wind_not_estimated", "withheld", name) for name in WINDS]
    findings.insert(0, Finding("by_attitude", "info", details={"reason": reason}))
    if not filtered:
        return result._replace(findings=tuple(findings))
    lost = [Finding("attitude_filter", "withheld", one.name) for one in result.estimates]
    return result._replace(estimates=(), covariance=None, findings=(*lost, *findings))


# --- records ------------------------------------------------------------------------------------------------


def aided_flight(source: ColumnSource, flight: Experiment, aircraft: Aircraft) -> AidedFlight:
    """The longest segment of a ``flight`` with fixes throughout, after the launch.

    A fix arrives later than it was measured; at its age the integrated specific force follows it best.

    Raises:
        InputError: the log has no ground velocities of a receiver, no attitude, or no such segment.
    """
    fixes = TopicTable(source, topics.GPS, "v_north", "v_east", "v_down")
    missing = [name for name in (*INPUTS, *ATTITUDE) if name not in flight.signals]
    if missing:
        raise InputError(f"the log has no {', '.join(missing)}")
    whole = bridged(flight, (*INPUTS, *ATTITUDE), int(LONGEST_GAP / flight.step + 1e-6))
    span = _longest_segment(_usable(whole, fixes), flight.step)
    time = whole.time[span]
    inputs, attitude = (np.column_stack([whole.signals[n][span] for n in names]) for names in (INPUTS, ATTITUDE))
    velocity = np.column_stack([fixes[name] for name in ("v_north", "v_east", "v_down")])
    age = _age(time, inputs, attitude, fixes.time, velocity)
    places = np.rint((fixes.time - age - time[0]) / flight.step).astype(np.int64)
    inside = (places >= 0) & (places < len(time)) & np.append(True, np.diff(places) > 0)
    arm = (aircraft.imu_x, 0.0, aircraft.imu_z)
    return AidedFlight(time, inputs, attitude, places[inside], velocity[inside], arm)


def _usable(flight: Experiment, fixes: TopicTable) -> NDArray[np.bool_]:
    """Samples in flight with readings of the IMU and fixes close by."""
    known = np.all([np.isfinite(flight.signals[name]) for name in (*INPUTS, *ATTITUDE)], axis=0)
    ground = np.hypot(fixes.linear("v_north", flight.time), fixes.linear("v_east", flight.time))
    # The larger of both: a blocked pitot or a headwind makes one of them too small.
    speed = np.fmax(flight.signals.get("airspeed", ground), ground)
    after = np.searchsorted(fixes.time, flight.time).clip(1, len(fixes.time) - 1)
    near = fixes.time[after] - fixes.time[after - 1] < MAX_PAUSE
    near &= (flight.time >= fixes.time[0]) & (flight.time <= fixes.time[-1])
    usable: NDArray[np.bool_] = known & near & (speed > FLIGHT_SPEED * float(np.quantile(speed, SPEED_QUANTILE)))
    return usable


def _longest_segment(usable: NDArray[np.bool_], step: float) -> slice:
    segment = longest_run(usable)
    first = segment.start + int(LEAD / step)
    if (segment.stop - first) * step < MIN_DURATION:
        raise InputError(
            f"no {MIN_DURATION:g} s of flight with fixes of the GPS throughout, {LEAD:g} s after the launch"
        )
    return slice(first, int(min(segment.stop, first + MAX_DURATION / step)))


def _age(time: Array, inputs: Array, attitude: Array, arrived: Array, velocity: Array) -> float:
    """Age (s) of the fixes at arrival: that at which the unexplained changes between fixes have the least variance.

    The recorded attitude is good enough: between two fixes its error is a constant force.
    """
    step = float(time[1] - time[0])
    gained = np.cumsum(np.einsum("nij,nj->ni", ned_from_frd(attitude), inputs[:, 3:]), axis=0) * step
    inside = (arrived > time[0] + MAX_AGE) & (arrived < time[-1])
    ages = step * np.arange(int(MAX_AGE / step) + 1)
    return float(ages[np.argmin([_scatter(time, gained, arrived[inside] - age, velocity[inside]) for age in ages])])


def _scatter(time: Array, gained: Array, at: Array, velocity: Array) -> float:
    left = velocity - np.column_stack([np.interp(at, time, column) for column in gained.T])
    return float(np.sum(np.var(np.diff(left, axis=0), axis=0)))


def _pieces(flight: Experiment) -> tuple[Experiment, ...]:
    """The maneuvers with their surroundings, or pieces of the flight, without gaps."""
    try:
        records = _merged(flight, excited(flight, LEAD, LEAD))
    except InputError:
        records = _airborne(flight)
    pieces: list[Experiment] = []
    for one in records:
        try:
            pieces += whole_records(one, (*INPUTS, "airspeed"), LONGEST_GAP, MIN_PIECE)
        except InputError:
            continue
    if not pieces:
        raise InputError(f"the log has no {MIN_PIECE:g} s of flight in which the IMU and the airspeed were recorded")
    return tuple(pieces[:MAX_PIECES])


def _merged(flight: Experiment, records: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
    """The records, overlapping ones as one: a sample that counts twice makes intervals too narrow."""
    merged: list[Experiment] = []
    for one in records:
        if merged and one.time[0] <= merged[-1].time[-1]:
            first, last = np.searchsorted(flight.time, (merged[-1].time[0], one.time[-1]))
            name = f"{merged[-1].name.partition(' to ')[0]} to {one.name.rpartition(' ')[2]}"
            merged[-1] = cut(flight, slice(int(first), int(last) + 1))._replace(name=name)
        else:
            merged.append(one)
    return tuple(merged)


def _airborne(flight: Experiment) -> tuple[Experiment, ...]:
    """Pieces of the flight at an airspeed, of about `PIECE` each."""
    speed = flight.signals["airspeed"]
    known = speed[np.isfinite(speed)]
    least = FLIGHT_SPEED * float(np.quantile(known, SPEED_QUANTILE)) if len(known) else np.inf
    pieces = []
    for run in runs(np.nan_to_num(speed) > least):
        first = min(run.start + int(LEAD / flight.step), run.stop)
        parts = max(round((run.stop - first) * flight.step / PIECE), 1)
        bounds = np.linspace(first, run.stop, parts + 1).astype(int)
        pieces += [
            cut(flight, slice(int(a), int(b))) for a, b in pairwise(bounds) if (b - a) * flight.step >= MIN_PIECE
        ]
    return tuple(one._replace(name=f"piece {number}") for number, one in enumerate(pieces, 1))


# --- truth of a simulated flight ------------------------------------------------------------------------------


def imu_truths(source: ColumnSource, aircraft: Aircraft, spans: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Mean error of each rate (rad/s) and specific force (m/s^2) over the ``spans`` (s), by name of its bias.

    Scales and misalignments are included. Empty if the log is not of a simulated flight.
    """
    try:
        true = _true_inputs(source, aircraft)
    except InputError:
        return {}
    flight = whole_flight(source, "flight", aircraft.imu)
    inside = np.any([(flight.time >= begin) & (flight.time <= end) for begin, end in spans], axis=0)
    errors = {name: flight.signals[name] - np.interp(flight.time, *true[name]) for name in INPUTS}
    return {f"bias_{name}": float(np.nanmean(values[inside])) for name, values in errors.items()}


def _true_inputs(source: ColumnSource, aircraft: Aircraft) -> dict[str, tuple[Array, Array]]:
    """Time and value of the true rates and of the specific forces at the IMU's position."""
    rates = ("roll_rate", "pitch_rate", "yaw_rate")
    state = TopicTable(source, truth.STATE, "v_north", "v_east", "v_down", *QUATERNION, *rates)
    to_ned = dcms_from_quaternions(np.column_stack([state[name] for name in QUATERNION]))
    omega = np.column_stack([state[name] for name in rates])
    arm = np.array((aircraft.imu_x, 0.0, aircraft.imu_z))
    v_ned = np.column_stack([state[f"v_{axis}"] for axis in ("north", "east", "down")])
    at_imu = v_ned + np.einsum("nij,nj->ni", to_ned, np.cross(omega, arm))
    force_ned = CubicSpline(state.time, at_imu)(state.time, 1) - np.array((0.0, 0.0, STANDARD_GRAVITY))
    forces = np.einsum("nji,nj->ni", to_ned, force_ned)
    return {name: (state.time, column) for name, column in zip(INPUTS, np.hstack((omega, forces)).T, strict=True)}
