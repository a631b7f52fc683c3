"""Chooses the input: its amplitude within the limits, its time unit or duration, and how often it is flown.

Without asked errors the time unit is the one that makes the mode's errors smallest for one manoeuvre; with them, the
one that reaches them in the shortest flight. Multisteps are tried about the unit that puts their spectrum on the mode
(1.6 over the natural frequency: Jategaonkar, Flight Vehicle System Identification, 2006, ch. 2), sweeps and
multisines over durations, from a quarter of the mode's frequency to three times it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from avionics.guidance import excitation as flown
from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.missions.excitations import check_excitation
from logs.identification.input_design.limits import Limits, allowed, peaks
from logs.identification.input_design.prediction import Gust, Predicted, predict, predicted_covariance
from logs.identification.input_design.prior import Prior
from logs.identification.input_design.response import respond
from logs.identification.input_design.waveform import Waveform, waveform
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
"""s; of one where no error is asked for: the longer the better, and nobody said how long"""
BELOW, ABOVE = 0.25, 3.0
"""-; of the mode's frequency, where the band of a sweep or multisine begins and ends"""
FLAPPING = 0.45
"""-; of the flapping frequency, above which stroke averages leave little of the response"""
UNIT_AMPLITUDE = 0.1
"""rad; of the input whose response is scaled"""
MOST_REPEATS = 100


class Asked(NamedTuple):
    """What is wanted of the manoeuvre."""

    shape: Shape
    limits: Limits
    amplitude: float | None = None
    """rad; None for the greatest within the limits"""
    width: float | None = None
    """s; of one step, of a sweep, or the period of a multisine; None to choose"""
    repeats: int | None = None
    """-; None for what the asked errors need, or 1"""
    frequency_error: float | None = None
    """-; asked standard error of the mode's frequency, relative"""
    damping_error: float | None = None
    """-; asked standard error of the mode's damping ratio"""
    settle: float | None = None
    """s; before and after the input, None for three of the mode's decay times"""
    fade: float = 1.0
    """s; of the ends of a sweep, by the vehicle"""
    pause: float = 2.0
    """s; between repeats, by the vehicle"""
    gust: Gust | None = None


class Plan(NamedTuple):
    """An input, and what it will tell."""

    excitation: Excitation
    """as it is flown"""
    predicted: tuple[Predicted, ...]
    """after all repeats, white sensor noise and the gusts asked for; the mode first"""
    gust_factor: float
    """-; the frequency's predicted error over that without gusts"""
    reached: Limits
    """how far the aircraft goes from its trim"""
    bound_by: str
    """-; the limit that set the amplitude, empty where it was given"""
    flight_time: float
    """s; of all repeats, with settling and recovery"""


class _Trial(NamedTuple):
    excitation: Excitation
    planned: Waveform
    covariance: Array
    """(12, 12); after one repeat"""
    reached: Limits
    bound_by: str


def plan(prior: Prior, asked: Asked, show: Callable[[float, float], None] = lambda done, of: None) -> Plan:
    """The best input of the asked shape; ``show`` is told how many of how many were tried.

    Raises:
        InputError: none can be flown, none tells the derivatives apart, or the asked errors need too many repeats.
    """
    trials, refusal = [], ""
    widths = _widths(prior, asked)
    for done, width in enumerate(widths):
        show(done, len(widths))
        try:
            trials.append(_trial(prior, asked, width))
        except InputError as error:
            refusal = str(error)
    if not trials:
        raise InputError(refusal)
    best = min(trials, key=lambda trial: _cost(prior, asked, trial))
    repeats = asked.repeats or _repeats(prior, asked, best)
    if repeats > MOST_REPEATS:
        raise InputError(
            f"the asked errors need {repeats} repeats, more than the {MOST_REPEATS} that one item flies:"
            " widen the limits, or ask for less"
        )
    return _planned(prior, asked, best, repeats)


def _planned(prior: Prior, asked: Asked, best: _Trial, repeats: int) -> Plan:
    excitation = best.excitation._replace(repeats=repeats)
    predicted = predict(prior, best.covariance, repeats)
    factor = 1.0
    if asked.gust is not None:
        calm = predicted_covariance(prior, best.planned, respond(prior, best.planned))
        factor = predicted[0].standard_error / predict(prior, calm, repeats)[0].standard_error
    return Plan(
        excitation, predicted, factor, best.reached, best.bound_by, repeats * _one_time(asked, best.excitation)
    )


