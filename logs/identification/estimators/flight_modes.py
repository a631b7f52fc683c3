"""Modes of a flapping flight by every method: output error, equation error, filter error, and without a model.

All methods work on the same records, stroke averages of elevator command and outputs (`data.maneuvers`), and on the
linear longitudinal model of `models.stability` behind the tail's delay and lag.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.maneuvers import (
    ELEVATOR,
    Maneuver,
    Reference,
    by_flight,
    dropped_maneuvers,
    find_maneuvers,
    holdout_sample,
    reference_of,
)
from logs.identification.data.resampling import behind
from logs.identification.diagnostics.agreement import agreement
from logs.identification.estimators.closed_loop import (
    EFFECTIVENESS,
    INSTRUMENTS,
    MEMORY,
    ClosedLoop,
    control_effectiveness,
)
from logs.identification.estimators.engine.problem import Fit, Nuisances, Parameter, Problem
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from logs.identification.estimators.filter_error import Filtered, filter_error_search
from logs.identification.estimators.modal import Records, records_of
from logs.identification.estimators.nonparametric import modes_of_records
from logs.identification.estimators.output_error import Search, fitted_series, output_error, predicted
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.estimators.regressors import without
from logs.identification.findings import Entry, Finding, note, register
from logs.identification.models.actuators import Actuated, Actuator
from logs.identification.models.modes import SHORT_PERIOD, Mode, ModesResult, mode_of_result, mode_of_system, nothing
from logs.identification.models.stroke_averaged import LONGITUDINAL, TAIL_DELAY, TAIL_LAG, UNITS, model_of
from logs.identification.results import Array, Estimate, EstimationResult, FitSeries
from logs.identification.statistics.covariance import ParameterUncertainty
from wingbeat.constants import STANDARD_GRAVITY

OUTPUT_ERROR, EQUATION_ERROR, FILTER_ERROR = "output error", "equation error, frequency domain", "filter error"
OUTPUTS = ("q", "a_x", "a_z")
"""fitted; the pitch angle is the integral of the pitch rate and adds no information"""
FIRST_LAG, MAX_LAG = 0.05, 0.3
"""s; of a tail whose time constant is not known: start and bound"""
HIGHEST = 0.5
"""-; of the flapping frequency: bandwidth of the stroke averages"""
DRIFT_ORDER = 2
"""-; of the polynomial in time that the biases of the sensors leave in the integrated speeds"""


IN_TURBULENCE = "not compared: only filter error models the turbulence, the other methods are biased by it"
STATES = ("u", "w", "q")
"""-; airspeeds, to whose rates gusts add nearly white noise, instrumented in equation error"""
LIFT_SLOPE = 3.0
"""1/rad; change of the lift over the lift"""
TURBULENT = 0.85
"""-; coefficient of determination of the pitch rate by output error, below which turbulence dominates"""
LARGE_PITCH = 0.25
"""rad; range of the pitch angle in a maneuver, above which the linear kinematics are inaccurate"""
VIBRATION_BAND, VIBRATION = 40.0, 1.2
"""Hz, m/s^2; RMS of the normal specific force above this frequency, above which vibration reaches the estimates"""
THIRD = 3
"""-; every third maneuver of a single flight is predicted by a fit to the others"""
EQUATIONS = (
    "du/dt = X_u u + X_w w + (X_q − w₀) q − g cos θ₀ θ + X_δ δ",
    "dw/dt = Z_u u + Z_w w + (Z_q + u₀) q − g sin θ₀ θ + Z_δ δ",
    "dq/dt = M_u u + M_w w + M_q q + M_δ δ,   dθ/dt = q",
    "u, w (airspeed along the body's x and z axis), q (pitch rate), θ (pitch) and δ (achieved tail angle, nose up"
    " positive) are changes from the steady flight u₀, w₀, θ₀ and averages over a wing stroke; body axes, x ahead, z"
    " down.",
)

register({
    "turbulence": Entry(
        "the elevator explains {share} of the pitch rate: intervals are too narrow",
        "The coefficient of determination of the pitch rate by output error is low: turbulence moves the aircraft as"
        " much as the input does. Methods without process noise are biased then. Filter error is less so, but of"
        " short records its intervals are too narrow too: white noise on each state is no gust (docs/validation).",
        "fly larger inputs, longer maneuvers, or in calmer air; repeat the flight and compare",
    ),
    "large_motion": Entry(
        "pitch moves through {value:.2f} rad; the linear model assumes less than {limit:g} rad",
        "Products of pitch rate and speeds and the rotation of gravity are not in the linear model: frequency and"
        " damping may be biased by one or two percent.",
        "fly smaller or shorter inputs",
    ),
    "vibration": Entry(
        "{value:.1f} m/s^2 RMS above {band:.0f} Hz at the IMU; prefer filter error",
        "Vibration of the airframe reaches the averages over a stroke: output error has too narrow intervals.",
        "mount the IMU softly; see wingbeat log vibration",
    ),
    "methods_disagree": Entry(
        "{statement}",
        "The difference of two methods exceeds the interval of the difference.",
        "compare fits and residuals of the methods; check the model's structure",
    ),
})  # fmt: skip


NO_FALLBACK = Search(fallback=False)


class FlightProblem(NamedTuple):
    """Maneuvers and the model that is fitted to them."""

    maneuvers: tuple[Maneuver, ...]
    reference: Reference
    aircraft: Aircraft
    names: tuple[str, ...] = LONGITUDINAL
    """-; derivatives that are free"""
    outputs: tuple[str, ...] = OUTPUTS
    """-; outputs that are fitted"""

    def problem(self, start: Mapping[str, float]) -> Problem:
        """The maximum-likelihood problem from ``start``, by parameter."""
        model = model_of(self.names, self.reference, self.aircraft)
        lag = self.aircraft.tail_time_constant
        parameters = {name: Parameter(start[name]) for name in self.names}
        parameters[TAIL_DELAY] = Parameter(self.aircraft.tail_delay, free=False)
        parameters[TAIL_LAG] = (
            Parameter(start.get(TAIL_LAG, FIRST_LAG), low=0.0, high=MAX_LAG) if lag is None else Parameter(lag, False)
        )
        experiments = tuple(one.experiment for one in self.maneuvers)
        nuisances = Nuisances(output_biases=self.outputs)
        actuated = Actuated(model, (Actuator((ELEVATOR,), TAIL_DELAY, TAIL_LAG),))
        return Problem(actuated, experiments, parameters, self.outputs, nuisances)

    def system(self, names: tuple[str, ...], values: Array) -> Array:
        """Matrix A (n, n) at the ``values`` (p,) of parameters ``names``."""
        model = model_of(self.names, self.reference, self.aircraft)
        given = dict(zip(names, values.tolist(), strict=True))
        return model.matrices(np.array([given.get(name, 0.0) for name in model.parameters])).a


class Regression(NamedTuple):
    """Derivatives by equation error."""

    names: tuple[str, ...]
    values: Array
    """(p,)"""
    covariance: Array
    """(p, p)"""
    degrees: float
    series: tuple[FitSeries, ...] = ()
    """each equation's response by its regressors and the drift"""
    failure: str = ""


