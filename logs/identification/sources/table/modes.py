"""[modes] of a map: short period and phugoid by a fitted model, by equation error and by methods without a model."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.agreement import agreement
from logs.identification.diagnostics.estimates import (
    FASTEST_TURN,
    LEAST_RUN,
    aliased_mode,
    coarse_inputs,
    short_records,
)
from logs.identification.diagnostics.model_structure import has_lack_of_fit
from logs.identification.estimators.equivalent_system import METHOD as EQUIVALENT
from logs.identification.estimators.free_response import METHOD as FREE_RESPONSE
from logs.identification.estimators.frequency_equations import (
    METHOD,
    STATES,
    EquationSettings,
    frequency_equation_error,
)
from logs.identification.estimators.initial_values import acting_at
from logs.identification.estimators.modal import away
from logs.identification.estimators.nonparametric import modes_of_experiments
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.findings import Entry, Finding, not_estimated, register
from logs.identification.models.lateral import DUTCH_ROLL, LateralModes, lateral_modes
from logs.identification.models.modes import (
    KINDS,
    PHUGOID,
    SHORT_PERIOD,
    Mode,
    ModesResult,
    mode_of_system,
    nothing,
)
from logs.identification.models.user import is_user_model
from logs.identification.results import SURE, EstimationResult
from logs.identification.sources.table.config import DELAY, ModesSection, OutputError, Parameter
from logs.identification.sources.table.derived import band_frequencies, check_distinct
from logs.identification.sources.table.maneuvers import DataSplit
from logs.identification.sources.table.model_fit import METHODS, ModelFit, model_fit, shortened
from logs.identification.sources.table.models import DROPPED, with_trim
from logs.identification.statistics.covariance import ParameterUncertainty
from logs.pages.document import Bar, Chapter, Intervals
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

TWO_STATES, FOUR_STATES, LATERAL = "short period", "longitudinal", "lateral"
SHORT_PERIOD_OUTPUTS = {"alpha", "q", "theta", "a_z", "n_z", "q_dot"}
LONGITUDINAL_OUTPUTS = SHORT_PERIOD_OUTPUTS | {"u", "a_x"}
EFFECTS = ("input_delay", "time_skew", "sensor_position")
ANGLES = {"alpha", "beta", "gamma", "phi", "theta", "psi"}
PHUGOID_RATIO, LEAST_SPEED = 3.0, 4.0
"""-; greatest frequency of a phugoid over Lanchester's, sqrt(2) g / V; m/s; airspeed that is assumed without any"""

register({
    "model_selection": Entry(
        "{subject} replaces output error of the short period: likelihood ratio {value:.0f}",
        "Speed and pitch as states, or process noise (turbulence), explain the residuals significantly better.",
    ),
    "stability_axes": Entry(
        "pitch angle unknown: four states in stability axes, level flight",
        "The bias of a vane is not separable from the trim angle of attack; stability axes do not need it.",
        "give alpha and theta in [constants]",
    ),
    "mode_kind": Entry(
        "{kind} of {value:.3g} rad/s by {subject}; phugoids are below {limit:.2g} rad/s",
        "Lanchester's phugoid has sqrt(2) g / V rad/s; the mode contradicts the kind that it is labeled with.",
        "correct kinds in [modes], or the airspeed",
    ),
})  # fmt: skip


