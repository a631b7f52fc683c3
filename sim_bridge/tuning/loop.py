"""What the five loops have in common: L = (P + I/s) measured + D rate, and the search for P, I and D.

Method: loop shaping within constraints. A candidate is a crossover frequency with the ratios of integral and damping
to the proportional term; among those that keep gain and phase margin, the limits of sensitivity and resonance (Astrom
and Murray, Feedback Systems, chapters on margins and on loop shaping), and cross over below a share of the flapping
frequency, the one with the greatest bandwidth from setpoint to what follows it is taken; a greater integral, which
rejects slow disturbances better (Astrom, Panagopoulos, Hagglund 1998, Automatica 34, 585), counts a little. The
search is a grid, then finer ones about the best; every number of the result is computed anew by `margins`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.tuning.margins import LIMITS, Complex, Limits, Margins, bandwidth, frequencies, margins, response
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

CROSSOVERS, DECADES = 40, 2.3
"""-; number of candidate crossovers, and their range below the highest one allowed"""
INTEGRALS = (0.1, 0.16, 0.25, 0.4, 0.63, 1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0, 40.0)
"""-; crossover frequency times P / I: for 1 the phase lag of the integral at crossover is 45 degrees"""
DAMPINGS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3)
"""-; crossover frequency times D / P"""
INTEGRAL_SHARE = 0.1
"""-; a doubled integral is equivalent to so many doublings of the bandwidth"""
REFINEMENTS = (1.0, 0.5, 0.25)
"""-; step fractions of successive searches about the best candidate"""
SLACK = 1.01
"""-; margin to the limits in the search, for the frequencies between the grid points"""


class Terms(NamedTuple):
    """Gains of one loop, in the loop's own units."""

    proportional: float
    integral: float
    damping: float


class Process(NamedTuple):
    """Process of a loop: single-input systems from the loop's command."""

    followed: Any
    """system to the controlled variable"""
    sensed: Any
    """system to two outputs: the variable compared with the setpoint, and the rate of the damping term"""
    forward: Any | None = None
    """system from the setpoint, bypassing the controller, to the controlled variable"""
    setpoint_weight: float = 1.0
    """-; fraction of the proportional term that acts on the setpoint, see `avionics.control_laws`"""


class LoopSpec(NamedTuple):
    """Specification of a search."""

    fastest: float
    """rad/s; highest gain crossover allowed"""
    integral: bool
    """whether the loop has an integral term"""
    damping: bool
    """whether the damping is designed"""
    ranges: tuple[float, float, float]
    """limits of P, I and D in the flight computer"""
    fixed: float = 0.0
    """damping gain of a loop whose damping is not designed"""
    regulates: bool = False
    """whether the integral gain is maximized instead of the bandwidth, because feed-forward does the tracking"""
    steepest: float = math.inf
    """largest P that the rate limit after the loop can follow"""
    limits: Limits = LIMITS


class _Sampled(NamedTuple):
    omega: Floats
    followed: Complex
    measured: Complex
    rate: Complex
    forward: Complex
    setpoint_weight: float


class _Candidate(NamedTuple):
    worth: float
    """-; objective, larger is better"""
    terms: Terms
    shape: tuple[float, float, float]
    """crossover in rad/s, P / I and D / P, both times the crossover"""


def open_loop(process: Process, terms: Terms) -> Any:
    """Return the loop opened at its command, as a python-control system with negative feedback."""
    import control

    return control.ss(*_cut(process, terms), 0.0)


def _cut(process: Process, terms: Terms) -> tuple[Floats, Floats, Floats]:
    """Return A, B and C of the open loop; an integral term adds a state, the integral of the measured variable."""
    steady = np.array([[terms.proportional, terms.damping]]) @ process.sensed.C
    if not terms.integral:
        return process.sensed.A, process.sensed.B, steady
    n, summed = process.sensed.nstates, process.sensed.C[:1]
    a = np.block([[process.sensed.A, np.zeros((n, 1))], [summed, np.zeros((1, 1))]])
    return a, np.vstack((process.sensed.B, [[0.0]])), np.hstack((steady, [[terms.integral]]))


def loop_margins(process: Process, terms: Terms) -> Margins:
    """Compute the margins of a loop with these gains."""
    return margins(open_loop(process, terms))


def loop_bandwidth(process: Process, terms: Terms) -> float:
    """Compute the -3 dB bandwidth in rad/s from the setpoint to the controlled variable."""
    sampled = _sample(process)
    return bandwidth(sampled.omega, _closed(sampled, terms)[1])


def search(process: Process, spec: LoopSpec) -> Terms:
    """Find the gains with the largest bandwidth within the limits.

    Raises:
        InputError: no gains meet them.
    """
    sampled = _sample(process)
    crossovers = spec.fastest * np.geomspace(10.0**-DECADES, 1.0, CROSSOVERS)
    integrals, dampings = INTEGRALS if spec.integral else (math.inf,), DAMPINGS if spec.damping else (0.0,)
    best = _best(process, sampled, spec, product(crossovers, integrals, dampings))
    if best is None:
        raise InputError(
            f"no gains give this loop {spec.limits.gain_margin_db:g} dB and"
            f" {math.degrees(spec.limits.phase_margin):.0f} degrees below {spec.fastest:.3g} rad/s"
        )
    for share in REFINEMENTS:
        best = _best(process, sampled, spec, _about(best, spec, share)) or best
    return best.terms


