"""Planned inputs over time, and the response of a linear model with its sensitivities.

Waveforms are those of `avionics.guidance.excitation`; sensitivities those of the maximum-likelihood engine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.guidance import excitation as shapes
from avionics.guidance import multisine
from avionics.guidance.mission import Excitation
from logs.identification.data.experiment import Experiment
from logs.identification.data.maneuvers import ELEVATOR, tail_angle
from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import flight_of
from logs.identification.input_design.prior import OUTPUTS, Prior
from logs.identification.models.actuators import Actuated
from logs.identification.models.stroke_averaged import LONGITUDINAL, model_of
from logs.identification.results import Array

STATES = ("u", "w", "q", "theta")
SHOWN = (*OUTPUTS, "theta")


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
    tail = tail_angle(planned.time, planned.command, prior.aircraft)
    zoh = () if prior.aircraft.tail_time_constant else (ELEVATOR,)
    model = Actuated(model_of(LONGITUDINAL, prior.reference, prior.aircraft), (), zoh)
    signals = {ELEVATOR: tail, **dict.fromkeys(OUTPUTS, np.zeros(len(tail)))}
    parameters = dict(zip(LONGITUDINAL, map(Parameter, prior.values.tolist()), strict=True))
    start = dict.fromkeys(STATES, 0.0)
    problem = Problem(model, (Experiment("plan", planned.time, signals, {}),), parameters, OUTPUTS, initial=(start,))
    flight = flight_of(problem)
    (record,), first, count = flight.records, flight.first(), len(LONGITUDINAL)
    slopes = flight.slopes(record, first.values, first.local[0])
    table = model.simulate(flight.split(record, first.values, first.local[0]).parameters, record.start, record.inputs,
                           record.step)  # fmt: skip
    states, outputs = (table[:, [list(model.outputs).index(name) for name in names]] for names in (STATES, SHOWN))
    return Response(states, outputs, slopes[:, :, :count], slopes[:, :, count:])
