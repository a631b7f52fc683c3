"""Input design: amplitude within limits, time unit or duration, and number of repeats.

Without required errors the time unit is that of the smallest errors of the mode for one maneuver; with them, that of
the shortest flight that reaches them. Multisteps are tried about the unit that puts their spectrum on the mode (1.6
over the natural frequency: Jategaonkar, Flight Vehicle System Identification, 2006, ch. 2), sweeps and multisines
over durations, from a quarter of the mode's frequency to three times it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from avionics.guidance import excitation as shapes
from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.missions.excitations import check_excitation
from logs.identification.input_design.prediction import (
    Gust,
    Predicted,
    Prior,
    Response,
    Waveform,
    predict,
    predicted_covariance,
    respond,
    waveform,
)
from logs.identification.models.modes import short_period_of
from logs.identification.results import Array
from wingbeat.errors import InputError

UNIT = 1.6
"""rad; time unit of a multistep times the natural frequency, about which units are tried"""
UNITS_TRIED = np.geomspace(0.4, 3.0, 12)
"""-; of that unit"""
DURATIONS = (6.0, 10.0, 15.0, 25.0, 40.0)
"""s; tried for sweeps and multisines"""
DURATION = 15.0
"""s; of one without required errors"""
BELOW, ABOVE = 0.25, 3.0
"""-; of the mode's frequency: band of a sweep or multisine"""
FLAPPING = 0.45
"""-; of the flapping frequency, above which stroke averages attenuate the response"""
MIN_SETTLE = 1.0
"""s; shortest default pause. In shorter records the slowly changing airspeed cannot be separated from biases, and an
estimate from the flight may not converge."""
UNIT_AMPLITUDE = 0.1
"""rad; of the input whose response is scaled"""
MAX_REPEATS = 100
NAMES = {
    "elevator": ("elevator", "rad"),
    "pitch": ("pitch", "rad"),
    "load": ("a_z", "m/s^2"),
    "alpha": ("angle of attack", "rad"),
    "airspeed": ("airspeed", "m/s"),
}
"""name and unit by limit"""
SHAPE_NAMES = {
    Shape.DOUBLET: "doublet",
    Shape.MULTISTEP_3211: "3211",
    Shape.LINEAR_SWEEP: "sweep",
    Shape.LOGARITHMIC_SWEEP: "log_sweep",
    Shape.MULTISINE: "multisine",
}


class Limits(NamedTuple):
    """Greatest changes from the trim; infinite if not limited."""

    elevator: float = math.inf
    """rad; of the command"""
    pitch: float = math.inf
    """rad"""
    load: float = math.inf
    """m/s^2; of the specific force along z at the IMU"""
    alpha: float = math.inf
    """rad; angle of attack"""
    airspeed: float = math.inf
    """m/s"""


class DesignSpec(NamedTuple):
    """Requirements of the maneuver."""

    shape: Shape
    limits: Limits
    amplitude: float | None = None
    """rad; None for the greatest within the limits"""
    width: float | None = None
    """s; of one step, of a sweep, or the period of a multisine; None to choose"""
    repeats: int | None = None
    """-; None for what the required errors need, or 1"""
    frequency_error: float | None = None
    """-; required relative standard error of the mode's frequency"""
    damping_error: float | None = None
    """-; required standard error of the mode's damping ratio"""
    settle: float | None = None
    """s; before and after the input, None for three of the mode's decay times"""
    fade: float = 1.0
    """s; of the ends of a sweep, by the vehicle"""
    pause: float = 2.0
    """s; between repeats, by the vehicle"""
    gust: Gust | None = None
    required: Mapping[str, float] = {}
    """-; required relative standard errors by name of a prediction, together with what is `known`"""
    known: Mapping[str, float] = {}
    """standard errors that an earlier flight left, by name of a prediction; empty without one"""


class InputDesign(NamedTuple):
    """An input and its predicted accuracy."""

    excitation: Excitation
    """with all repeats"""
    predicted: tuple[Predicted, ...]
    """after all repeats, with white sensor noise and gusts; the mode first"""
    gust_factor: float
    """-; the frequency's predicted error over that without gusts"""
    reached: Limits
    """greatest changes from the trim"""
    bound_by: str
    """-; the limit that set the amplitude; empty if it was given"""
    flight_time: float
    """s; of all repeats, with settling and recovery"""


class _Trial(NamedTuple):
    excitation: Excitation
    planned: Waveform
    covariance: Array
    """(12, 12); after one repeat"""
    reached: Limits
    bound_by: str