def _about(best: _Candidate, spec: LoopSpec, share: float) -> Iterable[tuple[float, float, float]]:
    """Return candidates around the best one, closer for a smaller ``share``, itself included."""
    crossover, integral, damping = best.shape
    steps = share * np.linspace(-1.0, 1.0, 7)
    crossovers = np.minimum(crossover * 1.16**steps, spec.fastest)
    dampings = np.maximum(damping + 0.15 * steps, 0.0) if spec.damping else (0.0,)
    return product(crossovers, integral * 1.6**steps if spec.integral else (math.inf,), dampings)


def _best(
    process: Process, sampled: _Sampled, spec: LoopSpec, shapes: Iterable[tuple[float, float, float]]
) -> _Candidate | None:
    """Return the best candidate that meets every limit; None if there is none."""
    found = []
    for shape in shapes:
        terms = _terms(sampled, shape, spec)
        chosen = terms if spec.damping else terms[:2]
        if all(0.0 <= value <= most for value, most in zip(chosen, spec.ranges, strict=False)):
            speed = _speed(sampled, terms, spec)
            if speed > 0.0 and terms.proportional <= spec.steepest:
                found.append(_Candidate(_worth(speed, terms, spec), terms, shape))
    # Poles take longer than all other limits together: they are computed of the best candidates alone.
    best_first = sorted(found, key=lambda candidate: candidate.worth, reverse=True)
    return next((candidate for candidate in best_first if _stable(process, candidate.terms)), None)


def _worth(speed: float, terms: Terms, spec: LoopSpec) -> float:
    if spec.regulates:
        return terms.integral
    return speed * terms.integral**INTEGRAL_SHARE if spec.integral else speed


def _stable(process: Process, terms: Terms) -> bool:
    """Return whether the closed loop is stable, from the poles with output feedback."""
    a, b, c = _cut(process, terms)
    return bool(np.all(np.linalg.eigvals(a - b @ c).real < 0.0))


def _terms(sampled: _Sampled, shape: tuple[float, float, float], spec: LoopSpec) -> Terms:
    """Return the gains with unit loop gain at the crossover, except a fixed damping."""
    crossover, integral, damping = shape
    i = int(np.searchsorted(sampled.omega, crossover))
    relative = 1.0 - 1j * crossover / (integral * sampled.omega[i])
    level = abs(relative * sampled.measured[i] + damping / crossover * sampled.rate[i])
    proportional = float(1.0 / level)
    rate = proportional * damping / crossover if spec.damping else spec.fixed
    return Terms(proportional, proportional * crossover / integral, rate)


def _speed(sampled: _Sampled, terms: Terms, spec: LoopSpec) -> float:
    """Return the bandwidth (rad/s) with these gains, 0 if a limit is violated."""
    limits = spec.limits
    loop, closed = _closed(sampled, terms)
    if np.min(np.abs(1.0 + loop)) < SLACK / limits.sensitivity or np.max(np.abs(closed)) > limits.resonance:
        return 0.0
    level = np.log(np.abs(loop))
    crossing = np.flatnonzero(np.diff(np.sign(level)))
    if len(crossing) == 0 or sampled.omega[crossing[-1]] > spec.fastest:
        return 0.0
    if np.min(np.abs(np.angle(-loop[crossing]))) < SLACK * limits.phase_margin:
        return 0.0
    turning = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0.0))
    most = SLACK * limits.gain_margin_db * math.log(10.0) / 20.0
    if len(turning) and np.min(np.abs(level[turning])) < most:
        return 0.0
    return bandwidth(sampled.omega, closed)


def _closed(sampled: _Sampled, terms: Terms) -> tuple[Complex, Complex]:
    """Return the responses (n,) of the open and of the closed loop."""
    integral = terms.integral / (1j * sampled.omega)
    loop = (terms.proportional + integral) * sampled.measured + terms.damping * sampled.rate
    command = sampled.setpoint_weight * terms.proportional + integral
    return loop, (command * sampled.followed + sampled.forward) / (1.0 + loop)


def _sample(process: Process) -> _Sampled:
    omega = frequencies()
    measured, rate = response(process.sensed, omega)[:, 0, :]
    forward = np.zeros(len(omega), dtype=np.complex128)
    if process.forward is not None:
        forward = response(process.forward, omega)
    return _Sampled(omega, response(process.followed, omega), measured, rate, forward, process.setpoint_weight)


def pick(system: Any, source: str, *targets: str) -> Any:
    """Select the part of a system from one named signal to others, which may be repeated."""
    import control

    column = [system.input_labels.index(source)]
    rows = [system.output_labels.index(target) for target in targets]
    return control.ss(system.A, system.B[:, column], system.C[rows], system.D[np.ix_(rows, column)])
