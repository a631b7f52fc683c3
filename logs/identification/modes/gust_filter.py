"""A Kalman filter over strokes: how likely stroke averages are of an aircraft that gusts move too.

Between its inputs the aircraft is a linear system driven by noise; a stroke's average is the integral of its outputs
over the stroke. State and integrals are carried over a whole stroke exactly, their joint covariance by doubling a
short step: the wings' shaking needs no model, and averages that do not overlap have white errors. Noise that moves
the state is also in the average, so that the gain takes the covariance of both (Jategaonkar, Flight Vehicle System
Identification, 2006, ch. 5, has them independent).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.modes.longitudinal import multiply
from logs.identification.results import Array
from sim_bridge.vectors import njit

DOUBLINGS = 7
TERMS, STEP_TERMS = 5, 8
"""-; of Taylor's series over a stroke's 128th part, and over a step of the inputs"""


class Driven(NamedTuple):
    """``x' = a x + b v + noise``, ``y = c x + d v``; v: inputs. The first states move, those behind are gusts."""

    a: Array
    """(n, n)"""
    b: Array
    """(r, p); of the states that move: the gusts do not know of the inputs"""
    c: Array
    """(m, n)"""
    d: Array
    """(m, p)"""
    density: Array
    """(n + m, n + m); spectral density of the white noise on the states' rates and, behind them, on the outputs"""
    start: Array
    """(n,); standard deviation of the first state of a stretch"""
    bias: Array
    """(m,); standard deviation of the outputs' biases in a stretch"""
    noise: Array
    """(m,); standard deviation of the errors of a stroke's averages"""


class Averaged(NamedTuple):
    """What was measured, stroke by stroke, stretch behind stretch."""

    lengths: Array
    """s; (l,), the lengths of a stroke that occur"""
    which: NDArray[np.int64]
    """-; (K,), each stroke's place in ``lengths``"""
    first: NDArray[np.bool_]
    """-; (K,), whether a stretch begins with it"""
    inputs: Array
    """(K, s + 1, p), at equal steps through each stroke, both ends included; linear within a step"""
    outputs: Array
    """(K, m); averages"""


class Innovations(NamedTuple):
    """What each stroke's averages add to what was foreseen of them."""

    surprise: Array
    """(K, m)"""
    covariance: Array
    """(K, m, m)"""


def innovations(system: Driven, averaged: Averaged) -> Innovations:
    """The stroke averages less what the strokes before foretell, and the covariance that this has."""
    n, m, count = len(system.a), len(system.c), len(averaged.which)
    surprise, covariance = np.zeros((count, m)), np.zeros((count, m, m))
    joint = np.zeros((n + m, n + m))
    joint[:n, :n], joint[n:, :n] = system.a, system.c
    over, spread = _strokes(joint, system.density, averaged.lengths)
    begin = np.concatenate((system.start, system.bias)) ** 2
    moving = len(system.b)
    steps = _steps(system.a[:moving, :moving], system.b, averaged.lengths / (averaged.inputs.shape[1] - 1))
    _filter(
        (over, spread, steps, system.c, system.d, begin, system.noise**2),
        (averaged.lengths, averaged.which, averaged.first, averaged.inputs, averaged.outputs),
        surprise,
        covariance,
    )  # fmt: skip
    return Innovations(surprise, covariance)


@njit(cache=True)
def _product_transposed(a, b, out):  # type: ignore[no-untyped-def]
    """``a b'``."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[j, k]
            out[i, j] = total


def _strokes(joint: Array, density: Array, lengths: Array) -> tuple[Array, Array]:
    """Transition (l, n, n) and noise covariance (l, n, n) over a stroke of each of ``lengths`` (l,).

    A short step is doubled; its covariance is that of Simpson's rule.
    """
    step = (lengths / 2.0**DOUBLINGS)[:, None, None]
    over, half = _exponential(joint * step, TERMS), _exponential(joint * step / 2.0, TERMS)
    middle, end = (each @ density @ each.transpose(0, 2, 1) for each in (half, over))
    spread = (density + 4.0 * middle + end) * step / 6.0
    for _ in range(DOUBLINGS):
        spread = spread + over @ spread @ over.transpose(0, 2, 1)
        over = over @ over
    return over, spread


def _exponential(small: Array, terms: int) -> Array:
    """Exponential (l, n, n) of ``small`` matrices by ``terms`` of Taylor's series."""
    total: Array = np.broadcast_to(np.eye(small.shape[-1]), small.shape)
    term = total
    for order in range(1, terms + 1):
        term = term @ small / order
        total = total + term
    return total