def design_input(
    prior: Prior, spec: DesignSpec, show: Callable[[float, float], None] = lambda done, of: None
) -> InputDesign:
    """The best input of the required shape; ``show`` gets the numbers of inputs that were tried, and of all.

    Raises:
        InputError: none is feasible, none identifies all derivatives, or the required errors need too many repeats.
    """
    trials, refusal = [], ""
    widths = _widths(prior, spec)
    for done, width in enumerate(widths):
        show(done, len(widths))
        try:
            trials.append(_trial(prior, spec, width))
        except InputError as error:
            refusal = str(error)
    if not trials:
        raise InputError(refusal)
    best = min(trials, key=lambda trial: _cost(prior, spec, trial))
    repeats = spec.repeats or _repeats(prior, spec, best)
    if repeats > MAX_REPEATS:
        raise InputError(
            f"the asked errors need {repeats} repeats, more than the {MAX_REPEATS} that one item flies:"
            " widen the limits, or ask for less"
        )
    return _design(prior, spec, best, repeats)


def _design(prior: Prior, spec: DesignSpec, best: _Trial, repeats: int) -> InputDesign:
    excitation = best.excitation._replace(repeats=repeats)
    predicted = predict(prior, best.covariance, repeats)
    factor = 1.0
    if spec.gust is not None:
        calm = predicted_covariance(prior, best.planned, respond(prior, best.planned))
        factor = predicted[0].standard_error / predict(prior, calm, repeats)[0].standard_error
    return InputDesign(
        excitation, predicted, factor, best.reached, best.bound_by, repeats * _repeat_time(spec, best.excitation)
    )


def _widths(prior: Prior, spec: DesignSpec) -> list[float]:
    """Steps, durations or periods (s) to try."""
    if spec.width is not None:
        return [spec.width]
    if spec.shape in shapes.SEGMENTS:
        unit = UNIT / _mode(prior)[0]
        return sorted({round(float(factor * unit), 2) for factor in UNITS_TRIED if factor * unit >= 0.02})
    return list(DURATIONS) if _errors_required(spec) else [DURATION]


def _mode(prior: Prior) -> tuple[float, float]:
    try:
        return short_period_of(prior.model().a)
    except ValueError as error:
        raise InputError(f"the prior model has no short period: {error}") from None


def _trial(prior: Prior, spec: DesignSpec, width: float) -> _Trial:
    """One input at its amplitude, and its predicted covariance."""
    unit = _excitation(prior, spec, width, UNIT_AMPLITUDE)
    planned = waveform(unit, prior.step, spec.fade, prior.wing_period)
    response = respond(prior, planned)
    amplitude, bound_by = spec.amplitude, ""
    if amplitude is None:
        factor, bound_by = amplitude_factor(spec.limits, peaks(prior, response, UNIT_AMPLITUDE))
        amplitude = _rounded_down(factor * UNIT_AMPLITUDE)
    excitation = _excitation(prior, spec, width, amplitude)
    refusal = check_excitation(excitation)
    if refusal:
        raise InputError(refusal)
    times = amplitude / UNIT_AMPLITUDE
    planned = planned._replace(command=times * planned.command)
    response = response.times(times)
    covariance = predicted_covariance(prior, planned, response, spec.gust)
    return _Trial(excitation, planned, covariance, peaks(prior, response, amplitude), bound_by)


def _rounded_down(amplitude: float) -> float:
    """The amplitude in tenths of a degree, rounded down."""
    return math.radians(math.floor(math.degrees(amplitude) * 10.0 + 1e-6) / 10.0)


def _excitation(prior: Prior, spec: DesignSpec, width: float, amplitude: float) -> Excitation:
    frequency, damping = _mode(prior)
    settle = spec.settle
    if settle is None:
        settle = round(min(max(3.0 / (max(damping, 0.05) * frequency), MIN_SETTLE), 5.0), 1)
    low = high = 0.0
    if spec.shape not in shapes.SEGMENTS:
        low, high = _band(prior, frequency, width)
    return Excitation(Channel.ELEVATOR, spec.shape, amplitude, width, settle, 1, low, high)


def _band(prior: Prior, frequency: float, width: float) -> tuple[float, float]:
    """Hz; band of a sweep or multisine of ``width`` s."""
    natural = frequency / math.tau
    low = max(round(BELOW * natural, 2), math.ceil(100.0 / width) / 100.0)
    high = ABOVE * natural
    if prior.wing_period:
        high = min(high, FLAPPING / prior.wing_period)
    return low, max(round(high, 2), low)


def _errors_required(spec: DesignSpec) -> bool:
    return spec.frequency_error is not None or spec.damping_error is not None or bool(spec.required)


def _errors(prior: Prior, trial: _Trial) -> tuple[float, float]:
    """Relative error of the frequency and error of the damping after one repeat."""
    frequency, damping = predict(prior, trial.covariance)[:2]
    return frequency.standard_error / frequency.value, damping.standard_error


