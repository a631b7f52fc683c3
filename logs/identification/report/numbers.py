"""`wingbeat identify`: what a log gives, as numbers, as a table for people and as a JSON document."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from logs.identification.data.flight import Aircraft, GaugeErrors
from logs.identification.diagnostics.agreement import Validation, validation
from logs.identification.estimators.bench import identify_load, load_truth
from logs.identification.estimators.flapping_frequency import FrequencyResult, identify_frequency
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.estimators.servo import identify_torque
from logs.identification.estimators.servo_power import power_truth, power_with_gauge_errors
from logs.identification.estimators.stepwise import Step
from logs.identification.estimators.wing_coefficients import AeroResult, coefficient_r_squared, coefficient_terms
from logs.identification.findings import Finding, not_estimated
from logs.identification.models.modes import KINDS, Mode, ModesResult, Oscillation
from logs.identification.report.markers import marker_document, marker_lines
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.flight import (
    DRIVE_TOPICS,
    MOTION_TOPICS,
    drive_data,
    flight_data,
    throttle_data,
    true_drive_data,
)
from logs.identification.sources.flight_path import PathResult, identify_path, imu_truths
from logs.identification.sources.motion import identify_aero
from logs.identification.sources.table.markers import MarkersResult
from logs.identification.sources.topic_table import CachedSource, ColumnSource
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.background import run_in_background
from wingbeat.errors import InputError

SUBJECTS = ("servo", "power", "modes", "aero", "path", "all")
Servo = tuple[EstimationResult | None, EstimationResult | None]
"""torque and power model of the drive servos; None for one that was not requested"""
POWER_TRUTH = "the same regression on this flight's noise-free drive; they vary with the flight"
"""Eq. 12 has no constants of the vehicle: its terms are fitted to the currents and voltages that were flown."""


FOLLOWS = re.compile(r"_(period|(time|cycles)_to_\w+)$")
"""names of what follows from a mode's frequency and damping"""
DECADE = 10.0
"""-; the upper end of an interval over the lower, above which such a number is not told"""
THEIL = ("coefficient", "bias", "variance", "covariance")
"""of `statistics.fit_quality.Theil`, in the JSON document"""


class Identification(NamedTuple):
    """What was identified from one log; None for what was not asked for or not to be had."""

    torque: EstimationResult | None = None
    """Gerdes Eq. 11"""
    power: EstimationResult | None = None
    """Gerdes Eq. 12"""
    load: EstimationResult | None = None
    """the wings' load on the drives, Gerdes Table 5"""
    frequency: FrequencyResult | None = None
    """flapping frequency against throttle"""
    modes: ModesResult | None = None
    """short period"""
    missing: tuple[Finding, ...] = ()
    """what the log does not give, and why"""
    truths: Mapping[str, float] = {}
    """as the estimate, by its name; true values, where they are known (`power.` before those of Eq. 12)"""
    aero: AeroResult | None = None
    """coefficients of the wings, Grauer Eq. 17 to 19"""
    path: PathResult | None = None
    """errors of the sensors by the flight path"""
    markers: MarkersResult | None = None
    """motion by a capture's markers"""


class Row(NamedTuple):
    """One line of the report."""

    subject: str
    name: str
    unit: str
    estimate: Estimate | None
    truth: float | None
    """as ``unit``; None where it is not known"""
    note: str


def servo_truth(source: ColumnSource, measured: EstimationResult) -> dict[str, float]:
    """Coefficients of Gerdes Eq. 12 from the world's noise-free topics, the same regression as ``measured``.

    Raises:
        InputError: the log has no truth.
    """
    return power_truth(true_drive_data(source), measured)


