"""The fitted models flown again beside what was measured: fits, residuals, and manoeuvres that were held out."""

from __future__ import annotations

import numpy as np

from logs.identification.data.flight_segments import Stretch
from logs.identification.data.maneuvers import Manoeuvre
from logs.identification.data.split import by_flight, drawn
from logs.identification.estimators.flight.equation_error import DerivativeFit, signals
from logs.identification.estimators.flight.filter_error import Filtered
from logs.identification.estimators.flight.gust_ekf_data import PHASES
from logs.identification.estimators.flight.gusts import OUTPUTS as FORETOLD
from logs.identification.estimators.flight.output_error import fitted_outputs, output_error, with_lag_known
from logs.identification.estimators.flight.short_period import EQUATION_ERROR, FILTER_ERROR, OUTPUT_ERROR
from logs.identification.estimators.flight.simulation import OUTPUTS, Problem
from logs.identification.models.modes import ModesResult
from logs.identification.models.stroke_averaged import UNITS
from logs.identification.results import Array, FitSeries, Fitted, Unidentified

OUTPUT_UNITS = ("rad/s", "m/s^2", "m/s^2", "rad")
HELD = 3
"""-; every third manoeuvre is held out of a single flight"""
DRIFT = 2
"""-; order of the polynomial that the integrated speeds leave in an equation's balance"""
LINEAR_MODEL = (
    "du/dt = X_u u + X_w w + (X_q − w₀) q − g cos θ₀ θ + X_δ δ",
    "dw/dt = Z_u u + Z_w w + (Z_q + u₀) q − g sin θ₀ θ + Z_δ δ",
    "dq/dt = M_u u + M_w w + M_q q + M_δ δ,   dθ/dt = q",
    "u, w (airspeed along the body's x and z axis), q (pitch rate), θ (pitch) and δ (achieved tail angle, nose up"
    " positive) are changes from the steady flight u₀, w₀, θ₀ and averages over a wing stroke; body axes, x ahead, z"
    " down.",
)


def fitted(result: ModesResult) -> tuple[Fitted, ...]:
    """What the methods with a physical model found, with measured and modelled outputs of every manoeuvre.

    Output error has manoeuvres held out too, where there are enough: those of the flights that were asked for, else
    those of a second fit.
    """
    if result.problem is None:
        return ()
    by_output, by_equation, by_filter = result.fits
    return (
        _output_error(OUTPUT_ERROR, result.problem, by_output, result.held_out),
        _equation_error(EQUATION_ERROR, result.problem, by_equation),
        _filter_error(FILTER_ERROR, by_filter, result.filtered, result.problem.manoeuvres),
    )


def predicted(problem: Problem, fit: DerivativeFit, held: tuple[Manoeuvre, ...]) -> tuple[FitSeries, ...]:
    """Outputs of manoeuvres that were not fitted, by a ``fit`` of output error; first states and biases their own."""
    ready, again = with_lag_known(problem._replace(manoeuvres=held), fit)
    return _series(ready, again, ready.manoeuvres, True)


def _output_error(method: str, problem: Problem, fit: DerivativeFit, held: tuple[Manoeuvre, ...]) -> Fitted:
    if fit.failure:
        return _failed(method, fit)
    ready, again = with_lag_known(problem, fit)
    series = _series(ready, again, ready.manoeuvres, False)
    if held:
        told, note = predicted(problem, fit, held), _said(held, problem.manoeuvres)
    else:
        told, note = _held_out(ready, again)
    return _told(method, fit)._replace(series=series + told, validation=note)


def _series(
    problem: Problem, fit: DerivativeFit, manoeuvres: tuple[Manoeuvre, ...], held: bool
) -> tuple[FitSeries, ...]:
    outputs = fitted_outputs(problem._replace(manoeuvres=manoeuvres), fit)
    return tuple(
        FitSeries(
            m.name,
            OUTPUTS[o],
            OUTPUT_UNITS[o],
            m.at,
            m.averages[:, o],
            modelled[:, i],
            held,
            float(m.averages[:, o].mean()),
        )
        for m, modelled in zip(manoeuvres, outputs, strict=True)
        for i, o in enumerate(problem.outputs)
    )


def _held_out(problem: Problem, fit: DerivativeFit) -> tuple[tuple[FitSeries, ...], str]:
    """Some manoeuvres as a model of the others predicts them, and in words what was done.

    Whole flights where there are several, else every third manoeuvre of the only one.
    """
    count = len(problem.manoeuvres)
    flights = sorted({m.flight.name for m in problem.manoeuvres if m.flight is not None})
    if len(flights) > 1:
        kept, held = by_flight(problem.manoeuvres, drawn(flights))
    elif count < HELD:
        return (), f"No manoeuvre was held out: of {count} none can be spared."
    else:
        kept, held = (
            tuple(m for i, m in enumerate(problem.manoeuvres) if (i % HELD == HELD - 1) is side)
            for side in (False, True)
        )
    again = output_error(problem._replace(manoeuvres=kept), fit.values)
    if again.failure:
        without = "those of a flight" if len(flights) > 1 else "every third of them"
        return (), f"No manoeuvre was held out: without {without}, {again.failure}."
    return _series(problem, again, held, True), _said(held, kept)


