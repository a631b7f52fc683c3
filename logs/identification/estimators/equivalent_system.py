"""Low-order equivalent system: transfer functions with one denominator and one delay, in the frequency domain.

``y_j(s) = (b_j0 + b_j1 s [+ b_j2 s^2]) exp(-tau s) / (s^2 + 2 zeta omega s + omega^2) u(s)``, with a second pair in
the denominator and two more powers in the numerators if the phugoid is identified too (MIL-HDBK-1797, appendix A;
Morelli, Identification of Low Order Equivalent System Models from Flight Test Data, NASA/TM-2000-210117). Output
error on finite Fourier transforms (Klein & Morelli, Aircraft System Identification, 2006, ch. 7). At a record's own
frequencies its initial and final state are a polynomial in s over the same denominator; with a drift they are linear
nuisance parameters of each record. Of a short period the handling-quality parameters follow (MIL-STD-1797A,
4.2.1.2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.estimators.modal import ModalFit, ModalMethod, NotIdentified, Record, Records
from logs.identification.estimators.separable import (
    Build,
    SeparableFit,
    SeparableRecord,
    log_squares,
    optimal,
    orthonormal,
    solve,
)
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.modes import SHORT_PERIOD
from logs.identification.results import Array, Estimate
from logs.identification.statistics.covariance import (
    ParameterUncertainty,
    at_least,
    cluster_covariance,
    information,
    is_determined,
    propagate,
)
from wingbeat.constants import STANDARD_GRAVITY

Complex = NDArray[np.complex128]
Function = Callable[[Array], float]
"""of the parameters"""
ACCELERATIONS = ("m/s^2", "rad/s^2")
"""units of outputs with direct transmission of the input"""
FORCES = ("n_y", "n_z", "alpha_dot", "beta_dot")
"""names of others with direct transmission: load factors and the rates of the flow angles"""
ANGLES = ("theta", "pitch")
"""names of outputs that contain the integral of the pitch rate"""
RATES = ("q", *ANGLES)
"""names of outputs whose numerator has the zero 1/T_theta2"""
POWER_FRACTION = 0.99
"""-; of the input's power in the band"""
HIGHEST = 0.2
"""-; of the sampling rate"""
GRID, STARTS = 12, 3
DAMPINGS = (0.1, 0.4, 0.8)
SLOW_FRACTION, SLOW_DAMPING = 0.12, 0.2
"""-; of the second pair, the frequency relative to the first: start values, and mean of its prior"""
SLOW_DEVIATIONS = 1.4, 0.2
"""-; standard deviation of that prior: factor of the frequency, damping ratio"""
ONE_PAIR, SLOW_PRIOR, TWO_PAIRS = "one pair", "slow pair with a prior", "two pairs"
NONLINEAR = {ONE_PAIR: 3, SLOW_PRIOR: 5, TWO_PAIRS: 5}
"""-; frequencies, dampings and delay; the numerators follow"""
MUCH_LESS = 4.0
"""-; ratio of the residual power with one pair to that with two, above which there are two"""
MIN_EXPLAINED = 0.95
"""-; of the outputs' power without the nuisances"""
MIN_PERIODS = 4.9
"""-; of the mode in all records together (Morelli, SIDPAC)"""
MIN_DEGREES = 4.0
MAX_DELAY_PHASE = 1.0
"""rad at the mode's frequency, above which the delay replaces the mode"""
CATEGORY_A = ((0.28, 3.6, 0.35, 1.3), (0.16, 10.0, 0.25, 2.0))
"""1/(g s^2), -; bounds of CAP and damping ratio of levels 1 and 2, flight phase category A (MIL-STD-1797A)"""
DELAYS = (0.10, 0.20, 0.25)
"""s; largest equivalent delay of levels 1 to 3"""

register({
    "delay_replaces_mode": Entry(
        "the delay turns the phase by {value:.2g} rad at the mode's frequency, more than {limit:g}: the input does"
        " not excite the mode, or has a wrong time", "The delay of the equivalent system took the place of the mode.",
        "check the time of the input",
    ),
    "handling_level": Entry(
        "short period of level {value:.0f} in category A (CAP {cap:.2g} 1/(g s^2), damping {damping:.2g}), equivalent"
        " delay of {delay:.2g} s of level {delay_level}{dropback}",
        "Level of MIL-STD-1797A by CAP, damping ratio and equivalent delay; 4 is worse than level 3.",
    ),
})  # fmt: skip


class Transform(NamedTuple):
    """One record at its own frequencies."""

    s: Complex
    """1/s; (F,), imaginary"""
    input: Complex
    """(F,)"""
    outputs: Complex
    """(F, m)"""
    length: float
    """s"""


