"""Markov parameters and the eigensystem realization algorithm (ERA).

Juang & Pappa, An Eigensystem Realization Algorithm for Modal Parameter Identification, J. Guidance 8(5), 1985, as
`control.eigensys_realization` has it. A free motion is a pulse response as it stands, one column for each record.
Driven records give the Markov parameters through an observer's (Juang, Phan, Horta & Longman, J. Guidance 16(2),
1993): `control.markov` wants one record that begins at rest and is longer than the response, which no manoeuvre is
that has a phugoid in it. Errors: of driven records by leaving out one piece at a time (jackknife), of free ones by a
bootstrap over blocks of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.records import Record, Records
from logs.identification.models.modes import (
    HEAVY,
    SHORT_PERIOD,
    TOO_FAST,
    Mode,
    eigenvalues_of,
    nothing,
    paired_mode,
    without_heavy,
)
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread

METHOD = "eigensystem realization"
SAMPLES_A_STROKE = 3
"""-; to which stroke averages are thinned: their neighbours hold the same wing strokes. With 4 the frequency of a
lightly damped aircraft was held in 89 % of 272 flights, with 3 in 92 of 257 (`DEPENDENT` being 1e-9); of weak inputs
197 and 231 of 300 gave a number"""
LONGEST_RECORD = 160
"""-; samples to which a free motion is thinned"""
SAMPLES_A_CYCLE = 8
"""-; of the highest frequency in the input"""
POWER_KEPT = 0.99
MEMORY = 1.2
"""s; of the input, with which the first instruments are made"""
RIDGE = 1e-3
STATES = 4
"""-; of the observer: short period and phugoid"""
LEAST_ROWS = 4
DEPENDENT = 2e-5
"""-; singular value of the observer's equations, of the largest, under which they tell nothing. With 1e-9 noise along
such directions made parts of the records contradict one another in 43 of 300 lightly damped flights; with 1e-4 the
damping came out too large"""
RESPONSE = 1.0
"""s; length of the pulse response that is realized"""
LARGEST_ORDER = 8
NOISE_SHARE = 0.03
"""-; of the largest singular value: what is below belongs to the noise"""
LARGEST_DAMPING = 0.4
"""-; above it noise in the slow roots moved the frequency by 2 % and the damping by 0.02"""
BLOCKS = 12
RESAMPLES = 40
BLOCK_SHARE = 10
SEED = 1
"""of the bootstrap: the same data give the same errors"""
LEAST_EXPLAINED = 0.8
"""-; of a free motion's power, by the oscillations, of the output where it is largest"""
LEAST_DRIVEN = 0.5
"""-; of driven records' power, by the last `MEMORY` of the input, of the output where it is largest: of white noise
that no input moved 3 of 40 gave a frequency, with a tight interval"""
WIDEST = 0.1
"""-; standard error of a frequency over it, and of a damping. Noise alone passed 0.25 once in 12 records; of 300
flights with inputs that hardly moved them 14 passed it with 1.4 to 2.1 times the frequency, none passed 0.1"""
HIGHEST_TURN = 0.6
"""-; of the sampling's Nyquist frequency: above it a pair is noise"""


class Lags(NamedTuple):
    """Of what the observer is made."""

    past: int
    """-; outputs"""
    every: int
    """-; samples from one to the next; the input is taken at every sample between, as so many inputs"""


class Regression(NamedTuple):
    """Normal equations of the observer, piece by piece."""

    squares: Array
    """(K, p, p)"""
    products: Array
    """(K, p, m)"""


