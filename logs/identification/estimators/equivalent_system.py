"""Low-order equivalent system: transfer functions of one denominator and one delay, fitted in the frequency domain.

``y_j(s) = (b_j0 + b_j1 s [+ b_j2 s^2]) exp(-tau s) / (s^2 + 2 zeta omega s + omega^2) u(s)``, with the phugoid's
pair in the denominator and two powers more in the numerators where it is asked for (MIL-HDBK-1797, appendix A;
Morelli, Identification of Low Order Equivalent System Models from Flight Test Data, NASA/TM-2000-210117).
Complex output error by maximum likelihood on finite Fourier transforms (Klein & Morelli, Aircraft System
Identification, 2006, ch. 7): the noise's spectrum is part of what is estimated. At a record's own frequencies what
it begins and ends with is a polynomial in s over the same denominator; with a slow drift it is each record's own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.diagnostics.model_structure_error import share_of_lack
from logs.identification.estimators.records import Record, Records
from logs.identification.estimators.variable_projection import (
    Build,
    Piece,
    Prior,
    SeparableFit,
    residuals_at,
    solve,
    squares,
    taken,
)
from logs.identification.models.modes import KINDS, PHUGOID, SHORT_PERIOD, TOO_FAST, Mode, nothing, paired_mode
from logs.identification.results import Array
from logs.identification.statistics.noise_spectrum import power_law
from logs.identification.statistics.parameter_uncertainty import Spread, by_scatter, determined, information

Complex = NDArray[np.complex128]
METHOD = "equivalent system"
ACCELERATIONS = ("m/s^2", "rad/s^2")
"""units of outputs that the input reaches at once"""
FORCES = ("n_y", "n_z", "alpha_dot", "beta_dot")
"""names of others that it does: load factors, and what turns the path. Without that power the frequency of q_dot's
motion came out 1.8 % too high, with an interval of 0.5 %"""
ANGLES = ("theta", "pitch")
"""names of outputs that hold the integral of the pitch rate"""
POWER_KEPT = 0.99
"""-; of the input's power: the band ends where it has been seen"""
HIGHEST_OF_AVERAGE = 0.8
"""-; of the moving average's own frequency, beyond which it leaves nothing"""
HIGHEST_OF_SAMPLING = 0.2
ALONE, BOTH = 0, 2
"""pairs that are fitted: one with nothing beside it, both; 1 is one with a slow pair that stands in for the other"""
MUCH_LESS = 4.0
"""-; times what both pairs leave of an output, which one alone must leave for the second to be told"""
GRID, STARTS = 12, 3
DAMPINGS = (0.1, 0.4, 0.8)
SLOW_SHARE, SLOW_DAMPING = 0.12, 0.2
"""-; the slow pair that stands for the phugoid where it is not asked for, its frequency as a share of the short
period's. Without one the frequency came out 1.3 % too high and the damping 0.02 too low. A system that has no slow
pair cancels it in the numerator"""
SLOW_DOUBT = 1.4, 0.2
"""-; how far it may be off, share (as a factor) and damping, one standard deviation: they are parameters with that
prior. Two fits with shares 1.4 times larger and smaller, taken for an error as large as they differ, had inputs of
0.4 s, which tell the share, say a third less than they do"""
LEAST_DEGREES = 4.0
LEAST_FREQUENCIES = 3
OWN = 5.0
"""-; of each record: what it begins and ends with, and a drift. Where records have no more frequencies than that on
average, half of all that they hold is their own: of 80 flights the intervals of 65, that gave a number, held the
frequency in 9, of 120 with up to one frequency more those of 81 in 80"""
LEAST_EXPLAINED = 0.95
"""-; by the input, of what is not the records' own. In gusts of 0.5 m/s it was 0.9, the frequency 14 % low"""
LEAST_EXPLAINED_FLAPPING = 0.993
"""-; the same of stroke averages. Where the stroke modulated the derivatives by 0.3 and doublets were of 0.1 s, it
was 0.989 and the frequency of every third flight a third too low or worse"""
LEAST_PERIODS = 6.0
"""-; of the mode in all records together. Of one record of 25 Hz, 24 times with other noise, 50 to 60 % of the
intervals held frequency and damping in 2 to 3 periods, 80 in 4 to 5, 90 in 6.7; in less than one it gave 18 rad/s
where 2.8 was true"""
MOST_IN_STEP = 0.7
"""-; of `Records.in_step`. What swings with the stroke averages out over inputs that come at all its phases; at one
phase it is taken for the aircraft. Of flights with two doublets and more whose derivatives swing by 0.15 or 0.3 the
intervals held the damping in 227 of 227 below this, 39 of 49 from here to 0.9 and 28 of 84 above"""
SURE_OF_DELAY = 2.6
"""-; standard errors from which on a delay is one: 99 %"""
LARGEST_DELAY = 1.0
"""rad at the mode's frequency, above which the delay has taken the mode's place"""


