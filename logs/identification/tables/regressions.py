"""[[aero.regressions]] of a map: coefficients of a measured or computed response on named regressors."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.derivative_signs import turned
from logs.identification.diagnostics.errors_in_variables import with_noise
from logs.identification.diagnostics.intersample_behavior import coarse, felt, said_coarse, with_between
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Domain,
    Settings,
    coefficient_regression,
    predict,
)
from logs.identification.estimators.orthogonal import Orthogonal, orthogonal_regression
from logs.identification.estimators.regressors import INTERCEPT, TREND, as_regressed
from logs.identification.estimators.stepwise import Rules, Step, stepwise_regression
from logs.identification.estimators.terms import parse
from logs.identification.report.document import Chapter, Table
from logs.identification.results import Array, FitSeries, Fitted, Information
from logs.identification.sources.table.config import Regression
from logs.identification.sources.table.constants import UNITS
from logs.identification.sources.table.derived import MADE, averaging_of, with_made
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.quantities import SIGNALS
from logs.identification.sources.table.signal_lookup import band_frequencies
from logs.identification.statistics.correlation import correlation_among
from logs.identification.statistics.output_fit import output_fits
from logs.identification.tables.results import TableFit
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

OF_THRUST = ("C_X", "C_Z", "C_L", "C_D")
"""responses that thrust is taken off"""
NO_CHANCE = 0.01
"""-; probability by chance, shared among the candidates, below which a function that was not kept is named"""
NAMED = "Each number in brackets is called by what it multiplies."


def regression_fit(asked: Regression, found: Cut, constants: Mapping[str, float]) -> TableFit:
    """One regression over all manoeuvres, and its prediction of those that were held out.

    Raises:
        InputError: a name that is neither signal nor constant and cannot be made of them, or no term was chosen.
    """
    names = tuple(product_of(name) for name in asked.regressors)
    wanted = {symbol for name in (asked.response, *names) for symbol in parse(name).powers}
    fitted = tuple(with_made(one, wanted, constants) for one in found.fitted)
    held = tuple(with_made(one, wanted, constants) for one in found.held_out)
    settings = Settings(
        constants=constants,
        units=UNITS,
        frequencies=_frequencies(asked, fitted),
        averaging=averaging_of(found.fitted, wanted),
    )
    thrust = _without_thrust(asked, found.fitted, constants)
    if asked.method == "orthogonal":
        fit = _orthogonal(asked, names, (fitted, held), settings)
        return fit._replace(fitted=fit.fitted._replace(notes=(*fit.fitted.notes, *thrust)))
    chosen, steps = _chosen(asked, names, fitted, settings)
    domain: Domain = "time" if asked.domain == "time" else "frequency"
    result = coefficient_regression(fitted, asked.response, chosen, domain, settings)
    result = _with_errors(result, fitted, settings)
    return _told(asked, result._replace(notes=(*result.notes, *thrust)), fitted, held, settings)._replace(steps=steps)


def _with_errors(
    result: CoefficientRegression, experiments: tuple[Experiment, ...], settings: Settings
) -> CoefficientRegression:
    """The regression with intervals that hold what noise in regressors and their course between samples do."""
    noisy = with_noise(result, experiments, settings)
    noisy = noisy._replace(notes=(*noisy.notes, *turned(noisy.estimates, noisy.response)))
    if settings.averaging is None or noisy.failure:
        return noisy
    chosen = tuple(name for name in result.names if name != INTERCEPT and not name.startswith(TREND))
    symbols = dict.fromkeys(symbol for name in chosen for symbol in parse(name).powers if symbol not in SIGNALS)
    unseen = coarse([one for one in symbols if all(one in each.signals for each in experiments)], experiments)
    others = settings._replace(averaging=settings.averaging._replace(weights=settings.averaging.others))
    otherwise = coefficient_regression(experiments, result.response, chosen, result.domain, others)
    told = said_coarse(unseen, "the intervals hold what that may do") if felt(noisy, otherwise) else ()
    noisy = with_between(noisy, otherwise, bool(unseen))
    return noisy._replace(notes=(*noisy.notes, *told))


def _without_thrust(
    asked: Regression, experiments: tuple[Experiment, ...], constants: Mapping[str, float]
) -> tuple[str, ...]:
    """What is said of a force that was made of accelerations where no thrust was told."""
    made = asked.response in OF_THRUST and asked.response not in experiments[0].signals
    if not made or "thrust" in experiments[0].signals or "thrust" in constants:
        return ()
    return (
        f"thrust is neither told nor measured: {asked.response} is of all that pushes, not of the air alone"
        " (thrust = 0.0 in [constants] is a glide)",
    )


def check_names(asked: Regression, signals: Collection[str], constants: Collection[str]) -> None:
    """Refuse what no manoeuvre can tell, a word misspelt, before anything is fitted.

    Raises:
        InputError: a regressor that is no product, or a name that is no signal, no constant and not to be made of
            them.
    """
    known = [*signals, *constants, *(name for name in MADE if name not in signals)]
    for name in (asked.response, *asked.regressors, *asked.always):
        for symbol in () if name in signals else parse(product_of(name)).powers:
            if symbol not in known:
                guess = did_you_mean(symbol, known)
                of = "" if symbol == name else f" of {name!r}"
                raise InputError(
                    f"aero.regressions of {asked.response}: {symbol!r}{of} is neither in [signals] nor in"
                    f" [constants]{guess}; there are: {', '.join([*signals, *constants])}"
                )


def _orthogonal(
    asked: Regression,
    names: tuple[str, ...],
    parts: tuple[tuple[Experiment, ...], tuple[Experiment, ...]],
    settings: Settings,
) -> TableFit:
    """The terms whose orthogonal functions lower the predicted square error, and every function's share.

    Raises:
        InputError: a choice by other means as well, the frequency domain, or no function that is worth its cost.
    """
    key = f"aero.regressions of {asked.response}"
    if asked.selection != "all" or asked.always or asked.domain != "time":
        raise InputError(f'{key}: method = "orthogonal" chooses its terms itself, in the time domain')
    found = orthogonal_regression(parts[0], asked.response, names, len(names), settings)
    if not found.terms:
        why = found.failure or "no orthogonal function lowers the predicted square error"
        raise InputError(f"{key}: nothing was chosen: {why}")
    told: tuple[str, ...] = tuple(
        Information(
            f"orthogonal function of {one.term}: {100 * one.gain:.3g} % of the variance, PSE {one.pse:.4g},"
            f" {'kept' if one.kept else 'not kept'}"
        )
        for one in found.functions
    )
    missed = [one.term for one in found.functions if not one.kept and one.chance < NO_CHANCE / len(names)]
    if missed:
        told = (
            *told,
            f"not kept, but more than chance: {', '.join(missed)}; what they tell is in the others' coefficients,"
            ' and not in their intervals (selection = "stepwise" chooses by F)',
        )
    model = _with_errors(found.model, parts[0], settings)
    model = model._replace(notes=(*told, *model.notes))
    fit = _told(asked, model, *parts, settings)
    return fit._replace(
        fitted=fit.fitted._replace(method=f"regression of {asked.response}, orthogonal functions"),
        chapters=(_functions(asked.response, found),),
    )


def _functions(response: str, found: Orthogonal) -> Chapter:
    """Every orthogonal function in the order in which they were made."""
    rows = tuple((one.term, 100.0 * one.gain, one.pse, "kept" if one.kept else "") for one in found.functions)
    table = Table(("made of", "share of the variance (%)", "PSE with it and all before", ""), rows)
    said = "Each is a term without what those before it tell; kept are those up to the least predicted square error."
    return Chapter(f"Orthogonal functions of {response}", (said,), (table,))


def _chosen(
    asked: Regression, names: tuple[str, ...], fitted: tuple[Experiment, ...], settings: Settings
) -> tuple[tuple[str, ...], tuple[Step, ...]]:
    """The regressors to fit, and the steps by which they were chosen, in the time domain."""
    if asked.selection == "all":
        return names, ()
    always = tuple(product_of(name) for name in asked.always)
    found = stepwise_regression(
        fitted, asked.response, names, Rules(always=always), settings._replace(frequencies=None)
    )
    if found.failure and not found.terms:
        raise InputError(f"stepwise regression of {asked.response} chose nothing: {found.failure}")
    return found.terms, found.steps


def product_of(name: str) -> str:
    """A regressor as its product: ``q c/2V`` is ``q*c/2V``."""
    return re.sub(r"(?<=[\w.)])\s+(?=[A-Za-z_(])", "*", name.strip())


def _frequencies(asked: Regression, experiments: tuple[Experiment, ...]) -> Array | None:
    """Of the band, where there is one."""
    if asked.band is None:
        return None
    key = f"aero.regressions of {asked.response}"
    if asked.domain != "frequency":
        raise InputError(f'{key}: band is for domain = "frequency"')
    return band_frequencies(asked.band, experiments, key)


def _told(
    asked: Regression,
    result: CoefficientRegression,
    fitted: tuple[Experiment, ...],
    held: tuple[Experiment, ...],
    settings: Settings,
) -> TableFit:
    series: list[FitSeries] = []
    if not result.failure:
        for one, residual in zip(fitted, result.residuals, strict=True):
            measured = as_regressed(parse(asked.response), one, settings.constants, settings.averaging)
            series.append(_series(one, result, measured, measured - residual, held_out=False))
        for one in held:
            measured = as_regressed(parse(asked.response), one, settings.constants, settings.averaging)
            series.append(_series(one, result, measured, predict(result, one, settings), held_out=True))
    equation = " + ".join(name if name == INTERCEPT else f"[{name}] {name}" for name in result.names)
    correlation = correlation_among(result.estimates, result.names, result.covariance)
    fitted_numbers = Fitted(
        f"regression of {asked.response}, {asked.domain} domain", (f"{asked.response} = {equation}", NAMED),
        result.estimates, result.unidentified, correlation, tuple(series), result.notes,
    )  # fmt: skip
    return TableFit(
        "aero", fitted_numbers, not result.failure, result.failure, {}, {}, output_fits(tuple(series)), result.samples
    )


def _series(
    one: Experiment, result: CoefficientRegression, measured: Array, model: Array, held_out: bool
) -> FitSeries:
    return FitSeries(one.name, result.response, result.unit, one.time, measured, model, held_out)