def _steps(a: Array, b: Array, steps: Array) -> Array:
    """What a step does, (l, n, n + 2 p), for each length of ``steps`` (l,) in s.

    ``x[k+1] = out[:, :n] x[k] + out[:, n : n + p] v[k] + out[:, n + p :] v[k+1]``. The inputs are
    linear within the step: the exponential of the system with the inputs and their change beside.
    """
    n, p = b.shape
    block = np.zeros((len(steps), n + 2 * p, n + 2 * p))
    block[:, :n, :n], block[:, :n, n : n + p] = a * steps[:, None, None], b * steps[:, None, None]
    block[:, n : n + p, n + p :] = np.eye(p)
    over = _exponential(block, STEP_TERMS)[:, :n].copy()
    over[:, :, n : n + p] -= over[:, :, n + p :]
    return over


@njit(cache=True)
def _driven(over, inputs, state, ahead, sums):  # type: ignore[no-untyped-def]
    """State after a stroke that begins at rest, driven by ``inputs``, and in ``sums`` its mean and the inputs'."""
    n, steps, count = over.shape[0], inputs.shape[0] - 1, inputs.shape[1]
    for i in range(n):
        state[i] = sums[i] = 0.0
    for j in range(count):
        sums[n + j] = 0.0
    for k in range(steps):
        for j in range(count):
            sums[n + j] += (inputs[k, j] + inputs[k + 1, j]) / 2.0 / steps
        for i in range(n):
            total = 0.0
            for j in range(count):
                total += over[i, n + j] * inputs[k, j] + over[i, n + count + j] * inputs[k + 1, j]
            for j in range(n):
                total += over[i, j] * state[j]
            ahead[i] = total
        for i in range(n):
            sums[i] += (state[i] + ahead[i]) / 2.0 / steps
            state[i] = ahead[i]


