"""A fitted longitudinal model as the linear model that ``wingbeat tune`` reads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.models.stroke_averaged import matrices
from logs.identification.report.model_file import identified_values
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.table.config import ALL, Map, ModesSection, OutputError, load_map
from logs.identification.sources.table.models import DROPPED, FIRST_SAMPLES, with_trim
from logs.identification.sources.table.results import TableIdentification
from sim_bridge.tuning.model import Identified, LinearModel
from wingbeat.errors import InputError

LONGITUDINAL = "longitudinal"
REGRESSORS = ("u", "alpha", "q", "delta")
WANTED = tuple(f"{axis}_{name}" for axis in "XZM" for name in REGRESSORS)
TRIM = ("theta", "alpha", "flapping")
"""constants beside the airspeed without which there is no trim to be linear about"""


class TableModel(NamedTuple):
    """Linear model, and notes on it."""

    model: LinearModel
    notes: tuple[str, ...]


class _Source(NamedTuple):
    """Section of a map that gives the model."""

    subject: str
    section: ModesSection | OutputError


def check_model(chosen: Map, what: str) -> None:
    """Refuse a map that gives no model file, before the long work.

    Raises:
        InputError: with what is missing.
    """
    request = _section(chosen, what)
    named = request.section.parameters
    if len(request.section.inputs) != 1:
        raise InputError(f"--model: the model takes one elevator in inputs, not {len(request.section.inputs)}")
    free = {_common_name(name, request.section.inputs[0]) for name in named}
    left_out = [name for name in WANTED if named and name not in free and name not in DROPPED]
    if left_out:
        raise InputError(f"--model: all derivatives are wanted; parameters lacks {', '.join(left_out)}")
    absent = [f"constants.{name}" for name in TRIM if name not in chosen.constants.quantities]
    if "V" not in chosen.constants.quantities and "V" not in chosen.signals:
        absent.insert(0, "constants.V or signals.V")
    if absent:
        raise InputError(f"--model: the trim is not known: the map lacks {', '.join(absent)}")


def has_model(mapping: Path, what: str) -> bool:
    """Whether ``--model`` would write a model from this map."""
    try:
        check_model(load_map(mapping), what)
    except InputError:
        return False
    return True


def _section(chosen: Map, what: str) -> _Source:
    results = []
    if chosen.modes is not None and what in ("modes", ALL):
        results.append(_Source("modes", chosen.modes))
    if chosen.aero is not None and what in ("aero", ALL):
        results += [_Source("aero", one) for one in chosen.aero.output_error]
    for one in results:
        if one.section.model == LONGITUDINAL:
            return one
    raise InputError(f'--model: it is of a fit with model = "{LONGITUDINAL}" in [modes] or [[aero.output_error]]')


def _common_name(name: str, elevator: str) -> str:
    return f"{name.removesuffix(elevator)}delta" if name.endswith(f"_{elevator}") else name


def table_model(chosen: Map, results: TableIdentification, what: str, sha256: str) -> TableModel:
    """Return the linear model, with a nose-up positive elevator whatever the sign of the table.

    Raises:
        InputError: the fit failed, or a derivative was not identified.
    """
    request = _section(chosen, what)
    fit = _fit(request, results)
    elevator = request.section.inputs[0]
    if results.records[0].units.get(elevator) != "rad":
        raise InputError(f"no model is written: {elevator} is no angle")
    known = with_trim(results.constants, tuple(one for one in results.records if one.name in results.experiments))
    speed, alpha, pitch = known["V"], known["alpha"], known["theta"]
    estimates = {one.name: one for one in fit.estimates}
    values = dict.fromkeys(WANTED, 0.0) | dict(fit.fixed) | {n: e.value for n, e in estimates.items()}
    sign = -1.0 if values["M_delta"] < 0 else 1.0
    factors = {"alpha": ("w", 1.0 / speed), "delta": ("delta", sign)}
    named = {name: _renamed(name, factors) for name in WANTED}
    derivatives = {new: factor * values[name] for name, (new, factor) in named.items()}
    trim = sign * _trim(results, elevator)
    about = Reference(speed * math.cos(alpha), speed * math.sin(alpha), pitch, speed, trim)
    system = matrices(tuple(derivatives), np.array(list(derivatives.values())), about, Aircraft())
    kept = tuple(_scaled(one, *named.get(name, (name, 1.0))) for name, one in estimates.items())
    method, files = fit.title, ", ".join(results.files)
    origin_of = Identified(files, sha256, method, trim, alpha, known.get("rho"), identified_values(kept))
    origin = f"{files}, {method}, {len(results.experiments)} maneuvers"
    model = LinearModel("", origin, speed, pitch, known["flapping"], system.a, system.b, None, None, origin_of)
    return TableModel(model, _notes(fit, elevator, sign, tuple(n for n in WANTED if n not in estimates), values))


def _fit(request: _Source, results: TableIdentification) -> EstimationResult:
    """Return the fit with a number for every derivative.

    Raises:
        InputError: there is no fit, or a derivative is not identified.
    """
    fits = [one for one in results.fits if one.subject == request.subject and one.model == LONGITUDINAL]
    if not fits:
        why = "; ".join(one.text for one in results.missing)
        raise InputError(f"no model is written: {why or 'nothing was fitted'}")
    fit = fits[0]
    lost = [f"{one.subject} is not identified: {one.text}" for one in fit.withheld]
    if fit.failure is not None or lost:
        raise InputError(f"no model is written: {fit.failure.text if fit.failure else '; '.join(lost)}")
    return fit


def _renamed(name: str, factors: dict[str, tuple[str, float]]) -> tuple[str, float]:
    """Return name and factor of a derivative by w and by the nose-up positive elevator."""
    axis, _, of = name.partition("_")
    new, factor = factors.get(of, (of, 1.0))
    return f"{axis}_{new}", factor


def _scaled(one: Estimate, name: str, factor: float) -> Estimate:
    ends = sorted((factor * one.low, factor * one.high))
    units = {"_w": "1/s", "M_w": "rad/s/m"}
    unit = units["M_w"] if name == "M_w" else units.get(name[1:], one.unit)
    return Estimate(name, unit, factor * one.value, abs(factor) * one.standard_error, ends[0], ends[1])


def _trim(results: TableIdentification, elevator: str) -> float:
    """Return the mean initial elevator in rad."""
    fitted = [one.signals[elevator] for one in results.records if one.name in results.experiments]
    first = [values[np.isfinite(values)][:FIRST_SAMPLES] for values in fitted]
    return float(np.mean([np.mean(values) for values in first if len(values)]))


def _notes(
    fit: EstimationResult, elevator: str, sign: float, fixed: tuple[str, ...], values: dict[str, float]
) -> tuple[str, ...]:
    notes = []
    if sign < 0:
        notes.append(f"{elevator} pitches the nose down: the model's elevator is -{elevator}")
    if fixed:
        notes.append("fixed, not estimated: " + ", ".join(f"{name} = {values[name]:.6g}" for name in fixed))
    if values.get("delay"):
        notes.append(f"the delay of {values['delay']:.3g} s is not in the model")
    return tuple(notes)
