"""The flight path of a log: `wingbeat identify FLIGHT.mcap path`.

The attitude that stands in a log is a filter's, made of the very IMU that is in question: taken for a measured one it
gives the filter's own opinion of the IMU back, with intervals that know nothing of its slow error. So the errors are
those by the ground velocities of the GPS (`aided_fit`). A log without these gives the motion that its attitude tells,
and numbers only where that is a sensor's of its own, which says so by a sigma of 0: it has no error of a filter.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from avionics import topics
from logs.identification.data.contiguous_runs import runs
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuver_detection import excited
from logs.identification.data.resampling import cut, whole_records
from logs.identification.estimators.flight_path.reconstruction import Setup, reconstruct
from logs.identification.estimators.flight_path.result import METHOD, SENSORS, WHOLE, fitted_path, path_chapter
from logs.identification.estimators.flight_path.sensors import UNITS, WINDS, Places, parameter
from logs.identification.estimators.gps_aided import AidedFit, AidedFlight, aided_fit
from logs.identification.models.rigid_body import INPUTS
from logs.identification.report.document import LINE, MEASURED, MODEL, POINTS, Chapter, Plot, Series
from logs.identification.results import Array, Estimate, FitSeries, Fitted, Unidentified, estimate
from logs.identification.sources.full_flight import LONGEST_GAP, whole_flight
from logs.identification.sources.topic_table import ColumnSource
from logs.identification.sources.velocity_fixes import ANGLES, FLYING, IN_FLIGHT, LEAD, aided_flight
from wingbeat.errors import InputError

PIECE = 30.0
"""s; of flight without a manoeuvre, in which the air is taken to move steadily"""
LEAST = 5.0
"""s; a shorter piece tells little but its first states"""
MOST_PIECES = 8
UNSURE = ("north", "east")
"""not used: without a vane sideways a filter's small error of bank is a large one of the wind, in no interval"""
NO_WIND = "not looked for: without a vane sideways it would rest on the attitude filter's bank"
NO_VELOCITY = (
    "it would rest on the flight computer's own attitude, whose slow error is taken for it and in no interval"
)
ATTITUDE = "motion: by the attitude that was told, as"
VELOCITIES = "north, east and down velocities of the GPS; the flight computer's attitude serves to begin with only"
MEANS = "bias: mean over the record of what a sensor told too much, its scale and misalignment included"
ADVICE = "fly longer, with turns, or with fixes of the GPS all along"


class PathResult(NamedTuple):
    """Flight path of a log."""

    fitted: Fitted
    records: tuple[str, ...]
    """-; what it was taken from"""
    chapter: Chapter | None
    spans: tuple[tuple[float, float], ...] = ()
    """s; begin and end of each record, since boot"""


def identify_path(source: ColumnSource, aircraft: Aircraft) -> PathResult:
    """Errors of the IMU and the motion, by the velocities of the GPS or, where there are none, by the attitude told.

    Raises:
        InputError: the log lacks the IMU, or both the GPS and the airspeed, has no flight that is long enough, or
            does not tell a path.
    """
    flight = whole_flight(source, "flight", aircraft.imu)
    try:
        aided = aided_flight(source, flight, aircraft)
    except InputError as reason:
        return _by_attitude(flight, aircraft, str(reason), _by_a_filter(source))
    found = aided_fit(aided)
    if found is None:
        raise InputError(f"flight path: the path by IMU and GPS did not settle in its repetitions; {ADVICE}")
    return _by_velocities(aided, found)


def _by_velocities(flight: AidedFlight, found: AidedFit) -> PathResult:
    errors = np.sqrt(np.diag(found.covariance))
    names = [f"bias_{name}" for name in INPUTS]
    every = [estimate(name, UNITS[channel], float(value), float(error))
             for name, channel, value, error in zip(names, INPUTS, found.errors, errors, strict=True)]  # fmt: skip
    sure = [place for place, one in enumerate(every) if not _vague(one)]
    refused = tuple(_refused(one) for one in every if _vague(one))
    correlation = (found.covariance / np.outer(errors, errors))[np.ix_(sure, sure)]
    series = tuple(_fix_series(flight, found, column) for column in range(3))
    told = tuple(every[place] for place in sure)
    fitted = Fitted(METHOD, (*WHOLE, SENSORS), told, refused, correlation, series, (VELOCITIES, MEANS))
    begin, end = (float(flight.time[flight.at[place]]) for place in (0, -1))
    return PathResult(fitted, (f"flight, {begin:.1f} s to {end:.1f} s",), _drawn(flight, found), ((begin, end),))


def _vague(one: Estimate) -> bool:
    asked = parameter(one.name)
    return asked is not None and one.standard_error > asked.limit


def _refused(one: Estimate) -> Unidentified:
    return Unidentified(one.name, f"told no better than to {one.standard_error:.2g} {one.unit} (standard error)")


def _fix_series(flight: AidedFlight, found: AidedFit, column: int) -> FitSeries:
    """A velocity as the fixes told it, beside that of the path."""
    name, at = ("v_north", "v_east", "v_down")[column], flight.time[flight.at]
    time = at[0] + float(np.median(np.diff(at))) * np.arange(len(at))
    if np.max(np.abs(time - at)) > flight.step:  # some fixes did not come
        time = np.linspace(at[0], at[-1], len(at))
    values = (np.interp(time, at, one[:, column]) for one in (flight.velocity, found.told))
    return FitSeries("flight", name, "m/s", time, *values)


