"""Eigensystem realization algorithm (ERA), of free responses or of Markov parameters of driven records.

Juang & Pappa, An Eigensystem Realization Algorithm for Modal Parameter Identification, J. Guidance 8(5), 1985, as
`control.eigensys_realization` has it. A free response is a pulse response, one column for each record. Driven records
give Markov parameters through an observer (OKID: Juang, Phan, Horta & Longman, J. Guidance 16(2), 1993) by
instrumental variables: the noise of past outputs is correlated with the present one's, their response to the past
input is not. Standard errors: of driven records by the jackknife over blocks, of free ones by a bootstrap over blocks
of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from logs.identification.estimators.modal import ModalFit, ModalMethod, NotIdentified, Record, Records
from logs.identification.findings import Entry, register
from logs.identification.models.modes import eigenvalues_of
from logs.identification.results import Array
from logs.identification.statistics.covariance import ParameterUncertainty

LONGEST_RECORD = 160
"""-; samples to which a free response is decimated"""
SAMPLES_PER_CYCLE = 8
"""-; of the highest frequency in the input"""
POWER_FRACTION = 0.99
STATES = 4
"""-; of observer and realization: short period and phugoid"""
MEMORY, RIDGE = 1.2, 1e-3
"""s; -; of the input's past in the instruments; of the ridge regression that gives them"""
DEPENDENT = 2e-5
"""-; relative singular value of the observer's equations that is neglected"""
RESPONSE = 1.0
"""s; length of the pulse response"""
MIN_ROWS, MAX_ORDER = 4, 8
NOISE_FRACTION = 0.03
"""-; of the largest singular value: smaller ones are noise"""
MAX_DAMPING = 0.4
"""-; above which noise in the slow roots biases frequency and damping"""
BLOCKS = 12
RESAMPLES = 40
BLOCK_FRACTION = 10
SEED = 1
"""of the bootstrap: the same data give the same errors"""
MIN_EXPLAINED, MIN_EXPLAINED_DRIVEN = 0.8, 0.5
"""-; of a free response's power by the oscillations, of driven records' by the past input, for the best output"""
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


def fit(records: Records, kinds: tuple[str, ...]) -> ModalFit:
    """Modes ``kinds`` of driven records or, without an input, of free ones."""
    driven = [r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0]
    if any(np.any(np.ptp(record.outputs, axis=0) == 0) for record in driven or records.pieces):
        raise NotIdentified("constant_output")
    if not driven:
        return _of_free(records.pieces, len(kinds))
    result = _of_driven(driven, len(kinds))
    if np.any(result.pairs[1::2] > MAX_DAMPING):
        raise NotIdentified("overdamped", float(np.max(result.pairs[1::2])), MAX_DAMPING)
    return result


def _band(record: Record) -> float:
    """Frequency (Hz) below which nearly all of the input's power lies."""
    given = _input(record)
    power = np.cumsum(np.abs(np.fft.rfft(given - given.mean())) ** 2)
    return float(max(np.searchsorted(power, POWER_FRACTION * power[-1]), 1) / (len(given) * record.step))