class Transform(NamedTuple):
    """One record at its own frequencies."""

    s: Complex
    """1/s; (F,), imaginary"""
    input: Complex
    """(F,), complex"""
    outputs: Complex
    """(F, m), complex"""
    length: float
    """s"""
    line: Array
    """-; (F,), by which the input's is less where it is a line between the samples"""


def equivalent_system(records: Records, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
    """Modes ``kinds`` from input and outputs of all records.

    A phugoid alone is the slower of two pairs where the data tell two: with but one, the faster was taken for it.
    """
    driven = tuple(r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0)
    if not driven:
        seen = any(r.input is not None for r in records.pieces)
        why = "the input does not move where all was measured" if seen else "it takes an input"
        return nothing(METHOD, why, kinds)
    transforms = [transform(record, records.blur) for record in driven]
    transforms = [t for t in transforms if len(t.s) > LEAST_FREQUENCIES]
    if not transforms:
        return nothing(METHOD, "the records hold too few frequencies below the end of the input's band", kinds)
    why = _little(transforms, records)
    if why:
        return nothing(METHOD, why, kinds)
    count = len(kinds) if SHORT_PERIOD in kinds else _told(transforms, records)
    fit, shift = fit_transforms(transforms, records, count)
    why = fit.failure or _doubt(fit, transforms, count, kinds)
    if why:
        return nothing(METHOD, why, kinds)
    spread = _spread(fit, count).plus(np.outer(shift, shift))
    spread = spread.plus(_lack(fit, spread)) if records.blur else spread
    if spread.degrees < LEAST_DEGREES:
        return nothing(METHOD, "the records hold too few frequencies for the model's parameters", kinds)
    delay = spread.part(slice(-1, None)).estimates({"delay": "s"}, fit.values[-1:])
    fitted = KINDS if count == BOTH else kinds
    oscillations = slice(0, 2 * len(fitted))
    mode = paired_mode(METHOD, fitted, fit.values[oscillations], spread.part(oscillations), delay)
    if SHORT_PERIOD in kinds:
        return mode
    return mode._replace(short_period=None, unidentified=tuple(u for u in mode.unidentified if u.name == PHUGOID))


def _told(transforms: list[Transform], records: Records) -> int:
    """Whether a motion of which the phugoid is asked is fitted as `BOTH` pairs or as one `ALONE`.

    Both where the second explains most of what one leaves: else it is fitted to noise, and told for the slower mode.
    """
    white = [np.ones(t.outputs.shape) for t in transforms]
    left = {}
    for count in (ALONE, BOTH):
        fit, _ = fit_transforms(transforms, records, count)
        if not np.all(np.isfinite(fit.values)):
            return BOTH
        residuals, _ = residuals_at(builder(transforms, records, white, count), fit.values)
        left[count] = np.sum(np.vstack(residuals) ** 2, axis=0)
    return BOTH if np.max(left[ALONE] / np.maximum(left[BOTH], 1e-300)) > MUCH_LESS else ALONE


def _little(transforms: list[Transform], records: Records) -> str:
    """Why no fit of the records may be believed; empty where it may."""
    if np.mean([len(t.s) for t in transforms]) <= OWN:
        return "the records are too short: half of what they hold is how they begin and end"
    if records.in_step >= MOST_IN_STEP and len(records.pieces) == 1:
        return "one input came at one phase of the stroke: what swings with it does not average out, fly more"
    if records.in_step >= MOST_IN_STEP:
        return "the inputs came at much the same phase of the stroke: what swings with it does not average out"
    return ""


def transform(record: Record, blur: float) -> Transform:
    """Finite Fourier transforms (trapezoids) at the record's own frequencies, up to the end of the input's band."""
    count = len(record.outputs)
    length = (count - 1) * record.step
    given = np.zeros(count) if record.input is None else record.input
    highest = min(HIGHEST_OF_SAMPLING / record.step, HIGHEST_OF_AVERAGE / blur if blur else math.inf)
    frequencies = np.arange(1, int(highest * length) + 1) / length
    kernel = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(count) * record.step))
    kernel[:, [0, -1]] /= 2
    both = kernel @ np.column_stack((given, record.outputs)) * record.step / math.sqrt(length)
    power = np.cumsum(np.abs(both[:, 0]) ** 2)
    kept = slice(0, int(np.searchsorted(power, POWER_KEPT * power[-1])) + 1) if len(power) else slice(0, 0)
    s: Complex = np.asarray(2j * np.pi * frequencies[kept], dtype=np.complex128)
    seen: Complex = np.asarray(both[kept], dtype=np.complex128)
    line = np.sinc(frequencies[kept] * record.step) ** 2
    return Transform(s, seen[:, 0], seen[:, 1:], length, line)


