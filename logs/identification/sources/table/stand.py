"""[load_cell] of a map: the wings' coefficients from runs on a six-axis load cell, by the model or by a tare run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.wing_coefficients import CANDIDATES, coefficient_terms, identify_coefficients
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.inverse_dynamics import COEFFICIENTS, WingCoefficients
from logs.identification.models.load_cell import LoadCell, StandRun, stand_coefficients
from logs.identification.models.wing_strokes import strokes_by_angle
from logs.identification.motion_capture.motion import CUTOFF
from logs.identification.results import EstimationResult, FitSeries
from logs.identification.sources.table.derived import Source, signal
from logs.identification.sources.table.maneuvers import DataSplit
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.schema import check_known

STROKE_TERMS = ("theta_11", "theta_11_rate", "theta_11^2", "theta_11*theta_11_rate", "theta_11_rate^2")
STILL = 1e-3
"""-; of its size, by which a regressor must vary over all runs"""
ENDS = 5.0
"""-; periods of the low-pass that are left out at both ends of a run"""
SAMPLED = 3.0
"""-; samples kept per period of the low-pass"""
EQUATIONS = (
    "Load of the air = load on the cell - weight and inertia of the vehicle, at the body's origin (Grauer Eq. 13)",
    "C_L = -F_z / (qbar S), C_T = F_x / (qbar S), C_m = M_y / (qbar S c), along the body's axes (Eq. 14 to 16)",
    "qbar = rho / 2 |v|^2 at every instant, v the wings' mean velocity through the air, flapping included",
)


register({
    "tare": Entry(
        "tail load subtracted by the vehicle's model, weight and inertia by {source}",
        "Source of the loads that are not those of the wings.",
    ),
    "mean_load": Entry(
        "{where}: lift {lift:.4g} N, thrust {thrust:.4g} N along the stream",
        "Mean loads of a run on the load cell.",
    ),
    "mean_body_load": Entry(
        "{where}: body axes {up:.4g} N up, {forward:.4g} N forward; mean {coefficients}",
        "Mean loads of a run in body axes, and mean coefficients.",
    ),
})  # fmt: skip


class StandSection(NamedTuple):
    """Section [load_cell]."""

    vehicle: str
    load: tuple[str, str, str, str, str, str] = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    flap: str = "flap"
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] = (
        (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0),
    )  # fmt: skip
    sign: float = 1.0
    tare: int | None = None
    """number of the maneuver"""
    cutoff: float = CUTOFF
    """Hz; of the low-pass of load and angle"""
    candidates: tuple[str, ...] = ()
    """candidate terms of the stepwise regression; those that vary if not given"""


def stand_fits(section: StandSection, data: DataSplit) -> list[EstimationResult]:
    """C_L, C_T and C_m over all runs but the tare, each as a sum of chosen terms; held-out runs are predicted.

    Raises:
        InputError: a signal or constant is missing, the vehicle is not known, or a run cannot be used.
    """
    if section.sign not in (1.0, -1.0):
        raise InputError("load_cell.sign must be 1 or -1")
    for name in section.candidates:
        check_known(name, CANDIDATES, f"load_cell.candidates {name}")
    folder = Path(section.vehicle)
    vehicle = load_vehicle(str(folder / "world.toml") if folder.is_dir() else section.vehicle)
    cell = LoadCell(section.place, np.array(section.axes), section.sign)
    tare = tare_of(section, data)
    if section.tare is not None and tare is None:
        raise InputError(f"load_cell.tare: there is no maneuver {section.tare}; there are {len(data.all)}")
    subtracted = None if tare is None else _run(section, tare, data.constants)
    fitted, predicted = (
        [
            stand_coefficients(vehicle, _run(section, one, data.constants), cell, subtracted, section.cutoff)
            for one in part
            if one is not tare
        ]
        for part in (data.fitted, data.held_out)
    )
    if not fitted:
        raise InputError("load_cell: no run is left besides the tare run and those held out")
    records, validation = ([_decimated(one, section.cutoff) for one in part] for part in (fitted, predicted))
    candidates = section.candidates or tuple(name for name in CANDIDATES if _varies(name, records))
    models = identify_coefficients(tuple(records), candidates).models
    source = "the vehicle's model" if tare is None else tare.name
    means = (finding for one in (*fitted, *predicted) for finding in _means(one))
    notes = (Finding("tare", "info", details={"source": source}), *means)
    return [_result(model, records, validation, () if place else notes) for place, model in enumerate(models)]


def tare_of(section: StandSection, data: DataSplit) -> Experiment | None:
    """The tare run; None if there is none."""
    return next((one for one in data.all if one.number == section.tare), None)


def _run(section: StandSection, one: Experiment, constants: Mapping[str, float]) -> StandRun:
    source = Source(one, constants, "load_cell")
    units = ("N",) * 3 + ("N m",) * 3
    load = [signal(one, name, unit, "load_cell.load") for name, unit in zip(section.load, units, strict=True)]
    flap = signal(one, section.flap, "rad", "load_cell.flap")
    speed, pitch, density = (float(np.nanmean(source.get(name))) for name in ("V", "alpha", "rho"))
    begin, end = strokes_by_angle(one.time, flap)
    if not len(begin):
        raise InputError(f"{one.name}: the wings' angle ({section.flap}) goes through no whole stroke")
    cuts = np.append(begin, end[-1])
    rate = 1.0 / float(np.mean(end - begin))
    count = np.interp(one.time, cuts, np.arange(len(cuts), dtype=np.float64))
    count += np.minimum(one.time - cuts[0], 0.0) * rate + np.maximum(one.time - cuts[-1], 0.0) * rate
    strokes = np.maximum.accumulate(count - count[0])
    return StandRun(one.name, one.time, np.column_stack(load), flap, speed, pitch, density, strokes)


def _decimated(maneuvers: WingCoefficients, cutoff: float) -> WingCoefficients:
    """Without the ends, and no more samples than the low-pass left something between."""
    one = maneuvers.experiment
    ends, every = math.ceil(ENDS / (cutoff * one.step)), max(int(1.0 / (SAMPLED * cutoff * one.step)), 1)
    kept = slice(ends, len(one.time) - ends, every)
    if len(one.time[kept]) < 3:
        raise InputError(f"{one.name}: too short for a low-pass at {cutoff:g} Hz")
    signals = {name: np.asarray(values)[kept] for name, values in one.signals.items()}
    return maneuvers._replace(experiment=one._replace(time=one.time[kept], signals=signals))


def _varies(name: str, records: list[WingCoefficients]) -> bool:
    if name not in STROKE_TERMS and len(records) < 2:
        return False
    values = np.concatenate([one.experiment.signals[name] for one in records])
    return float(np.ptp(values)) > STILL * float(np.max(np.abs(values)))


def _means(maneuvers: WingCoefficients) -> tuple[Finding, Finding]:
    """Mean force and coefficients of a run.

    A body pitched nose up by alpha: lift = F_x sin(alpha) - F_z cos(alpha), thrust = F_x cos(alpha) + F_z sin(alpha).
    """
    load, signals = maneuvers.load.mean(axis=0), maneuvers.experiment.signals
    pitch = math.atan2(float(np.mean(signals["v_z"])), float(np.mean(signals["v_x"])))
    details = {
        "where": maneuvers.experiment.name, "up": -load[2], "forward": load[0],
        "lift": load[0] * math.sin(pitch) - load[2] * math.cos(pitch),
        "thrust": load[0] * math.cos(pitch) + load[2] * math.sin(pitch),
        "coefficients": ", ".join(f"{name} {float(np.mean(signals[name])):.4g}" for name in COEFFICIENTS),
    }  # fmt: skip
    return Finding("mean_load", "info", details=details), Finding("mean_body_load", "info", details=details)


def _result(
    model: EstimationResult,
    fitted: list[WingCoefficients],
    predicted: list[WingCoefficients],
    notes: tuple[Finding, ...],
) -> EstimationResult:
    sides = [(one, False) for one in fitted] + [(one, True) for one in predicted]
    series = tuple(_series(model, one.experiment, side) for one, side in sides) if model.estimates else ()
    terms = " + ".join(("C_0", *(f"[{term}] {term}" for term in coefficient_terms(model))))
    return model._replace(
        method="load_cell", subject="load_cell", equations=(*EQUATIONS, f"{model.title} = {terms}"), series=series,
        findings=(*model.findings, *notes), title=f"{model.title} on the load cell", response="",
    )  # fmt: skip


def _series(model: EstimationResult, one: Experiment, held_out: bool) -> FitSeries:
    values: dict[str, Any] = {maneuvers.name: maneuvers.value for maneuvers in model.estimates}
    made = np.full(len(one.time), values.get(f"{model.title}_0", np.nan))
    for term in coefficient_terms(model):
        made = made + values.get(f"{model.title}_{term}", np.nan) * one.signals[term]
    return FitSeries(one.name, model.title, "-", one.time, np.asarray(one.signals[model.title]), made, held_out)