def identify(
    source: ColumnSource,
    what: str = "all",
    aircraft: Aircraft | None = None,
    truths: Callable[[bool], Mapping[str, float]] | None = None,
    bodies: SimulatedVehicle | None = None,
    method: str | None = None,
) -> Identification:
    """Identify ``what`` (`SUBJECTS`; servo is torque and power) from a log, the modes by one ``method`` if given.

    ``truths`` returns known true values by name (K_tau, K_tau0, and, if its argument is true, short_period_frequency
    and short_period_damping); it is called while the modes are identified in the background.
    Those of the power model are taken from the log itself where it is of a simulated flight. The wings' coefficients
    (aero) need the ``bodies`` of the vehicle, and are of all where these are known; the flight path (path) is not.

    Raises:
        InputError: unknown subject, or the log gives nothing of what was asked for.
    """
    if what not in SUBJECTS:
        raise InputError(f"cannot identify {what!r}; known: {', '.join(SUBJECTS)}")
    source = CachedSource(source)
    of_motion, of_drives = what in ("modes", "all"), what in ("servo", "power", "all")
    source.read_together((*(MOTION_TOPICS if of_motion else ()), *(DRIVE_TOPICS if of_drives else ())))
    known, aircraft, missing = dict[str, float](), aircraft or Aircraft(), list[Finding]()
    torque = power = load = frequency = None
    modes = _start_modes(source, what, aircraft, missing, method)
    if what in ("servo", "power", "all"):
        torque, power = _servo(source, what, aircraft, missing)
    if what in ("servo", "all"):
        load, frequency = _load_and_frequency(source, aircraft.gauges, missing)
    if power is not None:
        known |= _power_truths(source, power)
    if load is not None:
        known |= _load_truths(source, load)
    if truths is not None:
        known |= truths(modes is not None)
    if what == "path":
        path = identify_path(source, aircraft)
        return Identification(truths=known | imu_truths(source, aircraft, path.spans), path=path)
    unknown_wings = list[Finding]()
    aero = _wings(source, what, aircraft, bodies, unknown_wings)
    found, unknown_modes = modes() if modes else (None, [])
    missing += [*unknown_modes, *unknown_wings]
    if all(each is None for each in (torque, power, load, frequency, found, aero)):
        raise InputError("; ".join(entry.text for entry in missing))
    return Identification(torque, power, load, frequency, found, tuple(missing), known, aero)


def _start_modes(
    source: ColumnSource, what: str, aircraft: Aircraft, missing: list[Finding], method: str | None
) -> Callable[[], tuple[ModesResult | None, list[Finding]]] | None:
    """Start the modes in the background; the returned function waits for them. The log is read before.

    None if the log does not have their data, which is added to ``missing``.
    """
    data = None
    if what in ("modes", "all"):
        data = _attempt(lambda: flight_data(source, aircraft.imu), "short period", missing)
    if data is None:
        return None

    def work() -> tuple[ModesResult | None, list[Finding]]:
        refused = list[Finding]()
        return _attempt(lambda: identify_modes(data, aircraft, method=method), "short period", refused), refused

    return work if what == "modes" else run_in_background(work)


def _wings(
    source: ColumnSource, what: str, aircraft: Aircraft, bodies: SimulatedVehicle | None, missing: list[Finding]
) -> AeroResult | None:
    """The wings' coefficients, alone or beside all else; there nothing is asked of a vehicle that is not known.

    Raises:
        InputError: asked for alone, and not to be had.
    """
    if what == "aero":
        return identify_aero(source, bodies, aircraft.imu)
    if what != "all" or bodies is None:
        return None
    found: AeroResult | None = _attempt(
        lambda: identify_aero(source, bodies, aircraft.imu), "wing coefficients", missing
    )
    return found


def _attempt(work: Any, name: str, missing: list[Finding]) -> Any:
    try:
        return work()
    except InputError as error:
        missing.append(not_estimated(name, str(error)))
        return None


def _servo(source: ColumnSource, what: str, aircraft: Aircraft, missing: list[Finding]) -> Servo:
    """Each of the two models for itself: a stand that lacks what the one needs gives the other."""
    data = _attempt(lambda: drive_data(source), "servo model", missing)
    if data is None:
        return None, None
    center = aircraft.centre_current, aircraft.centre_voltage
    gauges = aircraft.gauges
    torque = None if what == "power" else _attempt(lambda: identify_torque(data, gauges), "servo torque", missing)
    power = _attempt(lambda: power_with_gauge_errors(data, gauges, *center), "servo power", missing)
    return torque, power