def _said(held: tuple[Manoeuvre, ...], kept: tuple[Manoeuvre, ...]) -> str:
    names = dict.fromkeys(m.flight.name for m in held if m.flight is not None)
    whole = f", all of {' and '.join(names)}," if names else ""
    return (
        f"{len(held)} of {len(held) + len(kept)} manoeuvres{whole} were held out: derivatives found from the other"
        f" {len(kept)} alone predict them; only initial state and sensor biases are those of the manoeuvre itself."
    )


def _equation_error(method: str, problem: Problem, fit: DerivativeFit) -> Fitted:
    """Each equation's balance in the time domain, the drift of the integrated speeds taken out of it."""
    if fit.failure:
        return _failed(method, fit)
    by_axis = {axis: [i for i, name in enumerate(fit.names) if name.startswith(axis)] for axis in "XZM"}
    units = {"X": ("f_x", "m/s^2"), "Z": ("f_z", "m/s^2"), "M": ("dq/dt", "rad/s^2")}
    series = []
    for manoeuvre in problem.manoeuvres:
        pair = signals(manoeuvre, problem.reference, problem.aircraft)
        for row, axis in enumerate("XZM"):
            if by_axis[axis]:
                columns = ["uwqd".index(fit.names[i].partition("_")[2][0]) for i in by_axis[axis]]
                model = pair.regressors[:, columns] @ fit.values[by_axis[axis]]
                measured = pair.responses[:, row]
                output, unit = units[axis]
                near = model + _drift(measured - model)
                series.append(FitSeries(manoeuvre.name, output, unit, manoeuvre.at, measured, near))
    return _told(method, fit)._replace(series=tuple(series))


def _filter_error(
    method: str, fit: DerivativeFit, filtered: Filtered | None, manoeuvres: tuple[Manoeuvre, ...]
) -> Fitted:
    """Each stroke's averages beside what the strokes before it foretell, stretch by stretch."""
    if filtered is None:
        return _failed(method, fit)
    series, done = [], 0
    for stretch in filtered.stretches:
        strokes = slice(done, done + len(stretch.averages))
        done = strokes.stop
        if stretch.phase != PHASES[0]:
            continue
        at, name = (stretch.edges[:-1] + stretch.edges[1:]) / 2.0, _from(stretch, manoeuvres)
        for i, output in enumerate(FORETOLD):
            measured, model = stretch.averages[:, i], filtered.foretold[strokes, i]
            series.append(FitSeries(name, output, OUTPUT_UNITS[i], at, measured, model))
    notes = (
        "Gusts are states of the model: what is shown foretells each stroke from those before, so that it follows"
        " gusts half a stroke late. How strong they were is not told: a gust and a stroke that differs look alike.",
        "Gusts may turn the air where they change along the flight, or not, and what the tail does may grow with the"
        " airspeed, or not; fits of all these are weighed by how likely the flight makes them: that gusts turned the"
        f" air {filtered.turning:.1%}, that the tail's work grew {filtered.growing:.1%}.",
    )
    return _told(method, fit)._replace(series=tuple(series), notes=notes)


def _drift(difference: Array) -> Array:
    position = np.linspace(-1.0, 1.0, len(difference))
    return np.asarray(np.polyval(np.polyfit(position, difference, DRIFT), position), dtype=np.float64)


def _from(stretch: Stretch, manoeuvres: tuple[Manoeuvre, ...]) -> str:
    begin, flight = float(stretch.edges[0]), manoeuvres[int(stretch.manoeuvre[0])].flight
    return f"from {begin:.1f} s" if flight is None else f"from {flight.own_time(begin):.1f} s of {flight.name}"


def _told(method: str, fit: DerivativeFit) -> Fitted:
    found = fit.spread.estimates({n: UNITS[n] for n in fit.names}, fit.values)
    spread = np.sqrt(np.maximum(np.diag(fit.spread.covariance), 1e-300))
    return Fitted(method, LINEAR_MODEL, found, (), fit.spread.covariance / np.outer(spread, spread))


def _failed(method: str, fit: DerivativeFit) -> Fitted:
    return Fitted(method, LINEAR_MODEL, (), (Unidentified(method, fit.failure),))
