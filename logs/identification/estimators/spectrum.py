"""Resonance peak of a spectrum: frequency and half-power bandwidth.

``P(omega) = (a + b omega^2) / ((omega_n^2 - omega^2)^2 + (2 zeta omega_n omega)^2) + floor`` is fitted to the power
spectrum of free motion or of motion in gusts, or to the frequency response if an input was measured (Bendat &
Piersol, Random Data, 2010, ch. 6 and 9, whose variances of the ordinates weigh the fit). The bandwidth at half the
power is ``2 zeta omega_n`` (Etkin & Reid, Dynamics of Flight, 1996, ch. 7).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.modal import ModalFit, ModalMethod, NotIdentified, Record, Records
from logs.identification.estimators.separable import (
    Build,
    SeparableFit,
    SeparableRecord,
    log_squares,
    orthonormal,
    solve,
)
from logs.identification.findings import Entry, register
from logs.identification.results import Array
from logs.identification.statistics.covariance import ParameterUncertainty, information, is_determined

MAX_DAMPING = 0.35
"""-; above which half the power is not reached on both sides of the peak"""
MIN_RECORDS = 4
"""-; for a coherence"""
MIN_COHERENCE = 0.3
MIN_ORDINATES = 12
HIGHEST = 0.25
"""-; of the sampling frequency"""
DECAY = 2.0
"""-; rms of the first third of a record over that of the last, above which the motion is a transient"""
MIN_TIME_CONSTANTS = 3.0
"""-; after the input; the spectrum of a transient that is cut off leaks"""
DAMPINGS = (0.03, 0.1, 0.3)
PASSES = 4
MIN_PEAK = 4.0
"""-; of the peak's power over the floor's"""

register({
    "one_mode_only": Entry("one peak does not separate two modes", "The spectrum identifies one mode."),
    "no_peak": Entry("the spectrum has no peak", "No resonance stands out of the spectrum."),
    "transient_cut_off": Entry(
        "the records end {value:.2g} time constants after the input, {limit:g} are needed: their spectra leak",
        "The motion has not decayed at the end of a record.", "record longer",
    ),
    "low_coherence": Entry(
        "input and output are coherent at too few frequencies",
        "A frequency response needs several records with a coherent response.",
    ),
})  # fmt: skip


class Ordinates(NamedTuple):
    """Powers at the frequencies of one record, or of one frequency response."""

    frequency: Array
    """rad/s; (F,)"""
    power: Array
    """(F, m)"""
    deviation: Array
    """(F, m); standard deviation of `power`, ones if the fit estimates it"""
    decays: bool
    """-; a transient in noise, not random motion"""
    accelerations: tuple[bool, ...]
    """-; m; outputs of a frequency response with direct transmission"""
    noisy: bool
    """-; with a noise floor"""


def fit(records: Records, kinds: tuple[str, ...]) -> ModalFit:
    """The one mode of ``kinds``, from its peak."""
    if len(kinds) > 1:
        raise NotIdentified("one_mode_only")
    driven = [r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0]
    if any(np.any(np.ptp(record.outputs, axis=0) == 0) for record in driven or records.pieces):
        raise NotIdentified("constant_output")
    given = [_response(driven, records)] if driven else [periodogram(record) for record in records.pieces]
    found = _fitted(given)
    span = _rests(driven) if driven else _decaying(records.pieces, given)
    constants = float(found.values[0] * found.values[1] * span)
    if constants < MIN_TIME_CONSTANTS:
        raise NotIdentified("transient_cut_off", constants, MIN_TIME_CONSTANTS)
    return ModalFit(found.values[:2], _uncertainty(found))


def _rests(records: list[Record]) -> float:
    """Time in s from the end of the input to the end of the record, of the shortest."""
    return min((len(record.outputs) - record.free_from) * record.step for record in records)


def _decaying(records: tuple[Record, ...], given: list[Ordinates]) -> float:
    """Length in s of the shortest record whose motion decays; infinite if it is random in all of them."""
    return min(
        (len(one.outputs) * one.step for one, powers in zip(records, given, strict=True) if powers.decays),
        default=math.inf,
    )


def periodogram(record: Record) -> Ordinates:
    """Power of each output at the record's own frequencies."""
    count = len(record.outputs)
    line = np.vander(np.linspace(-1, 1, count), 2)
    level = record.outputs - line @ np.linalg.lstsq(line, record.outputs, rcond=None)[0]
    third = count // 3
    falls = np.sqrt(np.mean(level[:third] ** 2, axis=0) / np.maximum(np.mean(level[-third:] ** 2, axis=0), 1e-300))
    decays = bool(np.median(falls) > DECAY)
    if decays:  # a line through a transient would leak; its jump at the start is halved (trapezoidal rule)
        level = record.outputs - record.outputs[-count // 10 :].mean(axis=0)
        level[0] /= 2
    frequency: Array = (2 * np.pi * np.fft.rfftfreq(count, record.step)).astype(np.float64)
    power = np.abs(np.fft.rfft(level, axis=0)) ** 2 * record.step / count
    kept = (frequency > 0) & (frequency < 2 * np.pi * HIGHEST / record.step)
    if kept.sum() < MIN_ORDINATES:
        raise NotIdentified("record_too_short", float(kept.sum()), MIN_ORDINATES, unit="ordinates")
    ones = np.ones((int(kept.sum()), power.shape[1]))
    none = (False,) * power.shape[1]
    return Ordinates(frequency[kept], power[kept], ones, decays, none, True)


def _response(records: list[Record], given: Records) -> Ordinates:
    """Squared modulus of the frequency response, averaged over records, with its error by the coherence."""
    if len(records) < MIN_RECORDS:
        raise NotIdentified("record_too_short", float(len(records)), MIN_RECORDS, unit="records")
    count, step = min(len(record.outputs) for record in records), records[0].step
    frequency = 2 * np.pi * np.fft.rfftfreq(count, step)
    inputs, outputs = [], []
    for record in records:
        moved = np.zeros(count) if record.input is None else record.input[:count]
        inputs.append(np.fft.rfft(moved - moved[-1]))
        seen = record.outputs[:count]
        outputs.append(np.fft.rfft(seen - seen[-count // 10 :].mean(axis=0), axis=0))
    u, y = np.array(inputs)[:, :, None], np.array(outputs)
    cross, auto = np.sum(np.conj(u) * y, axis=0), np.sum(np.abs(u) ** 2, axis=0)
    coherence = np.clip(np.abs(cross) ** 2 / (auto * np.sum(np.abs(y) ** 2, axis=0) + 1e-300), 0, 1 - 1e-9)
    kept = (frequency > 0) & np.all(coherence > MIN_COHERENCE, axis=1) & (frequency < 2 * np.pi * HIGHEST / step)
    if kept.sum() < MIN_ORDINATES / 2:
        raise NotIdentified("low_coherence")
    power = np.abs(cross / auto) ** 2
    relative = np.sqrt(2 * (1 - coherence) / (len(records) * coherence))
    sharp = tuple(unit == "m/s^2" for unit in given.units)
    return Ordinates(frequency[kept], power[kept], (power * np.maximum(relative, 0.02))[kept], False, sharp, False)


def _fitted(given: list[Ordinates]) -> SeparableFit:
    """Frequency and damping of the peak, the ordinates weighted by their variance under the model."""
    weights = [1 / o.deviation if not o.noisy else 1 / np.maximum(_smooth(o.power), 1e-300) for o in given]
    frequency = np.concatenate([o.frequency for o in given])
    grid = np.unique(frequency[frequency < 0.7 * frequency.max()])[:200]
    starts = [np.array([w, z]) for w in grid for z in DAMPINGS]
    build = _builder(given, weights)
    values = min(starts, key=lambda start: log_squares(build, start))
    for _ in range(PASSES):
        fit = solve(build, values)
        values = np.array([abs(fit.values[0]), abs(fit.values[1])])
        if not fit.converged or not frequency.min() < values[0] < frequency.max():
            raise NotIdentified("no_peak")
        if values[1] > MAX_DAMPING:
            raise NotIdentified("overdamped", float(values[1]), MAX_DAMPING)
        weights = [_weights(o, w, values) for o, w in zip(given, weights, strict=True)]
        build = _builder(given, weights)
    return solve(build, values)


def _smooth(power: Array) -> Array:
    kernel = np.array([1.0, 2.0, 3.0, 2.0, 1.0])
    spread = [np.convolve(p, kernel, "same") / np.convolve(np.ones_like(p), kernel, "same") for p in power.T]
    return np.column_stack(spread)


def _builder(given: list[Ordinates], weights: list[Array]) -> Build:
    def build(values: Array) -> list[SeparableRecord]:
        return [_record(o, w, values) for o, w in zip(given, weights, strict=True)]

    return build


def _columns(ordinates: Ordinates, output: int, values: Array) -> Array:
    frequency, (natural, damping) = ordinates.frequency, values
    peak = 1 / ((natural**2 - frequency**2) ** 2 + (2 * damping * natural * frequency) ** 2)
    columns = [peak * natural**4, peak * natural**2 * frequency**2]
    if ordinates.noisy:
        columns.append(np.ones_like(frequency))
    elif ordinates.accelerations[output]:
        columns.append(peak * frequency**4)
    return np.column_stack(columns)


def _record(ordinates: Ordinates, weights: Array, values: Array) -> SeparableRecord:
    outputs = range(ordinates.power.shape[1])
    bases = tuple(orthonormal(_columns(ordinates, j, values) * weights[:, [j]]) for j in outputs)
    return SeparableRecord(ordinates.power * weights, bases, tuple(basis[:, :0] for basis in bases))


def _weights(ordinates: Ordinates, weights: Array, values: Array) -> Array:
    """One over the standard deviation of each ordinate.

    A random motion's is its power. A transient's, ``|S + N|^2`` of noise N about S, is the root of
    ``2 S floor + floor^2``, once the floor is known.
    """
    if not ordinates.noisy:
        return weights
    fresh = []
    for output in range(ordinates.power.shape[1]):
        columns = _columns(ordinates, output, values)
        weighted = columns * weights[:, [output]]
        scale = np.linalg.norm(weighted, axis=0)
        measured = ordinates.power[:, output] * weights[:, output]
        parts = np.linalg.lstsq(weighted / scale, measured, rcond=None)[0] / scale
        signal, floor = (
            np.maximum(columns[:, :2] @ parts[:2], 0.0),
            max(float(parts[2]), _lower_bound(ordinates, output)),
        )
        if np.max(signal) < MIN_PEAK * floor:
            raise NotIdentified("no_peak")
        fresh.append(1 / np.sqrt(2 * signal * floor + floor**2) if ordinates.decays else 1 / (signal + floor))
    return np.column_stack(fresh)


def _lower_bound(ordinates: Ordinates, output: int) -> float:
    """A lower bound of the noise floor."""
    return 0.3 * float(np.median(ordinates.power[-len(ordinates.power) // 3 :, output])) + 1e-300


def _uncertainty(fit: SeparableFit) -> ParameterUncertainty:
    """Cramer-Rao bounds, scaled by the dispersion of the ordinates."""
    total = information(fit.sensitivities)
    if not fit.converged or not is_determined(total):
        raise NotIdentified("mode_not_identifiable")
    degrees = float(sum(r.size for r in fit.residuals) - fit.nuisances - len(fit.values))
    if degrees < 2:
        raise NotIdentified("record_too_short", degrees, 2.0, unit="degrees of freedom")
    squares = sum(float(np.sum(r**2)) for r in fit.residuals)
    return ParameterUncertainty(np.asarray(np.linalg.inv(total)) * squares / degrees, degrees)


SPECTRUM = ModalMethod("spectrum", "spectrum", fit, inputs=True)
METHOD = SPECTRUM.title
spectrum = SPECTRUM.mode