def modes_fit(section: ModesSection, data: DataSplit) -> tuple[list[EstimationResult], ModesResult | None]:
    """The fits of the model, and the modes by them and by all other methods that the records allow.

    A method of the registry that fits no model is alone.

    Raises:
        InputError: a signal that is not there, or no record is long enough.
    """
    _check(section, data)
    if section.method is not None and section.method not in METHODS:
        kinds = {} if section.kinds is None else {"kinds": section.kinds}
        acting = data.map(lambda one: acting_at(one, section.inputs, section.delay.fixed or 0.0))
        request = Request(
            acting.fitted, acting.held_out, section.inputs, section.outputs, constants=data.constants, options=kinds
        )
        row = ESTIMATORS[section.method]
        return [row.estimate(request)._replace(subject="modes", title=row.title)], None
    fits, rejected = _model_fits(section, data)
    results, known = [one.result for one in fits], (*(_mode(one, data) for one in fits), *rejected)
    if (not fits or fits[0].result.model == TWO_STATES or section.model is None) and _has_equations(section):
        # Parameters of a user's model are not derivatives of the two equations.
        equations = section._replace(parameters={}) if is_user_model(section.model or "") else section
        known = (*known, _by_equations(equations, data, results))
    delay = section.delay.fixed
    if delay is None:
        found = (fit.estimate(DELAY) for fit in results)
        delay = next((one.value for one in found if one is not None), 0.0)
    for place, mode in enumerate(known[: len(results)]):
        derived = () if mode.short_period is None else mode.short_period.estimates
        short = short_records(Context(data.fitted, result=results[place]._replace(derived=derived)))
        results[place] = results[place]._replace(findings=(*results[place].findings, *short))
    compared = _compared(section, data.fitted, known, delay)
    return results, compared._replace(findings=(*compared.findings, *_contradicted_kinds(compared, data)))


def fastest_phugoid(data: DataSplit) -> float:
    """Frequency (rad/s) above which a mode is no phugoid, from Lanchester's sqrt(2) g / V."""
    speed = with_trim(data.constants, data.fitted).get("V", 0.0)
    if not speed > 0.0:
        return math.sqrt(2.0) * STANDARD_GRAVITY / LEAST_SPEED
    return PHUGOID_RATIO * math.sqrt(2.0) * STANDARD_GRAVITY / speed


def _contradicted_kinds(result: ModesResult, data: DataSplit) -> tuple[Finding, ...]:
    """Phugoids that are too fast to be one, and short periods slower than Lanchester's phugoid."""
    limit = fastest_phugoid(data)
    slowest = limit / PHUGOID_RATIO if with_trim(data.constants, data.fitted).get("V", 0.0) > 0.0 else 0.0
    found = []
    for mode in result.modes:
        for kind, low, high in ((SHORT_PERIOD, slowest, math.inf), (PHUGOID, 0.0, limit)):
            pair = mode.of_kind(kind)
            if pair is not None and not low <= pair.frequency.value <= high:
                details = {"kind": kind.replace("_", " ")}
                found.append(Finding("mode_kind", "warning", mode.method, pair.frequency.value, limit, details))
    return tuple(found)


def _model_fits(section: ModesSection, data: DataSplit) -> tuple[list[ModelFit], tuple[Mode, ...]]:
    """The fit of the requested model and method, and withheld modes of the method that the selection rejected.

    If the map leaves them open, four states are tried beside two, and process noise (filter error) if output error
    has a lack of fit; the likelihood-ratio test selects (Ljung, System Identification, 1999, ch. 16).

    Raises:
        InputError: a method without a model.
    """
    model = section.model or _by_outputs(section)
    if model == "none":
        if section.method is not None:
            raise InputError(f'modes: method = "{section.method}" needs a model: set model to one')
        return [], ()
    request = OutputError(
        model, section.outputs, section.inputs, section.parameters, section.delay, section.zoh_inputs,
        section.biases, method=section.method or "output_error",
    )  # fmt: skip
    first = model_fit("modes", request, data)
    inputs = ", ".join(section.inputs)
    if any(one.code in EFFECTS and one.subject == inputs for one in first.result.findings):
        return [first], ()  # more states would hide a delay of the inputs
    requests, fits = [(request, data)], [first]
    known = with_trim(data.constants, data.fitted)
    automatic = section.model is None and section.states is None and not section.parameters and "V" in known
    if automatic and model == TWO_STATES and "theta" not in section.outputs:
        requests.append((_four_states(request, first, known["V"]), _in_stability_axes(data)))
        fits.append(model_fit("modes", *requests[-1]))
    best = min(fits, key=lambda one: _criterion(one, first))
    skewed = any(one.code in EFFECTS for one in best.result.findings)  # process noise would hide it
    lacking = best.fit.failure or (has_lack_of_fit(best.result.series) and not data.averaged)
    if section.method is None and model in (TWO_STATES, FOUR_STATES) and lacking and not skewed:
        for other, of in requests:
            with contextlib.suppress(InputError):
                fits.append(model_fit("modes", other._replace(method="filter_error"), of))
        best = min(fits, key=lambda one: _criterion(one, first))
    if best is first or best.fit.failure:
        return [first], ()
    findings = [Finding("model_selection", "info", best.result.title, 2.0 * (first.fit.cost - best.fit.cost))]
    if best.result.model != model and requests[-1][1] is not data:
        findings.append(Finding("stability_axes", "info"))
    best = best._replace(result=best.result._replace(findings=(*findings, *best.result.findings)))
    if best.result.method == request.method:
        return [best], ()
    return [best], (nothing(METHODS[request.method][0], "process noise is significant: see filter error"),)


