"""The modes of a flapping flight: every method, their intervals, and whether they agree."""

from __future__ import annotations

import numpy as np

from logs.identification.data.flight import AIRSPEED_GUESSED, STROKES_GUESSED, Aircraft, FlightData
from logs.identification.data.flight_segments import stretches
from logs.identification.data.maneuvers import (
    Reference,
    dropped_manoeuvres,
    find_manoeuvres,
    lagged,
    reference_of,
)
from logs.identification.data.split import by_flight
from logs.identification.diagnostics.agreement import agreement, contradiction
from logs.identification.diagnostics.model_structure_error import CALM, lacking, with_coarseness, with_differences
from logs.identification.estimators.flight.equation_error import DerivativeFit, equation_error, failed, likely_lag
from logs.identification.estimators.flight.filter_error import Filtered, filter_error
from logs.identification.estimators.flight.gust_ekf_data import PHASES, Task
from logs.identification.estimators.flight.linearization_correction import beyond_small_motions
from logs.identification.estimators.flight.output_error import (
    LOST,
    flown_regressors,
    output_error,
    share_explained,
    with_lag_known,
)
from logs.identification.estimators.flight.simulation import Problem
from logs.identification.estimators.nonparametric import modes_of_records
from logs.identification.estimators.records import Records, averaged_records
from logs.identification.models.modes import SHORT_PERIOD, Mode, ModesResult, mode_of_system, nothing
from logs.identification.models.stroke_averaged import LONGITUDINAL, TAIL, TAIL_LAG, UNITS, matrices, modes_matrix
from logs.identification.results import Array

ALONE = (
    "filter error alone gives a number, so that nothing tells whether its linear model fits in these gusts: of the"
    " simulated aircraft, in gusts of 0.7 to 2 m/s, its intervals held the damping in 113 flights of 131"
)
"""what is said of it then; see the README"""
FITTED_OUTPUTS = (0, 1, 2)
"""-; of `output_error.OUTPUTS`: q, a_x and a_z. The AHRS's pitch is the gyro integrated: it adds nothing"""
OUTPUT_ERROR, EQUATION_ERROR, FILTER_ERROR = "output error", "equation error, frequency domain", "filter error"
TAIL_PASSES = 3
LEAST_EXPLAINED = 0.85
"""-; of the pitch rate's power by the elevator, for output error and equation error: gusts ring the aircraft too, and
below it the frequency comes out too low, outside its interval"""
GUSTY = "of the pitch rate, the rest is gusts or what the model lacks: fly larger inputs, or in calmer air"
"""how a refusal for gusts ends"""
ELSEWHERE = "the motion of the fitted model is not the measured one: gusts, or a model that is not the aircraft's"
UNTOLD = f"{LOST}: nothing tells how much of the motion is gusts or noise, nor takes it out"
"""why no other method that knows of no gusts is believed then: in light turbulence on the multibody aircraft plain
equation error gave 6.1 rad/s (5.1 to 7.0) and a free response 20.7 (18.9 to 22.5) where 10.6 was true"""


def mode_of(method: str, fit: DerivativeFit, reference: Reference, aircraft: Aircraft) -> Mode:
    """The modes that a method's derivatives have, errors by the delta method."""
    if fit.failure:
        return nothing(method, fit.failure)

    def system(values: Array) -> Array:
        return modes_matrix(matrices(fit.names, values, reference, aircraft), fit.names)

    derivatives = fit.spread.estimates({n: UNITS[n] for n in fit.names}, fit.values)
    return mode_of_system(method, system, fit.values, fit.spread, derivatives)