def equation_error(flight: FlightProblem, lag: float, *, two_stage: bool = True) -> Regression:
    """Each equation of motion as a complex regression (Grauer Eq. 20, 21; Klein & Morelli, 2006, ch. 7).

    Disturbances of the stroke averages move the states, so that least squares in one stage is biased.
    """
    experiments = tuple(with_speeds(one, flight.reference, flight.aircraft, lag) for one in flight.maneuvers)
    responses = _responses(experiments) if two_stage else ()
    length = max(one.time[-1] - one.time[0] for one in experiments)
    period = float(np.mean([one.period for one in flight.maneuvers]))
    frequencies = np.arange(1, max(int(HIGHEST / period * length), 2) + 1) / length
    settings = Settings(trend=DRIFT_ORDER, frequencies=frequencies)
    names: list[str] = []
    values: list[float] = []
    blocks: list[Array] = []
    series: list[FitSeries] = []
    degrees = math.inf
    for axis, response in (("X", "f_x"), ("Z", "f_z"), ("M", "q_dot")):
        chosen = [name for name in flight.names if name.startswith(axis)]
        if not chosen:
            continue
        regressors = tuple(name[2:] for name in chosen)
        fit = coefficient_regression(experiments, response, regressors, "frequency", settings, responses)
        if fit.failure or fit.withheld:
            why = fit.failure or f"{fit.withheld[0].subject} {fit.withheld[0].text}"
            return Regression(flight.names, np.zeros(0), np.zeros((0, 0)), 1.0, (), f"{response}: {why}")
        for one, residual in zip(experiments, fit.residuals, strict=True):
            measured = one.signals[response]
            series.append(FitSeries(one.name, response, one.units[response], one.time, measured, measured - residual))
        places = [fit.names.index(name) for name in regressors]
        names += chosen
        values += [float(fit.values[place]) for place in places]
        blocks.append(fit.covariance[np.ix_(places, places)])
        degrees = min(degrees, fit.degrees)
    covariance = np.zeros((len(names), len(names)))
    at = 0
    for block in blocks:
        covariance[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return Regression(tuple(names), np.array(values), covariance, degrees, tuple(series))


def _responses(experiments: tuple[Experiment, ...]) -> tuple[Experiment, ...]:
    """The ``experiments`` with the part of u, w and q that follows from the tail's angle: the first stage.

    They are regressed on the angle behind low-pass filters in series.
    """
    inputs, drifts = [], [np.vander(np.linspace(-1, 1, len(one.time)), DRIFT_ORDER + 1) for one in experiments]
    for one in experiments:
        columns = [one.signals["delta"]]
        for _ in range(INSTRUMENTS - 1):
            columns.append(behind(columns[-1], one.step, 0.0, MEMORY, zoh=False))
        inputs.append(np.column_stack(columns))
    states = [np.column_stack([one.signals[name] for name in STATES]) for one in experiments]
    x, y = (np.vstack([without(*pair) for pair in zip(drifts, each, strict=True)]) for each in (inputs, states))
    gains = np.linalg.lstsq(x, y, rcond=None)[0]
    return tuple(
        one._replace(signals=dict(one.signals) | dict(zip(STATES, (columns @ gains).T, strict=True)))
        for one, columns in zip(experiments, inputs, strict=True)
    )


def with_speeds(maneuver: Maneuver, reference: Reference, aircraft: Aircraft, lag: float) -> Experiment:
    """Signals u, w (m/s), f_x, f_z (m/s^2, at the center of mass) and delta (rad, of the tail) besides the others.

    The speeds are integrated from the kinematics (Klein & Morelli, 2006, ch. 10) about the mean airspeed, without
    the mean of their rates.
    """
    signals = dict(maneuver.experiment.signals)
    step = maneuver.experiment.step
    q, pitch, q_dot = signals["q"], signals["theta"], signals["q_dot"]
    f_x, f_z = signals["a_x"] - aircraft.imu_z * q_dot, signals["a_z"] + aircraft.imu_x * q_dot
    scale = maneuver.airspeed / reference.airspeed
    means = scale * reference.u, scale * reference.w
    u, w = (np.full(len(q), mean) for mean in means)
    spread = maneuver.period**2 / 12
    gravity = STANDARD_GRAVITY * (1 - spread * q**2 / 2)
    for _ in range(SPEED_PASSES):
        # Means over a stroke of T s: of a product, that of the means plus T^2 / 12 times that of the slopes.
        turned_u, turned_w = (one * q + spread * np.gradient(one, step) * q_dot for one in (u, w))
        rates = (
            f_x - turned_w - gravity * np.sin(pitch),
            f_z + turned_u + gravity * np.cos(pitch),
        )
        integrals = (_integral(rate - rate.mean(), step) for rate in rates)
        u, w = (mean + one - one.mean() for mean, one in zip(means, integrals, strict=True))
    delta = behind(signals[ELEVATOR], step, aircraft.tail_delay, lag, zoh=False)
    more = {"u": u, "w": w, "f_x": f_x, "f_z": f_z, "delta": delta}
    units = {"u": "m/s", "w": "m/s", "f_x": "m/s^2", "f_z": "m/s^2", "delta": "rad"}
    kept = {name: values[::THINNED] for name, values in (signals | more).items()}
    return maneuver.experiment._replace(
        time=maneuver.experiment.time[::THINNED], signals=kept, units=dict(maneuver.experiment.units) | units
    )


SPEED_PASSES = 3
THINNED = 4
"""-; samples of a maneuver to one of the regressions, which use frequencies below half the flapping frequency"""


def _integral(rate: Array, step: float) -> Array:
    return np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) * step / 2)))