def _in_stability_axes(data: DataSplit) -> DataSplit:
    """The data with the trim angles of stability axes in level flight if the pitch angle is not known.

    The mean of a vane has its bias, by which body axes would be turned.
    """
    if {"alpha", "theta"} & data.constants.keys() or any("theta" in one.signals for one in data.fitted):
        return data
    return data._replace(constants={**data.constants, "alpha": 0.0, "theta": 0.0})


def _criterion(one: ModelFit, simplest: ModelFit) -> float:
    """Twice the negative log-likelihood and the 99 % point of what more parameters gain by chance (chi-squared)."""
    from scipy.special import chdtri

    if one.fit.failure:
        return np.inf
    more = len(one.fit.names) - len(simplest.fit.names)
    return float(2.0 * one.fit.cost + (chdtri(more, 1.0 - SURE) if more > 0 else 0.0))


def _by_outputs(section: ModesSection) -> str:
    """The model by the key ``states``, else by the outputs."""
    outputs = set(section.outputs)
    if section.states == 2 or (section.states is None and outputs <= SHORT_PERIOD_OUTPUTS):
        return TWO_STATES if outputs <= SHORT_PERIOD_OUTPUTS else "none"
    if section.states == 4 or outputs & {"u", "a_x"}:
        return FOUR_STATES if outputs <= LONGITUDINAL_OUTPUTS else "none"
    return "none"


def _four_states(request: OutputError, first: ModelFit, speed: float) -> OutputError:
    """The four-state model, started from the two-state one and the phugoid of Lanchester."""
    two = dict(zip(first.fit.names, first.fit.values.tolist(), strict=True)) if not first.fit.failure else {}
    starts = {
        "X_u": -0.02 * STANDARD_GRAVITY / speed, "X_alpha": 0.5 * STANDARD_GRAVITY,
        "Z_u": -2.0 * STANDARD_GRAVITY / speed, "Z_alpha": speed * two.get("Z_alpha", -1.0),
        "Z_delta": speed * two.get("Z_delta", 0.0),
    } | {name: value for name, value in two.items() if name.startswith("M_")}  # fmt: skip
    controls = ("delta",) if len(request.inputs) == 1 else request.inputs
    names = [f"{axis}_{of}" for axis in "ZM" for of in ("alpha", *controls)]
    names += ["X_u", "X_alpha", "Z_u", "M_q"]
    parameters = {name: Parameter(start=starts[name]) if name in starts else Parameter() for name in names}
    return request._replace(model=FOUR_STATES, parameters=parameters)


def _check(section: ModesSection, data: DataSplit) -> None:
    """Check the signals of the section.

    Raises:
        InputError: a signal that is missing or is input and output, no output, no kind, or constant inputs.
    """
    for name in (*section.inputs, *section.outputs):
        if name not in data.fitted[0].signals:
            raise InputError(f"modes: {name!r} is not in [signals]; there are: {', '.join(data.fitted[0].signals)}")
    if not section.outputs:
        raise InputError("modes.outputs names no signal")
    if section.kinds is not None and not section.kinds:
        raise InputError("modes.kinds names no mode: leave it out to have those that the outputs show")
    check_distinct(data.fitted, section.inputs, section.outputs, "modes")
    if not section.inputs:
        _check_free(data.fitted, section.outputs)
        return
    names = ", ".join(section.inputs)
    known = [one.signals[name] for one in data.fitted for name in section.inputs]
    known = [one[np.isfinite(one)] for one in known]
    if not any(map(len, known)):
        raise InputError(f"modes: {names}: nothing was measured; a free motion has inputs = []")
    if not any(len(one) and np.ptp(one) > 0.0 for one in known):
        verb = "do" if len(section.inputs) > 1 else "does"
        raise InputError(f"modes: {names} {verb} not move; a free motion has inputs = []")