def _load_and_frequency(
    source: ColumnSource, gauges: GaugeErrors, missing: list[Finding]
) -> tuple[EstimationResult | None, FrequencyResult | None]:
    """What the wings ask of the drives, and how fast they beat by the throttle, where the log has what they need."""
    load = frequency = None
    drive, throttle = (_attempt(lambda read=read: read(source), "", []) for read in (drive_data, throttle_data))
    if drive is not None and len(drive.wing_time):
        load = _attempt(lambda: identify_load(drive, gauges), "wing load", missing)
    if throttle is not None:
        frequency = _attempt(lambda: identify_frequency(throttle), "flapping frequency", missing)
    return load, frequency


def _power_truths(source: ColumnSource, power: EstimationResult) -> dict[str, float]:
    try:
        truth = servo_truth(source, power)
    except InputError:
        return {}  # a log of a real flight has no truth to compare with
    return {f"power.{name}": value for name, value in truth.items()}


def _load_truths(source: ColumnSource, load: EstimationResult) -> dict[str, float]:
    try:
        return load_truth(true_drive_data(source), load)
    except InputError:
        return {}


def rows(result: Identification) -> tuple[Row, ...]:
    """The report, line by line: every number with its truth where known, every refusal with its reason."""
    table: list[Row] = []
    for subject, model, prefix in (("servo torque", result.torque, ""), ("servo power", result.power, "power.")):
        if model is not None:
            table += _estimate_rows(subject, model.estimates, result.truths, prefix)
            table += _refusals(subject, model.withheld)
    frequency = None if result.frequency is None else result.frequency.result
    for subject, more in (("wing load", result.load), ("flapping frequency", frequency)):
        if more is not None:
            table += _estimate_rows(subject, more.estimates, result.truths, "")
            table += _refusals(subject, more.withheld)
    if any(name.startswith("power.") for name in result.truths):
        table.append(Row("servo power", "true values", "", None, None, POWER_TRUTH))
    for motion in result.markers.motions if result.markers else ():
        table += _estimate_rows("markers", (motion.noise,), result.truths, "")
        table += [Row("markers", name, "", None, None, text) for name, text in marker_lines(motion)]
    if result.markers:
        table += [Row("markers", "taken", "", None, None, note) for note in result.markers.notes]
    for aero in result.aero.models if result.aero else ():
        table += _estimate_rows(aero.title, aero.estimates, result.truths, "")
        table += _refusals(aero.title, aero.withheld)
        if aero.estimates:
            percent = 100 * coefficient_r_squared(aero.steps)
            told = f"{percent:.1f} % of its variance by these terms, {aero.samples} samples"
            table.append(Row(aero.title, "told", "", None, None, told))
    if result.aero:
        table += [Row("wing coefficients", "taken", "", None, None, note) for note in result.aero.notes]
    if result.path:
        path = result.path.result
        table += _estimate_rows(path.title, path.estimates, result.truths, "")
        table += _refusals(path.title, path.withheld)
        table += [Row(path.title, "taken", "", None, None, note) for note in _notes(path)]
    for mode in result.modes.modes if result.modes else ():
        for pair in (mode.of_kind(kind) for kind in KINDS):
            sure, wide = determined(() if pair is None else pair.estimates)
            table += _estimate_rows(mode.method, sure, result.truths, "")
            table += [Row(mode.method, one.subject, "", None, None, f"not determined: {one.text}") for one in wide]
        table += _estimate_rows(mode.method, mode.divergence, result.truths, "")
        if not any(mode.of_kind(kind) for kind in KINDS) and not mode.withheld:
            table += _estimate_rows(mode.method, mode.derivatives, result.truths, "")  # a method without modes
        table += _refusals(mode.method, mode.withheld)
    if result.modes:
        table.append(Row("modes", "agreement", "", None, None, result.modes.statement))
        tried = validation(result.modes)
        table += [] if tried is None else [Row("modes", "held out", "", None, None, tried.statement)]
        texts = {one.text for one in result.modes.findings if one.severity == "warning"}
        notes = [note for note in result.modes.notes if note not in texts]
        table += [Row("modes", "note", "", None, None, note) for note in notes]
        table += [Row("modes", "warning", "", None, None, text) for text in sorted(texts)]
    return (*table, *_refusals("", result.missing))