def _repeats(prior: Prior, spec: DesignSpec, trial: _Trial) -> int:
    required = (spec.frequency_error, spec.damping_error)
    pairs = [(error, limit) for error, limit in zip(_errors(prior, trial), required, strict=True) if limit]
    counts = [math.ceil((error / limit) ** 2 - 1e-9) for error, limit in pairs]
    if spec.required:
        counts += [_missing(spec, one) for one in predict(prior, trial.covariance) if one.name in spec.required]
    return max(counts, default=1) or 1


def _missing(spec: DesignSpec, one: Predicted) -> int:
    """Return the repeats whose information, added to what is known, meets the required error of a parameter.

    Information, 1 over the squared standard error, adds over independent maneuvers; correlation between parameters
    is neglected.
    """
    known = spec.known.get(one.name, math.inf)
    missing = (spec.required[one.name] * one.value) ** -2 - known**-2
    return max(math.ceil(missing * one.standard_error**2 - 1e-9), 0)


def combined_error(predicted: float, known: float | None) -> float:
    """Return the standard error of an earlier and the planned flight together."""
    return predicted if known is None else (predicted**-2 + known**-2) ** -0.5


def _repeat_time(spec: DesignSpec, excitation: Excitation) -> float:
    return spec.pause + 2.0 * excitation.settle + shapes.duration(excitation)


def _cost(prior: Prior, spec: DesignSpec, trial: _Trial) -> float:
    """What is minimized: the flight time if errors are required, else the mode's errors."""
    if _errors_required(spec) and spec.repeats is None:
        return _repeats(prior, spec, trial) * _repeat_time(spec, trial.excitation)
    return math.hypot(*_errors(prior, trial))


# --- limits -------------------------------------------------------------------------------------------------


def peaks(prior: Prior, response: Response, amplitude: float) -> Limits:
    """Greatest changes in a maneuver of ``amplitude`` (rad), stroke-averaged, by the prior."""
    u, w, _, theta = response.states.T
    reference = prior.reference
    airspeed = (u * reference.u + w * reference.w) / reference.airspeed
    alpha = (w * reference.u - u * reference.w) / reference.airspeed**2
    signals = (theta, response.outputs[:, 2], alpha, airspeed)
    return Limits(abs(amplitude), *(float(np.max(np.abs(signal))) for signal in signals))


def amplitude_factor(limits: Limits, reached: Limits) -> tuple[float, str]:
    """Factor of the amplitude that ``reached``, and the limit that sets it."""
    factors = {
        name: limit / peak if peak > 0.0 else math.inf
        for name, limit, peak in zip(Limits._fields, limits, reached, strict=True)
    }
    name = min(factors, key=lambda one: factors[one])
    return factors[name], name


# --- as a mission item and as a command ---------------------------------------------------------------------


def mission_item(excitation: Excitation) -> str:
    """The ``[[item]]`` of a mission file, on the elevator."""
    amplitude = f"{math.degrees(excitation.amplitude):.4g}"
    channel = [] if excitation.shape == Shape.MULTISINE else ['channel = "elevator"']
    lines = ["[[item]]", 'kind = "excite"', f'shape = "{SHAPE_NAMES[excitation.shape]}"', *channel]
    lines += [f"{key} = {value}" for key, value in _numbers(excitation, amplitude).items()]
    lines += [f"settle = {excitation.settle:g}", f"repeats = {excitation.repeats}"]
    return "\n".join(lines) + "\n"


def _numbers(excitation: Excitation, amplitude: str) -> dict[str, str]:
    width, low, high = (f"{value:g}" for value in (excitation.width, excitation.low, excitation.high))
    if excitation.shape == Shape.MULTISINE:
        return {"elevator_deg": amplitude, "period": width, "low": low, "high": high}
    if excitation.shape in (Shape.LINEAR_SWEEP, Shape.LOGARITHMIC_SWEEP):
        return {"amplitude_deg": amplitude, "start": low, "end": high, "duration": width}
    return {"amplitude_deg": amplitude, "width": width}


def command_line(excitation: Excitation, url: str = "URL") -> str:
    """The ``wingbeat gcs`` command."""
    numbers = _numbers(excitation, f"{math.degrees(excitation.amplitude):.4g}")
    options = {key.removesuffix("_deg"): value for key, value in numbers.items()}
    options |= {"settle": f"{excitation.settle:g}", "repeats": str(excitation.repeats)}
    channel = [] if excitation.shape == Shape.MULTISINE else ["elevator"]
    flags = [f"--{key} {value}" for key, value in options.items()]
    return " ".join(["wingbeat gcs", url, "excite", SHAPE_NAMES[excitation.shape], *channel, *flags])
