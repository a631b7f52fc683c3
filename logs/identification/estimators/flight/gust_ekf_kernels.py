"""What `gust_filter` does stroke by stroke, in compiled code.

A transition is (n + m, n): what a time makes of the n states, and behind them what it adds to the m integrals of the
outputs, which add to nothing. Row i of it is zero before column ``begins[i]``: gusts do not know of the motion. The
loops of the products run along rows, which the processor takes several numbers at a time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sim_bridge.compiled import internal, nogil_kernel

DOUBLINGS = 7
TERMS, STEP_TERMS = 5, 5
"""-; of Taylor's series over a stroke's 128th part, and over a step of the inputs"""


@internal
def _times(left: Any, right: Any, begins: Any, ones: float, out: Any) -> None:
    """``left right`` of transitions; ``ones`` is what integrals are multiplied by: 0 where ``left`` is a rate."""
    n = left.shape[1]
    for i in range(left.shape[0]):
        for j in range(n):
            out[i, j] = ones * right[i, j] if i >= n else 0.0
        for k in range(begins[i], n):
            factor = left[i, k]
            for j in range(n):
                out[i, j] += factor * right[k, j]


@internal
def _carried(over: Any, begins: Any, before: Any, half: Any, out: Any) -> None:
    """The covariance (n + m, n + m) that the transition ``over`` makes of the one ``before``."""
    size, n = over.shape[0], over.shape[1]
    for i in range(size):
        for j in range(size):
            half[i, j] = before[i, j] if i >= n else 0.0
        for k in range(begins[i], n):
            factor = over[i, k]
            for j in range(size):
                half[i, j] += factor * before[k, j]
    for i in range(size):
        for j in range(i, size):
            total = half[i, j] if j >= n else 0.0
            for k in range(begins[j], n):
                total += half[i, k] * over[j, k]
            out[i, j] = out[j, i] = total


@internal
def _series(rates: Any, step: float, begins: Any, small: Any, term: Any, spare: Any, total: Any) -> None:
    """Taylor's series of the transition over a short ``step`` in s."""
    size, n = rates.shape[0], rates.shape[1]
    for i in range(size):
        for j in range(n):
            small[i, j] = term[i, j] = rates[i, j] * step
            total[i, j] = small[i, j] + (1.0 if i == j else 0.0)
    for order in range(2, TERMS + 1):
        _times(term, small, begins, 0.0, spare)
        for i in range(size):
            for j in range(n):
                term[i, j] = spare[i, j] / order
                total[i, j] += term[i, j]


@internal
def _add(factor: float, more: Any, kept: float, out: Any) -> None:
    """``kept`` times ``out`` and ``factor`` times ``more`` in ``out``."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = kept * out[i, j] + factor * more[i, j]


@internal
def _at_airspeed(airspeed: float, growing: Any, usual: Any, out: Any) -> None:
    """What is ``usual`` at an ``airspeed`` of 1, at another; ``growing`` is the part that is proportional to it."""
    for i in range(usual.shape[0]):
        for j in range(usual.shape[1]):
            out[i, j] = usual[i, j] + (airspeed - 1.0) * growing[i, j]


@internal
def _between(ends: Any, which: Any, shares: Any, out: Any) -> None:
    """The mean of those of the ``ends`` (l, ...) that are at the places ``which``, each by its share."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
    for corner in range(which.shape[0]):
        kind, share = which[corner], shares[corner]
        for i in range(out.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] += share * ends[kind, i, j]


@internal
def _over_a_stroke(rates: Any, density: Any, length: float, begins: Any, spare: Any, over: Any, spread: Any) -> None:
    """Transition and noise covariance over a stroke of ``length`` s.

    A short step is doubled; its covariance is that of Simpson's rule.
    """
    one, two, three, half, more = spare
    step = length / 2.0**DOUBLINGS
    _series(rates, step / 2.0, begins, one, two, three, over)
    _carried(over, begins, density, half, more)
    _add(step / 6.0, density, 0.0, spread)
    _add(step * 4.0 / 6.0, more, 1.0, spread)
    _times(over, over, begins, 1.0, one)
    _carried(one, begins, density, half, more)
    _add(step / 6.0, more, 1.0, spread)
    for _ in range(DOUBLINGS):
        _carried(one, begins, spread, half, more)
        _add(1.0, more, 1.0, spread)
        _times(one, one, begins, 1.0, over)
        _add(1.0, over, 0.0, one)


