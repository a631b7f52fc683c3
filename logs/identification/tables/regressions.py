"""[[aero.regressions]] of a map: coefficients of a measured or computed response on named regressors."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.context import Context
from logs.identification.diagnostics.estimates import regression_findings
from logs.identification.diagnostics.signals import joined, measured, moves
from logs.identification.diagnostics.table import diagnose
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Settings,
    coefficient_regression,
    regression_result,
)
from logs.identification.estimators.model_structure import Orthogonal, orthogonal_regression
from logs.identification.estimators.registry import Request
from logs.identification.estimators.regressors import LOCAL_POLYNOMIAL, filtered_like_derivative
from logs.identification.estimators.stepwise import Rules, Step, stepwise_regression
from logs.identification.estimators.terms import parse
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.table.config import Regression
from logs.identification.sources.table.constants import UNITS
from logs.identification.sources.table.derived import MADE, averaging_of, with_made
from logs.identification.sources.table.maneuvers import Cut, file_of
from logs.identification.sources.table.signal_lookup import band_frequencies
from logs.pages.document import Chapter, Table
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
        "{subject} is the derivative of a signal smoothed by {method}, the regressors are not smoothed alike: their"
        " coefficients are biased where the smoothing attenuates the motion",
        "A regression with a derivative whose smoothing depends on the data.",
        "smooth by local_quadratic, which all signals then go through, or do not smooth",
    )
})  # fmt: skip


def regression_fit(section: Regression, cut: Cut, constants: Mapping[str, float]) -> EstimationResult:
    """One regression over all maneuvers, and its prediction of the held-out ones.

    Raises:
        InputError: a name that is neither signal nor constant and cannot be computed, a constant response, or no term
            was selected.
    """
    section, constant = _without_constant(section, cut.fitted)
    names = tuple(product_of(name) for name in section.regressors)
    wanted = {symbol for name in (section.response, *names) for symbol in parse(name).powers}
    alike = [tuple(filtered_like_derivative(one, wanted) for one in part) for part in (cut.fitted, cut.held_out)]
    parts = [tuple(with_made(one, wanted, constants) for one in part) for part in alike]
    steady = any(one.steady for one in cut.fitted)
    averaging = averaging_of(alike[0], wanted)
    if steady and (averaging is not None or section.domain != "time"):
        raise InputError(
            f"aero.regressions of {section.response}: steady readings have no derivatives and no spectrum"
        )
    settings = Settings(
        constants=constants, units=UNITS, frequencies=_frequencies(section, parts[0]), averaging=averaging,
        steady=steady,
    )  # fmt: skip
    steps: tuple[Step, ...] = ()
    findings: tuple[Finding, ...] = ()
    chapters: tuple[Chapter, ...] = ()
    if section.method == "orthogonal":
        model, findings, chapters = _orthogonal(section, names, parts[0], settings)
    else:
        selected, steps = _selected(section, names, parts[0], settings)
        model = coefficient_regression(
            parts[0], section.response, selected, "time" if section.domain == "time" else "frequency", settings
        )
    model, noisy = (model, ()) if steady else regression_findings(model, parts[0], settings)
    method = "orthogonal" if section.method == "orthogonal" else f"equation_error_{section.domain}"
    way = "orthogonal functions" if section.method == "orthogonal" else f"{section.domain} domain"
    options = settings._asdict() | {"units": UNITS}
    request = Request(parts[0], parts[1], outputs=(section.response,), constants=constants, options=options)
    result = regression_result(
        "stepwise" if steps else method, request, model, subject="aero", response=section.response, steps=steps,
        chapters=chapters, title=f"regression of {section.response}, {way}",
    )  # fmt: skip
    if model.failure:
        failed = Finding("not_estimated", "withheld", details={"reason": model.failure})
        result = result._replace(findings=(failed, *result.findings))
    result = result._replace(equations=(*result.equations, NAMED))
    symbols = tuple(dict.fromkeys(s for n in names for s in _symbols(n, cut.fitted) if s not in SCALES))
    checks = diagnose("regression", Context(cut.fitted, constants, signals=symbols, result=result))
    thrust = _thrust_unknown(section, cut.fitted, constants)
    return result._replace(
        findings=(*result.findings, *constant, *noisy, *checks, *thrust, *findings, *_smoothed(alike[0], wanted))
    )


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
    known = [*signals, *constants, *(name for name in MADE if name not in signals)]
    for name in (section.response, *section.regressors, *section.always):
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
    where = ", ".join(dict.fromkeys(file_of(one) for one in experiments))
    signals = [name for name in experiments[0].signals if measured(joined(name, experiments))]
    constant = {name for name in signals if not moves(joined(name, experiments))}
    rate = MOMENT_RATES.get(section.response, "")
    if section.response in constant:
        raise InputError(f"{section.response} is constant in {where}: is it the wrong column?")
    if rate in constant and not {section.response, f"{rate}_dot"} & set(experiments[0].signals):
        raise InputError(f"{section.response} is computed from {rate}, which is constant in {where}")
    lost = {}
    for name in dict.fromkeys((*section.regressors, *section.always)):
        symbols = [one for one in _symbols(name, experiments) if one not in SCALES]
        if symbols and set(symbols) <= constant:
            lost[name] = Finding("constant_signal", "withheld", name, details={"where": where})
    kept = tuple(name for name in section.regressors if name not in lost)
    if lost and not kept:
        raise InputError("; ".join(f"{name} is constant in {where}" for name in lost))
    always = tuple(name for name in section.always if name not in lost)
    return section._replace(regressors=kept, always=always), tuple(lost.values())


def _orthogonal(
    section: Regression, names: tuple[str, ...], fitted: tuple[Experiment, ...], settings: Settings
) -> tuple[CoefficientRegression, tuple[Finding, ...], tuple[Chapter, ...]]:
    """The regression on the terms whose orthogonal functions lower the predicted square error.

    Raises:
        InputError: another selection, the frequency domain, or no function that lowers it.
    """
    key = f"aero.regressions of {section.response}"
    if section.selection != "all" or section.always or section.domain != "time":
        raise InputError(f'{key}: method = "orthogonal" chooses its terms itself, in the time domain')
    found = orthogonal_regression(fitted, section.response, names, len(names), settings)
    if not found.terms:
        why = found.failure or "no orthogonal function lowers the predicted square error"
        raise InputError(f"{key}: nothing was chosen: {why}")
    findings = [
        Finding("orthogonal_function", "info", one.term, 100 * one.gain, None,
                {"pse": one.pse, "action": "kept" if one.kept else "not kept"})
        for one in found.functions
    ]  # fmt: skip
    missed = [one.term for one in found.functions if not one.kept and one.chance < SIGNIFICANT / len(names)]
    findings += [Finding("omitted_function", "warning", name) for name in missed]
    return found.model, tuple(findings), (_functions(section.response, found),)


def _functions(response: str, found: Orthogonal) -> Chapter:
    """Every orthogonal function in the order of their construction."""
    rows = tuple((one.term, 100.0 * one.gain, one.pse, "kept" if one.kept else "") for one in found.functions)
    table = Table(("term", "share of the variance (%)", "PSE", ""), rows)
    note = (
        "Each function is a term without its part along those before it; kept up to the least predicted square error."
    )
    return Chapter(f"Orthogonal functions of {response}", (note,), (table,))


def _selected(
    section: Regression, names: tuple[str, ...], fitted: tuple[Experiment, ...], settings: Settings
) -> tuple[tuple[str, ...], tuple[Step, ...]]:
    """The regressors to fit, and the steps of their selection, in the time domain."""
    if section.selection == "all":
        return names, ()
    always = tuple(product_of(name) for name in section.always)
    found = stepwise_regression(
        fitted, section.response, names, Rules(always=always), settings._replace(frequencies=None)
    )
    if found.failure and not found.terms:
        raise InputError(f"stepwise regression of {section.response} chose nothing: {found.failure}")
    return found.terms, found.steps


def product_of(name: str) -> str:
    """A regressor as its product: ``q c/2V`` is ``q*c/2V``."""
    return re.sub(r"(?<=[\w.)])\s+(?=[A-Za-z_(])", "*", name.strip())


def _frequencies(section: Regression, experiments: tuple[Experiment, ...]) -> Array | None:
    """Frequencies of the band; None without one."""
    if section.band is None:
        return None
    key = f"aero.regressions of {section.response}"
    if section.domain != "frequency":
        raise InputError(f'{key}: band is for domain = "frequency"')
    return band_frequencies(section.band, experiments, key)
