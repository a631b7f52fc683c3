"""Eigensystem realization algorithm (ERA), of free responses or of Markov parameters of driven records.

Juang & Pappa, An Eigensystem Realization Algorithm for Modal Parameter Identification, J. Guidance 8(5), 1985, as
`control.eigensys_realization` has it. A free response is a pulse response, one column for each record. Driven records
give Markov parameters through an observer (OKID: Juang, Phan, Horta & Longman, J. Guidance 16(2), 1993), estimated
with instrumental variables. Standard errors: of driven records by the jackknife over blocks, of free ones by a
bootstrap over blocks of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.modal import ModalFit, ModalMethod, NotIdentified, add_row
from logs.identification.estimators.records import Record, Records
from logs.identification.findings import Entry, register
from logs.identification.models.modes import eigenvalues_of
from logs.identification.results import Array
from logs.identification.statistics.uncertainty import ParameterUncertainty

LONGEST_RECORD = 160
"""-; samples to which a free response is decimated"""
SAMPLES_PER_CYCLE = 8
"""-; of the highest frequency in the input"""
POWER_FRACTION = 0.99
MEMORY = 1.2
"""s; of the input, from which the first instruments are computed"""
RIDGE = 1e-3
STATES = 4
"""-; of the observer: short period and phugoid"""
MIN_ROWS = 4
DEPENDENT = 2e-5
"""-; relative singular value of the observer's equations that is neglected"""
RESPONSE = 1.0
"""s; length of the pulse response"""
MAX_ORDER = 8
NOISE_FRACTION = 0.03
"""-; of the largest singular value: smaller ones are noise"""
MAX_DAMPING = 0.4
"""-; above which noise in the slow roots biases frequency and damping"""
BLOCKS = 12
RESAMPLES = 40
BLOCK_FRACTION = 10
SEED = 1
"""of the bootstrap: the same data give the same errors"""
MIN_EXPLAINED_FREE = 0.8
"""-; of a free response's power, by the oscillations, of the output where it is largest"""
MIN_EXPLAINED = 0.5
"""-; of driven records' power, by the last `MEMORY` of the input, of the output where it is largest"""
MAX_ERROR = 0.1
"""-; relative standard error of a frequency, and standard error of a damping"""
HIGHEST_TURN = 0.6
"""-; of the Nyquist frequency: above it a pair is noise"""

register({
    "hidden_in_noise": Entry(
        "blocks of the records give different modes ({value:.2g}, limit {limit:g}): noise",
        "Resampled records give too different frequencies or dampings, or none.",
    ),
    "no_oscillation": Entry(
        "the realization has no oscillating pair: overdamped or hidden in noise",
        "The realized system has fewer complex pairs than modes.",
    ),
})  # fmt: skip


class Lags(NamedTuple):
    """Lags of the observer."""

    past: int
    """-; outputs"""
    every: int
    """-; samples from one to the next; the input enters at every sample between, as separate inputs"""


class Regression(NamedTuple):
    """Normal equations of the observer by block."""

    squares: Array
    """(K, p, p)"""
    products: Array
    """(K, p, m)"""


def fit(records: Records, kinds: tuple[str, ...]) -> ModalFit:
    """Modes ``kinds`` of driven records or, without an input, of free ones."""
    driven = [r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0]
    if any(np.any(np.ptp(record.outputs, axis=0) == 0) for record in driven or records.pieces):
        raise NotIdentified("constant_output")
    if driven:
        pairs, covariance, degrees = _of_driven(driven, len(kinds))
        if np.any(pairs[1::2] > MAX_DAMPING):
            raise NotIdentified("overdamped", float(np.max(pairs[1::2])), MAX_DAMPING)
    else:
        pairs, covariance, degrees = _of_free(records.pieces, len(kinds))
    return ModalFit(pairs, ParameterUncertainty(covariance, degrees))


def _spacing(records: Sequence[Record]) -> int:
    """Samples between the observer's lags."""
    return max(int(1 / (SAMPLES_PER_CYCLE * max(_band(record) for record in records)) / records[0].step), 1)