@internal
def _input_step(rates: Any, b: Any, step: float, term: Any, spare: Any, out: Any) -> None:
    """What a ``step`` of the inputs in s does, (r, r + 2 p).

    ``x[k+1] = out[:, :r] x[k] + out[:, r : r + p] v[k] + out[:, r + p :] v[k+1]``. The inputs are linear within the
    step: the exponential of the system with the inputs and their change beside.
    """
    r, p = b.shape[0], b.shape[1]
    for i in range(r):
        for j in range(r + 2 * p):
            term[i, j] = out[i, j] = 1.0 if i == j else 0.0
    for order in range(1, STEP_TERMS + 1):
        for i in range(r):
            for j in range(r + 2 * p):
                total = term[i, j - p] if j >= r + p else 0.0
                for k in range(r):
                    if j < r:
                        total += term[i, k] * rates[k, j] * step
                    elif j < r + p:
                        total += term[i, k] * b[k, j - r] * step
                spare[i, j] = total / order
        for i in range(r):
            for j in range(r + 2 * p):
                term[i, j] = spare[i, j]
                out[i, j] += term[i, j]
    for i in range(r):
        for j in range(p):
            out[i, r + j] -= out[i, r + p + j]


@internal
def _driven(over: Any, inputs: Any, forced: Any, state: Any, ahead: Any, mean: Any) -> None:
    """``state`` after a stroke that begins at rest, driven by ``inputs`` (p, steps + 1), and its ``mean`` in it.

    What inputs do in each step comes first, ``forced`` (r, steps): many steps at a time, which the motion is not.
    """
    r, p, steps = over.shape[0], inputs.shape[0], forced.shape[1]
    for i in range(r):
        state[i] = mean[i] = 0.0
        for k in range(steps):
            forced[i, k] = 0.0
        for j in range(p):
            begin, end = over[i, r + j], over[i, r + p + j]
            for k in range(steps):
                forced[i, k] += begin * inputs[j, k] + end * inputs[j, k + 1]
    for k in range(steps):
        for i in range(r):
            total = forced[i, k]
            for j in range(r):
                total += over[i, j] * state[j]
            ahead[i] = total
        for i in range(r):
            mean[i] += (state[i] + ahead[i]) / 2.0 / steps
            state[i] = ahead[i]


@internal
def _surprised(measured: Any, system: Any, driven: Any, stroke: Any, state: Any, surprise: Any) -> None:
    """What was ``measured`` less what the inputs alone make of it and what the ``state`` foretells, biases with it.

    ``driven`` are the inputs' mean (p,) and that of the motion that they drive (r,), ``system`` its c (m, r) of what
    moves and its d, ``stroke`` the transition over the stroke and its length.
    """
    (c, d), (through, mean), (over, length) = system, driven, stroke
    n = over.shape[1]
    for i in range(surprise.shape[0]):
        total = measured[i] - state[n + i]
        for j in range(through.shape[0]):
            total -= d[i, j] * through[j]
        for j in range(mean.shape[0]):
            total -= c[i, j] * mean[j]
        for k in range(n):
            total -= over[n + i, k] / length * state[k]
        surprise[i] = total


@internal
def _seen(over: Any, length: float, known: Any, spread: Any, noise: Any, sight: Any, root: Any) -> None:
    """How averages and state vary together, ``sight`` (m, n + m), and the averages' covariance in ``root``."""
    n, m = over.shape[1], sight.shape[0]
    for i in range(m):
        for j in range(n + m):
            total = 0.0
            for k in range(n):
                total += over[n + i, k] * known[j, k]
            sight[i, j] = known[n + i, j] + total / length
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += sight[i, k] * over[n + j, k]
            root[i, j] = spread[n + i, n + j] / length**2 + sight[i, n + j] + total / length
        root[i, i] += noise[i]


@internal
def _crossed(over: Any, length: float, begins: Any, spread: Any, sight: Any, cross: Any) -> None:
    """How the state after a stroke varies with its averages: ``cross`` (n + m, m)."""
    n, m = over.shape[1], sight.shape[0]
    for i in range(n + m):
        for j in range(m):
            total = sight[j, i] if i >= n else spread[i, n + j] / length
            for k in range(begins[i], n):
                total += over[i, k] * sight[j, k]
            cross[i, j] = total


@internal
def _divided(root: Any, i: int, row: Any) -> None:
    """Element i of ``row`` divided by ``root``; those before it are."""
    total = row[i]
    for k in range(i):
        total -= root[i, k] * row[k]
    row[i] = total / root[i, i]