def fit(records: Records, kinds: tuple[str, ...]) -> ModalFit:
    """Modes ``kinds``, the delay, and of a short period gains, numerators and handling-quality parameters.

    A short period alone is fitted with a slow pair that has a prior, a phugoid alone as the slower of two pairs if
    the second explains most of what one leaves. The handling-quality parameters are those of one pair, the equivalent
    system of the standard.
    """
    driven = tuple(r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0)
    if not driven:
        raise NotIdentified("no_input")
    if any(np.any(np.ptp(record.outputs, axis=0) == 0) for record in driven):
        raise NotIdentified("constant_output")
    transforms = [transform(record, records.smooth_input) for record in driven]
    if kinds == (SHORT_PERIOD,):
        order = SLOW_PRIOR
    else:
        order = TWO_PAIRS if len(kinds) == 2 or _two_pairs(transforms, records) else ONE_PAIR
    best = _fitted(transforms, records, order)
    _check(best, builder(transforms, records, order), transforms, order, kinds)
    spread = _uncertainty(best, order)
    if spread.degrees < MIN_DEGREES:
        raise NotIdentified("record_too_short", spread.degrees, MIN_DEGREES, unit="degrees of freedom")
    last = NONLINEAR[order] - 1
    delay = spread.part(slice(last, last + 1)).estimates({"delay": "s"}, best.values[last : last + 1])
    pairs = [2 * int(k) + i for k in np.argsort(-_pairs(best.values, order)[: len(kinds), 0]) for i in (0, 1)]
    if order == TWO_PAIRS and len(kinds) == 1:
        slower = 2 * int(np.argmin(best.values[:4:2]))
        pairs = [slower, slower + 1]
    ordered = spread.transformed(np.eye(len(best.values))[pairs])
    if kinds != (SHORT_PERIOD,):
        return ModalFit(best.values[pairs], ordered, delay)
    single = _fitted(transforms, records, ONE_PAIR)
    if not single.converged or not is_determined(information(single.sensitivities)):
        return ModalFit(best.values[pairs], ordered, delay)
    parameters, level = _parameters(records, single.values, _uncertainty(single, ONE_PAIR))
    return ModalFit(best.values[pairs], ordered, (*delay, *parameters), level)


def _two_pairs(transforms: list[Transform], records: Records) -> bool:
    """Whether a second pair explains most of what one leaves of an output."""
    left = []
    for order in (ONE_PAIR, TWO_PAIRS):
        try:
            found = _fitted(transforms, records, order)
        except NotIdentified:
            return False
        left.append(found.deviation**2)
    return bool(np.max(left[0] / np.maximum(left[1], 1e-300)) > MUCH_LESS)


def transform(record: Record, smooth_input: bool = False) -> Transform:
    """Finite Fourier transforms (trapezoids) at the record's own frequencies, up to the end of the input's band.

    An input that is linear between samples has the squared sinc of its samples' transform.
    """
    count = len(record.outputs)
    length = (count - 1) * record.step
    given = np.zeros(count) if record.input is None else record.input
    frequencies = np.arange(1, int(HIGHEST / record.step * length) + 1) / length
    kernel = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(count) * record.step))
    kernel[:, [0, -1]] /= 2
    both = kernel @ np.column_stack((given, record.outputs)) * record.step / math.sqrt(length)
    power = np.cumsum(np.abs(both[:, 0]) ** 2)
    band = slice(0, int(np.searchsorted(power, POWER_FRACTION * power[-1])) + 1) if len(power) else slice(0, 0)
    s: Complex = np.asarray(2j * np.pi * frequencies[band], dtype=np.complex128)
    spectra: Complex = np.asarray(both[band], dtype=np.complex128)
    hold = 1.0 if smooth_input else np.sinc(frequencies[band] * record.step) ** 2
    return Transform(s, hold * spectra[:, 0], spectra[:, 1:], length)


def builder(transforms: list[Transform], records: Records, order: str) -> Build:
    """The linear problem at frequency and damping of the pairs and the delay (p,)."""

    def build(values: Array) -> list[SeparableRecord]:
        return [
            _record(one, records, _pairs(values, order), float(values[NONLINEAR[order] - 1])) for one in transforms
        ]

    return build


def _pairs(values: Array, order: str) -> Array:
    """Frequencies and dampings (k, 2) of the denominator."""
    if order != SLOW_PRIOR:
        return values[: NONLINEAR[order] - 1].reshape(-1, 2)
    frequency, damping, slower, heavier = values[:4]
    factor, difference = SLOW_DEVIATIONS
    slow = [SLOW_FRACTION * factor**slower * frequency, SLOW_DAMPING + difference * heavier]
    return np.array([[frequency, damping], slow])


def _precision(order: str) -> Array | None:
    """Of the prior, one over the standard deviation of each parameter (p,)."""
    return np.array([0.0, 0.0, 1.0, 1.0, 0.0]) if order == SLOW_PRIOR else None


