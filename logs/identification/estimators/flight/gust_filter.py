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

from logs.identification.estimators.flight.gust_ekf_kernels import filter_strokes
from logs.identification.results import Array


class Driven(NamedTuple):
    """``x' = a x + b v + noise``, ``y = c x + d v``; v: inputs. The first states move, those behind are gusts.

    Several systems s side by side: what they have in common with the first is found once.
    """

    a: Array
    """(n, n, s); nothing that moves acts on the gusts"""
    b: Array
    """(r, p, s); of the states that move: the gusts do not know of the inputs"""
    c: Array
    """(m, n, s)"""
    d: Array
    """(m, p, s)"""
    density: Array
    """(n + m, n + m, s); spectral density of the white noise on the states' rates and, behind them, on the outputs"""
    start: Array
    """(n, n, s); covariance of the first state of a stretch"""
    bias: Array
    """(m, s); standard deviation of the outputs' biases in a stretch"""
    noise: Array
    """(m, s); standard deviation of the errors of a stroke's averages"""
    growing: Array
    """(n + m, n, s); what of ``a`` and, below it, ``c`` is proportional to the airspeed"""
    denser: Array
    """(n + m, n + m, s); what of ``density`` is"""


class Kinds(NamedTuple):
    """The strokes that the filter computes, and between which of them those of a flight are."""

    lengths: Array
    """s; (l,)"""
    airspeeds: Array
    """-; (l,), times the usual"""
    kinematics: Array
    """(l, r, r); what there is to add to ``a`` of the states that move"""
    which: NDArray[np.int64]
    """-; (K, c), places in the former that each stroke is between, all of one length"""
    shares: Array
    """-; (K, c), what each of them counts, one together"""


class Averaged(NamedTuple):
    """What was measured, stroke by stroke, stretch behind stretch."""

    kinds: Kinds
    first: NDArray[np.bool_]
    """-; (K,), whether a stretch begins with it"""
    inputs: Array
    """(K, p, s + 1), at equal steps through each stroke, both ends included; linear within a step"""
    outputs: Array
    """(K, m); averages"""


class Innovations(NamedTuple):
    """What each stroke's averages add to what was foreseen of them, by each system."""

    surprise: Array
    """(s, K, m)"""
    root: Array
    """(s, K, m, m); Cholesky's lower factor of the covariance of that; not finite where it has none"""
    white: Array
    """(s, K, m); the surprise divided by the root"""
    followed: Array
    """(s, K, r); the states that move, mean of a stroke's beginning and end, each by what was measured before it"""


def innovations(system: Driven, averaged: Averaged) -> Innovations:
    """The stroke averages less what the strokes before foretell, and the covariance that this has."""
    n, (m, p, count), moving, strokes = len(system.a), system.d.shape, len(system.b), len(averaged.outputs)
    rates, begin = np.concatenate((system.a, system.c)), np.zeros((n + m, n + m, count))
    begin[:n, :n], begin[range(n, n + m), range(n, n + m)] = system.start, system.bias**2
    more = system.growing, system.denser
    systems = tuple(map(_each, (rates, system.density, system.b, system.d, begin, system.noise**2, *more)))
    others = (
        _differs(rates) | _differs(system.density) | _differs(system.growing) | _differs(system.denser),
        _differs(system.a[:moving, :moving]) | _differs(system.growing[:moving, :moving]) | _differs(system.b),
    )
    rows, passing = (np.repeat([0, moving, last], [moving, n - moving, m]) for last in (0, n))
    transition, square, step, tall = (n + m, n), (n + m, n + m), (moving, moving + 2 * p), (n + m, m)
    kinds, reach = len(averaged.kinds.lengths), (2, strokes, moving)
    kept = (2, kinds, *transition), (2, kinds, *square), (2, kinds, *transition), (kinds, *step), reach, reach
    spare = *[transition] * 3, *[square] * 2, *[step] * 2, square, tall[::-1], tall, *[(n + m,)] * 2, (moving,)
    forced = moving, averaged.inputs.shape[2] - 1
    stroke = transition, square, (m, moving)
    found = tuple(np.zeros((count, strokes, *shape)) for shape in ((m,), (m, m), (m,), (moving,)))
    through = (averaged.inputs[:, :, 1:] + averaged.inputs[:, :, :-1]).mean(axis=2) / 2.0
    filter_strokes(
        (*systems, *(np.asarray(other, dtype=np.int64) for other in others)),
        (*averaged.kinds, averaged.first, averaged.inputs, through, averaged.outputs),
        (rows, passing),
        tuple(map(np.zeros, kept)),
        (tuple(map(np.zeros, (*spare, forced, square))), tuple(map(np.zeros, stroke))),
        found,
    )
    return Innovations(*found)


def _each(systems: Array) -> Array:
    """(s, ...) of what has its systems (..., s) last."""
    return np.ascontiguousarray(np.moveaxis(systems, -1, 0))


def _differs(systems: Array) -> NDArray[np.bool_]:
    """Which (s,) of systems (..., s) differ from the first."""
    different: NDArray[np.bool_] = np.any(systems != systems[..., :1], axis=tuple(range(systems.ndim - 1)))
    return different
