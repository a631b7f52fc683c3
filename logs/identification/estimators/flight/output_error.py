"""Maximum-likelihood output error: the model flies every manoeuvre again and its outputs are fitted to the measured.

Gauss-Newton on the derivatives (Klein & Morelli, Aircraft System Identification, 2006, ch. 6; Jategaonkar,
Flight Vehicle System Identification, 2006, ch. 4). The model is driven with the tail angle sample by sample
and its outputs are then averaged over the same strokes as the measured ones. Initial states and output
biases of each manoeuvre enter linearly: they are projected out, so that the errors of the derivatives contain
theirs. Standard errors are Cramer-Rao bounds corrected for coloured residuals; with several manoeuvres those
of the scatter between them, which tells what the model lacks too.
"""

from __future__ import annotations

import math

import numpy as np

from logs.identification.data.maneuvers import OUTPUT_STEP, lagged
from logs.identification.diagnostics.model_structure_error import lacking, share_of_lack
from logs.identification.estimators.flight.equation_error import NOTHING, DerivativeFit, failed
from logs.identification.estimators.flight.linearization_correction import swung, without_second_order
from logs.identification.estimators.flight.modulation import (
    LEAST_MANOEUVRES,
    cleared,
    factors_of,
    products,
    responses,
)
from logs.identification.estimators.flight.simulation import (
    OUTPUTS,
    Linearised,
    Problem,
    flown_at,
    linearise,
    project,
    projections,
    residuals_of,
    spread_of,
    squares_of,
    without_nuisances,
)
from logs.identification.models.stroke_averaged import TAIL, TAIL_LAG, propagate
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import by_scatter, coloured_spread, information

ITERATIONS = 40
CONVERGED = 2e-2
"""-; largest step, in standard errors"""
SECOND_ORDER_PASSES = 3
MODULATED_STEPS = 2, 8
"""-; of Gauss-Newton with the stroke's modulation, from the optimum without it: at least and at the most"""
SETTLED = 0.3
"""-; step with the modulation, in standard errors, after which there is none more: each is a quarter of the last one
or less"""
LAG_STROKES = 2.0
NOTICED = 2.0
"""-; standard errors of a delay that is not there from which on it counts. By a test at 99 % four of twelve flights
of the Arizona in a steady wind had a fifth of the others' intervals, and three missed what was true; from 1.4 on,
every sixth flight of an aircraft that lacks nothing has one"""
LOST = "output error did not converge"
WORST_CONDITION = 1e5


def output_error(problem: Problem, start: Array) -> DerivativeFit:
    """Derivatives ``problem.names`` by Gauss-Newton from ``start`` (p,), as equation error or a prior gives it.

    The outputs' variances are estimated anew after every step (relaxation of the likelihood). What the kinematics
    and the stroke's modulation add to second order is taken off the measured outputs as the last fit tells it, and
    before the first as ``start`` does: of a lightly damped aircraft a linear model flown against all of it found no
    optimum in 19 of 300 flights, and in the others one so far off that two passes more did not lead back.
    """
    linear, fit = problem, _begun(problem, start)
    for _ in range(SECOND_ORDER_PASSES):
        linear = without_second_order(problem, linear, fit)
        fit = _fitted(linear, fit.values)
        if fit.failure:
            break
    return fit


def _begun(problem: Problem, start: Array) -> DerivativeFit:
    """Derivatives ``start`` (p,) with the scatter that they leave, worth nothing."""
    scatter = spread_of(residuals_of(problem, start, np.ones(len(problem.outputs))))
    return failed(problem.names, "not fitted")._replace(values=start, scatter=scatter)


def _fitted(problem: Problem, start: Array) -> DerivativeFit:
    values, deviation = start.copy(), np.ones(len(problem.outputs))
    for _ in range(3):
        deviation = deviation * spread_of(residuals_of(problem, values, deviation))
    for _ in range(ITERATIONS):
        here = linearise(problem, values, deviation)
        step, errors = _gauss_newton(here)
        if not np.all(np.isfinite(step)):
            return failed(problem.names, "the manoeuvres do not determine all derivatives")
        if np.max(np.abs(step) / errors) < CONVERGED:
            return _finish(problem, values, deviation)
        advanced = _advance(problem, values, step, deviation, squares_of(here.residuals))
        if advanced is None:
            break
        values, deviation = advanced
    return failed(problem.names, LOST)