def realization(records: Records, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
    """Modes ``kinds`` by ERA, of driven records or, where no input was measured, of free ones."""
    driven = [r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0]
    try:
        if driven:
            pairs, covariance, degrees = _of_driven(driven, _spacing(driven, records.blur), len(kinds))
        else:
            pairs, covariance, degrees = _of_free(records.pieces, len(kinds))
    except ValueError as error:
        return nothing(METHOD, str(error), kinds)
    mode = paired_mode(METHOD, kinds, pairs, Spread(covariance, degrees))
    # By its interval as well: of an Arizona damped by 0.68 one flight of twenty came out at 0.36.
    return without_heavy(mode, LARGEST_DAMPING) if driven else mode


def _spacing(records: Sequence[Record], blur: float) -> int:
    """Samples between the observer's lags: a stroke average and the input's band keep a few."""
    seconds = max(blur / SAMPLES_A_STROKE, 1 / (SAMPLES_A_CYCLE * max(_band(record) for record in records)))
    return max(int(seconds / records[0].step), 1)


def _band(record: Record) -> float:
    """Frequency (Hz) below which nearly all of the input's power lies."""
    given = np.zeros(1) if record.input is None else record.input
    power = np.cumsum(np.abs(np.fft.rfft(given - given.mean())) ** 2)
    return float(max(np.searchsorted(power, POWER_KEPT * power[-1]), 1) / (len(given) * record.step))


def _of_driven(records: list[Record], every: int, count: int) -> tuple[Array, Array, float]:
    """Frequencies and dampings (2 k,), their covariance and its degrees of freedom.

    Raises:
        ValueError: no number may be had, with the reason.
    """
    step, outputs = records[0].step, records[0].outputs.shape[1]
    if any(np.any(np.ptp(record.outputs, axis=0) == 0) for record in records):
        raise ValueError("an output is constant: it tells no motion")
    lags = max(math.ceil(STATES / outputs), 2)
    clean = _filtered(records, max(int(MEMORY / step), lags * every))
    if _share_of_input(records, clean) < LEAST_DRIVEN:
        raise ValueError("the input explains too little of the records: noise, turbulence, or nothing that it moves")
    fit = _observer(records, Lags(lags, every), clean)
    total = fit.squares.sum(axis=0), fit.products.sum(axis=0)

    def pairs(squares: Array, products: Array, order: int | None, near: Array | None = None) -> tuple[Array, int]:
        length = max(int(RESPONSE / step / every), 4 * STATES)
        response = system_markov(_solved(squares, products), Lags(lags, every), outputs, length)
        return realized_pairs(response, step * every, count, order, near)

    whole, order = pairs(*total, STATES)
    left_out = []
    for squares, products in zip(fit.squares, fit.products, strict=True):
        left_out.append(pairs(total[0] - squares, total[1] - products, order, whole)[0])
    if float(np.max(whole[::2])) > 2 * math.pi * max(_band(record) for record in records):
        raise ValueError(TOO_FAST)
    if np.any(whole[1::2] > LARGEST_DAMPING):
        raise ValueError(HEAVY)
    around, number = np.array(left_out), len(left_out)
    about = around - around.mean(axis=0)
    covariance = about.T @ about * (number - 1) / number
    relative = np.sqrt(np.diag(covariance)) / np.column_stack((whole[::2], np.ones(count))).ravel()
    if np.any(relative > WIDEST):
        raise ValueError("parts of the records tell different frequencies or dampings: it is hidden in noise")
    return whole, covariance, number - 1.0


def _solved(squares: Array, products: Array) -> Array:
    """Without what the data hardly tell: neighbouring samples of a smooth input are nearly alike."""
    scale = np.maximum(np.sqrt(np.abs(np.diag(squares))), 1e-300)
    values: Array = np.linalg.lstsq(squares / np.outer(scale, scale), products / scale[:, None], rcond=DEPENDENT)[0]
    return values / scale[:, None]


def _observer(records: list[Record], lags: Lags, instruments: list[Record]) -> Regression:
    """``y[k] = sum A_i y[k - i] + sum B_i u[k - i]`` and an offset of each record, by instrumental variables.

    The past outputs carry noise that stroke averages and filters make correlated with the present one's; what the
    past input tells of them (``instruments``) does not.

    Raises:
        ValueError: the records are too short.
    """
    squares, products, rows = [], [], 0
    for record, clean in zip(records, instruments, strict=True):
        if len(record.outputs) - (lags.past + 1) * lags.every < LEAST_ROWS:
            continue
        design, response = (part - part.mean(axis=0) for part in _lagged(record, lags))
        leading = _lagged(clean, lags)[0]
        leading = leading - leading.mean(axis=0)
        for part in np.array_split(np.arange(len(design)), max(BLOCKS // len(records), 1)):
            squares.append(leading[part].T @ design[part])
            products.append(leading[part].T @ response[part])
        rows += len(design)
    if not squares or rows < 2 * squares[0].shape[0]:
        raise ValueError("the records are too short for Markov parameters")
    return Regression(np.array(squares), np.array(products))


def _filtered(records: list[Record], memory: int) -> list[Record]:
    """The records with outputs as the last ``memory`` samples of the input alone tell them, by least squares."""
    if memory > min(len(record.outputs) for record in records):
        raise ValueError("the records are too short for Markov parameters")
    given = [np.zeros(len(r.outputs)) if r.input is None else r.input for r in records]
    designs = [np.column_stack([_later(u, i) for i in range(memory)]) for u in given]
    about = [(d - d.mean(axis=0), r.outputs - r.outputs.mean(axis=0)) for d, r in zip(designs, records, strict=True)]
    squares = np.sum([d.T @ d for d, _ in about], axis=0)
    ridge = RIDGE * float(np.trace(squares)) / memory * np.eye(memory)
    values = np.linalg.solve(squares + ridge, np.sum([d.T @ y for d, y in about], axis=0))
    return [r._replace(outputs=d @ values) for r, (d, _) in zip(records, about, strict=True)]


def _share_of_input(records: list[Record], clean: list[Record]) -> float:
    """Share of the outputs' power that their past input tells (``clean``), of the output where it is largest."""
    about = [one.outputs - one.outputs.mean(axis=0) for one in records]
    left = sum(np.sum((y - one.outputs) ** 2, axis=0) for y, one in zip(about, clean, strict=True))
    return float(np.max(1.0 - left / sum(np.sum(y**2, axis=0) for y in about)))


def _later(values: Array, by: int) -> Array:
    return np.concatenate((np.zeros(by), values[: len(values) - by]))


def _lagged(record: Record, lags: Lags) -> tuple[Array, Array]:
    """Past outputs and inputs (K, p), and present outputs (K, m)."""
    given = np.zeros(len(record.outputs)) if record.input is None else record.input
    first, count = (lags.past + 1) * lags.every, len(given)
    past = [record.outputs[first - i : count - i] for i in lags.every * np.arange(1, lags.past + 1)]
    inputs = [given[first - i : count - i, None] for i in range((lags.past + 1) * lags.every)]
    return np.hstack((*past, *inputs)), record.outputs[first:]


def system_markov(values: Array, lags: Lags, outputs: int, count: int) -> Array:
    """Markov parameters (m, ``lags.every``, ``count``) of the system from the observer's ``values`` (p, m).

    Every sample of the input between two lags is an input of its own, so that none is taken for held.
    """
    autonomous = values[: lags.past * outputs].reshape(lags.past, outputs, outputs)
    driven = values[lags.past * outputs :].reshape(lags.past + 1, lags.every, outputs)
    response = np.zeros((count, lags.every, outputs))
    for k in range(count):
        response[k] = driven[k] if k <= lags.past else 0.0
        for i in range(1, min(k, lags.past) + 1):
            response[k] += response[k - i] @ autonomous[i - 1]
    return response.transpose(2, 1, 0)


def realized_pairs(
    response: Array, step: float, count: int, order: int | None, near: Array | None = None
) -> tuple[Array, int]:
    """Frequency (rad/s) and damping of ``count`` pairs of a pulse ``response`` (m, r, N), and the order.

    An order of None is chosen by the singular values. The pairs are the strongest, or those closest to ``near``.

    Raises:
        ValueError: the realization has fewer oscillating pairs.
    """
    from control import eigensys_realization  # a second of imports, which only this method needs

    half = (response.shape[2] - 1) // 2
    if order is None:
        order = order_of(eigensys_realization(response, 2, m=half, n=half, dt=step)[1], 2 * count)
    system, _ = eigensys_realization(response, order, m=half, n=half, dt=step)
    found = _pairs(system, step)
    if len(found) < count:
        raise ValueError("the realization has no oscillating pair: damped too heavily or hidden in noise")
    if near is None:
        return np.concatenate(sorted((pair for _, pair in found[:count]), key=lambda pair: -pair[0])), order
    wanted = near.reshape(-1, 2)
    chosen = [min((pair for _, pair in found), key=lambda pair: float(np.sum((pair - w) ** 2))) for w in wanted]
    return np.concatenate(chosen), order


def order_of(singular: Array, least: int) -> int:
    """Order of the model: how many ``singular`` values stand above the noise, even, of ``least`` to the largest."""
    above = int(np.sum(singular > NOISE_SHARE * singular[0]))
    return min(max(above + above % 2, least), LARGEST_ORDER, len(singular))


def _pairs(system: object, step: float) -> list[tuple[float, Array]]:
    """Oscillating pairs (2,) of frequency and damping with their part in the outputs, the largest first."""
    a, b, c = (np.asarray(getattr(system, name)) for name in "ABC")
    roots, vectors = np.linalg.eig(a)
    shares = np.linalg.norm(c @ vectors, axis=0) * np.linalg.norm(np.linalg.pinv(vectors) @ b, axis=1)
    found = []
    for root, share in zip(roots, shares, strict=True):
        if root.imag > 1e-6 and np.angle(root) < HIGHEST_TURN * np.pi:
            exponent = np.log(root) / step
            pair = np.array([abs(exponent), -exponent.real / abs(exponent)])
            found.append((float(share) * float(pair[0]), pair))
    return sorted(found, key=lambda entry: -entry[0])


def _of_free(records: Sequence[Record], count: int) -> tuple[Array, Array, float]:
    """As `_of_driven`, of records without an input.

    Raises:
        ValueError: no number may be had, with the reason.
    """
    length = min(len(record.outputs) for record in records)
    every = math.ceil(length / LONGEST_RECORD)
    response = np.stack([_level(_means(r.outputs[:length], every)).T for r in records], axis=1)
    step = records[0].step * every
    whole, order = realized_pairs(response, step, count, None)
    model = _refitted(response, whole, step)
    rest = response - model
    if (
        float(np.max(1 - np.sum(rest**2, axis=(1, 2)) / np.sum(response**2, axis=(1, 2)).clip(1e-300)))
        < LEAST_EXPLAINED
    ):
        raise ValueError("free oscillation explains too little of the records: noise, turbulence, or a forced motion")
    rng = np.random.default_rng(SEED)
    around = []
    for _ in range(RESAMPLES):
        try:
            around.append(realized_pairs(model + _shuffled(rest, rng), step, count, order, whole)[0])
        except ValueError:
            continue  # a sample in which the pair has vanished tells that it is near the noise
    if len(around) < 0.9 * RESAMPLES:
        raise ValueError("the pair vanishes in resampled data: it is hidden in noise")
    free = response[0].size / BLOCK_SHARE * response.shape[0]
    return whole, np.cov(np.array(around).T), max(free, 2.0)


def _means(outputs: Array, every: int) -> Array:
    """Means over ``every`` samples, which leave an exponential's exponent as it is: (N / every, m)."""
    count = len(outputs) // every
    means: Array = outputs[: count * every].reshape(count, every, -1).mean(axis=1)
    return means


def _level(outputs: Array) -> Array:
    """``outputs`` (N, m) without offset and slope, which a pulse response has not."""
    line = np.vander(np.linspace(-1, 1, len(outputs)), 2)
    level: Array = outputs - line @ np.linalg.lstsq(line, outputs, rcond=None)[0]
    return level


def _refitted(response: Array, pairs: Array, step: float) -> Array:
    """The part of ``response`` (m, r, N) that damped sinusoids of ``pairs`` make up."""
    time = np.arange(response.shape[2]) * step
    roots = [root for pair in pairs.reshape(-1, 2).tolist() for root in eigenvalues_of(*pair)[:1]]
    waves = [part for root in roots for part in (np.exp(root * time).real, np.exp(root * time).imag)]
    basis = np.linalg.qr(np.column_stack(waves))[0]
    model: Array = (response @ basis) @ basis.T
    return model


def _shuffled(rest: Array, rng: np.random.Generator) -> Array:
    """``rest`` (m, r, N) put together anew from blocks of itself, the same of every output, of random sign."""
    count = rest.shape[2]
    size = max(count // BLOCK_SHARE, 1)
    starts = rng.integers(0, count - size + 1, math.ceil(count / size))
    signs = np.repeat(rng.choice((-1.0, 1.0), len(starts)), size)
    order = (starts[:, None] + np.arange(size)).ravel()
    shuffled: Array = (rest[:, :, order] * signs)[:, :, :count]
    return shuffled
