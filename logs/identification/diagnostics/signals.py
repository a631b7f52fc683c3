"""Diagnostics of measured signals: constant channels, outliers, missing samples, units and signs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from logs.identification.data.experiment import Experiment, longest_run, runs
from logs.identification.data.signal_errors import MEDIAN_TO_DEVIATION, noise_with_steps
from logs.identification.diagnostics import Context
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

Flags = NDArray[np.bool_]

MOTION = 1e-9
"""-; range over size of a signal, below which it is constant: less is rounding of its unit"""
OUTLIER, HALF_WINDOW = 8.0, 10
"""-; robust standard deviations and samples on either side of the Hampel filter"""
LEAST_SAMPLES = 20
ROUNDING = 2e-3
"""-; of a signal's standard deviation: least noise that is assumed"""
FROZEN = 8
"""-; equal samples in a row far from the model that are a frozen channel"""
EXPLAINED, IMPROVEMENT = 0.7, 4.0
"""-; share of the motion that the corrected kinematics explain; factor by which the correction lowers the residual"""
WIDEST_INPUT = math.pi
"""rad; range of a control, above which its unit is in doubt"""
SMALLEST_INPUT = 0.05
"""-; range of a control over that of the flow angles, below which its unit is in doubt"""
NOISY_INPUT = 0.005
"""-; share of noise in the power of a flow angle that is an input"""
UPRIGHT = (0.7, 1.4)
"""-; bounds of the size of the mean of a_z over g in flight"""
SPEED_UNITS = {"kn": 3600.0 / 1852.0, "mph": 3600.0 / 1609.344, "ft/s": 1.0 / 0.3048, "km/h": 3.6}
DEGREES = math.degrees(1.0)

register({
    "constant_signal": Entry(
        "{subject} is constant in {where}",
        "A signal that does not change carries no information on the motion.",
        "leave it out, or correct its column in [signals]",
    ),
    "frozen_signal": Entry(
        "{subject} is constant in {where} but not elsewhere",
        "A channel froze or was not connected in one maneuver.",
        "leave the maneuver out",
    ),
    "missing_samples": Entry(
        "{where}: {value:.0f} of {total} samples of {subject} not measured",
        "Samples of an output are missing; the fit skips them.",
    ),
    "outliers": Entry(
        "{where}: {value:.0f} outliers of {subject} from {start:.6g} s on (Hampel filter)",
        "Single samples differ from their neighbors and from the model by far more than the noise, or repeat.",
        "mark them with missing = [...] in [signals]",
    ),
    "unit": Entry(
        "{subject} is off by a factor of {value:.3g}: {hint}",
        "The kinematics or the size of a signal contradict its unit (Klein & Morelli 2006, ch. 10).",
        "correct its unit in the map",
    ),
    "sign": Entry(
        "{subject} has the wrong sign: {hint}",
        "The kinematics contradict the sign of a signal; body axes are x forward, y right, z down.",
        "set scale = -1.0 in [signals]",
    ),
    "noisy_input": Entry(
        "{subject} is an input with {percent:.2g} % noise",
        "A measured flow angle drives the model with the noise of its vane.",
        "make it an output, or smooth it in [prepare]",
    ),
})  # fmt: skip


