"""``wingbeat identify CAPTURE markers``: motion from motion-capture markers."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from groundstation.command import options
from groundstation.command.compiling import announced
from groundstation.command.identify_out import check_outputs, sha256
from groundstation.views.progress import ProgressBar
from logs.attached import simulated_vehicle
from logs.identification.findings import not_estimated
from logs.identification.motion_capture.motion import Cloud
from logs.identification.report import Identification
from logs.identification.report.report import Subject, write_report
from logs.identification.sources.table.markers import (
    MarkersMap,
    MarkersSection,
    cloud_of_log,
    clouds_of_tables,
    identify_markers,
    load_markers_map,
    wings_by_markers,
)
from logs.reader import open_log
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_bodies
from wingbeat.errors import InputError

MARKERS = "markers"


def identified_by_markers(
    files: Sequence[Path], tables: bool, chosen: argparse.Namespace
) -> tuple[Identification, Callable[[], list[str]]]:
    """Identify from markers; also return a function that writes the report and returns lines about the files.

    Raises:
        InputError: no map, an option of another subject, an invalid capture or map.
    """
    if chosen.map is None:
        raise InputError("markers needs --map MAP.toml (wingbeat identify --map-example markers prints one)")
    if chosen.model is not None or chosen.elevator is not None or chosen.validate or chosen.validate_share:
        raise InputError("markers takes --map, --vehicle, --report and --json")
    check_outputs(chosen)
    mapped = load_markers_map(chosen.map)
    with announced(chosen.json):
        vehicle, clouds, notes = _captured(files, tables, mapped, chosen.vehicle or mapped.markers.vehicle)
        estimates = _identified(vehicle, mapped.markers, clouds, notes)

    def write() -> list[str]:
        if chosen.report is None:
            return []
        with ProgressBar("writing the report"):
            write_report(chosen.report, _subject(files, estimates, clouds), estimates)
        return [f"written {chosen.report}"]

    return estimates, write


def _captured(
    files: Sequence[Path], tables: bool, mapped: MarkersMap, vehicle: str | None
) -> tuple[SimulatedVehicle | None, tuple[Cloud, ...], tuple[str, ...]]:
    """Return the vehicle's bodies, None for a single rigid body, and the markers of all files."""
    if tables:
        bodies = _bodies(vehicle, mapped.markers)
        return bodies, *clouds_of_tables(files, mapped)
    estimates, own = [], None
    for file in files:
        with open_log(file) as log:
            estimates.append(cloud_of_log(log, mapped.markers))
            own = own or simulated_vehicle(log)
    if own is not None and vehicle is not None:
        raise InputError(f"{files[0]} carries the file of its vehicle: leave markers.vehicle and --vehicle out")
    return own or _bodies(vehicle, mapped.markers), tuple(estimates), ()


def _bodies(vehicle: str | None, requested: MarkersSection) -> SimulatedVehicle | None:
    if vehicle is not None:
        return load_bodies(options.vehicle_files(vehicle)[0])
    if len(requested.places) != 1:
        raise InputError("which vehicle's bodies are the markers on? (markers.vehicle of the map, or --vehicle)")
    if requested.aero:
        raise InputError("which vehicle's wings are the coefficients of? (markers.vehicle of the map, or --vehicle)")
    return None


def _identified(
    vehicle: SimulatedVehicle | None, requested: MarkersSection, clouds: Sequence[Cloud], notes: tuple[str, ...]
) -> Identification:
    estimates = identify_markers(vehicle, requested, clouds, notes)
    if vehicle is None or not requested.aero:
        return Identification(markers=estimates)
    try:
        return Identification(markers=estimates, aero=wings_by_markers(vehicle, requested, estimates))
    except InputError as error:
        return Identification(markers=estimates, missing=(not_estimated("wing coefficients", str(error)),))


def _subject(files: Sequence[Path], estimates: Identification, clouds: Sequence[Cloud]) -> Subject:
    length = sum(float(cloud.time[-1] - cloud.time[0]) for cloud in clouds)
    name = estimates.markers.vehicle if estimates.markers is not None else ""
    (first, *more) = [(file.name, sha256(file)) for file in files]
    facts = (("vehicle", name), ("length", f"{length:.1f} s"))
    return Subject(f"{name}: motion by markers", *first, facts, tuple(more))
