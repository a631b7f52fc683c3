"""Markov parameters and the eigensystem realization algorithm (ERA).

Juang & Pappa, An Eigensystem Realization Algorithm for Modal Parameter Identification, J. Guidance 8(5), 1985, as
`control.eigensys_realization` has it. A free motion is a pulse response as it stands, one column for each record.
Driven records give the Markov parameters through an observer's (Juang, Phan, Horta & Longman, J. Guidance 16(2),
1993): `control.markov` wants one record that begins at rest and is longer than the response, which no manoeuvre is
that has a phugoid in it. Errors: of driven records by leaving out one piece at a time (jackknife, which takes the
first-order bias out too), of free ones by a bootstrap over blocks of the residuals.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.modes.mode import SHORT_PERIOD, Mode, eigenvalues_of, nothing, paired_mode
from logs.identification.modes.records import Record, Records
from logs.identification.results import Array

METHOD = "eigensystem realization"
SAMPLES_A_STROKE = 4
"""-; to which stroke averages are thinned: their neighbours hold the same wing strokes"""
LONGEST_RECORD = 160
"""-; samples to which a free motion is thinned"""
SAMPLES_A_CYCLE = 8
"""-; of the highest frequency in the input"""
POWER_KEPT = 0.99
FIRST_LAGS = 6
"""-; of the least squares that the first instruments are made with"""
STATES = 4
"""-; of the observer: short period and phugoid"""
INSTRUMENT_PASSES = 4
LEAST_ROWS = 4
UNSTABLE = 100.0
"""-; times the measured outputs"""
RESPONSE = 1.6
"""s; length of the pulse response that is realized"""
LARGEST_ORDER = 8
NOISE_SHARE = 0.03
"""-; of the largest singular value: what is below belongs to the noise"""
BLOCKS = 12
RESAMPLES = 40
BLOCK_SHARE = 10
SEED = 1
"""of the bootstrap: the same data give the same errors"""
HIGHEST_TURN = 0.6
"""-; of the sampling's Nyquist frequency: above it a pair is noise"""


class Regression(NamedTuple):
    """Normal equations of the observer, piece by piece."""

    squares: Array
    """(K, p, p)"""
    products: Array
    """(K, p, m)"""
    lags: int

    @property
    def values(self) -> Array:
        """The observer's parameters (p, m)."""
        return _solved(self.squares.sum(axis=0), self.products.sum(axis=0))


