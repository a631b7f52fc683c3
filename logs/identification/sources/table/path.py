"""[path] of a map: biases and scales of the sensors by flight-path reconstruction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import whole_records
from logs.identification.estimators.flight_path import MIN_SAMPLES, PathOptions, reconstruct
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.rigid_body import INPUTS, LONGITUDINAL_INPUTS, UNITS, WINDS, SensorPositions
from logs.identification.report.subjects import path_chapter
from logs.identification.results import EstimationResult
from logs.identification.sources.table.maneuvers import DataSplit
from logs.identification.sources.table.signals import LONGEST_FILL
from wingbeat.errors import InputError
from wingbeat.schema import check_known
from wingbeat.text import pluralize


class PathSection(NamedTuple):
    """Section [path]."""

    longitudinal: bool | None = None
    """if absent: whether one of p, r and a_y is not measured"""
    also: tuple[str, ...] = ()
    known: tuple[str, ...] = ()
    places: SensorPositions = SensorPositions()
    """m; the IMU's is that of the constants imu_x, imu_y, imu_z if absent"""
    input_noise: dict[str, float] = {}
    """SI; standard deviation of the white noise by input; estimated from the records if absent"""


register({
    "longitudinal_only": Entry(
        "not measured: {signals}; the longitudinal motion alone, with level wings",
        "The lateral inputs of the kinematics are absent.",
    ),
    "record_left_out": Entry("left out: {reason}", "A record has no piece in which all inputs are measured."),
    "samples_bridged": Entry(
        "{lost} without {signals}, {bridged} of them bridged, {left} left out",
        "Gaps of the inputs are interpolated up to `fill`; records are cut at longer ones.",
    ),
})  # fmt: skip


def path_fit(section: PathSection, data: DataSplit) -> list[EstimationResult]:
    """The reconstruction over all maneuvers, and the prediction of those that were held out.

    Raises:
        InputError: an input or the airspeed is not there, or no piece without a gap is long enough.
    """
    options, findings = _options(section, tuple(data.fitted[0].signals), data.constants)
    fitted = _records(data.fitted, options.longitudinal, data.fill, findings)
    if not fitted:
        raise InputError("path: " + "; ".join(one.text for one in findings))
    held_out = _records(data.held_out, options.longitudinal, data.fill, findings)
    path = reconstruct(fitted, options, held_out)
    chapter = path_chapter(fitted, path)
    result = path.result._replace(
        subject="path", title="flight path", findings=(*findings, *path.result.findings),
        samples=sum(len(one.time) for one in fitted), chapters=() if chapter is None else (chapter,),
    )  # fmt: skip
    return [result]


def _options(
    section: PathSection, signals: tuple[str, ...], constants: Mapping[str, float]
) -> tuple[PathOptions, list[Finding]]:
    names = (*(f"{kind}_{channel}" for kind in ("bias", "scale") for channel in UNITS), *WINDS)
    for key in ("also", "known"):
        for name in getattr(section, key):
            check_known(name, names, f"path.{key} {name}")
    for name, value in section.input_noise.items():
        check_known(name, INPUTS, f"path.input_noise.{name}")
        if not value > 0:
            raise InputError(f"path.input_noise.{name} must be above 0")
    lateral = [name for name in INPUTS if name not in signals and name not in LONGITUDINAL_INPUTS]
    longitudinal = bool(lateral) if section.longitudinal is None else section.longitudinal
    missing = [f"signals.{name}" for name in _inputs(longitudinal) if name not in signals]
    missing += [] if {"V", "airspeed"} & set(signals) else ["signals.V"]
    if missing:
        raise InputError(f"path needs {', '.join(missing)}")
    positions = section.places
    if positions.imu == SensorPositions().imu:
        x, y, z = (constants.get(f"imu_{axis}", 0.0) for axis in "xyz")
        positions = positions._replace(imu=(x, y, z))
    options = PathOptions(longitudinal, section.also, section.known, positions, section.input_noise)
    if section.longitudinal is None and longitudinal:
        return options, [Finding("longitudinal_only", "info", details={"signals": ", ".join(lateral)})]
    return options, []


def _inputs(longitudinal: bool) -> tuple[str, ...]:
    return LONGITUDINAL_INPUTS if longitudinal else INPUTS


def _records(
    experiments: tuple[Experiment, ...], longitudinal: bool, fill: float | None, findings: list[Finding]
) -> list[Experiment]:
    """Pieces of the maneuvers without gaps in the inputs, the airspeed by its name in the kinematics."""
    records: list[Experiment] = []
    for one in map(_renamed, experiments):
        names, gap = _inputs(longitudinal), LONGEST_FILL * one.step if fill is None else fill
        lost = int(np.count_nonzero(~np.all([np.isfinite(one.signals[name]) for name in names], axis=0)))
        try:
            pieces = whole_records(one, names, gap, (MIN_SAMPLES - 1) * one.step)
        except InputError as reason:
            findings.append(Finding("record_left_out", "warning", details={"reason": str(reason)}))
            continue
        left = len(one.time) - sum(len(piece.time) for piece in pieces)
        if lost:
            counts = {"lost": pluralize(lost, "sample"), "bridged": lost - min(left, lost), "left": left}
            findings.append(
                Finding("samples_bridged", "info", one.name, details=counts | {"signals": ", ".join(names)})
            )
        records += pieces
    return records


def _renamed(one: Experiment) -> Experiment:
    if "V" not in one.signals or "airspeed" in one.signals:
        return one
    signals = {("airspeed" if name == "V" else name): values for name, values in one.signals.items()}
    return one._replace(signals=signals, units={name: UNITS.get(name, one.units.get(name, "")) for name in signals})