def moves(values: Array) -> bool:
    """Whether a signal (N,) changes by more than the rounding of its unit."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > MOTION * float(np.max(np.abs(known)))


def measured(values: Array) -> bool:
    """Whether a signal (N,) has any sample."""
    return bool(np.any(np.isfinite(values)))


def joined(name: str, experiments: Sequence[Experiment]) -> Array:
    """A signal over all experiments that have it (N,)."""
    parts = [np.asarray(one.signals[name], dtype=np.float64) for one in experiments if name in one.signals]
    return np.concatenate(parts) if parts else np.zeros(0)


def frozen_signals(context: Context) -> tuple[Finding, ...]:
    """Signals of the model that are constant in one maneuver and move in another."""
    found = []
    for name in context.signals:
        if not moves(joined(name, context.experiments)):
            continue
        for one in context.experiments:
            values = np.asarray(one.signals.get(name, np.zeros(0)), dtype=np.float64)
            others = any(moves(one.signals[other]) for other in context.signals if other in one.signals)
            if measured(values) and not moves(values) and others:
                found.append(Finding("frozen_signal", "warning", name, details={"where": one.name}))
    return tuple(found)


def missing_samples(context: Context) -> tuple[Finding, ...]:
    """Outputs that were not measured throughout."""
    series = context.result.series if context.result else ()
    return tuple(
        Finding("missing_samples", "info", one.output, count, None, {"where": one.experiment, "total": len(known)})
        for one in series
        if (count := float(np.count_nonzero(~(known := np.isfinite(one.measured)))))
    )


def outliers(context: Context) -> tuple[Finding, ...]:
    """Spikes, dropouts and frozen samples of the outputs by a Hampel filter of the residuals."""
    found = []
    for one in context.result.series if context.result else ():
        places = np.flatnonzero(outlier_flags(one.measured, one.measured - one.model))
        if len(places):
            details = {"where": one.experiment, "start": float(one.time[places[0]])}
            found.append(Finding("outliers", "warning", one.output, float(len(places)), OUTLIER, details))
    return tuple(found)


def outlier_flags(values: Array, residuals: Array) -> Flags:
    """(N,) of bool; outliers of ``residuals`` (N,) and frozen samples of ``values`` (N,).

    Hampel filter (Pearson, Mining Imperfect Data, 2005): distance from the local median over the larger of the
    local and the global robust standard deviation.
    """
    if np.count_nonzero(np.isfinite(residuals)) < LEAST_SAMPLES:
        return np.zeros(len(values), dtype=bool)
    deviation = MEDIAN_TO_DEVIATION * float(np.nanmedian(np.abs(residuals - np.nanmedian(residuals))))
    deviation = max(deviation, ROUNDING * float(np.nanstd(values)))
    isolated = _hampel(residuals, deviation)
    far = np.abs(residuals - np.nanmedian(residuals)) > OUTLIER * deviation
    repeated = np.zeros(len(values), dtype=bool)
    equal = [(run.start, run.stop + 1) for run in runs(np.append(np.diff(values) == 0.0, False))]
    elsewhere = max((end - start for start, end in equal if not far[start:end].any()), default=1)
    model = values - residuals
    for start, end in equal:
        moving = float(np.ptp(model[start:end])) > OUTLIER * deviation
        if moving and end - start >= max(FROZEN, 2 * elsewhere) and far[start:end].any():
            repeated[start:end] = True
    return isolated | repeated


def _hampel(values: Array, deviation: float) -> Flags:
    """(N,) of bool; only samples far from the global median can be far from the local one."""
    flags = np.zeros(len(values), dtype=bool)
    places = np.flatnonzero(np.abs(values - np.nanmedian(values)) > OUTLIER * deviation)
    if not len(places) or not deviation > 0.0:
        return flags
    padded = np.pad(values, HALF_WINDOW, constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * HALF_WINDOW + 1)[places]
    middle = np.nanmedian(windows, axis=1)
    local = MEDIAN_TO_DEVIATION * np.nanmedian(np.abs(windows - middle[:, None]), axis=1)
    flags[places] = np.abs(values[places] - middle) > OUTLIER * np.maximum(local, deviation)
    return flags


def noisy_inputs(context: Context) -> tuple[Finding, ...]:
    """Flow angles that are inputs with the noise of their vanes."""
    found = []
    for name in ("alpha", "beta"):
        for one in context.experiments if name in context.inputs else ():
            values = np.asarray(one.signals.get(name, np.zeros(0)), dtype=np.float64)
            power = float(np.nanvar(values)) if measured(values) else 0.0
            share = noise_with_steps(values) ** 2 / power if power > 0.0 else 0.0
            if share > NOISY_INPUT:
                details = {"percent": 100.0 * share}
                found.append(Finding("noisy_input", "warning", name, share, NOISY_INPUT, details))
                break
    return tuple(found)


def input_sizes(context: Context) -> tuple[Finding, ...]:
    """Controls with a range that no control in radians has, or far below that of the flow angles."""
    found = []
    flow = max((_range(joined(name, context.experiments)) for name in ("alpha", "beta")), default=0.0)
    for name in context.inputs:
        if name in ("alpha", "beta") or any(one.units.get(name) != "rad" for one in context.experiments):
            continue
        size = _range(joined(name, context.experiments))
        if size > WIDEST_INPUT:
            details = {"hint": f"its range is {math.degrees(size):.0f} deg; is it in deg, not in rad?"}
            found.append(Finding("unit", "warning", name, DEGREES, None, details))
        elif 0.0 < size < SMALLEST_INPUT * flow:
            details = {"hint": f"the flow angles move {flow / size:.0f} times as far; is it in rad, not in deg?"}
            found.append(Finding("unit", "warning", name, 1.0 / DEGREES, None, details))
    return tuple(found)


def _range(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(np.percentile(known, (0.5, 99.5)))) if len(known) else 0.0


def gravity(context: Context) -> tuple[Finding, ...]:
    """The mean of a_z in flight is -g."""
    known = joined("a_z", context.experiments)
    known = known[np.isfinite(known)]
    mean = float(known.mean()) / STANDARD_GRAVITY if len(known) else 0.0
    if UPRIGHT[0] < mean < UPRIGHT[1]:
        return (Finding("sign", "warning", "a_z", -1.0, None, {"hint": "its mean in flight is -9.8 m/s^2"}),)
    if UPRIGHT[0] < abs(mean) / STANDARD_GRAVITY < UPRIGHT[1]:
        hint = "its mean in flight is -9.8 m/s^2; is it in m/s^2, not in g?"
        return (Finding("unit", "warning", "a_z", STANDARD_GRAVITY, None, {"hint": hint}),)
    return ()


def airspeed_constant(context: Context) -> tuple[Finding, ...]:
    """The constant V and the measured airspeed are in the same unit."""
    constant, known = context.constants.get("V", 0.0), joined("V", context.experiments)
    known = known[np.isfinite(known) & (known > 0.1 * constant)]
    if not constant > 0.0 or len(known) < LEAST_SAMPLES:
        return ()
    ratio = constant / float(np.median(known))
    for unit, factor in SPEED_UNITS.items():
        if any(one / 1.1 < ratio < one * 1.1 for one in (factor, 1.0 / factor)):
            hint = f"signals.V has a median of {float(np.median(known)):.4g} m/s; is one of them in {unit}?"
            return (Finding("unit", "warning", "constants.V", ratio, None, {"hint": hint}),)
    return ()


class _Relation(NamedTuple):
    """An angle and the terms of its rate, each named by the signal that it tests."""

    angle: str
    needed: tuple[str, ...]
    defaults: Mapping[str, float]
    terms: Callable[[Mapping[str, Array]], dict[str, Array]]
    speed: tuple[str, ...] = ()
    """terms in inverse proportion to the airspeed"""
    positions: tuple[str, ...] = ()
    """rates that a vane or an accelerometer away from the center of mass adds"""


def _normal(of: Mapping[str, Array]) -> dict[str, Array]:
    weight = STANDARD_GRAVITY * np.cos(of["theta"]) * np.cos(of["phi"])
    return {"q": of["q"], "a_z": of["a_z"] / of["V"], "weight": weight / of["V"]}


def _lateral(of: Mapping[str, Array]) -> dict[str, Array]:
    weight = STANDARD_GRAVITY * np.cos(of["theta"]) * np.sin(of["phi"]) / of["V"]
    return {
        "a_y": of["a_y"] / of["V"], "phi": weight,
        "p": of["p"] * np.sin(of["alpha"]), "r": -of["r"] * np.cos(of["alpha"]),
    }  # fmt: skip


RELATIONS = (
    _Relation("theta", ("q",), {}, lambda of: {"q": of["q"]}),
    _Relation("phi", ("p",), {}, lambda of: {"p": of["p"]}),
    _Relation("alpha", ("q", "a_z", "V"), {"theta": 0.0, "phi": 0.0}, _normal, ("a_z", "weight"), ("q",)),
    _Relation(
        "beta", ("p", "r", "phi", "a_y", "V"), {"theta": 0.0, "alpha": 0.0}, _lateral, ("a_y", "phi"), ("r", "p")
    ),
)


class _Correction(NamedTuple):
    """A mistake of a table: the factors of the terms that correct it."""

    code: str
    subject: str
    factor: float
    factors: Mapping[str, float]
    hint: str


def _corrections(relation: _Relation) -> list[_Correction]:
    found: list[_Correction] = []
    rates = [name for name in ("p", "q", "r") if name in relation.needed]
    agreement = f"it contradicts {relation.angle} and the other signals of its rate"
    for name in (*rates, *(one for one in ("a_y", "a_z") if one in relation.needed)):
        found.append(_Correction("sign", name, -1.0, {name: -1.0}, agreement))
        scales = (
            ((DEGREES, "is it in deg/s, not in rad/s?"), (1.0 / DEGREES, "is it in rad/s, not in deg/s?"))
            if name in rates
            else (
                (STANDARD_GRAVITY, "is it in g, not in m/s^2?"),
                (1 / STANDARD_GRAVITY, "is it in m/s^2, not in g?"),
            )
        )
        found += [_Correction("unit", name, 1.0 / scale, {name: scale}, hint) for scale, hint in scales]
    everything = (*rates, "a_y", "a_z", "phi", "weight")
    found.append(_Correction("sign", relation.angle, -1.0, dict.fromkeys(everything, -1.0), agreement))
    for scale in (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9):
        found.append(_Correction("unit", "time", 1.0 / scale, dict.fromkeys(everything, scale), "check time.unit"))
    for unit, scale in SPEED_UNITS.items():
        for factor, hint in ((scale, f"is it in {unit}, not in m/s?"), (1 / scale, f"is it in m/s, not in {unit}?")):
            found.append(_Correction("unit", "V", factor, dict.fromkeys(relation.speed, factor), hint))
    if relation.speed:
        for factor, hint in ((DEGREES, "in deg, not in rad"), (1.0 / DEGREES, "in rad, not in deg")):
            found.append(
                _Correction("unit", relation.angle, factor, dict.fromkeys(relation.speed, factor),
                            f"are {relation.angle} and the rates {hint}?")
            )  # fmt: skip
    return [one for one in found if one.factors]


def kinematic_consistency(context: Context) -> tuple[Finding, ...]:
    """Sign and unit of signals by the kinematics: an angle is the integral of its rates and specific forces.

    ``V alpha' = V q + a_z + g cos(theta) cos(phi)`` and the like (Klein & Morelli 2006, ch. 3 and 10). A correction
    is reported if it explains `EXPLAINED` of the angle's motion and lowers the residual by `IMPROVEMENT`.
    """
    found = []
    for relation in RELATIONS:
        pieces = [piece for one in context.experiments if (piece := _integrated(relation, one, context.constants))]
        if not pieces:
            continue
        angle, positions = (np.concatenate([piece[place] for piece in pieces]) for place in (0, 2))
        terms = {name: np.concatenate([piece[1][name] for piece in pieces]) for name in pieces[0][1]}
        power = float(angle @ angle)
        plain = _residual(angle, terms, positions, {})
        tried = [(_residual(angle, terms, positions, one.factors), one) for one in _corrections(relation)]
        least, best = min(tried, key=lambda pair: pair[0])
        noise = sum(piece[3] for piece in pieces)
        if power > 0.0 and least < min((1.0 - EXPLAINED) * power, (plain - 3.0 * noise) / IMPROVEMENT):
            found.append(Finding(best.code, "warning", best.subject, best.factor, None, {"hint": best.hint}))
    return tuple({(one.code, one.subject): one for one in found}.values())


def _residual(angle: Array, terms: Mapping[str, Array], positions: Array, factors: Mapping[str, float]) -> float:
    """Sum of squares of what the integrals leave, positions of sensors free."""
    rest = angle - np.sum([factors.get(name, 1.0) * values for name, values in terms.items()], axis=0)
    if positions.shape[1]:
        rest = rest - positions @ np.linalg.lstsq(positions, rest, rcond=None)[0]
    return float(rest @ rest)


def _integrated(
    relation: _Relation, one: Experiment, constants: Mapping[str, float]
) -> tuple[Array, dict[str, Array], Array, float] | None:
    """The angle, the integrals of its terms, the rates of positions, each without mean and slope; noise (rad^2).

    The last is the sum of squares of the integrated white noise: a random walk of N steps without its mean and slope
    has N / 15 times the variance of a step.
    """
    columns: dict[str, Array] = {}
    for name in (relation.angle, *relation.needed, *relation.defaults):
        alias = "airspeed" if name == "V" and name not in one.signals else name
        value = constants.get(name, relation.defaults.get(name))
        if alias in one.signals:
            columns[name] = np.asarray(one.signals[alias], dtype=np.float64)
        elif value is None or name == relation.angle:
            return None
        else:
            columns[name] = np.full(len(one.time), value)
    positive = columns.get("V", np.ones(len(one.time))) > 0
    run = longest_run(np.all(np.isfinite(np.column_stack(list(columns.values()))), axis=1) & positive)
    if run.stop - run.start < LEAST_SAMPLES:
        return None
    columns = {name: values[run] for name, values in columns.items()}
    if not moves(columns[relation.angle]):
        return None

    def integral(rate: Array) -> Array:
        return level(np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0 * one.step))))

    rates = relation.terms(columns)
    terms = {name: integral(rate) for name, rate in rates.items()}
    length = run.stop - run.start
    noise = sum((noise_with_steps(rate) * one.step) ** 2 for rate in rates.values()) * length**2 / 15.0
    positions = np.column_stack([np.zeros((length, 0)), *(level(columns[n]) for n in relation.positions)])
    return level(np.unwrap(columns[relation.angle])), terms, positions, noise


def level(values: Array) -> Array:
    """``values`` (N,) without mean and slope."""
    line = np.vander(np.linspace(-1.0, 1.0, len(values)), 2)
    flat: Array = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
    return flat