class Fits(NamedTuple):
    """What the methods with a physical model found."""

    problem: Problem
    output: Fit
    equation: Regression
    filter: Filtered


def first_problem(flight: FlightProblem) -> tuple[Regression, Problem]:
    """Equation error, and the maximum-likelihood problem that starts from least squares."""
    known_lag = flight.aircraft.tail_time_constant
    lag = FIRST_LAG if known_lag is None else known_lag
    # Least squares is biased but has the least variance: few or short maneuvers have good start values too.
    regression, start = equation_error(flight, lag), equation_error(flight, lag, two_stage=False)
    known = {} if start.failure else dict(zip(start.names, start.values.tolist(), strict=True))
    return regression, flight.problem(typical(flight) | known)


def fit_derivatives(flight: FlightProblem) -> Fits:
    """Derivatives, and the lag of the tail if it is not known, by output error, equation error and filter error."""
    regression, problem = first_problem(flight)
    by_output = output_error(problem, NO_FALLBACK)
    if flight.aircraft.tail_time_constant is None and not by_output.failure:
        regression = equation_error(flight, _lag(flight, by_output))
    if by_output.failure:
        control = {name: one.start for name, one in problem.parameters.items() if name.endswith("_delta")}
        starts = problem, flight.problem(typical(flight) | control)
        ends = [_filtered(flight, one, None) for one in starts]
        by_filter = min(ends, key=lambda end: (bool(end.fit.failure), end.fit.cost))
    else:
        by_filter = _filtered(flight, problem, by_output)
    return Fits(problem, by_output, regression, by_filter)