def realization(records: Records, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
    """Modes ``kinds`` by ERA, of driven records or, where no input was measured, of free ones."""
    driven = [r for r in records.pieces if r.input is not None and np.ptp(r.input) > 0]
    try:
        pairs, covariance, degrees = (
            _of_driven(_thinned(driven, records.blur), len(kinds)) if driven else _of_free(records.pieces, len(kinds))
        )
    except ValueError as error:
        return nothing(METHOD, str(error), kinds)
    roots = [root for pair in pairs.reshape(-1, 2).tolist() for root in eigenvalues_of(*pair)]
    return paired_mode(METHOD, kinds, pairs, covariance, degrees, roots)


def _thinned(records: Sequence[Record], blur: float) -> list[Record]:
    """Means of n samples each, n so that a stroke average and the input's band keep a few."""
    step = records[0].step
    seconds = max(blur / SAMPLES_A_STROKE, 1 / (SAMPLES_A_CYCLE * max(_band(record) for record in records)))
    return [_every(record, max(int(seconds / step), 1)) for record in records]


def _band(record: Record) -> float:
    """Frequency (Hz) below which nearly all of the input's power lies."""
    given = np.zeros(1) if record.input is None else record.input
    power = np.cumsum(np.abs(np.fft.rfft(given - given.mean())) ** 2)
    return float(max(np.searchsorted(power, POWER_KEPT * power[-1]), 1) / (len(given) * record.step))


def _every(record: Record, every: int) -> Record:
    count = len(record.outputs) // every
    outputs = record.outputs[: count * every].reshape(count, every, -1).mean(axis=1)
    given = None if record.input is None else record.input[: count * every].reshape(count, every).mean(axis=1)
    return record._replace(step=record.step * every, input=given, outputs=outputs)


def _of_driven(records: list[Record], count: int) -> tuple[Array, Array, float]:
    """Frequencies and dampings (2 k,), their covariance and its degrees of freedom.

    Raises:
        ValueError: no number may be had, with the reason.
    """
    step, outputs = records[0].step, records[0].outputs.shape[1]
    fit = _observer(records, FIRST_LAGS)
    for _ in range(INSTRUMENT_PASSES):
        fit = _observer(records, max(math.ceil(STATES / outputs), 2), _simulated(records, fit))
    total = fit.squares.sum(axis=0), fit.products.sum(axis=0)

    def pairs(squares: Array, products: Array, order: int | None) -> tuple[Array, int]:
        length = max(int(RESPONSE / step), 4 * STATES)
        return realized_pairs(
            system_markov(_solved(squares, products), fit.lags, outputs, length), step, count, order
        )

    whole, order = pairs(*total, None)
    left_out = []
    for squares, products in zip(fit.squares, fit.products, strict=True):
        left_out.append(pairs(total[0] - squares, total[1] - products, order)[0])
    around, number = np.array(left_out), len(left_out)
    about = around - around.mean(axis=0)
    return whole, about.T @ about * (number - 1) / number, number - 1.0


def _solved(squares: Array, products: Array) -> Array:
    scale = np.maximum(np.sqrt(np.abs(np.diag(squares))), 1e-300)
    values: Array = np.linalg.lstsq(squares / np.outer(scale, scale), products / scale[:, None], rcond=1e-13)[0]
    return values / scale[:, None]


def _observer(records: list[Record], lags: int, instruments: list[Record] | None = None) -> Regression:
    """``y[k] = sum A_i y[k - i] + sum B_i u[k - i]`` and an offset of each record, by instrumental variables.

    The past outputs carry noise that stroke averages and filters make correlated with the present one's; what the
    model of the pass before makes of the input (``instruments``) does not. Without instruments: least squares.

    Raises:
        ValueError: the records are too short.
    """
    squares, products, rows = [], [], 0
    for record, clean in zip(records, instruments or records, strict=True):
        if len(record.outputs) - lags < LEAST_ROWS:
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
    return Regression(np.array(squares), np.array(products), lags)


def _simulated(records: list[Record], fit: Regression) -> list[Record]:
    """The records with outputs as the observer's model makes them of the input alone."""
    outputs = records[0].outputs.shape[1]
    autonomous = fit.values[: fit.lags * outputs].reshape(fit.lags, outputs, outputs)
    driven = fit.values[fit.lags * outputs :]
    flown = []
    for record in records:
        given = np.concatenate((np.zeros(fit.lags), np.zeros(0) if record.input is None else record.input))
        made = np.zeros((len(given), outputs))
        for k in range(fit.lags, len(given)):
            past = np.einsum("io,iop->p", made[k - fit.lags : k][::-1], autonomous)
            made[k] = past + given[k - fit.lags : k + 1][::-1] @ driven
        if not np.all(np.isfinite(made)) or np.max(np.abs(made)) > UNSTABLE * np.max(np.abs(record.outputs)):
            raise ValueError("the observer's model is unstable: the noise hides the response")
        flown.append(record._replace(outputs=made[fit.lags :]))
    return flown


def _lagged(record: Record, lags: int) -> tuple[Array, Array]:
    count = len(record.outputs)
    given = np.zeros(count) if record.input is None else record.input
    past = [record.outputs[lags - i : count - i] for i in range(1, lags + 1)]
    inputs = [given[lags - i : count - i, None] for i in range(lags + 1)]
    return np.hstack((*past, *inputs)), record.outputs[lags:]


def system_markov(values: Array, lags: int, outputs: int, count: int) -> Array:
    """Markov parameters (m, 1, ``count``) of the system from the observer's ``values`` (p, m)."""
    autonomous = values[: lags * outputs].reshape(lags, outputs, outputs)
    driven = values[lags * outputs :]
    response = np.zeros((count, outputs))
    for k in range(count):
        response[k] = driven[k] if k <= lags else 0.0
        for i in range(1, min(k, lags) + 1):
            response[k] += response[k - i] @ autonomous[i - 1]
    return response.T[:, None, :]


def realized_pairs(response: Array, step: float, count: int, order: int | None) -> tuple[Array, int]:
    """Frequency (rad/s) and damping of the ``count`` strongest pairs of a ``response`` (m, r, N), and the order.

    Raises:
        ValueError: the realization has fewer oscillating pairs.
    """
    from control import eigensys_realization  # a second of imports, which only this method needs

    half = (response.shape[2] - 1) // 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if order is None:
            order = order_of(eigensys_realization(response, 2, m=half, n=half, dt=step)[1], 2 * count)
        system, _ = eigensys_realization(response, order, m=half, n=half, dt=step)
    return _strongest(system, step, count), order


def order_of(singular: Array, least: int) -> int:
    """Order of the model: how many ``singular`` values stand above the noise, even, of ``least`` to the largest."""
    above = int(np.sum(singular > NOISE_SHARE * singular[0]))
    return min(max(above + above % 2, least), LARGEST_ORDER, len(singular))


def _strongest(system: object, step: float, count: int) -> Array:
    """Pairs (2 k,), the faster first: those whose part in the outputs is largest."""
    a, b, c = (np.asarray(getattr(system, name)) for name in "ABC")
    roots, vectors = np.linalg.eig(a)
    shares = np.linalg.norm(c @ vectors, axis=0) * np.linalg.norm(np.linalg.pinv(vectors) @ b, axis=1)
    found = []
    for root, share in zip(roots, shares, strict=True):
        if root.imag > 1e-6 and np.angle(root) < HIGHEST_TURN * np.pi:
            exponent = np.log(root) / step
            lasting = 1 / math.sqrt(max(1 - min(abs(root), 0.999) ** 2, 1e-6))
            found.append((share * lasting, abs(exponent), -exponent.real / abs(exponent)))
    if len(found) < count:
        raise ValueError("the realization has no oscillating pair: damped too heavily or hidden in noise")
    chosen = sorted(sorted(found, reverse=True)[:count], key=lambda entry: -entry[1])
    return np.array([number for entry in chosen for number in entry[1:]])


def _of_free(records: Sequence[Record], count: int) -> tuple[Array, Array, float]:
    """As `_of_driven`, of records without an input.

    Raises:
        ValueError: no number may be had, with the reason.
    """
    length = min(len(record.outputs) for record in records)
    every = max(length // LONGEST_RECORD, 1)
    response = np.stack([_level(r.outputs[:length:every]).T for r in records], axis=1)
    step = records[0].step * every
    whole, order = realized_pairs(response, step, count, None)
    model = _refitted(response, whole, step)
    rest = response - model
    rng = np.random.default_rng(SEED)
    around = []
    for _ in range(RESAMPLES):
        try:
            around.append(realized_pairs(model + _shuffled(rest, rng), step, count, order)[0])
        except ValueError:
            continue  # a sample in which the pair has vanished tells that it is near the noise
    if len(around) < 0.9 * RESAMPLES:
        raise ValueError("the pair vanishes in resampled data: it is hidden in noise")
    free = response[0].size / BLOCK_SHARE * response.shape[0]
    return whole, np.cov(np.array(around).T), max(free, 2.0)


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
