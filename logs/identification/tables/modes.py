"""[modes] of a map: short period and phugoid by output error with a model, and by every method without one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.agreement import agreement
from logs.identification.diagnostics.input_delay import (
    counted_from_record,
    delay_beside,
    known_delay,
    lateness,
    suspected_delay,
    tells,
)
from logs.identification.diagnostics.intersample_behavior import FURTHEST_TURN, LEAST_RUN, coarse
from logs.identification.estimators.engine.problem import Fit
from logs.identification.estimators.free_response import METHOD as RINGING
from logs.identification.estimators.initial_values import acting_at
from logs.identification.estimators.nonparametric import modes_of_experiments
from logs.identification.estimators.records import away
from logs.identification.models.modes import KINDS, Mode, ModesResult, mode_of_system, nothing
from logs.identification.models.user import is_user_model
from logs.identification.sources.table.config import ModesSection, OutputError
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signal_lookup import check_apart
from logs.identification.statistics.parameter_uncertainty import Spread
from logs.identification.tables.equation_errors import by_equations, has_equations
from logs.identification.tables.models import Chosen
from logs.identification.tables.output_errors import output_error_fit, shortened
from logs.identification.tables.results import TableFit
from logs.identification.tables.systems import fitted_system
from wingbeat.errors import InputError

LONGITUDINAL = "longitudinal"
SHORT_PERIOD_OUTPUTS = {"alpha", "q", "theta", "a_z", "n_z", "q_dot"}

MOTION = {"alpha", "beta", "gamma", "phi", "theta", "psi"}


def modes_fit(
    asked: ModesSection, found: Cut, constants: Mapping[str, float], fill: float | None
) -> tuple[list[TableFit], ModesResult]:
    """The fit of the model, and the modes by it and by all other methods that the records allow.

    Raises:
        InputError: a signal that is not there, or no record is long enough.
    """
    _check(asked, found)
    fits, known, suspected = _by_model(asked, found, constants, fill)
    result = _compared(asked, found.fitted, known, known_delay(asked, fits))
    told = delay_beside(result, found.fitted) if fits else 0.0
    late = told or suspected
    if late and asked.delay.fixed == 0.0:
        result = result._replace(notes=(*result.notes, lateness(late, bool(told), ", ".join(asked.inputs))))
    return fits, result


def _check(asked: ModesSection, found: Cut) -> None:
    """Refuse what no method could answer.

    Raises:
        InputError: a signal that is not there or is input and output, no output, no kind, or inputs that do not move.
    """
    for name in (*asked.inputs, *asked.outputs):
        if name not in found.fitted[0].signals:
            raise InputError(f"modes: {name!r} is not in [signals]; there are: {', '.join(found.fitted[0].signals)}")
    if not asked.outputs:
        raise InputError("modes.outputs names no signal")
    if asked.kinds is not None and not asked.kinds:
        raise InputError("modes.kinds names no mode: leave it out to have those that the outputs show")
    check_apart(found.fitted, asked.inputs, asked.outputs, "modes")
    if not asked.inputs:
        _must_be_free(found.fitted, asked.outputs)
    _must_move(found.fitted, asked.inputs)


def _by_model(
    asked: ModesSection, found: Cut, constants: Mapping[str, float], fill: float | None
) -> tuple[list[TableFit], tuple[Mode, ...], float]:
    """The fit of the model, the modes by it and by its equations, and by how much (s) its inputs seem late."""
    fits: list[TableFit] = []
    known: tuple[Mode, ...] = ()
    suspected = 0.0
    model = asked.model or ("short period" if set(asked.outputs) <= SHORT_PERIOD_OUTPUTS else "none")
    if model != "none":
        wanted = OutputError(
            model, asked.outputs, asked.inputs, asked.parameters, asked.delay, asked.hold, asked.biases
        )
        table, fit, chosen = output_error_fit("modes", wanted, found, constants, fill)
        fits, known = [table], (_mode(table, fit, chosen),)
        suspected = suspected_delay(table, wanted, found, constants, fill)
    if model != LONGITUDINAL and has_equations(asked):
        # The names of a user's parameters are no derivatives of the two equations.
        equations = asked._replace(parameters={}) if is_user_model(model) else asked
        known = (*known, by_equations(equations, found.fitted, constants, fits))
    return fits, known, suspected


def _compared(
    asked: ModesSection, experiments: tuple[Experiment, ...], known: tuple[Mode, ...], delay: float
) -> ModesResult:
    """The ``known`` modes beside those of every method that needs no model, of inputs that act by ``delay`` s late.

    Raises:
        InputError: no method can be asked, and no mode is known.
    """
    first = asked.inputs[0] if asked.inputs else None
    acting = tuple(acting_at(one, asked.inputs, delay) for one in experiments)
    try:
        result = modes_of_experiments(acting, first, asked.outputs, asked.kinds, known, asked.inputs[1:])
    except InputError as error:
        if not known:
            raise
        return ModesResult(known, None, f"no comparison: {error}", None, len(experiments), None)
    result = result._replace(modes=tuple(counted_from_record(mode, delay) for mode in result.modes))
    return _seen(result, experiments, [name for name in asked.inputs if name not in asked.hold])


def _seen(result: ModesResult, experiments: tuple[Experiment, ...], lines: list[str]) -> ModesResult:
    """The modes, or none by the inputs where one method finds a motion that turns far between two samples.

    That is where the inputs' course between them is not known. What rings after the inputs does not ask for them.
    """
    driven = [mode for mode in result.modes if mode.method != RINGING]
    pairs = [pair for mode in driven for kind in KINDS if (pair := mode.of_kind(kind)) is not None]
    turned = max((pair.frequency.value for pair in pairs), default=0.0) * min(one.step for one in experiments)
    if turned <= FURTHEST_TURN or not coarse(lines, experiments):
        return result
    samples = f"{2.0 * np.pi / turned:.1f} samples"
    why = f"the motion has a period of {samples}, and inputs move far between two: record it faster"
    modes = tuple(nothing(mode.method, why) if mode in driven and tells(mode) else mode for mode in result.modes)
    agree, statement = agreement(modes)
    return result._replace(modes=modes, agree=agree, statement=statement)


def _must_move(experiments: tuple[Experiment, ...], inputs: tuple[str, ...]) -> None:
    """Refuse a response to inputs none of which moves: what derivatives it gave would be those of a free motion.

    Raises:
        InputError: no input moves in any manoeuvre.
    """
    measured = [one.signals[name] for one in experiments for name in inputs]
    moved = [one[np.isfinite(one)] for one in measured]
    if inputs and not any(map(len, moved)):
        raise InputError(f"modes: {', '.join(inputs)}: nothing was measured; a free motion has inputs = []")
    if inputs and not any(len(one) and np.ptp(one) > 0.0 for one in moved):
        said = "do" if len(inputs) > 1 else "does"
        raise InputError(f"modes: {', '.join(inputs)} {said} not move; a free motion has inputs = []")


def _must_be_free(experiments: tuple[Experiment, ...], outputs: tuple[str, ...]) -> None:
    """Refuse a free response in which a control, an angle with a name of its own, moves.

    Raises:
        InputError: one does, with the time at which it comes to rest.
    """
    for one in experiments:
        for name in one.signals.keys() - MOTION - set(outputs):
            values = one.signals[name]
            if one.units.get(name) != "rad" or not np.any(np.isfinite(values)):
                continue
            rest = float(values[np.isfinite(values)][-LEAST_RUN:].mean())
            moved = np.flatnonzero(away(values, rest))
            if len(moved):
                raise InputError(
                    f"modes: inputs = [] but {name} moves until {one.time[moved[-1]]:.6g} s in {one.name}: begin the "
                    "manoeuvre after that, name it in inputs, or leave it out of [signals] if it is no control"
                )


def _mode(table: TableFit, fit: Fit, chosen: Chosen) -> Mode:
    """The modes that the fitted matrices have, errors by the delta method."""
    method = "output error"
    system = fitted_system(table, fit, chosen)
    if system.failure:
        return nothing(method, system.failure)
    return mode_of_system(
        method, system.of, fit.values, Spread(fit.covariance, fit.degrees), tuple(map(shortened, fit.estimates))
    )