def _filtered(flight: FlightProblem, problem: Problem, before: Fit | None) -> Filtered:
    """Filter error of one stroke average a stroke; the problem's start values if ``before`` is None."""
    step, period = flight.maneuvers[0].experiment.step, float(np.mean([one.period for one in flight.maneuvers]))
    every = max(round(period / step), 1)
    return filter_error_search(problem, STATES, every=every, averaged=True, before=before, start_here=before is None)


def typical(flight: FlightProblem) -> dict[str, float]:
    """Derivatives of a stable aircraft at this airspeed: start values if equation error gives none."""
    airspeed = flight.reference.airspeed
    damped = STANDARD_GRAVITY / airspeed * LIFT_SLOPE
    stable = {
        "X_u": -0.3, "Z_u": -damped / LIFT_SLOPE, "Z_w": -damped, "M_w": -(damped**2) / airspeed, "M_q": -damped,
        "M_delta": damped**2,
    }  # fmt: skip
    return {name: stable.get(name, 0.0) for name in flight.names}


def identify_modes(
    data: FlightData,
    aircraft: Aircraft,
    names: tuple[str, ...] = LONGITUDINAL,
    outputs: tuple[str, ...] = OUTPUTS,
    held_out: tuple[str, ...] = (),
    method: str | None = None,
) -> ModesResult:
    """The modes of a flight by all methods, or by one row of the registry.

    Of joined flights those named by ``held_out`` are not fitted but predicted. In closed loop the control
    effectiveness is also estimated by instrumental variables; without maneuvers, by these alone.

    Raises:
        InputError: no usable elevator maneuver, in all flights or in one that is held out.
    """
    closed = control_effectiveness(data, aircraft)
    if closed is not None and not data.active.any():
        alone = _mode_of(closed)
        return ModesResult(
            (alone,), None, "no maneuver: no mode", None, 0, None,
            results=(closed.result,), findings=(*map(note, data.notes), closed.finding),
        )  # fmt: skip
    every = find_maneuvers(data)
    maneuvers, locked = by_flight(every, held_out)
    flight = FlightProblem(maneuvers, reference_of(data, maneuvers), aircraft, names, outputs)
    if method is not None:
        return _consistent(_by_row(method, data, flight, every, locked), closed)
    fits = fit_derivatives(flight)
    results: tuple[EstimationResult, ...] = results_of(flight, fits, locked)
    modes = (
        mode_of(OUTPUT_ERROR, flight, fits.output),
        mode_of(EQUATION_ERROR, flight, fits.equation),
        mode_of(FILTER_ERROR, flight, fits.filter.fit),
        *modes_of_records(records_of_flight(flight, _lag(flight, fits.output)), (SHORT_PERIOD,)),
    )
    findings = (*motion_findings(flight, results[0]), *vibration_findings(data))
    agree, statement = agreement(modes)
    if any(one.code == "turbulence" for one in findings):
        # Only filter error models the turbulence: agreement of the others would be that of equal biases.
        agree, statement = None, IN_TURBULENCE
        if modes[2].short_period is not None:
            modes = (modes[2], *modes[:2], *modes[3:])
    findings = (*map(note, (*data.notes, *dropped_maneuvers(data, every))), *findings)
    if agree is False:
        findings += (Finding("methods_disagree", "warning", details={"statement": statement}),)
    return _consistent(_modes_result(modes, agree, statement, flight, results, locked, findings), closed)