@internal
def _divide(root: Any, cross: Any, surprise: Any, white: Any) -> None:
    """Cholesky's factor in place of the covariance in ``root``, and what it divides: ``cross`` and ``surprise``."""
    for i in range(root.shape[0]):
        for j in range(i + 1):
            total = root[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(total) if i == j else total / root[j, j]
        white[i] = surprise[i]
        _divided(root, i, white)
        for row in range(cross.shape[0]):
            _divided(root, i, cross[row])


@internal
def _settle(carried: Any, spread: Any, cross: Any, known: Any) -> None:
    """Covariance ``known`` of the state after a stroke: carried on, widened by the noise, less what was seen."""
    size, m = cross.shape[0], cross.shape[1]
    for i in range(size):
        for j in range(i + 1):
            total = carried[i, j] + (spread[i, j] if i < size - m else 0.0)
            for k in range(m):
                total -= cross[i, k] * cross[j, k]
            known[i, j] = known[j, i] = total


@internal
def _move(over: Any, begins: Any, reached: Any, cross: Any, white: Any, state: Any, ahead: Any) -> None:
    """The ``state`` after a stroke: carried on, moved by the inputs as far as ``reached``, and by what was seen."""
    n, size = over.shape[1], state.shape[0]
    for i in range(size):
        total = state[i] if i >= n else 0.0
        if i < reached.shape[0]:
            total += reached[i]
        for k in range(begins[i], n):
            total += over[i, k] * state[k]
        for j in range(white.shape[0]):
            total += cross[i, j] * white[j]
        ahead[i] = total
    for i in range(size):
        state[i] = ahead[i]


@internal
def _follow(state: Any, followed: Any) -> None:
    """Add half of the ``state``: at both ends of a stroke, that is its mean."""
    for i in range(followed.shape[0]):
        followed[i] += state[i] / 2.0


@internal
def _begin(begin: Any, state: Any, known: Any) -> None:
    """The first ``state`` of a stretch and its covariance ``known``."""
    for i in range(state.shape[0]):
        state[i] = 0.0
        for j in range(state.shape[0]):
            known[i, j] = begin[i, j]


@nogil_kernel
def filter_strokes(systems: Any, averaged: Any, columns: Any, kept: Any, spare: Any, found: Any) -> None:
    """Fill ``found``, what `gust_filter.Innovations` holds, for each of the ``systems`` (s, ...).

    The filter's state is that of the system, and behind it the outputs' biases. ``columns`` are where rows of a
    transition begin, of a system's integrals and of biases, which pass on to themselves alone. ``kept`` holds what
    strokes do and inputs reach: in its first place of the first system, which every other takes that does not differ
    in what they come of. A stroke is between some of those that were computed: so is what it does.
    """
    rates, densities, bs, ds, begins, noises, growing, denser, other_strokes, other_motion = systems
    lengths, airspeeds, kinematics, which, shares, first, inputs, through, outputs = averaged
    rows, passing = columns
    over, spread, there, steps, reached, means = kept
    (one, two, three, half, more, term, turn, known, sight, cross, state, ahead, after, forced, dense), stroke = spare
    does, noise, here = stroke
    surprises, roots, whites, followed = found
    n, moving = rates.shape[2], bs.shape[1]
    for system in range(rates.shape[0]):
        strokes, motion = other_strokes[system], other_motion[system]
        if system == 0 or strokes > 0:
            for kind in range(lengths.shape[0]):
                _at_airspeed(airspeeds[kind], growing[system], rates[system], there[strokes, kind])
                _add(1.0, kinematics[kind], 1.0, there[strokes, kind, :moving, :moving])
                _at_airspeed(airspeeds[kind], denser[system], densities[system], dense)
                _over_a_stroke(
                    there[strokes, kind], dense, lengths[kind], rows, (one, two, three, half, more),
                    over[strokes, kind], spread[strokes, kind],
                )  # fmt: skip
        if system == 0 or motion > 0:
            for kind in range(lengths.shape[0]):
                _input_step(
                    there[strokes, kind], bs[system], lengths[kind] / (inputs.shape[2] - 1), term, turn, steps[kind]
                )
            for k in range(which.shape[0]):
                _between(steps, which[k], shares[k], turn)
                _driven(turn, inputs[k], forced, reached[motion, k], after, means[motion, k])
        for k in range(which.shape[0]):
            surprise, root, white = surprises[system, k], roots[system, k], whites[system, k]
            length = lengths[which[k, 0]]
            _between(over[strokes], which[k], shares[k], does)
            _between(spread[strokes], which[k], shares[k], noise)
            _between(there[strokes, :, n:, :moving], which[k], shares[k], here)
            if first[k]:
                _begin(begins[system], state, known)
            driven = through[k], means[motion, k]
            _surprised(outputs[k], (here, ds[system]), driven, (does, length), state, surprise)
            _seen(does, length, known, noise, noises[system], sight, root)
            _crossed(does, length, passing, noise, sight, cross)
            _divide(root, cross, surprise, white)
            _follow(state, followed[system, k])
            _move(does, passing, reached[motion, k], cross, white, state, ahead)
            _follow(state, followed[system, k])
            _carried(does, passing, known, half, more)
            _settle(more, noise, cross, known)
