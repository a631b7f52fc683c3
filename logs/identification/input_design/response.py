"""Planned inputs over time, and the response of a linear model with its sensitivities.

The derivatives enter the state space linearly, so a state's sensitivity is a state too:
``x_j' = A x_j + dA/dtheta_j x + dB/dtheta_j delta`` (Klein & Morelli, Aircraft System Identification, 2006, ch. 6.1).
Model and sensitivities are one linear system with an exact step. Waveforms are those of
`avionics.guidance.excitation`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from avionics.guidance import excitation as shapes
from avionics.guidance import multisine
from avionics.guidance.mission import Excitation
from logs.identification.data.maneuvers import tail_angle
from logs.identification.input_design.prior import OUTPUTS, Prior
from logs.identification.models.stroke_averaged import LONGITUDINAL, Matrices, matrices
from logs.identification.results import Array

STATES = 4


class Waveform(NamedTuple):
    """One maneuver: settle, input, settle, with a margin at both ends."""

    time: Array
    """s; (N,), from 0"""
    command: Array
    """rad; (N,), added to the elevator"""
    start: float
    """s; of the maneuver"""
    end: float
    """s; of the maneuver"""


def waveform(excitation: Excitation, step: float, fade: float, margin: float) -> Waveform:
    """Return one repeat of ``excitation`` with a ``margin`` (s) at its ends; ``fade`` (s) is that of a sweep."""
    length = 2.0 * excitation.settle + shapes.duration(excitation)
    time: Array = step * np.arange(int((length + 2.0 * margin) / step) + 1, dtype=np.float64)
    since = time - margin - excitation.settle
    return Waveform(time, np.array([_value(excitation, fade, t) for t in since.tolist()]), margin, margin + length)


def _value(excitation: Excitation, fade: float, since: float) -> float:
    if not 0.0 <= since < shapes.duration(excitation):
        return 0.0
    if excitation.shape in shapes.SEGMENTS:
        return excitation.amplitude * shapes.steps(excitation.shape, excitation.width, since)
    if excitation.shape in shapes.SWEEPS:
        return excitation.amplitude * shapes.sweep(excitation, fade, since)
    return multisine.value(shapes.spectrum(excitation)[excitation.channel], since)


class Response(NamedTuple):
    """Response of the prior to one maneuver."""

    states: Array
    """m/s, m/s, rad/s, rad; (N, 4), u, w, q and theta about the trim"""
    outputs: Array
    """rad/s, m/s^2, m/s^2, rad; (N, 4), q, a_x and a_z at the IMU, theta, about the trim"""
    sensitivities: Array
    """as the output per derivative; (N, 3, 12), of `OUTPUTS`"""
    starts: Array
    """as the output per state; (N, 3, 4), of `OUTPUTS` to the initial state"""

    def times(self, factor: float) -> Response:
        """The response to an input ``factor`` times as large."""
        return Response(self.states * factor, self.outputs * factor, self.sensitivities * factor, self.starts)


def respond(prior: Prior, planned: Waveform) -> Response:
    """The response to ``planned`` from the trim, and its sensitivities."""
    model, slopes = prior.model(), _slopes(prior)
    tail = tail_angle(planned.time, planned.command, prior.aircraft)
    rows = _integrated(model, slopes, tail, prior.step, zero_order_hold=not prior.aircraft.tail_time_constant)
    states, sensitivity_states = rows[:, :STATES], rows[:, STATES:].reshape(len(rows), len(slopes), STATES)
    outputs = states @ model.c.T + np.outer(tail, model.d)
    sensitivities = np.stack(
        [
            sensitivity_states[:, j] @ model.c.T + states @ slope.c.T + np.outer(tail, slope.d)
            for j, slope in enumerate(slopes)
        ],
        axis=2,
    )
    count = len(OUTPUTS)
    return Response(states, outputs, sensitivities[:, :count], _free_motion(model, prior.step, len(tail))[:, :count])


def _slopes(prior: Prior) -> list[Matrices]:
    """Matrices by unit of each derivative, in which they are linear."""
    none = matrices(LONGITUDINAL, np.zeros(len(LONGITUDINAL)), prior.reference, prior.aircraft)
    units = (matrices(LONGITUDINAL, unit, prior.reference, prior.aircraft) for unit in np.eye(len(LONGITUDINAL)))
    return [Matrices(*(one - zero for one, zero in zip(unit, none, strict=True))) for unit in units]


def _integrated(model: Matrices, slopes: list[Matrices], tail: Array, step: float, zero_order_hold: bool) -> Array:
    """States and their sensitivities (N, 4 (1 + p)) from rest, driven by ``tail`` (N,)."""
    size = STATES * (1 + len(slopes))
    block = np.zeros((size + 2, size + 2))
    block[:size, :size] = np.kron(np.eye(1 + len(slopes)), model.a)
    block[:STATES, size] = model.b
    for j, slope in enumerate(slopes, start=1):
        at = slice(STATES * j, STATES * (j + 1))
        block[at, :STATES], block[at, size] = slope.a, slope.b
    block *= step
    block[size, size + 1] = 1.0
    exact = expm(block)
    f, constant, ramp = exact[:size, :size], exact[:size, size], exact[:size, size + 1]
    first, second = (constant, np.zeros(size)) if zero_order_hold else (constant - ramp, ramp)
    drive = np.outer(tail[:-1], first) + np.outer(tail[1:], second)
    rows = np.zeros((len(tail), size))
    for k in range(len(drive)):
        rows[k + 1] = f @ rows[k] + drive[k]
    return rows


def _free_motion(model: Matrices, step: float, count: int) -> Array:
    """Outputs (N, 4, 4) of the free motion from each unit state."""
    once, powers = expm(model.a * step), np.zeros((count, STATES, STATES))
    powers[0] = np.eye(STATES)
    for k in range(1, count):
        powers[k] = once @ powers[k - 1]
    outputs: Array = np.einsum("ij,njk->nik", model.c, powers)
    return outputs