def _modes_result(
    modes: tuple[Mode, ...], agree: bool | None, statement: str, flight: FlightProblem,
    results: tuple[EstimationResult, ...], locked: tuple[Maneuver, ...], findings: tuple[Finding, ...],
) -> ModesResult:  # fmt: skip
    maneuvers = flight.maneuvers
    period = float(np.mean([one.period for one in maneuvers]))
    return ModesResult(
        modes,
        agree,
        statement,
        flight.reference,
        len(maneuvers),
        period,
        maneuvers,
        results,
        locked,
        findings,
        flight,
    )


def _mode_of(closed: ClosedLoop) -> Mode:
    """The control effectiveness as a method without a mode."""
    return Mode(closed.result.method, None, None, (), closed.result.estimates, closed.result.withheld)


def _consistent(result: ModesResult, closed: ClosedLoop | None) -> ModesResult:
    """Add the control effectiveness by instrumental variables, and withhold what contradicts it."""
    if closed is None:
        return result
    return result._replace(
        modes=(*(consistent_mode(one, closed) for one in result.modes), _mode_of(closed)),
        results=(*(consistent_result(one, closed) for one in result.results), closed.result),
        findings=(*result.findings, closed.finding),
    )


def consistent_mode(mode: Mode, closed: ClosedLoop) -> Mode:
    """Withhold the control effectiveness of a method if closed-loop data do not tell it, or tell another sign."""
    estimate = next((one for one in mode.derivatives if one.name == EFFECTIVENESS), None)
    reason = None if estimate is None else closed.contradiction(estimate)
    if reason is None:
        return mode
    kept = tuple(one for one in mode.derivatives if one.name != EFFECTIVENESS)
    return mode._replace(derivatives=kept, withheld=(*mode.withheld, reason))


def consistent_result(result: EstimationResult, closed: ClosedLoop) -> EstimationResult:
    """`consistent_mode` of an `EstimationResult`."""
    estimate = result.estimate(EFFECTIVENESS)
    reason = None if estimate is None else closed.contradiction(estimate)
    if reason is None:
        return result
    kept = [place for place, one in enumerate(result.estimates) if one.name != EFFECTIVENESS]
    return result._replace(
        estimates=tuple(result.estimates[place] for place in kept),
        covariance=None if result.covariance is None else result.covariance[np.ix_(kept, kept)],
        findings=(*result.findings, reason),
    )