@njit(cache=True)
def _gain(cross, covariance, root, gain):  # type: ignore[no-untyped-def]
    """``cross covariance^-1`` by Cholesky's factor ``root``."""
    m = covariance.shape[0]
    for i in range(m):
        for j in range(i + 1):
            total = covariance[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(max(total, 1e-300)) if i == j else total / root[j, j]
    for row in range(cross.shape[0]):
        for i in range(m):
            total = cross[row, i]
            for k in range(i):
                total -= root[i, k] * gain[row, k]
            gain[row, i] = total / root[i, i]
        for i in range(m - 1, -1, -1):
            total = gain[row, i]
            for k in range(i + 1, m):
                total -= root[k, i] * gain[row, k]
            gain[row, i] = total / root[i, i]


@njit(cache=True)
def _over_a_stroke(over, length, ahead, seen):  # type: ignore[no-untyped-def]
    """What a stroke makes of the filter's state, ``ahead``, and what of it its averages show, ``seen``."""
    n, m = over.shape[0] - seen.shape[0], seen.shape[0]
    for j in range(n):
        for i in range(n):
            ahead[i, j] = over[i, j]
        for i in range(m):
            seen[i, j] = over[n + i, j] / length
    for i in range(m):
        ahead[n + i, n + i] = seen[i, n + i] = 1.0


@njit(cache=True)
def _foretell(measured, seen, sight, state, spread, length, surprise, covariance):  # type: ignore[no-untyped-def]
    """What the averages ``measured`` (the input's share taken off) are beyond the foretold, and its covariance."""
    m, size = seen.shape
    n = size - m
    for i in range(m):
        surprise[i] = measured[i]
        for j in range(size):
            surprise[i] -= seen[i, j] * state[j]
        for j in range(m):
            covariance[i, j] += spread[n + i, n + j] / length**2
            for s in range(size):
                covariance[i, j] += sight[i, s] * seen[j, s]


@njit(cache=True)
def _settle(carried, spread, gain, cross, known):  # type: ignore[no-untyped-def]
    """Covariance ``known`` of the state after a stroke: carried on, widened by the noise, less what was seen."""
    size, m = gain.shape
    for i in range(size):
        for j in range(i + 1):
            total = (carried[i, j] + carried[j, i]) / 2.0
            if i < size - m:
                total += (spread[i, j] + spread[j, i]) / 2.0
            for s in range(m):
                total -= (gain[i, s] * cross[j, s] + gain[j, s] * cross[i, s]) / 2.0
            known[i, j] = known[j, i] = total


@njit(cache=True)
def _begin(begin, state, known):  # type: ignore[no-untyped-def]
    """The first ``state`` of a stretch and its covariance ``known``, of variances ``begin``."""
    for i in range(len(state)):
        state[i] = 0.0
        for j in range(len(state)):
            known[i, j] = begin[i] if i == j else 0.0


@njit(cache=True)
def _less_input(outputs, c, d, sums, measured):  # type: ignore[no-untyped-def]
    """The averages ``measured``: ``outputs`` less what the inputs alone make of them, by their ``sums``."""
    moving = len(sums) - d.shape[1]
    for i in range(len(outputs)):
        measured[i] = outputs[i]
        for j in range(d.shape[1]):
            measured[i] -= d[i, j] * sums[moving + j]
        for j in range(moving):
            measured[i] -= c[i, j] * sums[j]


@njit(cache=True)
def _carry(ahead, gain, reached, surprise, state, foretold):  # type: ignore[no-untyped-def]
    """The ``state`` after a stroke: foretold, moved by the inputs as far as ``reached``, and by the surprise."""
    for i in range(len(state)):
        foretold[i] = reached[i] if i < len(reached) else 0.0
        for j in range(len(state)):
            foretold[i] += ahead[i, j] * state[j]
        for j in range(len(surprise)):
            foretold[i] += gain[i, j] * surprise[j]
    state[:] = foretold


@njit(cache=True)
def _filter(system, averaged, surprise, covariance):  # type: ignore[no-untyped-def]
    """The filter's state is that of the system, and behind it the outputs' biases."""
    over, spread, steps, c, d, begin, noise = system
    lengths, which, first, inputs, outputs = averaged
    n, m, moving = c.shape[1], c.shape[0], steps.shape[1]
    size = n + m
    ahead, seen, state, foretold = np.zeros((size, size)), np.zeros((m, size)), np.zeros(size), np.zeros(size)
    known, spare, carried = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    sight, cross, gain, root = np.zeros((m, size)), np.zeros((size, m)), np.zeros((size, m)), np.zeros((m, m))
    reached, after, sums, measured = np.zeros(moving), np.zeros(moving), np.zeros(moving + d.shape[1]), np.zeros(m)
    for k in range(len(which)):
        stroke = which[k]
        length = lengths[stroke]
        if first[k]:
            _begin(begin, state, known)
        _over_a_stroke(over[stroke], length, ahead, seen)
        _driven(steps[stroke], inputs[k], reached, after, sums)
        _less_input(outputs[k], c, d, sums, measured)
        for i in range(m):
            covariance[k, i, i] = noise[i]
        multiply(seen, known, sight)
        _foretell(measured, seen, sight, state, spread[stroke], length, surprise[k], covariance[k])
        _product_transposed(ahead, sight, cross)
        for i in range(n):
            for j in range(m):
                cross[i, j] += spread[stroke, i, n + j] / length
        _gain(cross, covariance[k], root, gain)
        multiply(ahead, known, spare)
        _product_transposed(spare, ahead, carried)
        _carry(ahead, gain, reached, surprise[k], state, foretold)
        _settle(carried, spread[stroke], gain, cross, known)