def _band(record: Record) -> float:
    """Frequency (Hz) below which nearly all of the input's power lies."""
    given = np.zeros(1) if record.input is None else record.input
    power = np.cumsum(np.abs(np.fft.rfft(given - given.mean())) ** 2)
    return float(max(np.searchsorted(power, POWER_FRACTION * power[-1]), 1) / (len(given) * record.step))


def _of_driven(records: list[Record], count: int) -> tuple[Array, Array, float]:
    """Frequencies and dampings (2 k,), their covariance and its degrees of freedom."""
    step, outputs, every = records[0].step, records[0].outputs.shape[1], _spacing(records)
    lags = max(math.ceil(STATES / outputs), 2)
    clean = _filtered(records, max(int(MEMORY / step), lags * every))
    explained = _explained(records, clean)
    if explained < MIN_EXPLAINED:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED)
    blocks = _observer(records, Lags(lags, every), clean)
    total = blocks.squares.sum(axis=0), blocks.products.sum(axis=0)

    def pairs(squares: Array, products: Array, order: int | None, near: Array | None = None) -> tuple[Array, int]:
        length = max(int(RESPONSE / step / every), 4 * STATES)
        response = system_markov(_solved(squares, products), Lags(lags, every), outputs, length)
        return realized_pairs(response, step * every, count, order, near)

    whole, order = pairs(*total, STATES)
    band = 2 * math.pi * max(_band(record) for record in records)
    if float(np.max(whole[::2])) > band:
        raise NotIdentified("mode_too_fast", float(np.max(whole[::2])), band)
    left_out = np.array([
        pairs(total[0] - squares, total[1] - products, order, whole)[0]
        for squares, products in zip(blocks.squares, blocks.products, strict=True)
    ])  # fmt: skip
    deviations, number = left_out - left_out.mean(axis=0), len(left_out)
    covariance = deviations.T @ deviations * (number - 1) / number
    relative = np.sqrt(np.diag(covariance)) / np.column_stack((whole[::2], np.ones(count))).ravel()
    if np.any(relative > MAX_ERROR):
        raise NotIdentified("hidden_in_noise", float(relative.max()), MAX_ERROR)
    return whole, covariance, number - 1.0


def _solved(squares: Array, products: Array) -> Array:
    """Truncated least squares: neighboring samples of a smooth input are nearly dependent."""
    scale = np.maximum(np.sqrt(np.abs(np.diag(squares))), 1e-300)
    values: Array = np.linalg.lstsq(squares / np.outer(scale, scale), products / scale[:, None], rcond=DEPENDENT)[0]
    return values / scale[:, None]


