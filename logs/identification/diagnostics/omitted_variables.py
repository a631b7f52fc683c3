"""What would explain the residuals of output error: what is late, a vane off the centre, a derivative left out.

Each is a number that the model holds at zero. What one step of its search would find, the fitted parameters and all
nuisances moving with it, is the score test (Rao, Proc. Cambridge Phil. Soc. 44, 1948): its value, and the share of
the residuals' power that it would take. The fit is not made anew.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.output_sensitivities import beside, flown_with, places_of
from logs.identification.estimators.engine.problem import Fit, Own, Problem
from logs.identification.estimators.engine.records import Record
from logs.identification.results import Array
from logs.identification.sources.table.config import DELAY

LEAST_SHARE = 0.1
"""-; of the residuals' power that a suspect takes, below which it is none"""
LEAST_ERRORS = 6.0
"""-; standard errors of white residuals that it differs from zero by"""
LEAST_STEPS = 0.2
"""-; of a sampling interval, by which something is late at least"""
LEAST_MOVE = 0.02
"""-; of an output's swing, by which a vane's place or a derivative moves it at least"""
DERIVATIVE, WIDTH = "derivative", 1e-4
"""-; as the derivative: width of the difference that tells what it does"""
VANES = {"alpha": ("q", -1.0), "beta": ("r", 1.0)}
"""a flow angle -> the rate that a vane ahead of the centre of mass feels, and the sign"""


class Suspect(NamedTuple):
    """A number held at zero that would explain a part of the residuals."""

    name: str
    """-; `DELAY` of the inputs, ``late NAME`` of an output, ``vane NAME`` or ``derivative NAME``"""
    value: float
    """s late, m ahead of the centre of mass, or as the derivative, beside what it is held at"""
    share: float
    """-; of the residuals' power"""


def suspicion(
    problem: Problem, fit: Fit, speeds: Mapping[str, float], unnamed: Collection[str] = ()
) -> tuple[str, ...]:
    """A line on what explains the most of the residuals, where it is much.

    ``speeds`` (m/s) by manoeuvre are for vanes; ``unnamed`` are parameters that the model has and the map leaves out.
    """
    found = most_suspect(problem, fit, speeds, unnamed)
    if found is None:
        return ()
    kind, _, name = found.name.partition(" ")
    late = "late" if found.value > 0 else "early"
    taken = f"would explain {100 * found.share:.0f} % of what the model leaves"
    doubt = "derivatives may be off by more than their intervals"
    if kind == "vane":
        where = "ahead of" if found.value > 0 else "behind"
        return (
            f"a vane of {name} {abs(found.value):.2g} m {where} the place that is told {taken}: give vane_x, or the"
            f" accelerometers' imu_x; {doubt}",
        )
    if kind == DERIVATIVE:
        return (f"{name} of {found.value:+.2g}, which is held, {taken}: name it in the parameters; {doubt}",)
    if kind == "late":
        return (f"{name} {abs(found.value):.2g} s {late} {taken}: [prepare.delay] moves it; {doubt}",)
    return (f'inputs that act {abs(found.value):.2g} s {late} {taken}: delay = "free" finds it; {doubt}',)


def most_suspect(
    problem: Problem, fit: Fit, speeds: Mapping[str, float], unnamed: Collection[str] = ()
) -> Suspect | None:
    """The suspect that takes the most of the residuals' power; None where none takes much."""
    if fit.failure or not problem.model.inputs:
        return None
    names, p = _suspects(problem, speeds, unnamed), len(fit.values)
    swings = np.full(len(names), 1e-300)

    def changes(record: Record, own: Own, outputs: Array) -> list[Array]:
        moved = [_moved(name, problem, record, own, outputs, speeds) for name in names]
        swings[:] = np.maximum(swings, [float(np.max(np.abs(one) / _swing(outputs))) for one in moved])
        return moved

    parameters, columns, left = beside(problem, fit, changes)
    stacked = np.column_stack((columns, left))
    if not np.all(np.isfinite(stacked)):
        return None
    rest = stacked - parameters @ np.linalg.lstsq(parameters, stacked, rcond=1e-10)[0]
    left, free = rest[:, -1], max(len(rest) - p, 1)
    power, step = float(left @ left), problem.experiments[0].step
    found = []
    for name, column, swing in zip(names, rest.T, swings, strict=False):
        size = float(column @ column)
        if not size > 0.0 or not power > 0.0:
            continue
        value = float(column @ left) / size
        share = value**2 * size / power
        least = LEAST_MOVE / swing if name.startswith(("vane", DERIVATIVE)) else LEAST_STEPS * step
        sure = value**2 * size * free > LEAST_ERRORS**2 * power
        if abs(value) >= least and share > LEAST_SHARE and sure:
            found.append(Suspect(name, value, share))
    return max(found, key=lambda one: one.share, default=None)


def _suspects(problem: Problem, speeds: Mapping[str, float], unnamed: Collection[str]) -> list[str]:
    model = problem.model
    names = [DELAY] if DELAY not in model.parameters else []
    if len(problem.outputs) > 1:  # of one alone the inputs' delay tells it
        names += [f"late {name}" for name in problem.outputs]
    names += [f"{DERIVATIVE} {name}" for name in unnamed]
    told = all(one.name in speeds for one in problem.experiments)
    return names + [
        f"vane {angle}"
        for angle, (rate, _) in VANES.items()
        if told and angle in problem.outputs and rate in model.outputs
    ]


def _moved(
    name: str, problem: Problem, record: Record, own: Own, outputs: Array, speeds: Mapping[str, float]
) -> Array:
    """What a unit of the suspect ``name`` does to the ``outputs`` (N, m) of a record."""
    kind, _, of = name.partition(" ")
    if kind == "late":
        place = problem.outputs.index(of)
        column = np.zeros_like(outputs)
        column[:, place] = -np.gradient(outputs[:, place], record.step)
        return column
    inputs = record.inputs
    if kind == DERIVATIVE:
        more = own._replace(parameters={**own.parameters, of: own.parameters[of] + WIDTH})
        flown = [flown_with(problem, each, inputs, record.step) for each in (more, own)]
        return np.asarray((flown[0] - flown[1])[:, places_of(problem)] / WIDTH)
    if kind == DELAY:
        flown = [flown_with(problem, own, one, record.step) for one in (_later(inputs), inputs)]
        return np.asarray((flown[0] - flown[1])[:, places_of(problem)] / record.step)
    rate, sign = VANES[of]
    turning = flown_with(problem, own, inputs, record.step)[:, list(problem.model.outputs).index(rate)]
    column = np.zeros_like(outputs)
    column[:, problem.outputs.index(of)] = sign * turning / speeds[record.name]
    return column


def _swing(outputs: Array) -> Array:
    """From end to end (m,), 1 of what does not move."""
    reach = np.ptp(outputs, axis=0)
    return np.where(reach > 0.0, reach, 1.0)


def _later(inputs: Array) -> Array:
    """``inputs`` (N, k) one sample later."""
    return np.vstack((inputs[:1], inputs[:-1]))


def speeds_of(experiments: tuple[Experiment, ...], constants: Mapping[str, float]) -> dict[str, float]:
    """Mean airspeed in m/s by manoeuvre, of those that tell one."""
    found = {}
    for one in experiments:
        measured = np.asarray(one.signals.get("V", np.zeros(0)), dtype=np.float64)
        speed = float(np.nanmean(measured)) if np.any(np.isfinite(measured)) else constants.get("V", 0.0)
        if speed > 0.0:
            found[one.name] = speed
    return found