def _check_free(experiments: tuple[Experiment, ...], outputs: tuple[str, ...]) -> None:
    """Reject a free response during which a control moves.

    Raises:
        InputError: one does, with the time at which it comes to rest.
    """
    for one in experiments:
        for name in one.signals.keys() - ANGLES - set(outputs):
            values = one.signals[name]
            if one.units.get(name) != "rad" or not np.any(np.isfinite(values)):
                continue
            rest = float(values[np.isfinite(values)][-LEAST_RUN:].mean())
            moved = np.flatnonzero(away(values, rest))
            if len(moved):
                raise InputError(
                    f"modes: inputs = [] but {name} moves until {one.time[moved[-1]]:.6g} s in {one.name}: begin the "
                    "maneuver after that, name it in inputs, or leave it out of [signals] if it is no control"
                )


def _compared(
    section: ModesSection, experiments: tuple[Experiment, ...], known: tuple[Mode, ...], delay: float
) -> ModesResult:
    """The ``known`` modes and those of every method without a model, inputs ``delay`` s late.

    Raises:
        InputError: no method applies, and no mode is known.
    """
    first = section.inputs[0] if section.inputs else None
    acting = tuple(acting_at(one, section.inputs, delay) for one in experiments)
    try:
        result = modes_of_experiments(acting, first, section.outputs, section.kinds, known, section.inputs[1:])
    except InputError as error:
        if not known:
            raise
        return ModesResult(known, None, f"no comparison: {error}", None, len(experiments), None)
    result = result._replace(modes=tuple(_from_record(mode, delay) for mode in result.modes))
    return _without_aliased(result, experiments, [name for name in section.inputs if name not in section.zoh_inputs])


def _from_record(mode: Mode, delay: float) -> Mode:
    """The mode with the equivalent system's delay from the time of the record."""
    if mode.method != EQUIVALENT or not delay:
        return mode
    moved = tuple(
        one._replace(value=one.value + delay, low=one.low + delay, high=one.high + delay)
        if one.name == DELAY
        else one
        for one in mode.derivatives
    )
    return mode._replace(derivatives=moved)


def _without_aliased(result: ModesResult, experiments: tuple[Experiment, ...], lines: list[str]) -> ModesResult:
    """The modes without those of a response to inputs that are unknown between samples, if they are too fast."""
    driven = [mode for mode in result.modes if mode.method != FREE_RESPONSE]
    pairs = [pair for mode in driven for kind in KINDS if (pair := mode.of_kind(kind)) is not None]
    fastest, step = max((one.frequency.value for one in pairs), default=0.0), min(one.step for one in experiments)
    if fastest * step <= FASTEST_TURN or not coarse_inputs(lines, experiments):
        return result
    why = f"{aliased_mode(fastest, step).text}: record at a higher rate"
    modes = tuple(
        nothing(mode.method, why) if mode in driven and any(mode.of_kind(k) for k in KINDS) else mode
        for mode in result.modes
    )
    agree, statement = agreement(modes)
    return result._replace(modes=modes, agree=agree, statement=statement)


def _withheld_mode(one: ModelFit) -> str:
    """Why the modes of a linear model's fit have no number; empty if they have."""
    if one.result.failure is not None:
        return one.result.failure.text
    system = one.chosen.system_of(one.fit)
    for lost in one.result.withheld:
        if lost.subject not in one.fit.names:
            continue
        moved, place = one.fit.values.copy(), one.fit.names.index(lost.subject)
        moved[place] += max(abs(float(moved[place])), 1.0)
        if np.any(system(moved) != system(one.fit.values)):
            return f"{lost.subject} is not identified: {lost.text}"
    return ""