def fit_transforms(transforms: list[Transform], records: Records, count: int) -> tuple[SeparableFit, Array]:
    """Two pairs of frequency and damping and the delay (5,), residuals white; and what is not known of the input.

    The former are (w, z, w, z, delay); of a ``count`` of 1 the second pair is by how many standard deviations the
    slow pair's share and damping are off, of `ALONE` it is not used.
    The second (5,) is by what they move where the input is a line between the samples, not as smooth as they allow.
    """
    unknown = np.zeros(5)
    weights, prior = [np.ones(t.outputs.shape) for t in transforms], _prior(count)
    build = builder(transforms, records, weights, count)
    least = LEAST_EXPLAINED_FLAPPING if records.blur else LEAST_EXPLAINED
    first = _first(build, transforms, count, least)
    if first.failure:
        return first, unknown
    explained = _explained(build, first)
    weights = _reweighted(build, first, transforms, weights)
    build = builder(transforms, records, weights, count)
    fit = solve(build, first.values, prior)
    # Whitened residuals hide what is not explained: on the Arizona it was 0.99 before and 0.997 with the weights.
    if not fit.failure and min(explained, _explained(build, fit)) < least:
        why = "the input explains too little of the motion: turbulence, or a lag that is not known"
        return fit._replace(failure=why), unknown
    if records.blur or fit.failure:  # an average is smooth
        return fit, unknown
    lines = [t._replace(input=t.input * t.line) for t in transforms]
    other = solve(builder(lines, records, weights, count), fit.values, prior)
    why = f"with its input as a line between samples {other.failure}" if other.failure else ""
    return fit._replace(failure=why), other.values - fit.values


def _prior(count: int) -> Prior:
    """What is known beforehand of a fit of ``count``: what the pair may be that stands in, or that it is not used."""
    weight = np.zeros(5)
    weight[2:4] = float(count != BOTH)
    return Prior(np.zeros(5), weight)