def _drawn(flight: AidedFlight, found: AidedFit) -> Chapter:
    """Attitude of flight computer and path, and the velocities."""
    at = flight.time[flight.at]
    plots = [
        _plot(name, "rad", at, np.unwrap(flight.attitude[flight.at, k]), found.motion[:, 3 + k], LINE)
        for k, name in enumerate(ANGLES)
    ]
    plots += [
        _plot(name, "m/s", at, flight.velocity[:, k], found.told[:, k], POINTS)
        for k, name in enumerate(("v_north", "v_east", "v_down"))
    ]
    note = "The motion that IMU and GPS agree on, beside the flight computer's attitude and the fixes."
    return Chapter("Flight path", (note,), plots=tuple(plots))


def _plot(name: str, unit: str, time: Array, measured: Array, found: Array, style: str) -> Plot:
    lines = (Series("told", time, measured, MEASURED, style), Series("reconstructed", time, found, MODEL, LINE))
    return Plot("", "time", "s", name, unit, lines)


def _by_a_filter(source: ColumnSource) -> bool:
    """Whether the attitude has an error of its own, or does not say that it has none."""
    try:
        return bool(np.any(np.asarray(source.columns(topics.ATTITUDE)["tilt_sigma"], dtype=np.float64) != 0.0))
    except (KeyError, InputError):
        return True


def _by_attitude(flight: Experiment, aircraft: Aircraft, reason: str, by_a_filter: bool) -> PathResult:
    """The motion by the attitude that was told, without numbers where that is ``by_a_filter``.

    The ``reason`` says why not by the GPS.

    Raises:
        InputError: the log has no airspeed, no flight that is long enough, or does not tell a path.
    """
    if "airspeed" not in flight.signals:
        raise InputError(f"a flight path needs velocities of the GPS ({reason}) or the airspeed (/main/air_data)")
    flight = flight._replace(signals={name: one for name, one in flight.signals.items() if name not in UNSURE})
    records = _pieces(flight)
    setup = Setup(places=Places(imu=(aircraft.imu_x, 0.0, aircraft.imu_z)), gusts=True)
    found = reconstruct(records, setup)
    if found.failure:
        raise InputError(f"flight path: {found.failure}; by the attitude, as {reason}")
    told = fitted_path(records, found, setup)
    lost = tuple(one._replace(reason=NO_WIND) if one.name in WINDS else one for one in told.unidentified)
    told = told._replace(unidentified=lost, notes=(f"{ATTITUDE} {reason}", *told.notes))
    if by_a_filter:
        refused = tuple(Unidentified(one.name, NO_VELOCITY) for one in told.estimates)
        told = told._replace(estimates=(), unidentified=(*refused, *lost), correlation=None)
    names = tuple(f"{one.name}, {one.time[0]:.1f} s to {one.time[-1]:.1f} s" for one in records)
    spans = tuple((float(one.time[0]), float(one.time[-1])) for one in records)
    return PathResult(told, names, path_chapter(records, found), spans)


def _pieces(flight: Experiment) -> tuple[Experiment, ...]:
    """The manoeuvres with what is beside them, or pieces of the flight, without gaps."""
    try:
        found = _joined(flight, excited(flight, LEAD, LEAD))
    except InputError:
        found = _flying(flight)
    pieces: list[Experiment] = []
    for one in found:
        try:
            pieces += whole_records(one, (*INPUTS, "airspeed"), LONGEST_GAP, LEAST)
        except InputError:
            continue
    if not pieces:
        raise InputError(f"the log has no {LEAST:g} s of flight in which the IMU and the airspeed were recorded")
    return tuple(pieces[:MOST_PIECES])


def _joined(flight: Experiment, records: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
    """The records, those that share samples as one: a sample that counts twice makes intervals too narrow."""
    whole: list[Experiment] = []
    for one in records:
        if whole and one.time[0] <= whole[-1].time[-1]:
            first, last = np.searchsorted(flight.time, (whole[-1].time[0], one.time[-1]))
            name = f"{whole[-1].name.partition(' to ')[0]} to {one.name.rpartition(' ')[2]}"
            whole[-1] = cut(flight, slice(int(first), int(last) + 1))._replace(name=name)
        else:
            whole.append(one)
    return tuple(whole)


def _flying(flight: Experiment) -> tuple[Experiment, ...]:
    """Pieces of the flight at an airspeed, of about `PIECE` each."""
    speed = flight.signals["airspeed"]
    known = speed[np.isfinite(speed)]
    least = FLYING * float(np.quantile(known, IN_FLIGHT)) if len(known) else np.inf
    fast = np.nan_to_num(speed) > least
    pieces = []
    for run in runs(fast):
        first = min(run.start + int(LEAD / flight.step), run.stop)
        parts = max(round((run.stop - first) * flight.step / PIECE), 1)
        bounds = np.linspace(first, run.stop, parts + 1).astype(int)
        pieces += [cut(flight, slice(int(a), int(b))) for a, b in pairwise(bounds) if (b - a) * flight.step >= LEAST]
    return tuple(one._replace(name=f"piece {number}") for number, one in enumerate(pieces, 1))