def identify_modes(
    data: FlightData,
    aircraft: Aircraft,
    names: tuple[str, ...] = LONGITUDINAL,
    outputs: tuple[int, ...] = FITTED_OUTPUTS,
    held_out: tuple[str, ...] = (),
) -> ModesResult:
    """The modes of a flight by output, equation and filter error and by the methods without a physical model.

    Of joined flights those named by ``held_out`` are not fitted but predicted (`diagnostics.validation`).

    Raises:
        InputError: no usable elevator manoeuvre, in all flights or in one that is held out.
    """
    every = find_manoeuvres(data, aircraft)
    manoeuvres, held = by_flight(every, held_out)
    reference = reference_of(data, manoeuvres)
    problem = Problem(manoeuvres, reference, aircraft, names, outputs)
    first, second = fit_derivatives(problem)
    third, filtered = _with_gusts(data, problem, second)
    third = with_coarseness(third, second)
    by_filter = mode_of(FILTER_ERROR, third, reference, aircraft)
    second, first = _uncontradicted(by_filter, (second, first), reference, aircraft)
    records = records_flown(problem, second)
    modes = (
        mode_of(OUTPUT_ERROR, second, reference, aircraft),
        mode_of(EQUATION_ERROR, first, reference, aircraft),
        by_filter,
        *(_in_gusts(mode, (second, first), by_filter) for mode in modes_of_records(records, (SHORT_PERIOD,))),
    )
    agree, statement = agreement(modes)
    if by_filter.frequency is not None and sum(mode.frequency is not None for mode in modes) == 1:
        statement = ALONE
    period = float(np.mean([m.period for m in manoeuvres]))
    notes = (*data.notes, *dropped_manoeuvres(data, every))
    fits = (second, first, third)
    return ModesResult(
        modes, agree, statement, reference, len(manoeuvres), period, notes, problem, fits, filtered, held
    )


def records_flown(problem: Problem, by_output: DerivativeFit) -> Records:
    """What methods without a physical model work on: stroke averages, as small motions would have them where output
    error tells what large ones add, and driven by the tail with the lag that it found."""
    if by_output.failure:
        return averaged_records(problem.manoeuvres)
    ready, fit = with_lag_known(problem, by_output)
    with np.errstate(over="ignore", invalid="ignore"):
        beyond = beyond_small_motions(ready, fit)
    finite = all(np.all(np.isfinite(one)) for one in beyond)
    return averaged_records(ready.manoeuvres, beyond if finite else ())


def _with_gusts(data: FlightData, problem: Problem, near: DerivativeFit) -> tuple[DerivativeFit, Filtered | None]:
    """Derivatives by filter error, which starts from what equation error finds in any air, and ``near`` its lag."""
    names, aircraft = tuple(name for name in problem.names if name not in TAIL), problem.aircraft
    manoeuvres = problem.manoeuvres
    lag: list[float] = []
    if aircraft.tail_time_constant is None:
        found = near.values[-1] if not near.failure else likely_lag(manoeuvres, problem.reference, aircraft, names)
        lag = [max(float(found), 0.0)]
        manoeuvres = tuple(lagged(m, aircraft._replace(tail_time_constant=lag[0])) for m in manoeuvres)
    start = equation_error(manoeuvres, problem.reference, aircraft, names)
    asked = (*names, TAIL_LAG) if lag else names
    if start.failure:
        return failed(asked, f"no starting values: {start.failure}"), None
    if STROKES_GUESSED in data.notes:
        return failed(asked, "no wing's phase was measured: it follows the gusts from stroke to stroke"), None
    cut = tuple(stretch for phase in PHASES for stretch in stretches(data, manoeuvres, phase))
    if AIRSPEED_GUESSED in data.notes:
        # Over ground it lacks the very gusts: as little is made of it as if it never changed.
        steady = problem.reference.airspeed
        cut = tuple(stretch._replace(airspeed=np.full_like(stretch.airspeed, steady)) for stretch in cut)
    task = Task(cut, problem.reference, aircraft, asked)
    return filter_error(task, np.concatenate((start.values, lag)))


def fit_derivatives(problem: Problem) -> tuple[DerivativeFit, DerivativeFit]:
    """Derivatives by equation error and by output error, with the tail's time constant where it is not known."""
    return _both_fits(problem) if problem.aircraft.tail_time_constant is not None else _with_unknown_tail(problem)