def _record(given: Transform, records: Records, pairs: Array, delay: float) -> SeparableRecord:
    s = given.s
    denominator = np.prod([s**2 + 2 * z * w * s + w**2 for w, z in pairs], axis=0)
    driven = given.input * np.exp(-s * delay) / denominator
    nuisances, shared = [], []
    for name, unit in zip(records.names, records.units, strict=True):
        integral = s if name in ANGLES else np.ones_like(s)
        powers = 2 * len(pairs) + (unit in ACCELERATIONS or name in FORCES)
        ends = [s**k / (denominator * integral) for k in range(2 * len(pairs) + (name in ANGLES))]
        drift = [] if name in ANGLES else [1 / s]
        nuisances.append(orthonormal(_real(np.column_stack([*ends, *drift]))))
        shared.append(_real(np.column_stack([driven / integral * s**k for k in range(powers)])))
    return SeparableRecord(_real(given.outputs), tuple(nuisances), tuple(shared))


def _real(columns: Complex) -> Array:
    """Real parts and, behind them, imaginary ones (2 F, k)."""
    return np.vstack((columns.real, columns.imag))


def _fitted(transforms: list[Transform], records: Records, order: str) -> SeparableFit:
    """Fit of pairs and delay from the best start value, or the next ones if it explains little."""
    build, count = builder(transforms, records, order), 1 if order == ONE_PAIR else 2
    low = 0.7 * min((abs(t.s[0]) for t in transforms if len(t.s)), default=0.0)
    high = max((abs(t.s[-1]) for t in transforms if len(t.s)), default=0.0)
    unknowns = 2 * count * (len(transforms) + 1)
    frequencies = sum(len(t.s) for t in transforms)
    if not low < high or 2 * frequencies <= unknowns + 2 * count + 1:
        raise NotIdentified("record_too_short", float(frequencies), float(unknowns), unit="frequencies")
    starts, costs = [], []
    for w in np.geomspace(low, high, GRID):
        slow = {ONE_PAIR: (), SLOW_PRIOR: (0.0, 0.0), TWO_PAIRS: (SLOW_FRACTION * w, SLOW_DAMPING)}[order]
        tried = [np.array([w, z, *slow, 0.0]) for z in DAMPINGS]
        cost = [log_squares(build, start) for start in tried]
        starts.append(tried[int(np.argmin(cost))])
        costs.append(min(cost))
    padded = np.concatenate(([np.inf], costs, [np.inf]))
    minima = [k for k in range(GRID) if costs[k] <= min(padded[k], padded[k + 2])]
    # The first that explains the outputs, not the best: another may take the mode for its slow pair.
    fits = []
    for k in sorted(minima, key=lambda k: costs[k])[:STARTS]:
        fit = solve(build, starts[k], _precision(order))
        if (
            fit.converged
            and np.all(_pairs(fit.values, order)[:, 0] > 0)
            and _explained(build, fit, order) > MIN_EXPLAINED
        ):
            return fit
        fits.append(fit)
    return fits[0]


def _check(fit: SeparableFit, build: Build, transforms: list[Transform], order: str, kinds: tuple[str, ...]) -> None:
    """Refuse a fit that determines no mode."""
    frequencies = fit.values[: 4 if order == TWO_PAIRS else 2 : 2]
    if not fit.converged or not is_determined(_information(fit, order)) or np.any(frequencies <= 0):
        raise NotIdentified("mode_not_identifiable")
    explained = _explained(build, fit, order)
    if explained < MIN_EXPLAINED:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED)
    frequency = float(np.max(frequencies) if SHORT_PERIOD in kinds else np.min(frequencies))
    phase = abs(float(fit.values[NONLINEAR[order] - 1])) * frequency
    if phase > MAX_DELAY_PHASE:
        raise NotIdentified("delay_replaces_mode", phase, MAX_DELAY_PHASE)
    periods = frequency * sum(t.length for t in transforms) / (2 * math.pi)
    if periods < MIN_PERIODS:
        raise NotIdentified("record_too_short", periods, MIN_PERIODS, unit="periods of the mode")
    band = max(abs(t.s[-1]) for t in transforms)
    if frequency > band:
        raise NotIdentified("mode_too_fast", frequency, band)


def _prior(fit: SeparableFit, order: str) -> Array:
    """Information matrix (P, P) of the prior."""
    prior, precision = np.zeros((len(fit.values), len(fit.values))), _precision(order)
    if precision is not None:
        prior[: len(precision), : len(precision)] = np.diag(precision**2)
    return prior


def _information(fit: SeparableFit, order: str) -> Array:
    return information(fit.sensitivities) + _prior(fit, order)