def _widths(prior: Prior, asked: Asked) -> list[float]:
    """Steps, durations or periods (s) to try."""
    if asked.width is not None:
        return [asked.width]
    if asked.shape in flown.SEGMENTS:
        unit = UNIT / _mode(prior)[0]
        return sorted({round(float(share * unit), 2) for share in UNITS_TRIED if share * unit >= 0.02})
    return list(DURATIONS) if _errors_asked(asked) else [DURATION]


def _mode(prior: Prior) -> tuple[float, float]:
    try:
        return short_period_of(prior.model().a)
    except ValueError as error:
        raise InputError(f"the prior model has no short period: {error}") from None


def _trial(prior: Prior, asked: Asked, width: float) -> _Trial:
    """One input, as large as asked or as the limits allow, and what it tells."""
    unit = _excitation(prior, asked, width, UNIT_AMPLITUDE)
    planned = waveform(unit, prior.step, asked.fade, prior.wing_period)
    response = respond(prior, planned)
    amplitude, bound_by = asked.amplitude, ""
    if amplitude is None:
        share, bound_by = allowed(asked.limits, peaks(prior, response, UNIT_AMPLITUDE))
        amplitude = _rounded_down(share * UNIT_AMPLITUDE)
    excitation = _excitation(prior, asked, width, amplitude)
    refusal = check_excitation(excitation)
    if refusal:
        raise InputError(refusal)
    times = amplitude / UNIT_AMPLITUDE
    planned = planned._replace(command=times * planned.command)
    response = response.times(times)
    covariance = predicted_covariance(prior, planned, response, asked.gust)
    return _Trial(excitation, planned, covariance, peaks(prior, response, amplitude), bound_by)


def _rounded_down(amplitude: float) -> float:
    """A tenth of a degree is what is typed; never more than allowed."""
    return math.radians(math.floor(math.degrees(amplitude) * 10.0 + 1e-6) / 10.0)


def _excitation(prior: Prior, asked: Asked, width: float, amplitude: float) -> Excitation:
    frequency, damping = _mode(prior)
    settle = asked.settle
    if settle is None:
        settle = round(min(max(3.0 / (max(damping, 0.05) * frequency), 0.5), 5.0), 1)
    low = high = 0.0
    if asked.shape not in flown.SEGMENTS:
        low, high = _band(prior, frequency, width)
    return Excitation(Channel.ELEVATOR, asked.shape, amplitude, width, settle, 1, low, high)


def _band(prior: Prior, frequency: float, width: float) -> tuple[float, float]:
    """Hz; where a sweep or multisine of ``width`` s begins and ends."""
    own = frequency / math.tau
    low = max(round(BELOW * own, 2), math.ceil(100.0 / width) / 100.0)
    high = ABOVE * own
    if prior.wing_period:
        high = min(high, FLAPPING / prior.wing_period)
    return low, max(round(high, 2), low)


def _errors_asked(asked: Asked) -> bool:
    return asked.frequency_error is not None or asked.damping_error is not None


def _ratios(prior: Prior, asked: Asked, trial: _Trial) -> tuple[float, float]:
    """Relative error of the frequency and error of the damping after one repeat."""
    frequency, damping = predict(prior, trial.covariance)[:2]
    return frequency.standard_error / frequency.value, damping.standard_error


def _repeats(prior: Prior, asked: Asked, trial: _Trial) -> int:
    wanted = (asked.frequency_error, asked.damping_error)
    pairs = [(error, want) for error, want in zip(_ratios(prior, asked, trial), wanted, strict=True) if want]
    return max((math.ceil((error / want) ** 2 - 1e-9) for error, want in pairs), default=1) or 1


def _one_time(asked: Asked, excitation: Excitation) -> float:
    return asked.pause + 2.0 * excitation.settle + flown.duration(excitation)


def _cost(prior: Prior, asked: Asked, trial: _Trial) -> float:
    """What is made small: the flight's length where errors are asked for, else the mode's errors."""
    if _errors_asked(asked) and asked.repeats is None:
        return _repeats(prior, asked, trial) * _one_time(asked, trial.excitation)
    return math.hypot(*_ratios(prior, asked, trial))