def _both_fits(problem: Problem) -> tuple[DerivativeFit, DerivativeFit]:
    """Equation error, and output error that starts from it; neither where gusts move the aircraft too much."""
    derivatives = tuple(name for name in problem.names if name not in TAIL)
    first = equation_error(problem.manoeuvres, problem.reference, problem.aircraft, derivatives)
    if first.failure:
        return first, failed(problem.names, f"no starting values: {first.failure}")
    start = np.concatenate((first.values, np.zeros(len(problem.names) - len(derivatives))))
    second = output_error(problem, start)
    share = share_explained(problem, start if second.failure else second.values)
    if not second.failure and share >= LEAST_EXPLAINED:
        clean = flown_regressors(problem, second)
        first = equation_error(problem.manoeuvres, problem.reference, problem.aircraft, derivatives, clean)
        if first.failure:
            return first._replace(explained=share), failed(problem.names, ELSEWHERE)._replace(explained=share)
        first, second = with_differences(lacking(first, second.lack), second, len(problem.manoeuvres))
    first, second = first._replace(explained=share), second._replace(explained=share)
    if second.failure == LOST and not first.failure:
        first = failed(first.names, UNTOLD)
    if not share >= LEAST_EXPLAINED and not first.failure:
        first = failed(first.names, _too_gusty(share))
    if not share >= LEAST_EXPLAINED and not second.failure:
        second = failed(second.names, _too_gusty(share))
    return first, second


def _uncontradicted(
    by_filter: Mode, fits: tuple[DerivativeFit, DerivativeFit], reference: Reference, aircraft: Aircraft
) -> tuple[DerivativeFit, DerivativeFit]:
    """Fits by output and by equation error, each refused where filter error contradicts its modes in gusts.

    Neither knows of gusts, nor do their intervals; equation error has output error's motion for its instruments, and
    is refused with it. In one of twelve flights of the multibody aircraft in light turbulence output error gave 4.3
    rad/s (1.0 to 7.7) where 11.4 is true and filter error gave 11.5 (9.9 to 13.0). In calm air it is filter error
    that has the coarser model.
    """
    told, why = [], ""
    for method, fit in zip((OUTPUT_ERROR, EQUATION_ERROR), fits, strict=True):
        if not why and not fit.failure and by_filter.short_period is not None and fit.explained < CALM:
            clause = contradiction(mode_of(method, fit, reference, aircraft), by_filter)
            why = f"{clause}; {_too_gusty(fit.explained)}" if clause else ""
        told.append(failed(fit.names, why) if why and not fit.failure else fit)
    return told[0], told[1]


def _too_gusty(share: float) -> str:
    return f"the elevator explains {max(share, 0.0) if np.isfinite(share) else 0.0:.0%} {GUSTY}"


def _in_gusts(mode: Mode, fits: tuple[DerivativeFit, DerivativeFit], by_filter: Mode) -> Mode:
    """The mode, refused where gusts were too strong for one of two methods that know more of the aircraft.

    So it is where output error lost its way in them, and where filter error contradicts it: of an Arizona in 2 m/s,
    whose fitted model diverged, the free response rang at 19.1 rad/s (18.8 to 19.4) where 10.3 was true and filter
    error gave 11.7 (9.9 to 13.5).
    """
    if mode.short_period is None:
        return mode
    why = next((fit.failure for fit in fits if GUSTY in fit.failure or fit.failure in (UNTOLD, ELSEWHERE)), "")
    share = min(fit.explained for fit in fits)
    if not why and by_filter.short_period is not None and share < CALM:
        clause = contradiction(mode, by_filter)
        why = f"{clause}; {_too_gusty(share)}" if clause else ""
    return nothing(mode.method, why) if why else mode


def _with_unknown_tail(problem: Problem) -> tuple[DerivativeFit, DerivativeFit]:
    """Both fits with the tail's time constant as one more parameter, linearised anew about what was found."""
    derivatives = tuple(name for name in problem.names if name not in TAIL)
    constant = likely_lag(problem.manoeuvres, problem.reference, problem.aircraft, derivatives)
    for _ in range(TAIL_PASSES):
        aircraft = problem.aircraft._replace(tail_time_constant=constant)
        manoeuvres = tuple(lagged(m, aircraft) for m in problem.manoeuvres)
        names = (*derivatives, TAIL_LAG)
        first, second = _both_fits(problem._replace(manoeuvres=manoeuvres, aircraft=aircraft, names=names))
        if second.failure:
            break
        second.values[-1] += constant
        constant = max(float(second.values[-1]), 0.0)
    return first, second