def _of_driven(records: list[Record], count: int) -> ModalFit:
    """Frequencies and dampings, their covariance by the jackknife over blocks."""
    step, outputs, band = records[0].step, records[0].outputs.shape[1], max(map(_band, records))
    every, past = max(int(1 / (SAMPLES_PER_CYCLE * band) / step), 1), max(math.ceil(STATES / outputs), 2)
    instruments = _instruments(records, max(int(MEMORY / step), past * every))
    blocks: list[tuple[Array, Array]] = []
    rows, parts = 0, max(BLOCKS // len(records), 1)
    for record, clean in zip(records, instruments, strict=True):
        design, response = _lagged(_input(record), record.outputs, past, every)
        leading = _lagged(_input(record), clean, past, every)[0]
        rows += len(design)
        for part in np.array_split(np.arange(len(design)), parts) if len(design) >= MIN_ROWS else ():
            blocks.append((leading[part].T @ design[part], leading[part].T @ response[part]))
    columns = past * outputs + (past + 1) * every
    if not blocks or rows < 2 * columns:
        raise NotIdentified("record_too_short", float(rows), 2.0 * columns, unit="rows")
    length = max(int(RESPONSE / step / every), 4 * STATES)

    def pairs(used: list[tuple[Array, Array]], near: Array | None = None) -> Array:
        squares, products = (np.sum(part, axis=0) for part in zip(*used, strict=True))
        scale = np.maximum(np.sqrt(np.abs(np.diag(squares))), 1e-300)
        scaled = squares / np.outer(scale, scale), products / scale[:, None]
        values = np.linalg.lstsq(*scaled, rcond=DEPENDENT)[0] / scale[:, None]
        return realized_pairs(system_markov(values, past, every, length), step * every, count, STATES, near)[0]

    modes = pairs(blocks)
    if float(np.max(modes[::2])) > 2 * math.pi * band:
        raise NotIdentified("mode_too_fast", float(np.max(modes[::2])), 2 * math.pi * band)
    without = np.array([pairs(blocks[:k] + blocks[k + 1 :], modes) for k in range(len(blocks))])
    covariance = np.cov(without.T, bias=True) * (len(without) - 1)
    relative = np.sqrt(np.diag(covariance)) / np.column_stack((modes[::2], np.ones(count))).ravel()
    if np.any(relative > MAX_ERROR):
        raise NotIdentified("hidden_in_noise", float(relative.max()), MAX_ERROR)
    return ModalFit(modes, ParameterUncertainty(covariance, len(without) - 1.0))


def _instruments(records: list[Record], memory: int) -> list[Array]:
    """Outputs (N, m) computed from the last ``memory`` samples of the input, by ridge regression."""
    shortest = min(len(record.outputs) for record in records)
    if memory > shortest:
        raise NotIdentified("record_too_short", float(shortest), float(memory), unit="samples")
    designs = [np.column_stack([np.append(np.zeros(i), _input(r)[: len(_input(r)) - i]) for i in range(memory)])
               for r in records]  # fmt: skip
    pairs = [(d - d.mean(axis=0), r.outputs - r.outputs.mean(axis=0)) for d, r in zip(designs, records, strict=True)]
    squares = np.sum([d.T @ d for d, _ in pairs], axis=0)
    ridge = RIDGE * float(np.trace(squares)) / memory * np.eye(memory)
    values = np.linalg.solve(squares + ridge, np.sum([d.T @ y for d, y in pairs], axis=0))
    left = sum(np.sum((y - d @ values) ** 2, axis=0) for d, y in pairs)
    explained = float(np.max(1.0 - left / sum(np.sum(y**2, axis=0) for _, y in pairs)))
    if explained < MIN_EXPLAINED_DRIVEN:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED_DRIVEN)
    return [np.asarray(d @ values) for d, _ in pairs]


def _input(record: Record) -> Array:
    return np.zeros(len(record.outputs)) if record.input is None else record.input


def _lagged(given: Array, outputs: Array, past: int, every: int) -> tuple[Array, Array]:
    """Past outputs and inputs (K, p), and present outputs (K, m), without their means.

    The outputs enter every ``every`` samples, the input at every sample between, as separate inputs: there is no
    assumption between samples.
    """
    first, count = (past + 1) * every, len(given)
    earlier = [outputs[first - i : count - i] for i in every * np.arange(1, past + 1)]
    inputs = [given[first - i : count - i, None] for i in range(first)]
    design, response = np.hstack((*earlier, *inputs)), outputs[first:]
    return design - design.mean(axis=0), response - response.mean(axis=0)


def system_markov(values: Array, past: int, every: int, count: int) -> Array:
    """Markov parameters (m, ``every``, ``count``) of the system from the observer's ``values`` (p, m)."""
    outputs = values.shape[1]
    autonomous = values[: past * outputs].reshape(past, outputs, outputs)
    driven = values[past * outputs :].reshape(past + 1, every, outputs)
    response = np.zeros((count, every, outputs))
    for k in range(count):
        response[k] = driven[k] if k <= past else 0.0
        for i in range(1, min(k, past) + 1):
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


def _of_free(records: Sequence[Record], count: int) -> ModalFit:
    """Frequencies and dampings of records without an input, their covariance by a bootstrap."""
    length = min(len(record.outputs) for record in records)
    every = math.ceil(length / LONGEST_RECORD)
    response = np.stack([_level(_means(r.outputs[:length], every)).T for r in records], axis=1)
    step = records[0].step * every
    whole, order = realized_pairs(response, step, count, None)
    model = _refitted(response, whole, step)
    rest = response - model
    power, left = (np.sum(one**2, axis=(1, 2)) for one in (response, rest))
    explained = float(np.max(1 - left / power.clip(1e-300)))
    if explained < MIN_EXPLAINED:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED)
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
    return ModalFit(whole, ParameterUncertainty(np.cov(np.array(around).T), max(free, 2.0)))


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


ERA = ModalMethod("era", "eigensystem realization", fit, True, MAX_DAMPING)
METHOD = ERA.title
realization = ERA.mode