def determined(estimates: Sequence[Estimate]) -> tuple[list[Estimate], list[Finding]]:
    """A mode's numbers, and those that follow from its frequency and damping and that these leave open.

    Where the damping may be next to none, a time to half may be anything: more than a decade says nothing.
    """
    told: list[Estimate] = []
    wide: list[Finding] = []
    for one in estimates:
        if FOLLOWS.search(one.name) and one.high > DECADE * one.low:
            unit = "" if one.unit == "-" else f" {one.unit}"
            bounds = f"{one.low:.2g} to {one.high:.3g}{unit}"
            wide.append(not_estimated(one.name, f"the data allow {bounds}"))
        else:
            told.append(one)
    return told, wide


def _estimate_rows(
    subject: str, estimates: Iterable[Estimate], truths: Mapping[str, float], prefix: str
) -> list[Row]:
    return [Row(subject, e.name, e.unit, e, truths.get(prefix + e.name), "") for e in estimates]


def _refusals(subject: str, refused: Iterable[Finding]) -> list[Row]:
    return [
        Row(subject or one.subject, one.subject, "", None, None, f"not identified: {one.text}") for one in refused
    ]


def document(result: Identification) -> dict[str, Any]:
    """The report as a JSON document, with the keys of `Identification`; a number that is not finite is null."""
    return {
        "torque": None if result.torque is None else _model(result.torque, result.truths, ""),
        "power": None if result.power is None else _model(result.power, result.truths, "power."),
        "load": None if result.load is None else _model(result.load, result.truths, ""),
        "frequency": None if result.frequency is None else _frequency(result.frequency, result.truths),
        "modes": None if result.modes is None else _modes(result.modes, result.truths),
        "aero": None if result.aero is None else _aero(result.aero, result.truths),
        "path": None if result.path is None else _path(result.path, result.truths),
        "markers": None if result.markers is None else marker_document(result.markers),
        "missing": _unidentified(result.missing),
    }


def _path(result: PathResult, truths: Mapping[str, float]) -> dict[str, Any]:
    return {
        "estimates": [_estimate(found, truths) for found in result.result.estimates],
        "unidentified": _unidentified(result.result.withheld),
        "records": list(result.records),
        "notes": _notes(result.result),
        "findings": [one.document() for one in result.result.findings],
    }


def _notes(result: EstimationResult) -> list[str]:
    return [one.text for one in result.findings if one.severity != "withheld"]


def _aero(result: AeroResult, truths: Mapping[str, float]) -> dict[str, Any]:
    return {
        "models": [
            {
                "name": model.title,
                "terms": list(coefficient_terms(model)),
                "estimates": [_estimate(found, truths) for found in model.estimates],
                "unidentified": _unidentified(model.withheld),
                "steps": step_entries(model.steps),
                "r_squared": _number(coefficient_r_squared(model.steps)),
                "samples": model.samples,
                "findings": _withheld(model.withheld),
            }
            for model in result.models
        ],
        "records": list(result.records),
        "notes": list(result.notes),
    }


def step_entries(steps: tuple[Step, ...]) -> list[dict[str, Any]]:
    """The steps by which a stepwise regression chose its terms, for a JSON document."""
    return [
        {"action": s.action, "term": s.term, "why": s.why, "r_squared": _number(s.statistics.r_squared)}
        for s in steps
    ]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _estimate(one: Estimate, truths: Mapping[str, float], prefix: str = "") -> dict[str, Any]:
    entry = {key: value if isinstance(value, str) else _number(value) for key, value in one._asdict().items()}
    return entry | {"truth": truths.get(prefix + one.name)}