def flown_regressors(problem: Problem, fit: DerivativeFit) -> list[Array]:
    """Stroke averages (M, 8) in each manoeuvre, as the fitted model flies them: of u, w, q, the tail angle and
    `modulation.products`.

    Without what the kinematics add: with it the drifts of the speeds are wrong and the frequency of a lightly damped
    aircraft, 0.1 % off, was held in 70 % of its flights.
    """
    flown, regressors = flown_at(problem, fit.values), []
    for manoeuvre in problem.manoeuvres:
        start = project(problem, flown, manoeuvre, fit.scatter).start
        tail = flown.tail(manoeuvre)
        states = swung(flown, manoeuvre, propagate(flown.exact, start, tail), fit.swing)
        columns = (states[:, :3], tail, products(manoeuvre, states))
        regressors.append(manoeuvre.averaging @ np.column_stack(columns))
    return regressors


def fitted_outputs(problem: Problem, fit: DerivativeFit) -> list[Array]:
    """Stroke-averaged outputs (M_i, m) of the fitted model; initial states and biases at their best."""
    pieces = projections(without_second_order(problem, problem, fit), fit.values, fit.scatter)
    pairs = zip(problem.manoeuvres, pieces, strict=True)
    return [m.averages[:, problem.outputs] - piece.residuals * fit.scatter for m, piece in pairs]


def with_lag_known(problem: Problem, fit: DerivativeFit) -> tuple[Problem, DerivativeFit]:
    """Both with the tail's lag that was found taken as known, the parameter then being the rest of it: none."""
    if TAIL_LAG not in fit.names:
        return problem, fit
    values, place = fit.values.copy(), fit.names.index(TAIL_LAG)
    aircraft = problem.aircraft._replace(tail_time_constant=max(float(values[place]), 0.0))
    values[place] = 0.0
    manoeuvres = tuple(lagged(m, aircraft) for m in problem.manoeuvres)
    return problem._replace(manoeuvres=manoeuvres, aircraft=aircraft, names=fit.names), fit._replace(values=values)


def share_explained(problem: Problem, values: Array) -> float:
    """Share of the pitch rate's power that the tail explains with the derivatives ``values`` (p,), at most 1.

    What initial states and biases could explain is in neither. Negative where the model is worse than none.
    """
    deviation, pitch_rate = np.ones(len(problem.outputs)), problem.outputs.index(OUTPUTS.index("q"))
    for _ in range(3):
        deviation = deviation * spread_of(residuals_of(problem, values, deviation))
    flown, left, whole = flown_at(problem, values), 0.0, 0.0
    for manoeuvre in problem.manoeuvres:
        piece = project(problem, flown, manoeuvre, deviation)
        driven = flown.driven(manoeuvre, np.zeros(4))[:, problem.outputs] / deviation
        measured = piece.residuals + without_nuisances(piece.basis, driven)
        left += float(np.sum(piece.residuals[:, pitch_rate] ** 2))
        whole += float(np.sum(measured[:, pitch_rate] ** 2))
    return 1.0 - left / whole if whole > 0 else 0.0


def _gauss_newton(here: Linearised) -> tuple[Array, Array]:
    """Step (p,) of least squares and its standard errors for white residuals; NaN where it is not determined."""
    squared = information(here.sensitivities)
    gradient = sum(np.einsum("nip,ni->p", s, r) for s, r in zip(here.sensitivities, here.residuals, strict=True))
    scale = np.sqrt(np.diag(squared))
    nothing = np.full(len(scale), np.nan)
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return nothing, nothing
    values, vectors = np.linalg.eigh(squared / np.outer(scale, scale))
    if values[0] * WORST_CONDITION**2 < values[-1]:
        return nothing, nothing
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse @ gradient, np.sqrt(np.diag(inverse))


def _advance(
    problem: Problem, values: Array, step: Array, deviation: Array, before: float
) -> tuple[Array, Array] | None:
    """The step, halved until the squares fall, and the outputs' new standard deviations; None where nothing helps."""
    for halving in range(8):
        trial = values + step * 0.5**halving
        residuals = residuals_of(problem, trial, deviation)
        if squares_of(residuals) <= before * (1 + 1e-9):
            return trial, deviation * spread_of(residuals)
    return None


