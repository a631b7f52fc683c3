"""Stroke averages of a flight as small motions without a stroke's modulation would have them.

Linear methods take what large inputs make of the kinematics for the aircraft. A model that is fitted tells that part
well: it is of second order, so that an error of the model is one of third. What it adds to the measured outputs is
taken off them (`kinematics`, `modulation`). Both act on one motion: where the stroke swings Z_w by 0.3 and inputs
turn the aircraft by a quarter of a radian, each on the linear motion alone left 4 % in Z_u and 25 % in M_u.
"""

from __future__ import annotations

import numpy as np

from logs.identification.data.maneuvers import Manoeuvre, Reference
from logs.identification.estimators.flight.equation_error import DerivativeFit
from logs.identification.estimators.flight.kinematics import turned
from logs.identification.estimators.flight.modulation import felt_at, pushes, swing
from logs.identification.estimators.flight.simulation import Flown, Problem, flown_at, project
from logs.identification.models.stroke_averaged import propagate
from logs.identification.results import Array

PASSES = 3
"""-; of putting the motion into the products that make it"""


def without_second_order(problem: Problem, linear: Problem, fit: DerivativeFit) -> Problem:
    """``problem`` with outputs as linear kinematics and a modulation of first order would have them.

    ``linear`` is the last such one.
    """
    flown, manoeuvres = flown_at(problem, fit.values), []
    for measured, states in zip(problem.manoeuvres, _linear_states(problem, linear, fit, flown), strict=True):
        more = _added(problem, flown, measured, states, fit.swing)
        if len(fit.swing):
            first = swing(measured, states, fit.swing)
            more = more - _felt(problem, flown, measured, _states_of(flown, measured, first), first)
        manoeuvres.append(measured._replace(averages=measured.averages - more))
    return problem._replace(manoeuvres=tuple(manoeuvres))


def beyond_small_motions(problem: Problem, fit: DerivativeFit) -> tuple[Array, ...]:
    """Of each manoeuvre, outputs (L, 4) of `flown_again.OUTPUTS` that kinematics and modulation add, until it ends.

    ``fit`` is output error's. Of a lightly damped aircraft that inputs of 0.15 rad swing
    through 0.27 rad methods without a physical model found 0.8 % less damping than it has, and with this taken off
    0.1 %.
    """
    flown, found = flown_at(problem, fit.values), []
    linear = without_second_order(problem, problem, fit)
    for measured, states in zip(problem.manoeuvres, _linear_states(problem, linear, fit, flown), strict=True):
        to_end = measured._replace(averaging=measured.averaging_to_end)
        found.append(_added(problem, flown, to_end, states, fit.swing))
    return tuple(found)


def swung(flown: Flown, manoeuvre: Manoeuvre, states: Array, factors: Array) -> Array:
    """The linear ``states`` (N, 4) where ``factors`` (12,), as `modulation.swing` takes them, swing the model; where
    they are empty, as they are."""
    moved: Array = states + _beyond(flown, manoeuvre, states, factors)[0]
    return moved


def _linear_states(problem: Problem, linear: Problem, fit: DerivativeFit, flown: Flown) -> list[Array]:
    """Of each manoeuvre, the linear states (N, 4) from where the ``linear`` outputs tell it to begin."""

    def of(measured: Manoeuvre, last: Manoeuvre) -> Array:
        start = project(linear, flown, last, fit.scatter).start
        return propagate(flown.exact, start, flown.tail(measured))

    return [of(*pair) for pair in zip(problem.manoeuvres, linear.manoeuvres, strict=True)]


def _added(problem: Problem, flown: Flown, manoeuvre: Manoeuvre, states: Array, factors: Array) -> Array:
    """Stroke-averaged outputs (M, 4) that kinematics and modulation add to those of the linear ``states`` (N, 4)."""
    return _felt(problem, flown, manoeuvre, *_beyond(flown, manoeuvre, states, factors, problem.reference))


def _beyond(
    flown: Flown, manoeuvre: Manoeuvre, states: Array, factors: Array, reference: Reference | None = None
) -> tuple[Array, Array]:
    """What modulation adds to the linear ``states`` (N, 4), and its accelerations (N, 3).

    With a ``reference`` what the kinematics about it add too; without ``factors`` (12,), the kinematics alone.
    """
    more, swinging, turning = np.zeros_like(states), np.zeros((len(states), 3)), np.zeros((len(states), 3))
    for _ in range(PASSES):
        swinging = swing(manoeuvre, states + more, factors) if len(factors) else swinging
        turning = turned(states + more, manoeuvre, reference) if reference is not None else turning
        more = _states_of(flown, manoeuvre, swinging + turning)
    return more, swinging


def _states_of(flown: Flown, manoeuvre: Manoeuvre, pushed: Array) -> Array:
    """States (N, 4) that accelerations ``pushed`` (N, 3) along x, along z and in pitch make."""
    pairs = zip(pushes(flown.model, manoeuvre), pushed.T, strict=True)
    states: Array = np.sum([propagate(exact, np.zeros(4), push) for exact, push in pairs], axis=0)
    return states


def _felt(problem: Problem, flown: Flown, manoeuvre: Manoeuvre, states: Array, pushed: Array) -> Array:
    """Stroke-averaged outputs (M, 4) of ``states`` (N, 4) and of the accelerations ``pushed`` (N, 3) as such, which
    the IMU feels where it is."""
    imu = problem.aircraft.imu_x, problem.aircraft.imu_z
    outputs: Array = manoeuvre.averaging @ (states @ flown.model.c.T + pushed @ felt_at(imu))
    return outputs