def _model(model: EstimationResult, truths: Mapping[str, float], prefix: str) -> dict[str, Any]:
    return {
        "estimates": [_estimate(found, truths, prefix) for found in model.estimates],
        "unidentified": _unidentified(model.withheld),
        "centre_current": model.fixed.get("C_D", 0.0),
        "centre_voltage": model.fixed.get("C_E", 0.0),
        "residual": _number(model.residual_deviation),
        "samples": model.samples,
        "findings": _withheld(model.withheld),
    }


def _unidentified(lost: Iterable[Finding]) -> list[dict[str, str]]:
    """Name and reason of each parameter without an estimate."""
    return [{"name": one.subject, "reason": one.text} for one in lost]


def _withheld(lost: Iterable[Finding]) -> list[dict[str, Any]]:
    """Findings of parameters without an estimate."""
    return [one.document() for one in lost]


def _frequency(frequency: FrequencyResult, truths: Mapping[str, float]) -> dict[str, Any]:
    model, segments = frequency
    return {
        "estimates": [_estimate(found, truths) for found in model.estimates],
        "unidentified": _unidentified(model.withheld),
        "centre_throttle": model.fixed["T_c"],
        "centre_voltage": model.fixed.get("V_c", 0.0),
        "residual": _number(model.residual_deviation),
        "findings": _withheld(model.withheld),
        "segments": [{key: _number(value) for key, value in segment._asdict().items()} for segment in segments],
    }


def _modes(result: ModesResult, truths: Mapping[str, float]) -> dict[str, Any]:
    return {
        "methods": [_mode(mode, truths) for mode in result.modes],
        "agree": result.agree,
        "statement": result.statement,
        "manoeuvres": result.manoeuvres,
        "notes": list(result.notes),
        "findings": [one.document() for one in result.findings],
        "wing_period": result.wing_period,
        "reference": None if result.reference is None else _floats(result.reference._asdict()),
        "held_out": _held_out(validation(result)),
    }


def _held_out(tried: Validation | None) -> dict[str, Any] | None:
    if tried is None:
        return None
    predictions = [
        {
            "flight": one.flight, "manoeuvres": one.manoeuvres, "output": one.output, "unit": one.unit,
            "rms": _number(one.rms),
            "theil": {key: _number(getattr(one.theil, key)) for key in THEIL},
        }
        for one in tried.predictions
    ]  # fmt: skip
    return {"flights": list(tried.held_out), "predictions": predictions, "failure": tried.failure}


def _floats(values: Mapping[str, Any]) -> dict[str, float]:
    return {key: float(value) for key, value in values.items()}


def _mode(mode: Mode, truths: Mapping[str, float]) -> dict[str, Any]:
    return {
        "method": mode.method,
        **_oscillation(mode.short_period, truths),
        "phugoid": None if mode.phugoid is None else _oscillation(mode.phugoid, truths),
        "eigenvalues": [
            [root.real, root.imag]
            for root in mode.eigenvalues
            if mode.short_period or mode.phugoid or mode.divergence
        ],
        "divergence": [_estimate(found, truths) for found in mode.divergence],
        "derivatives": [_estimate(found, truths) for found in mode.derivatives],
        "unidentified": _unidentified(mode.withheld),
    }


def _oscillation(pair: Oscillation | None, truths: Mapping[str, float]) -> dict[str, Any]:
    """`frequency`, `damping`, `period`, `time_to_half`, `cycles`: null where not identified; `time_constants`."""
    single = ("frequency", "damping", "period", "time_to_half", "cycles")
    found = {key: None if pair is None else getattr(pair, key) for key in single}
    entries = {key: None if value is None else _estimate(value, truths) for key, value in found.items()}
    constants = () if pair is None else pair.time_constants
    return entries | {"time_constants": [_estimate(value, truths) for value in constants]}