def _explained(build: Build, fit: SeparableFit, order: str) -> float:
    """Fraction of the power without the nuisances that the input explains, of the output where it is largest."""
    records = build(fit.values[: NONLINEAR[order]])
    undriven = [one._replace(shared=tuple(c[:, :0] for c in one.shared)) for one in records]
    left, total = (np.sum(np.vstack(optimal(each)[0]) ** 2, axis=0) for each in (records, undriven))
    return float(np.max(1 - left / np.maximum(total, 1e-300)))


def _uncertainty(fit: SeparableFit, order: str) -> ParameterUncertainty:
    """Cramer-Rao bounds, at least the dispersion between records if there are enough."""
    size = sum(r.size for r in fit.residuals)
    degrees = float(size - fit.nuisances - len(fit.values))
    inverse = np.asarray(np.linalg.pinv(_information(fit, order), hermitian=True))
    within = inverse * size / max(degrees, 1.0)
    between = cluster_covariance(fit.residuals, fit.sensitivities, _prior(fit, order))
    if between is None:
        return ParameterUncertainty(within, degrees)
    return ParameterUncertainty(at_least(within, between), min(degrees, len(fit.residuals) - 1.0))


def _parameters(
    records: Records, values: Array, spread: ParameterUncertainty
) -> tuple[tuple[Estimate, ...], tuple[Finding, ...]]:
    """Static gains and numerators of one pair, CAP and dropback, and the level that follows."""
    found: list[Estimate] = []

    def add(name: str, unit: str, of: Function) -> None:
        value, worth = propagate(lambda p: np.array([of(p)]), values, spread)
        if np.isfinite(value[0]):
            found.extend(worth.estimates({name: unit}, value))

    places: dict[str, list[int]] = {}
    start = 3
    for name, unit in zip(records.names, records.units, strict=True):
        powers = 2 + (unit in ACCELERATIONS or name in FORCES)
        places[name] = list(range(start, start + powers))
        for power, place in enumerate(places[name]):
            add(f"{name}_b{power}", f"{unit or '-'} s^{power - 2}", itemgetter(place))
        if name not in ANGLES:
            add(f"{name}_gain", unit or "-", partial(_gain, places[name][0]))
        start += powers
    rate = next((places[name] for name in RATES if name in places), None)
    constants = {one.name: one for one in found if one.name.endswith("_b0")}
    zero = next((constants[f"{name}_b0"] for name in RATES if name in places), None)
    if rate is not None and zero is not None and not zero.contains(0.0):
        add("T_theta2", "s", lambda p: p[rate[1]] / p[rate[0]])
        add("dropback", "s", lambda p: p[rate[1]] / p[rate[0]] - 2 * p[1] / p[0])
    load = _load_factor(records, places, rate)
    if load is not None:
        add("n_alpha", "1/rad", load)
        if not found[-1].contains(0.0):
            add("CAP", "1/(g s^2)", lambda p: p[0] ** 2 / load(p))
    return tuple(found), _level(found, values)


def _gain(place: int, values: Array) -> float:
    """Static gain of the numerator whose constant is at ``place``."""
    return float(values[place] / values[0] ** 2)


def _load_factor(records: Records, places: dict[str, list[int]], rate: list[int] | None) -> Function | None:
    """Load factor per angle of attack, g/rad, as a function of the parameters; None if it is not measured."""
    if "alpha" in places and "a_z" in places:
        return lambda p: -p[places["a_z"][0]] / p[places["alpha"][0]] / STANDARD_GRAVITY
    if "alpha" in places and "n_z" in places:
        return lambda p: p[places["n_z"][0]] / p[places["alpha"][0]]
    if rate is not None and records.airspeed is not None:
        speed = records.airspeed
        return lambda p: speed / STANDARD_GRAVITY * p[rate[0]] / p[rate[1]]
    return None


def _level(derived: list[Estimate], values: Array) -> tuple[Finding, ...]:
    """Level of MIL-STD-1797A by CAP, damping and delay."""
    known = {one.name: one.value for one in derived}
    if "CAP" not in known:
        return ()
    cap, damping, delay = known["CAP"], float(values[1]), float(values[2])
    inside = [low <= cap <= high and least <= damping <= most for low, high, least, most in CATEGORY_A]
    details = {
        "cap": cap, "damping": damping, "delay": delay,
        "delay_level": next((k + 1 for k, limit in enumerate(DELAYS) if delay <= limit), 4),
        "dropback": f", dropback {known['dropback']:.2g} s" if "dropback" in known else "",
    }  # fmt: skip
    level = float(1 + inside.index(True) if any(inside) else 3)
    return (Finding("handling_level", "info", SHORT_PERIOD, level, details=details),)


EQUIVALENT_SYSTEM = ModalMethod("equivalent_system", "equivalent system", fit, inputs=True)
METHOD = EQUIVALENT_SYSTEM.title
equivalent_system = EQUIVALENT_SYSTEM.mode