def _by_row(
    method: str, data: FlightData, flight: FlightProblem, every: tuple[Maneuver, ...], locked: tuple[Maneuver, ...]
) -> ModesResult:
    """The modes by one row of the registry: angle of the tail to pitch rate and normal specific force."""
    titles = {"output_error": OUTPUT_ERROR, "filter_error": FILTER_ERROR}
    title = titles.get(method, ESTIMATORS[method].title.lower())
    if method in titles:
        fits = fit_derivatives(flight)
        result = next(one for one in results_of(flight, fits, locked) if one.method == title)
        mode = mode_of(title, flight, fits.output if method == "output_error" else fits.filter.fit)
    else:
        lag = flight.aircraft.tail_time_constant or 0.0
        fitted, held = (tail_driven(flight._replace(maneuvers=some), lag) for some in (flight.maneuvers, locked))
        request = Request(fitted, held, (ELEVATOR,), ("q", "a_z"))
        result = ESTIMATORS[method].estimate(request)._replace(title=title)
        mode = mode_of_result(title, result)
    notes = tuple(map(note, (*data.notes, *dropped_maneuvers(data, every))))
    statement = f"by {title} alone" if result.estimates else f"no mode by {title}"
    return _modes_result((mode,), None, statement, flight, (result,), locked, notes)


def motion_findings(flight: FlightProblem, result: EstimationResult) -> tuple[Finding, ...]:
    """Turbulence and motions too large for a linear model."""
    findings = []
    pairs = [one for one in result.series if one.output == "q" and not one.held_out]
    left = sum(float(np.nansum((one.measured - one.model) ** 2)) for one in pairs)
    whole = sum(float(np.nansum((one.measured - np.nanmean(one.measured)) ** 2)) for one in pairs)
    determination = 1.0 - left / whole if pairs else 0.0
    if not determination >= TURBULENT:
        share = f"{max(determination, 0.0):.0%}" if pairs else "too little"
        details = {"share": share}
        findings.append(Finding("turbulence", "warning", OUTPUT_ERROR, determination, TURBULENT, details))
    pitch = max(float(np.ptp(one.experiment.signals["theta"])) for one in flight.maneuvers)
    if pitch > LARGE_PITCH:
        findings.append(Finding("large_motion", "warning", "theta", pitch, LARGE_PITCH))
    return tuple(findings)


def vibration_findings(data: FlightData) -> tuple[Finding, ...]:
    """Vibration at the IMU during the maneuvers."""
    step = float(np.median(np.diff(data.time)))
    active = data.active > 0
    if not active.any() or 0.5 / step <= 1.2 * VIBRATION_BAND:
        return ()
    filtered = sosfiltfilt(butter(4, VIBRATION_BAND, "high", fs=1.0 / step, output="sos"), data.accel_z)
    level = float(filtered[active].std())
    if level <= VIBRATION:
        return ()
    return (Finding("vibration", "warning", "a_z", level, VIBRATION, {"band": VIBRATION_BAND}),)


def _lag(flight: FlightProblem, by_output: Fit) -> float:
    """Time constant of the tail, known or estimated."""
    if flight.aircraft.tail_time_constant is not None:
        return flight.aircraft.tail_time_constant
    return 0.0 if by_output.failure else float(by_output.values[by_output.names.index(TAIL_LAG)])


def tail_driven(flight: FlightProblem, lag: float) -> tuple[Experiment, ...]:
    """Maneuvers with the angle of a tail with this ``lag`` (s) in place of the command, every second sample."""
    experiments = []
    for one in (maneuver.experiment for maneuver in flight.maneuvers):
        tail = behind(one.signals[ELEVATOR], one.step, flight.aircraft.tail_delay, lag, zoh=False)
        signals = {name: values[::2] for name, values in {**one.signals, ELEVATOR: tail}.items()}
        experiments.append(one._replace(time=one.time[::2], signals=signals))
    return tuple(experiments)