def _explained(build: Build, fit: SeparableFit) -> float:
    """Share of the power that is not the records' own which the input explains, of the output where it is largest."""

    def idle(values: Array) -> list[Piece]:
        return [piece._replace(shared=tuple(c[:, :0] for c in piece.shared)) for piece in build(values)]

    left, total = (np.sum(np.vstack(residuals_at(made, fit.values)[0]) ** 2, axis=0) for made in (build, idle))
    return float(np.max(1 - left / np.maximum(total, 1e-300)))


def _first(build: Build, transforms: list[Transform], count: int, least: float) -> SeparableFit:
    """The fit from the best place of a grid, or where it does not explain ``least`` the first one that does.

    From the best place alone a pitch that rang at 2 and at 0.2 rad/s was fitted with the latter and a delay of a
    second.
    """
    fits = []
    for start in _starts(build, transforms, count):
        fit = solve(build, start, _prior(count))
        turns = not fit.failure and bool(np.all(_pairs(fit.values, count)[:, 0] > 0))
        if turns and _explained(build, fit) >= least:
            return fit
        fits.append(fit)
    return next((fit for fit in fits if not fit.failure), fits[0])


def _starts(build: Build, transforms: list[Transform], count: int) -> list[Array]:
    """Of a grid of frequencies, each with its best damping, those `STARTS` that fit best among their neighbours."""
    low = 0.7 * min(abs(t.s[0]) for t in transforms)
    high = max(abs(t.s[-1]) for t in transforms)
    best, costs = [], []
    for w in np.geomspace(low, high, GRID):
        other = (0.0, 0.0) if count != BOTH else (SLOW_SHARE * w, SLOW_DAMPING)
        tried = [np.array([w, z, *other, 0.0]) for z in DAMPINGS]
        cost = [squares(build, start) for start in tried]
        best.append(tried[int(np.argmin(cost))])
        costs.append(min(cost))
    around = np.concatenate(([np.inf], costs, [np.inf]))
    valleys = [k for k in range(GRID) if around[k + 1] <= min(around[k], around[k + 2])]
    return [best[k] for k in sorted(valleys, key=lambda k: costs[k])[:STARTS]]


def builder(transforms: list[Transform], records: Records, weights: list[Array], count: int) -> Build:
    """What makes the linear problem of a ``count`` of pairs and the delay (5,), as `fit_transforms` has them."""

    def build(values: Array) -> list[Piece]:
        given = _pairs(values, count), values[-1]
        return [_piece(t, records, w, given) for t, w in zip(transforms, weights, strict=True)]

    return build


def _pairs(values: Array, count: int) -> Array:
    """Frequencies and dampings of the denominator: (2, 2), of one `ALONE` (1, 2)."""
    if count == BOTH:
        return values[:-1].reshape(-1, 2)
    if count == ALONE:
        return values[:2].reshape(1, 2)
    frequency, damping, share, slow = values[:-1]
    by_share, by_damping = SLOW_DOUBT
    standing_in = [SLOW_SHARE * by_share**share * frequency, SLOW_DAMPING + by_damping * slow]
    return np.array([[frequency, damping], standing_in])


def _piece(given: Transform, records: Records, weights: Array, parameters: tuple[Array, float]) -> Piece:
    s, (pairs, delay) = given.s, parameters
    denominator = np.prod([s**2 + 2 * z * w * s + w**2 for w, z in pairs], axis=0)
    driven = given.input * np.exp(-s * delay) / denominator
    own, shared = [], []
    for output, (name, unit) in enumerate(zip(records.names, records.units, strict=True)):
        below = s if name in ANGLES else np.ones_like(s)
        powers = 2 * len(pairs) + (unit in ACCELERATIONS or name in FORCES)
        ends = [s**k / (denominator * below) for k in range(2 * len(pairs) + (name in ANGLES))]
        drift = [] if name in ANGLES else [1 / s]  # an angle's ends span it already
        own.append(_stacked(np.column_stack([*ends, *drift]), weights[:, output]))
        shared.append(_stacked(np.column_stack([driven / below * s**k for k in range(powers)]), weights[:, output]))
    measured = [_stacked(given.outputs[:, [j]], weights[:, j])[:, 0] for j in range(len(own))]
    return Piece(np.column_stack(measured), tuple(own), tuple(shared))


