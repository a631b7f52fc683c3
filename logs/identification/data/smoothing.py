"""Smoothing and differentiating the signals of an experiment by any of the methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from logs.identification.data.experiment import Experiment
from logs.identification.data.fourier_smoothing import fourier_smoothing
from logs.identification.data.local_quadratic import local_quadratic
from logs.identification.data.rts import rts
from logs.identification.data.smoothed import Smoothed
from logs.identification.data.spline import smoothing_spline
from logs.identification.data.stroke_average import stroke_smoothed
from logs.identification.results import Array
from wingbeat.errors import InputError

RATE_SUFFIX = "_dot"
"""the slope of signal q is called q_dot"""
STROKES = "strokes"
"""-; the signal that counts wing strokes, for the method ``stroke``"""

Method = Callable[[Experiment, Array], Smoothed]


def _stroke(experiment: Experiment, values: Array) -> Smoothed:
    if STROKES not in experiment.signals:
        raise InputError(f"no signal {STROKES} to average over")
    return stroke_smoothed(experiment.time, values, experiment.signals[STROKES])


METHODS: Mapping[str, Method] = {
    "local_quadratic": lambda experiment, values: local_quadratic(values, experiment.step),
    "fourier": lambda experiment, values: fourier_smoothing(values, experiment.step).smoothed,
    "spline": lambda experiment, values: smoothing_spline(experiment.time, values),
    "rts": lambda experiment, values: rts(values, experiment.step),
    "stroke": _stroke,
}
"""every method at its own choice of cut-off; ``spline`` and ``rts`` bridge gaps, the others refuse them"""


class SmoothedExperiment(NamedTuple):
    """An experiment with smoothed signals."""

    experiment: Experiment
    """its signals smoothed, the slopes of those beside them, named with `RATE_SUFFIX`"""
    noise: Mapping[str, float]
    """as the signal, by its name; standard deviation of what was taken off"""


def smoothed(experiment: Experiment, names: Sequence[str], method: str = "fourier") -> SmoothedExperiment:
    """The experiment with the signals ``names`` smoothed and differentiated by one of `METHODS`.

    Raises:
        InputError: no such method or signal, or a signal that the method cannot take, with its name.
    """
    if method not in METHODS:
        raise InputError(f"no method {method!r} to smooth with: it is one of {', '.join(METHODS)}")
    signals, units = dict(experiment.signals), dict(experiment.units)
    noise: dict[str, float] = {}
    for name in names:
        if name not in experiment.signals:
            raise InputError(f"{experiment.name} has no signal {name}")
        try:
            found = METHODS[method](experiment, experiment.signals[name])
        except InputError as reason:
            raise InputError(f"{experiment.name}, {name}: {reason}") from None
        signals[name], signals[name + RATE_SUFFIX] = found.values, found.rates
        units[name + RATE_SUFFIX] = f"{units[name]}/s"
        noise[name] = found.noise
    return SmoothedExperiment(experiment._replace(signals=signals, units=units), noise)
