"""Stroke averages of a flight as small motions without a stroke's modulation would have them.

Linear methods take what large inputs make of the kinematics for the aircraft. A model that is fitted tells that part
well: it is of second order, so that an error of the model is one of third. What it adds to the measured outputs is
taken off them (`kinematics`, `modulation`).
"""

from __future__ import annotations

from logs.identification.modes.equation_error import DerivativeFit
from logs.identification.modes.flown_again import Flown, Problem, flown_at, project
from logs.identification.modes.kinematics import second_order
from logs.identification.modes.longitudinal import propagate
from logs.identification.modes.modulation import second_order as swung_again
from logs.identification.modes.modulation import swing_of
from logs.identification.preparing.manoeuvre import Manoeuvre
from logs.identification.results import Array


def without_second_order(problem: Problem, linear: Problem, fit: DerivativeFit) -> Problem:
    """``problem`` with outputs as linear kinematics and a modulation of first order would have them.

    ``linear`` is the last such one.
    """
    imu = problem.aircraft.imu_x, problem.aircraft.imu_z
    flown, manoeuvres = flown_at(problem, fit.values), []
    for measured, states in zip(problem.manoeuvres, _states(problem, linear, fit, flown), strict=True):
        more = second_order(flown.model, measured, states, problem.reference)
        if len(fit.swing):
            more = more + swung_again(flown.model, measured, states, fit.swing, imu)
        manoeuvres.append(measured._replace(averages=measured.averages - more))
    return problem._replace(manoeuvres=tuple(manoeuvres))


def beyond_small_motions(problem: Problem, fit: DerivativeFit) -> tuple[Array, ...]:
    """Of each manoeuvre, outputs (L, 4) of `flown_again.OUTPUTS` that kinematics and modulation add, until it ends.

    ``fit`` is output error's. Of a lightly damped aircraft that inputs of 0.15 rad swing
    through 0.27 rad methods without a physical model found 0.8 % less damping than it has, and with this taken off
    0.1 %.
    """
    imu = problem.aircraft.imu_x, problem.aircraft.imu_z
    flown, found = flown_at(problem, fit.values), []
    linear = without_second_order(problem, problem, fit)
    for measured, states in zip(problem.manoeuvres, _states(problem, linear, fit, flown), strict=True):
        to_end = measured._replace(averaging=measured.averaging_to_end)
        more = second_order(flown.model, to_end, states, problem.reference)
        if len(fit.swing):
            more = more + swing_of(flown.model, to_end, states, fit.swing, imu)
        found.append(more)
    return tuple(found)


def _states(problem: Problem, linear: Problem, fit: DerivativeFit, flown: Flown) -> list[Array]:
    """Of each manoeuvre, the linear states (N, 4) from where the ``linear`` outputs tell it to begin."""

    def of(measured: Manoeuvre, last: Manoeuvre) -> Array:
        start = project(linear, flown, last, fit.scatter).start
        return propagate(flown.exact, start, flown.tail(measured))

    return [of(*pair) for pair in zip(problem.manoeuvres, linear.manoeuvres, strict=True)]