def _stacked(columns: Complex, weights: Array) -> Array:
    weighted = columns * weights[:, None]
    return np.vstack((weighted.real, weighted.imag))


def _reweighted(build: Build, fit: SeparableFit, transforms: list[Transform], weights: list[Array]) -> list[Array]:
    """Weights (F, m) that make the residuals white: their power as a power law in frequency, of each output."""
    frequencies = [np.abs(t.s) for t in transforms]
    left = np.split(1.0 - taken(build, fit.values), np.cumsum([2 * len(f) for f in frequencies])[:-1])
    degrees = np.vstack([_folded(each) for each in left])
    power = np.vstack([_folded(r**2) / w**2 for r, w in zip(fit.residuals, weights, strict=True)])
    every = np.concatenate(frequencies)
    level, slope = np.column_stack([power_law(every, *each) for each in zip(power.T, degrees.T, strict=True)])
    return [np.exp(-(level + np.outer(np.log(f), slope)) / 2.0) for f in frequencies]


def _folded(both: Array) -> Array:
    """Real parts and, behind them, imaginary ones (2 F, m) added up: (F, m)."""
    half = len(both) // 2
    return both[:half] + both[half:]


def _doubt(fit: SeparableFit, transforms: list[Transform], count: int, kinds: tuple[str, ...]) -> str:
    """Why the fitted numbers may not be used; empty where they may."""
    if not determined(fit.sensitivities, np.diag(_prior(count).weight ** 2)):
        return "the records do not determine frequency, damping and delay"
    frequencies = fit.values[: 4 if count == BOTH else 2 : 2]
    if np.any(frequencies <= 0):
        return "no mode of second order fits the records"
    asked = float(np.max(frequencies) if SHORT_PERIOD in kinds else np.min(frequencies))
    if abs(fit.values[-1]) * asked > LARGEST_DELAY:
        return "the delay took the mode's place: the input does not excite it, or was recorded far off its time"
    periods = asked * sum(t.length for t in transforms) / (2 * math.pi)
    if periods < LEAST_PERIODS:
        return f"the records are short, {periods:.1f} periods in all: its interval needs {LEAST_PERIODS:g}"
    if asked > max(abs(t.s[-1]) for t in transforms):
        return TOO_FAST
    return ""


def _spread(fit: SeparableFit, count: int) -> Spread:
    """Cramer-Rao bounds or the scatter between records, the prior's information with the records'."""
    known = np.diag(_prior(count).weight ** 2)
    inverse = np.asarray(np.linalg.inv(information(fit.sensitivities) + known), dtype=np.float64)
    size = sum(r.size for r in fit.residuals)
    degrees = float(size - fit.linear - len(fit.values))
    within = Spread(inverse * size / max(degrees, 1.0), degrees)
    return by_scatter(within, fit.residuals, fit.sensitivities, known)


def _lack(fit: SeparableFit, spread: Spread) -> Array:
    """Covariance (5, 5) of what moves where the delay is none, as far as it is more than noise.

    A flight's tail angle has the tail's lag, as it is known or as output error found it: a delay beyond it stands for
    what four states lack. Its noise is in the errors already, unlike output error's, which fits none: so it must be
    surer here. The delay's own interval holds none then. Together and each alone, see `differing.lacking`. Without it
    the multibody Robo Raven in still air, 4 % too fast at the median, was held in 17 flights of twenty.
    """
    delay, covariance = float(fit.values[-1]), spread.covariance
    share = share_of_lack(delay, float(covariance[-1, -1]), SURE_OF_DELAY)
    if share == 0.0:
        return np.zeros_like(covariance)
    way = covariance[:, -1] / covariance[-1, -1] * delay
    both: Array = share * (np.outer(way, way) + np.diag(way**2)) / 2.0
    return both