def _finish(problem: Problem, values: Array, deviation: Array) -> DerivativeFit:
    """The last steps, with the stroke's modulation as a nuisance, and the errors.

    Cramer-Rao bounds, corrected for coloured residuals and for what the nuisances took out of them.
    """
    least, most = MODULATED_STEPS
    for taken in range(1, most + 1):
        late = _with_delay(problem, values, deviation)
        if not all(np.all(np.isfinite(s)) for s in (*late.residuals, *late.sensitivities)):
            return failed(problem.names, LOST)
        columns = _modulation(problem, values, deviation)
        wide = _without_modulation(late, columns)
        here = _narrow(wide, len(values))
        step, errors = _gauss_newton(here)
        if not np.all(np.isfinite(step)):
            return failed(problem.names, "the manoeuvres do not determine all derivatives")
        values = values + step
        if taken >= least and np.max(np.abs(step) / errors) <= SETTLED:
            break
    else:
        return failed(problem.names, LOST)
    residuals = [r - s @ step for r, s in zip(here.residuals, here.sensitivities, strict=True)]
    within = coloured_spread(residuals, here.sensitivities, _reach(problem), here.nuisances)
    spread = by_scatter(within, residuals, here.sensitivities)
    fit = DerivativeFit(problem.names, values, spread, deviation)
    if columns:
        left = [r - s @ step for r, s in zip(late.residuals, _narrow(late, len(values)).sensitivities, strict=True)]
        fit = fit._replace(swing=factors_of(left, columns, _swinging(problem, values), _reach(problem)[0]))
    return lacking(fit, _lack(problem, wide, residuals))


def _reach(problem: Problem) -> tuple[int, int]:
    """Samples of a stroke, and lags at which the residuals are looked at."""
    stroke = round(max(m.period for m in problem.manoeuvres) / OUTPUT_STEP)
    longest = max(len(m.at) for m in problem.manoeuvres)
    return stroke, int(min(max(longest / 10, LAG_STROKES * stroke), longest / 2)) + 1


def _with_delay(problem: Problem, values: Array, deviation: Array) -> Linearised:
    """`linearise` with one sensitivity more, to a delay of the tail beyond what is known of it."""
    here, flown = linearise(problem, values, deviation), flown_at(problem, values)
    wider = []
    pieces = projections(problem, values, deviation)
    for manoeuvre, piece, slopes in zip(problem.manoeuvres, pieces, here.sensitivities, strict=True):
        delayed = flown.averages(manoeuvre, np.zeros(4), -manoeuvre.tail_rate)[:, problem.outputs] / deviation
        wider.append(np.dstack((slopes, without_nuisances(piece.basis, delayed))))
    return here._replace(sensitivities=wider)


def _narrow(wide: Linearised, count: int) -> Linearised:
    return wide._replace(sensitivities=[slopes[:, :, :count] for slopes in wide.sensitivities])


def _lack(problem: Problem, wide: Linearised, residuals: list[Array]) -> Array:
    """By what the derivatives (p,) move where the tail may be late too, as far as that is more than noise.

    A delay that is not there stands for what four states lack: wings that twist, a wake that grows. It moves the
    frequency by several per cent and shows neither in the noise nor in the scatter between manoeuvres.
    """
    wide = wide._replace(residuals=residuals)
    step, _ = _gauss_newton(wide)
    if set(TAIL) & set(problem.names) or not np.all(np.isfinite(step)) or step[-1] == 0.0:
        return NOTHING
    spread = coloured_spread(residuals, wide.sensitivities, _reach(problem), wide.nuisances)
    share = share_of_lack(float(step[-1]), float(spread.covariance[-1, -1]), NOTICED)
    return step[:-1] * math.sqrt(share) if share > 0.0 else NOTHING


def _modulation(problem: Problem, values: Array, deviation: Array) -> list[Array]:
    """What each factor of the stroke's modulation adds to the outputs, (M_i, m, f), in standard deviations.

    Nuisances are projected out; empty where too few manoeuvres tell the factors.
    """
    if len(problem.manoeuvres) < LEAST_MANOEUVRES:
        return []
    flown, columns = flown_at(problem, values), []
    for manoeuvre, piece in zip(problem.manoeuvres, projections(problem, values, deviation), strict=True):
        forcing = products(manoeuvre, propagate(flown.exact, piece.start, flown.tail(manoeuvre)))
        imu = problem.aircraft.imu_x, problem.aircraft.imu_z
        outputs = responses(flown.model, manoeuvre, forcing, imu)[:, problem.outputs]
        columns.append(without_nuisances(piece.basis, outputs / deviation[:, None]))
    return columns


def _without_modulation(here: Linearised, columns: list[Array]) -> Linearised:
    if not columns:
        return here
    rest = cleared(here.residuals, here.sensitivities, columns)
    return Linearised(rest.residuals, rest.sensitivities, here.nuisances + rest.factors)


def _swinging(problem: Problem, values: Array) -> Array:
    """Sizes (12,) of what may swing: the derivatives with w and q along x, along z and in pitch, as `products`."""
    found = dict(zip(problem.names, np.abs(values), strict=True))
    return np.array([found.get(f"{axis}_{state}", 0.0) for axis in "XZM" for state in "wwqq"])