def _mode(one: ModelFit, data: DataSplit) -> Mode:
    """The modes of the fitted matrices, errors by the delta method."""
    title = METHODS[one.result.method][0]
    why = _withheld_mode(one)
    if why:
        return nothing(title, why)
    spread = ParameterUncertainty(one.fit.covariance, one.fit.degrees)
    estimates = tuple(map(shortened, one.fit.estimates))
    system = one.chosen.system_of(one.fit)
    return mode_of_system(title, system, one.fit.values, spread, estimates, fastest_phugoid(data))


def with_lateral_modes(one: ModelFit) -> EstimationResult:
    """A lateral model's result with its modes as derived numbers; any other's as it is."""
    result = one.result
    if result.model != LATERAL or result.failure is not None:
        return result
    why = _withheld_mode(one)
    if why:
        found: LateralModes = ((), (not_estimated(DUTCH_ROLL, why),))
    else:
        spread = ParameterUncertainty(np.asarray(one.fit.covariance), one.fit.degrees)
        found = lateral_modes(one.chosen.system_of(one.fit), one.fit.values, spread)
    derived, lost = found
    notes = tuple(f"{lost.subject} not identified: {lost.text}" for lost in lost)
    bars = tuple(Bar(one.name, one) for one in derived)
    chapter = Chapter("Lateral modes", notes, plots=(Intervals("", bars),) if bars else ())
    return result._replace(derived=derived, findings=(*result.findings, *lost), chapters=(*result.chapters, chapter))


# --- equation error in the frequency domain --------------------------------------------------------------------

SINGLE = "delta"
"""name of a single input in the derivatives"""


def _has_equations(section: ModesSection) -> bool:
    """Whether the short period is requested, and alpha or q is among the outputs."""
    return (not section.kinds or SHORT_PERIOD in section.kinds) and bool(set(STATES) & set(section.outputs))


def _by_equations(section: ModesSection, data: DataSplit, fits: Sequence[EstimationResult]) -> Mode:
    """The short period by its two equations; with output error's delay, and its error, if that is free.

    Raises:
        InputError: a band without a frequency.
    """
    delay, error = section.delay.fixed, 0.0
    if delay is None:
        found = next((one for fit in fits if (one := fit.estimate(DELAY)) is not None), None)
        if found is None:
            return nothing(METHOD, "the delay is free, and output error does not give it: fix it")
        delay, error = found.value, found.standard_error
    band = section.frequency_band
    frequencies = None if band is None else band_frequencies(band, data.fitted, "modes")
    inputs = (SINGLE,) if len(section.inputs) == 1 else section.inputs
    pairs = list(zip(inputs, section.inputs, strict=True))

    def renamed(one: Experiment) -> Experiment:
        return one._replace(signals={**one.signals, **{new: np.asarray(one.signals[name]) for new, name in pairs}})

    speed = with_trim(data.constants, data.fitted).get("V")
    zoh = tuple(new for new, name in pairs if name in section.zoh_inputs)
    arm = float(data.constants.get("imu_x", 0.0))
    settings = EquationSettings(inputs, _fixed(section, inputs), speed, arm, delay, error, frequencies, zoh)
    return frequency_equation_error(tuple(map(renamed, data.fitted)), settings)


def _fixed(section: ModesSection, inputs: tuple[str, ...]) -> dict[str, float]:
    """Derivatives that are not free: those that the map does not name are zero, as in output error."""
    names = [f"{axis}_{name}" for axis in "ZM" for name in (*STATES, *inputs)]
    if not section.parameters:
        return {name: 0.0 for name in names if name in DROPPED}
    fixed = dict.fromkeys(names, 0.0)
    for name, one in section.parameters.items():
        key = name
        if len(section.inputs) == 1 and name.endswith(f"_{section.inputs[0]}"):
            key = f"{name.removesuffix(section.inputs[0])}{SINGLE}"
        if one.fixed is None:
            fixed.pop(key, None)
        else:
            fixed[key] = one.fixed
    return fixed