def records_of_flight(flight: FlightProblem, lag: float) -> Records:
    """Angle of the tail, pitch rate and normal specific force, for methods without a model."""
    return records_of(tail_driven(flight, lag), ELEVATOR, ("q", "a_z"), smooth_input=True)


def results_of(
    flight: FlightProblem, fits: Fits, locked: tuple[Maneuver, ...] = ()
) -> tuple[EstimationResult, EstimationResult, EstimationResult]:
    """Estimates, covariance and fitted outputs of the methods with a physical model.

    Output error also predicts the maneuvers of the flights that are ``locked``.
    """
    ahead = predicted(fits.problem, fits.output, tuple(one.experiment for one in locked))
    every = fits.filter.every
    filtered = tuple(
        one._replace(time=one.time[::every], measured=one.measured[::every], model=one.model[::every])
        for one in fitted_series(fits.filter.problem, fits.filter.fit)
    )
    return (
        _result(OUTPUT_ERROR, fits.output, (*fitted_series(fits.problem, fits.output), *map(_steady, ahead))),
        _result(EQUATION_ERROR, fits.equation, fits.equation.series),
        _result(FILTER_ERROR, fits.filter.fit, filtered),
    )


def _steady(series: FitSeries) -> FitSeries:
    """With the mean as steady value, so that gravity does not count as predicted."""
    return series._replace(steady=float(np.nanmean(series.measured)))


def _result(method: str, fit: Fit | Regression, series: tuple[FitSeries, ...]) -> EstimationResult:
    if fit.failure:
        reason = Finding("not_converged", "withheld", method, details={"reason": fit.failure})
        why = fit.findings if isinstance(fit, Fit) else (reason,)
        return EstimationResult(method, "modes", "", EQUATIONS, "not converged", findings=why)
    estimates = derivatives_of(fit)
    kept = [fit.names.index(one.name) for one in estimates]
    return EstimationResult(
        method, "modes", "longitudinal", EQUATIONS, "converged", estimates, fit.covariance[np.ix_(kept, kept)],
        fit.degrees, series=series, findings=fit.findings if isinstance(fit, Fit) else (),
    )  # fmt: skip


def cross_validated(flight: FlightProblem) -> tuple[FitSeries, ...]:
    """Some maneuvers as predicted by output error of the others: whole flights, else every third maneuver."""
    flights = sorted({one.flight.name for one in flight.maneuvers if one.flight is not None})
    if len(flights) > 1:
        kept, locked = by_flight(flight.maneuvers, holdout_sample(flights))
    else:
        kept, locked = (
            tuple(one for i, one in enumerate(flight.maneuvers) if (i % THIRD == THIRD - 1) is side)
            for side in (False, True)
        )
    if not locked or not kept:
        return ()
    problem = first_problem(flight._replace(maneuvers=kept))[1]
    ahead = predicted(problem, output_error(problem), tuple(one.experiment for one in locked))
    return tuple(map(_steady, ahead))


def derivatives_of(fit: Fit | Regression) -> tuple[Estimate, ...]:
    """Derivatives and parameters of the tail, without the strengths of the process noise."""
    if isinstance(fit, Fit):
        return tuple(one._replace(unit=UNITS[one.name]) for one in fit.estimates if one.name in UNITS)
    return ParameterUncertainty(fit.covariance, fit.degrees).estimates(
        {name: UNITS[name] for name in fit.names}, fit.values
    )


def mode_of(method: str, flight: FlightProblem, fit: Fit | Regression) -> Mode:
    """The modes of the derivatives that a method estimated, errors by the delta method."""
    if fit.failure:
        return nothing(method, fit.failure)
    spread = ParameterUncertainty(fit.covariance, fit.degrees)
    system = flight.system
    return mode_of_system(method, lambda values: system(fit.names, values), fit.values, spread, derivatives_of(fit))
