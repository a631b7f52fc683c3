"""[[aero.regressions]] of a map: coefficients of a measured or computed response on named regressors."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import with_input_sampling, with_regressor_noise
from logs.identification.diagnostics.signals import joined, measured, moves
from logs.identification.diagnostics.table import diagnose
from logs.identification.estimators.equation_error import Settings
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.estimators.regressors import INTERCEPT, LOCAL_POLYNOMIAL, filtered_like_derivative
from logs.identification.estimators.terms import parse
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.table.config import LEAST_SQUARES, Regression
from logs.identification.sources.table.derived import DERIVED, averaging_of, band_frequencies, with_derived
from logs.identification.sources.table.maneuvers import DataSplit, files_of
from logs.identification.sources.table.quantities import UNITS
from logs.pages.document import Band, Chapter, Plot, Series, Table
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

FORCES = ("C_X", "C_Z", "C_L", "C_D")
"""responses from which thrust is subtracted"""
SIGNIFICANT = 0.01
"""-; probability by chance, over all candidates, below which a function that was not kept is reported"""
SCALES = ("V", "rho", "qbar", "altitude", "thrust")
"""signals that make regressors dimensionless"""
MOMENT_RATES = {"C_l": "p", "C_m": "q", "C_n": "r"}
"""the rate whose derivative a moment coefficient contains if no angular acceleration was measured"""
NAMED = "Each number in brackets is named by its regressor."

register({
    "thrust_unknown": Entry(
        "thrust is neither a signal nor a constant: {subject} contains it",
        "A force coefficient computed from accelerations contains the thrust.",
        "set thrust in [constants] (0.0 for a glide) or [signals]",
    ),
    "orthogonal_function": Entry(
        "orthogonal function of {subject}: {value:.3g} % of the variance, PSE {pse:.4g}, {action}",
        "An orthogonal function of the regressors (Klein & Morelli 2006, sec. 5.4).",
    ),
    "omitted_function": Entry(
        "not kept, but significant: {subject}; its effect is in the other coefficients",
        "The predicted square error rejects a term that the F test keeps.",
        "selection = \"stepwise\" selects by F",
    ),
    "smoothed_derivative": Entry(
        "derivative {subject} of a smoothed signal ({method}) biases the coefficients",
        "A regression with a derivative whose smoothing depends on the data.",
        "smooth by local_quadratic, which filters all signals alike",
    )
})  # fmt: skip


def regression_fit(section: Regression, data: DataSplit) -> EstimationResult:
    """One regression over all maneuvers, and its prediction of the held-out ones.

    Raises:
        InputError: a name that is neither signal nor constant and cannot be computed, a constant response, or no term
            was selected.
    """
    constants = data.constants
    section, constant = _without_constant(section, data.fitted)
    names = tuple(product_of(name) for name in section.regressors)
    symbols = {symbol for name in (section.response, *names) for symbol in parse(name).powers}
    filtered = data.map(lambda one: filtered_like_derivative(one, symbols))
    complete = filtered.map(lambda one: with_derived(one, symbols, constants))
    steady = any(one.steady for one in data.fitted)
    averaging = averaging_of(filtered.fitted, symbols)
    if steady and (averaging is not None or section.domain != "time"):
        raise InputError(
            f"aero.regressions of {section.response}: steady readings have no derivatives and no spectrum"
        )
    frequencies = _frequencies(section, complete.fitted)
    settings = Settings(constants=constants, units=UNITS, frequencies=frequencies, averaging=averaging, steady=steady)
    result = _estimated(section, names, complete, settings)
    noise: tuple[Finding, ...] = ()
    if not steady and section.domain == "time":
        result, noise = with_regressor_noise(result, complete.fitted, settings)
    if not steady:
        result, sampling = with_input_sampling(result, complete.fitted, settings, section.domain)
        noise = (*noise, *sampling)
    way = f"{section.domain} domain" if section.method == LEAST_SQUARES else ESTIMATORS[section.method].title.lower()
    result = result._replace(
        subject="aero", response=section.response, title=f"regression of {section.response}, {way}",
        equations=(*result.equations, NAMED),
    )  # fmt: skip
    used = tuple(dict.fromkeys(s for n in names for s in _symbols(n, data.fitted) if s not in SCALES))
    checks = diagnose("regression", Context(data.fitted, constants, signals=used, result=result))
    thrust = _thrust_unknown(section, data.fitted, constants)
    smoothed = _smoothed(filtered.fitted, symbols)
    return result._replace(findings=(*result.findings, *constant, *noise, *checks, *thrust, *smoothed))


def _estimated(section: Regression, names: tuple[str, ...], data: DataSplit, settings: Settings) -> EstimationResult:
    """The result of the row of the registry that the section requests.

    Raises:
        InputError: no term was selected, or orthogonal functions with another selection or domain.
    """
    key = f"aero.regressions of {section.response}"

    def estimate(row: str, regressors: tuple[str, ...], **options: Any) -> EstimationResult:
        every = settings._asdict() | options
        request = Request(
            data.fitted, data.held_out, (), (section.response,), regressors, None, {}, data.constants, every
        )
        return ESTIMATORS[row].estimate(request)

    def selected(result: EstimationResult) -> tuple[str, ...]:
        terms = tuple(one.name for one in result.estimates if one.name != INTERCEPT)
        if not terms:
            raise InputError(f"{key}: no term was selected: {_reason(result)}")
        return terms

    alone = section.method != LEAST_SQUARES
    if alone and (section.selection != "all" or section.forced_terms or section.domain != "time"):
        raise InputError(f'{key}: method = "{section.method}" is in the time domain, without selection of terms')
    if section.method == "orthogonal":
        result = estimate("orthogonal", names, most_terms=len(names))
        selected(result)
        functions, count = result.steps, len(names)
        missed = [one.term for one in functions if not one.kept and one.chance < SIGNIFICANT / count]
        findings = [
            Finding("orthogonal_function", "info", one.term, 100 * one.gain, None,
                    {"pse": one.pse, "action": "kept" if one.kept else "not kept"})
            for one in functions
        ]  # fmt: skip
        findings += [Finding("omitted_function", "warning", name) for name in missed]
        return result._replace(
            findings=(*result.findings, *findings), steps=(), chapters=(_functions(section.response, functions),)
        )
    if section.selection == "stepwise":
        forced = tuple(product_of(name) for name in section.forced_terms)
        result = estimate("stepwise", names, always=forced, frequencies=None)
        terms = selected(result)
        if section.domain == "time":
            return result
        return estimate("equation_error_frequency", terms)._replace(method="stepwise", steps=result.steps)
    row = section.method if section.method in ESTIMATORS else f"equation_error_{section.domain}"
    result = estimate(row, names)
    if result.steps:
        result = result._replace(steps=(), chapters=(*result.chapters, _histories(result.steps)))
    if not result.estimates:
        failed = Finding("not_estimated", "withheld", details={"reason": _reason(result)})
        result = result._replace(findings=(failed, *result.findings))
    return result


def _reason(result: EstimationResult) -> str:
    """Why a regression has no coefficient: the texts of its withheld terms."""
    texts = dict.fromkeys(one.text for one in result.withheld)
    if len(texts) == 1:
        return next(iter(texts))
    return "; ".join(f"{one.subject}: {one.text}" for one in result.withheld) or "no term passes the test"


def _smoothed(experiments: Sequence[Experiment], symbols: Collection[str]) -> tuple[Finding, ...]:
    """Derivatives of signals that were smoothed by a method that depends on the data."""
    return tuple(
        Finding("smoothed_derivative", "warning", f"{name}_dot", details={"method": method})
        for name, method in experiments[0].smoothed.items()
        if f"{name}_dot" in symbols and method != LOCAL_POLYNOMIAL
    )


def _thrust_unknown(
    section: Regression, experiments: tuple[Experiment, ...], constants: Mapping[str, float]
) -> tuple[Finding, ...]:
    computed = section.response in FORCES and section.response not in experiments[0].signals
    if not computed or "thrust" in experiments[0].signals or "thrust" in constants:
        return ()
    return (Finding("thrust_unknown", "warning", section.response),)


def check_names(section: Regression, signals: Collection[str], constants: Collection[str]) -> None:
    """Reject unknown names before anything is fitted.

    Raises:
        InputError: a regressor that is no product, or a name that is no signal, no constant and cannot be computed.
    """
    known = [*signals, *constants, *(name for name in DERIVED if name not in signals)]
    for name in (section.response, *section.regressors, *section.forced_terms):
        for symbol in () if name in signals else parse(product_of(name)).powers:
            if symbol not in known:
                guess = did_you_mean(symbol, known)
                of = "" if symbol == name else f" of {name!r}"
                raise InputError(
                    f"aero.regressions of {section.response}: {symbol!r}{of} is neither in [signals] nor in"
                    f" [constants]{guess}; there are: {', '.join([*signals, *constants])}"
                )


def _symbols(name: str, experiments: tuple[Experiment, ...]) -> tuple[str, ...]:
    signals = experiments[0].signals
    return (name,) if name in signals else tuple(one for one in parse(product_of(name)).powers if one in signals)


def _without_constant(
    section: Regression, experiments: tuple[Experiment, ...]
) -> tuple[Regression, tuple[Finding, ...]]:
    """The regression without terms of constant signals, and a finding for each.

    Raises:
        InputError: the response is constant, or no term is left.
    """
    where = files_of(experiments)
    signals = [name for name in experiments[0].signals if measured(joined(name, experiments))]
    constant = {name for name in signals if not moves(joined(name, experiments))}
    rate = MOMENT_RATES.get(section.response, "")
    if section.response in constant:
        raise InputError(f"{section.response} is constant in {where}: is it the wrong column?")
    if rate in constant and not {section.response, f"{rate}_dot"} & set(experiments[0].signals):
        raise InputError(f"{section.response} is computed from {rate}, which is constant in {where}")
    lost = {}
    for name in dict.fromkeys((*section.regressors, *section.forced_terms)):
        symbols = [one for one in _symbols(name, experiments) if one not in SCALES]
        if symbols and set(symbols) <= constant:
            lost[name] = Finding("constant_signal", "withheld", name, details={"where": where})
    kept = tuple(name for name in section.regressors if name not in lost)
    if lost and not kept:
        raise InputError("; ".join(f"{name} is constant in {where}" for name in lost))
    forced = tuple(name for name in section.forced_terms if name not in lost)
    return section._replace(regressors=kept, forced_terms=forced), tuple(lost.values())


def _functions(response: str, functions: Sequence[Any]) -> Chapter:
    """Every orthogonal function in the order of their construction."""
    rows = tuple((one.term, 100.0 * one.gain, one.pse, "kept" if one.kept else "") for one in functions)
    table = Table(("term", "share of the variance (%)", "PSE", ""), rows)
    note = (
        "Each function is a term without its part along those before it; kept up to the least predicted square error."
    )
    return Chapter(f"Orthogonal functions of {response}", (note,), (table,))


def _histories(histories: Sequence[Any]) -> Chapter:
    """Each parameter against time with two standard errors (Klein & Morelli 2006, ch. 8)."""
    plots = tuple(
        Plot(
            one.name, "time", "s", one.name, one.unit, (Series(one.name, one.time, one.value),),
            (Band("two standard errors", one.time, *(one.value + f * one.standard_error for f in (-2.0, 2.0))),),
        )
        for one in histories
    )  # fmt: skip
    return Chapter("Parameters against time", ("Estimates after every sample.",), plots=plots)


def product_of(name: str) -> str:
    """A regressor as its product: ``q c/2V`` is ``q*c/2V``."""
    return re.sub(r"(?<=[\w.)])\s+(?=[A-Za-z_(])", "*", name.strip())


def _frequencies(section: Regression, experiments: tuple[Experiment, ...]) -> Array | None:
    """Frequencies of the band; None without one."""
    if section.frequency_band is None:
        return None
    key = f"aero.regressions of {section.response}"
    if section.domain != "frequency":
        raise InputError(f'{key}: frequency_band is for domain = "frequency"')
    return band_frequencies(section.frequency_band, experiments, key)