def _observer(records: list[Record], lags: Lags, instruments: list[Record]) -> Regression:
    """``y[k] = sum A_i y[k - i] + sum B_i u[k - i]`` and an offset of each record, by instrumental variables.

    The noise of the past outputs is correlated with the present one's; their response to the past input
    (``instruments``) is not.
    """
    squares, products, rows = [], [], 0
    for record, clean in zip(records, instruments, strict=True):
        if len(record.outputs) - (lags.past + 1) * lags.every < MIN_ROWS:
            continue
        design, response = (part - part.mean(axis=0) for part in _lagged(record, lags))
        leading = _lagged(clean, lags)[0]
        leading = leading - leading.mean(axis=0)
        for part in np.array_split(np.arange(len(design)), max(BLOCKS // len(records), 1)):
            squares.append(leading[part].T @ design[part])
            products.append(leading[part].T @ response[part])
        rows += len(design)
    if not squares or rows < 2 * squares[0].shape[0]:
        raise NotIdentified(
            "record_too_short", float(rows), 2.0 * (squares[0].shape[0] if squares else 1), unit="rows"
        )
    return Regression(np.array(squares), np.array(products))


def _filtered(records: list[Record], memory: int) -> list[Record]:
    """The records with outputs computed from the last ``memory`` samples of the input, by least squares."""
    if memory > min(len(record.outputs) for record in records):
        shortest = min(len(record.outputs) for record in records)
        raise NotIdentified("record_too_short", float(shortest), float(memory), unit="samples")
    given = [np.zeros(len(r.outputs)) if r.input is None else r.input for r in records]
    designs = [np.column_stack([_later(u, i) for i in range(memory)]) for u in given]
    about = [(d - d.mean(axis=0), r.outputs - r.outputs.mean(axis=0)) for d, r in zip(designs, records, strict=True)]
    squares = np.sum([d.T @ d for d, _ in about], axis=0)
    ridge = RIDGE * float(np.trace(squares)) / memory * np.eye(memory)
    values = np.linalg.solve(squares + ridge, np.sum([d.T @ y for d, y in about], axis=0))
    return [r._replace(outputs=d @ values) for r, (d, _) in zip(records, about, strict=True)]


def _explained(records: list[Record], clean: list[Record]) -> float:
    """Fraction of the outputs' power that the past input explains (``clean``), of the output where it is largest."""
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

    Every sample of the input between two lags is a separate input, without an assumption between samples.
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
    """
    from control import eigensys_realization  # a second of imports, which only this method needs

    half = (response.shape[2] - 1) // 2
    if order is None:
        order = order_of(eigensys_realization(response, 2, m=half, n=half, dt=step)[1], 2 * count)
    system, _ = eigensys_realization(response, order, m=half, n=half, dt=step)
    found = _pairs(system, step)
    if len(found) < count:
        raise NotIdentified("no_oscillation")
    if near is None:
        return np.concatenate(sorted((pair for _, pair in found[:count]), key=lambda pair: -pair[0])), order
    found_pairs = [pair for _, pair in found]
    chosen = [min(found_pairs, key=lambda pair: float(np.sum((pair - w) ** 2))) for w in near.reshape(-1, 2)]
    return np.concatenate(chosen), order


def order_of(singular: Array, least: int) -> int:
    """Order of the model: number of ``singular`` values above the noise, even, at least ``least``."""
    above = int(np.sum(singular > NOISE_FRACTION * singular[0]))
    return min(max(above + above % 2, least), MAX_ORDER, len(singular))


def _pairs(system: object, step: float) -> list[tuple[float, Array]]:
    """Oscillating pairs (2,) of frequency and damping with their participation in the outputs, the largest first."""
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
    """As `_of_driven`, of records without an input."""
    length = min(len(record.outputs) for record in records)
    every = math.ceil(length / LONGEST_RECORD)
    response = np.stack([_level(_means(r.outputs[:length], every)).T for r in records], axis=1)
    step = records[0].step * every
    whole, order = realized_pairs(response, step, count, None)
    model = _refitted(response, whole, step)
    rest = response - model
    power, left = (np.sum(one**2, axis=(1, 2)) for one in (response, rest))
    explained = float(np.max(1 - left / power.clip(1e-300)))
    if explained < MIN_EXPLAINED_FREE:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED_FREE)
    rng = np.random.default_rng(SEED)
    around = []
    for _ in range(RESAMPLES):
        try:
            around.append(realized_pairs(model + _shuffled(rest, rng), step, count, order, whole)[0])
        except NotIdentified:
            continue
    if len(around) < 0.9 * RESAMPLES:
        raise NotIdentified("hidden_in_noise", 1.0 - len(around) / RESAMPLES, 0.1)
    free = response[0].size / BLOCK_FRACTION * response.shape[0]
    return whole, np.cov(np.array(around).T), max(free, 2.0)


def _means(outputs: Array, every: int) -> Array:
    """Means over ``every`` samples, which do not change an exponent: (N / every, m)."""
    count = len(outputs) // every
    means: Array = outputs[: count * every].reshape(count, every, -1).mean(axis=1)
    return means


def _level(outputs: Array) -> Array:
    """``outputs`` (N, m) without offset and slope."""
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
    """``rest`` (m, r, N) resampled in blocks, the same for every output, of random sign."""
    count = rest.shape[2]
    size = max(count // BLOCK_FRACTION, 1)
    starts = rng.integers(0, count - size + 1, math.ceil(count / size))
    signs = np.repeat(rng.choice((-1.0, 1.0), len(starts)), size)
    order = (starts[:, None] + np.arange(size)).ravel()
    shuffled: Array = (rest[:, :, order] * signs)[:, :, :count]
    return shuffled


ERA = add_row(
    ModalMethod("era", "eigensystem realization", "Juang & Pappa, J. Guidance 8(5), 1985", fit, True, MAX_DAMPING)
)
METHOD = ERA.title
realization = ERA.mode
