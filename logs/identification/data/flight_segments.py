"""Stretches of a flight that hold its manoeuvres and the calm between them, cut into whole strokes."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.flight import FlightData
from logs.identification.data.maneuvers import Manoeuvre
from logs.identification.results import Array
from logs.strokes import interval_mean, time_at

LONGEST_CALM = 3.0
"""s; between two manoeuvres of one stretch: later the flight may have become another"""
UNEVEN = 1.5
"""-; a stroke longer or shorter than the median by that factor ends a stretch: the wings stood, or counts lack"""
LEAST_STROKES = 8
UNTOLD = 1e-6
"""-; of a stroke, above rounding"""


class Stretch(NamedTuple):
    """A stretch of flight, stroke by stroke."""

    time: Array
    """s; (N,), of the raw samples"""
    command: Array
    """rad; (N,), elevator command minus its value at the first edge"""
    edges: Array
    """s; (K + 1,), where strokes begin and end"""
    averages: Array
    """(K, 4); pitch rate rad/s, specific forces x and z at the IMU m/s^2, pitch rad"""
    wing_rate_squared: Array
    """rad^2/s^2; (K,), mean of both wings; zeros of a flight in which it was not measured"""
    airspeed: Array
    """m/s; (K,)"""
    sideways: Array
    """(N, 5); roll rad, roll, pitch and yaw rate rad/s, and specific force y at the IMU m/s^2, averaged over the
    stroke about its sample; zeros where the flight does not tell all of them"""
    manoeuvre: NDArray[np.int64]
    """-; (K,), place of the manoeuvre that each stroke is in or behind, of all that are usable"""
    phase: float = 0.0
    """-; of a stroke, 0 to 1, at which its strokes begin"""


def stretches(data: FlightData, manoeuvres: tuple[Manoeuvre, ...], phase: float) -> tuple[Stretch, ...]:
    """The stretches that hold the usable ``manoeuvres``; none where the strokes are too few or too uneven.

    Strokes are cut at ``phase`` (of a stroke, 0 to 1).
    """
    starts = np.array([m.start for m in manoeuvres])
    ends = starts + [m.time[-1] for m in manoeuvres]
    groups = [[0, 0]]
    for place in range(1, len(manoeuvres)):
        between = (data.time > ends[place - 1]) & (data.time < starts[place])
        if starts[place] - ends[place - 1] <= LONGEST_CALM and not np.any(data.aborted[between]):
            groups[-1][1] = place
        else:
            groups.append([place, place])
    return tuple(
        stretch._replace(phase=phase)
        for first, last in groups
        for stretch in _cut(data, (starts[first], ends[last]), phase, starts)
    )


def _cut(data: FlightData, span: tuple[float, float], phase: float, starts: Array) -> list[Stretch]:
    """Whole strokes within ``span`` (s); a stretch for every run of even ones."""
    reach = slice(int(np.searchsorted(data.time, span[0])), int(np.searchsorted(data.time, span[1], side="right")))
    time, strokes = data.time[reach], data.strokes[reach]
    numbers = phase + np.arange(np.ceil(strokes[0] - phase), np.floor(strokes[-1] - phase) + 1)
    edges = time_at(time, strokes, numbers)
    edges = edges[np.isfinite(edges)]
    if len(edges) <= LEAST_STROKES:
        return []
    raw, sideways = (np.column_stack([c[reach] for c in told]) for told in (_averaged(data), _sideways(data)))
    # Where a flight tells how hard the wings flap, a stroke of which it does not would be taken for the mean one.
    measured = np.isfinite(data.wing_rate_squared)
    untold = interval_mean(time, 1.0 - measured[reach], edges[:-1], edges[1:]) > UNTOLD
    return [
        _stretch(time, data.elevator[reach], (raw, sideways), edges[run], starts)
        for run in _even_runs(np.diff(edges), untold & np.any(measured))
        if run.stop - run.start > LEAST_STROKES
    ]


def _averaged(data: FlightData) -> tuple[Array, ...]:
    """What is averaged over strokes: the four of `Stretch.averages`, the wings' rate and the airspeed."""
    wing = np.nan_to_num(data.wing_rate_squared)
    return data.pitch_rate, data.accel_x, data.accel_z, data.pitch, wing, data.airspeed


def _sideways(data: FlightData) -> tuple[Array, ...]:
    """What becomes `Stretch.sideways`, where it is told."""
    told = np.array((data.roll, data.roll_rate, data.pitch_rate, data.yaw_rate, data.accel_y))
    return tuple(np.where(np.isfinite(told).all(axis=0), told, 0.0))


def _even_runs(durations: Array, untold: NDArray[np.bool_]) -> list[slice]:
    """Runs of edges between which every stroke is about as long as the median one and none is ``untold``."""
    ratio = durations / np.median(durations)
    breaks = np.flatnonzero((ratio > UNEVEN) | (ratio < 1.0 / UNEVEN) | untold)
    bounds = [-1, *breaks, len(durations)]
    return [slice(int(a) + 1, int(b) + 1) for a, b in pairwise(bounds)]


def _stretch(time: Array, command: Array, raw: tuple[Array, Array], edges: Array, starts: Array) -> Stretch:
    """``starts`` (s) are those of all manoeuvres."""
    *averages, wing, airspeed = interval_mean(time, raw[0], edges[:-1], edges[1:]).T
    period = np.interp(time, (edges[1:] + edges[:-1]) / 2.0, np.diff(edges))
    about = (np.clip(time + side * period / 2.0, time[0], time[-1]) for side in (-1.0, 1.0))
    within = np.maximum(np.searchsorted(starts, edges[:-1], side="right") - 1, 0)
    zero = float(np.interp(edges[0], time, command))
    sideways = np.column_stack((raw[1][:, :4], interval_mean(time, raw[1][:, 4], *about)))
    return Stretch(time, command - zero, edges, np.column_stack(averages), wing, airspeed, sideways, within)
