"""The flight path of a log: `wingbeat identify FLIGHT.mcap path`."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from logs.identification.chapter import Chapter
from logs.identification.data import Aircraft
from logs.identification.experiment import Experiment
from logs.identification.kinematics.flight_path import Setup, reconstruct
from logs.identification.kinematics.flight_sensors import WINDS, Places
from logs.identification.kinematics.flight_told import fitted_path, path_chapter
from logs.identification.kinematics.rigid_motion import INPUTS
from logs.identification.preparing.excited import excited
from logs.identification.preparing.resampling import cut, whole_records
from logs.identification.results import Fitted
from logs.identification.sources.topic_table import ColumnSource
from logs.identification.sources.whole_flight import LONGEST_GAP, whole_flight

FLYING = 0.5
"""-; of the median airspeed, below which it stands or lands"""
PIECE = 30.0
"""s; of flight without a manoeuvre, in which the air is taken to move steadily"""
LEAST = 5.0
"""s; a shorter piece tells little but its first states"""
MOST_PIECES = 8
LEAD = 5.0
"""s; beside a manoeuvre, taken with it; behind a launch, left out"""
UNSURE = ("north", "east")
"""not used: without a vane sideways a filter's small error of bank is a large one of the wind, in no interval"""
NO_WIND = "not looked for: without a vane sideways it would rest on the attitude filter's bank"
ATTITUDE = "attitude: the flight computer's own; what it drifts by over longer than a record is taken for the motion"


class PathResult(NamedTuple):
    """Flight path of a log."""

    fitted: Fitted
    records: tuple[str, ...]
    """-; what it was taken from"""
    chapter: Chapter | None


def identify_path(source: ColumnSource, aircraft: Aircraft) -> PathResult:
    """Errors of the sensors and the motion that they agree on, from a log's flight; manoeuvres where it has some.

    Raises:
        BadInput: the log lacks the IMU or the airspeed, has no flight that is long enough, or does not tell a path.
    """
    flight = whole_flight(source, "flight", aircraft.imu)
    if "airspeed" not in flight.signals:
        raise BadInput("the log has no airspeed (/main/air_data), which a flight path needs")
    flight = flight._replace(signals={name: one for name, one in flight.signals.items() if name not in UNSURE})
    records = _pieces(flight)
    setup = Setup(places=Places(imu=(aircraft.imu_x, 0.0, aircraft.imu_z)))
    found = reconstruct(records, setup)
    if found.failure:
        raise BadInput(f"flight path: {found.failure}")
    told = fitted_path(records, found, setup)
    lost = tuple(one._replace(reason=NO_WIND) if one.name in WINDS else one for one in told.unidentified)
    notes = (ATTITUDE,) if {"theta", "phi"} & set(flight.signals) else ()
    names = tuple(f"{one.name}, {one.time[0]:.1f} s to {one.time[-1]:.1f} s" for one in records)
    told = told._replace(unidentified=lost, notes=(*notes, *told.notes))
    return PathResult(told, names, path_chapter(records, found))


def _pieces(flight: Experiment) -> tuple[Experiment, ...]:
    """The manoeuvres with what is beside them, or pieces of the flight, without gaps."""
    try:
        found = excited(flight, LEAD, LEAD)
    except BadInput:
        found = _flying(flight)
    pieces: list[Experiment] = []
    for one in found:
        try:
            pieces += whole_records(one, (*INPUTS, "airspeed"), LONGEST_GAP, LEAST)
        except BadInput:
            continue
    if not pieces:
        raise BadInput(f"the log has no {LEAST:g} s of flight in which the IMU and the airspeed were recorded")
    return tuple(pieces[:MOST_PIECES])


def _flying(flight: Experiment) -> tuple[Experiment, ...]:
    """Pieces of the flight at an airspeed, of about `PIECE` each."""
    speed = flight.signals["airspeed"]
    known = speed[np.isfinite(speed)]
    fast = np.nan_to_num(speed) > FLYING * float(np.median(known)) if len(known) else np.zeros(len(speed), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], fast.astype(int), [0]))))
    pieces = []
    for begin, last in edges.reshape(-1, 2).tolist():
        first = min(begin + int(LEAD / flight.step), last)
        parts = max(round((last - first) * flight.step / PIECE), 1)
        bounds = np.linspace(first, last, parts + 1).astype(int)
        pieces += [cut(flight, slice(int(a), int(b))) for a, b in pairwise(bounds)]
    return tuple(one._replace(name=f"piece {number}") for number, one in enumerate(pieces, 1))
