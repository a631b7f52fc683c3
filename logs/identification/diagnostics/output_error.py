"""What an engineer is told to doubt of an output-error fit: inputs, residuals and numbers that cannot be as told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.noise_level import noise_beside_steps
from logs.identification.diagnostics.derivative_signs import turned
from logs.identification.diagnostics.intersample_behavior import jumping
from logs.identification.diagnostics.intersample_sensitivity import unseen
from logs.identification.diagnostics.lack_of_fit import lacking
from logs.identification.diagnostics.omitted_variables import speeds_of, suspicion
from logs.identification.estimators.engine.problem import Fit, Problem
from logs.identification.results import Array, FitSeries, Information
from logs.identification.sources.table.config import OutputError
from logs.identification.tables.models import Chosen, untold_trim
from wingbeat.text import pluralize

OVERDRIVEN = 20.0
"""-; angle of attack or sideslip per angle of the input, from which the unit of either is asked for"""
FLOWS, NOISY = frozenset(("alpha", "beta")), 0.005
"""inputs that vanes measure; -; share of noise in one's power, from which on it is said"""

APART = 1.15
"""-; of the greatest mean airspeed of a manoeuvre over the least: derivatives differ by a third at the most"""


class Flown(NamedTuple):
    """A fit with what it was made of."""

    chosen: Chosen
    problem: Problem
    fit: Fit
    series: tuple[FitSeries, ...]
    """measured beside modelled, fitted and held out"""


def doubts(
    asked: OutputError, experiments: tuple[Experiment, ...], flown: Flown, constants: Mapping[str, float]
) -> tuple[str, ...]:
    """One line each; ``experiments`` are the fitted manoeuvres as measured."""
    chosen, problem, fit, series = flown
    between = {name: chosen.aliases.get(name, name) for name in lines_of(asked)}
    return tuple(
        chain(
            _missing(series), jumping(lines_of(asked), experiments), unseen(problem, fit, between),
            _overdriven(asked, experiments), _noisy(asked, experiments), untold_trim(asked, constants, experiments),
            _trims(chosen, speeds_of(problem.experiments, constants)),
            lacking(series), suspicion(problem, fit, speeds_of(problem.experiments, constants), chosen.unnamed),
            turned(fit.estimates),
        )
    )  # fmt: skip


def _missing(series: Sequence[FitSeries]) -> tuple[Information, ...]:
    """What is said of outputs that were not measured throughout: the fit passes over those samples."""
    counts = [(one, int(np.count_nonzero(~np.isfinite(one.measured)))) for one in series]
    return tuple(
        Information(
            f"{one.experiment}: {count} of {pluralize(len(one.measured), 'sample')} of {one.output} not measured"
        )
        for one, count in counts
        if count
    )


def lines_of(asked: OutputError) -> tuple[str, ...]:
    """Inputs that are lines from each sample to the next."""
    return tuple(name for name in asked.inputs if name not in asked.hold)


def _trims(chosen: Chosen, speeds: Mapping[str, float]) -> tuple[str, ...]:
    """What is said of manoeuvres at airspeeds so different that one linear model is none of them.

    At 80, 100 and 130 m/s a fit of all told a roll by aileron a third too small for their mean.
    """
    least, most = min(speeds.values(), default=1.0), max(speeds.values(), default=1.0)
    if not chosen.linear or most < APART * least:
        return ()
    return (
        f"airspeeds from {least:.3g} to {most:.3g} m/s are one linear model: its derivatives, which grow with the"
        " airspeed and its square, are those of no manoeuvre; fit them apart",
    )


def _overdriven(asked: OutputError, experiments: tuple[Experiment, ...]) -> tuple[str, ...]:
    """What is said of inputs so small beside the flow angles that the unit of one of the two is in doubt."""
    told = []
    for one in experiments:
        reach = {name: _reach(one.signals.get(name, np.zeros(0))) for name in (*asked.inputs, "alpha", "beta")}
        for name in asked.inputs:
            moved = max(reach[angle] for angle in ("alpha", "beta") if angle != name)
            if one.units.get(name) == "rad" and 0 < OVERDRIVEN * reach[name] < moved:
                told.append(
                    f"{one.name}: a flow angle moves {moved / reach[name]:.0f} times as far as {name}:"
                    f" is {name} in rad and called deg, or the angle in deg and called rad?"
                )
    return tuple(told)


def _noisy(asked: OutputError, experiments: tuple[Experiment, ...]) -> tuple[str, ...]:
    """What is said of flow angles that are flown as inputs with the noise of their vanes.

    Noise of 2.4 % of a sideslip's power took 2.5 % of Y_beta, whose interval held in 2 of 20; of 19 % a fifth.
    """
    told = []
    for name in FLOWS & set(asked.inputs):
        angles = [np.asarray(one.signals[name]) for one in experiments if name in one.signals]
        power = [(noise_beside_steps(one) ** 2, float(np.nanvar(one))) for one in angles if np.any(np.isfinite(one))]
        share = max((noise / whole for noise, whole in power if whole > 0.0), default=0.0)
        if share > NOISY:
            told.append(
                f"{name} is flown as it was measured, {100 * share:.2g} % of it noise, which shrinks its derivatives"
                " by as much and puts off others: make it an output, or smooth it in [prepare]"
            )
    return tuple(told)


def _reach(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0
