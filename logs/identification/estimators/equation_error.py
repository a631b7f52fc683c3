"""Equation error: a measured quantity as a sum of named regressors, in the time or in the frequency domain.

Time domain: ordinary least squares over the samples that have every signal (Klein & Morelli, Aircraft System
Identification, 2006, ch. 5; Grauer Eq. 17 to 19). Frequency domain: a finite Fourier transform F at chosen
frequencies gives complex equations with the least squares theta = Re(X^H F^H F X)^-1 Re(X^H F^H F z) (ch. 7; Grauer
Eq. 20, 21). That is linear in the samples: an estimate with the instruments Re(F^H F X), the regressors in the band.
Intercepts and trends of a maneuver are regressors of their own.

Least squares is biased if the residuals move the regressors, as disturbances in an equation of motion do. Instruments
that follow from the input alone remove that bias (instrumental variables: Young, Recursive Estimation and Time-Series
Analysis, 1984, ch. 8).

    settings = Settings(constants={"c": 0.2}, units={"c": "m"})
    result = coefficient_regression((flight,), "C_L", ("alpha", "q*c/2V", "delta"), "time", settings)
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import check_frequencies, in_band, transform
from logs.identification.estimators.least_squares import CovarianceKind, Fit, RecordBlock, regress_records
from logs.identification.estimators.registry import Request
from logs.identification.estimators.regressors import (
    INTERCEPT,
    Averaging,
    Design,
    Intercept,
    Record,
    as_regressed,
    bridged,
    design_of,
    nuisances,
    without,
)
from logs.identification.estimators.terms import parse
from logs.identification.findings import Entry, Finding, of_severity, register
from logs.identification.results import Array, Estimate, EstimationResult, FitSeries, estimate
from logs.identification.statistics.fit_quality import DEPENDENT, NOTABLE, Collinearity, collinearity
from wingbeat.errors import InputError

Domain = Literal["time", "frequency"]
BAND_SHARE = 0.99
"""-; of each regressor's variance that the default band contains"""

register({
    "no_common_sample": Entry(
        "no sample has {response} and all regressors", "No sample of any maneuver has every signal of the regression."
    ),
    "too_few_samples": Entry(
        "{value:g} samples for {limit:g} parameters", "A regression needs three samples more than parameters."
    ),
    "constant_response": Entry("{response} is {value:g} throughout", "The response of a regression does not vary."),
    "constant_regressor": Entry(
        "it does not vary on its own: it is zero, or the mean or the trend over again",
        "The regressor is a combination of intercept and trends.", "vary it, or leave it out",
    ),
    "dependent_regressors": Entry(
        "it depends linearly on {others} in this data", "A linear combination of regressors is zero up to rounding.",
        "leave one out, or vary them independently",
    ),
    "singular_regression": Entry(
        "the samples do not determine regressors and residuals", "The normal equations are singular."
    ),
    "collinearity": Entry(
        "{others} follow one another (condition index {value:.0f}): their coefficients are known better together"
        " than each",
        "Condition index and variance proportions of Belsley, Kuh & Welsch exceed their limits.",
        "vary them independently",
    ),
})  # fmt: skip


class Settings(NamedTuple):
    """Settings of a regression."""

    intercept: Intercept = "common"
    """-; one for all maneuvers, one for each, or none"""
    trend: int | None = None
    """-; order of each maneuver's polynomial in time; None: 0 in the time domain, 1 in the frequency domain"""
    frequencies: Array | None = None
    """Hz; (F,), of the transform; None: `default_frequencies`"""
    longest_gap: int = 5
    """-; missing samples in a row that are interpolated in the frequency domain"""
    covariance: CovarianceKind = "autocorrelated"
    """-; of the residuals, see `statistics.covariance`"""
    constants: Mapping[str, float] = MappingProxyType({})
    """SI; by name, for regressors such as q*c/2V"""
    units: Mapping[str, str] = MappingProxyType({})
    """SI unit by the constant's name"""
    averaging: Averaging | None = None
    """moving average of the columns if some are derivatives over several samples"""
    steady: bool = False
    """-; rows are independent steady readings in any order: residuals are white"""

    def design(self, experiments: tuple[Experiment, ...], response: str, regressors: tuple[str, ...]) -> Design:
        """`regressors.design_of` with these settings."""
        return design_of(
            experiments, response, regressors, self.constants, self.units, self.averaging, steady=self.steady
        )


class Equations(NamedTuple):
    """A regression ready to be solved: nuisances first, then the design's regressors."""

    names: tuple[str, ...]
    """-; (p,), of all columns"""
    reported: tuple[bool, ...]
    """-; (p,), False for a trend"""
    blocks: tuple[RecordBlock, ...]
    separate: Array
    """(M, r); the design's regressors without their nuisances, in samples or transformed"""
    frequencies: Array
    """Hz; (F,), empty in the time domain"""


class CoefficientRegression(NamedTuple):
    """Result of one regression."""

    response: str
    """-; name of the response"""
    unit: str
    """-; of the response"""
    domain: Domain
    names: tuple[str, ...]
    """-; (p,), of the fitted columns, the intercept first"""
    values: Array
    """(p,); response per regressor"""
    covariance: Array
    """(p, p)"""
    degrees: float
    """-; effective degrees of freedom"""
    estimates: tuple[Estimate, ...]
    findings: tuple[Finding, ...]
    """withheld coefficients and collinear regressors"""
    collinearity: Collinearity | None
    """of the regressors, without intercept and trends"""
    residuals: tuple[Array, ...]
    """as the response; (N_i,) of each maneuver, measured minus model, NaN where not used"""
    frequencies: Array
    """Hz; (F,), of the transform; empty in the time domain"""
    samples: int
    """-; used"""
    notes: tuple[str, ...] = ()
    """texts of diagnostics that are no findings yet"""

    @property
    def withheld(self) -> tuple[Finding, ...]:
        """Coefficients (subject) without an estimate."""
        return of_severity(self.findings, "withheld")

    @property
    def failure(self) -> str:
        """Why there are no numbers, empty if there are."""
        if self.estimates:
            return ""
        withheld = of_severity(self.findings, "withheld")
        if len({one.code for one in withheld}) == 1 and withheld[0].code != "dependent_regressors":
            return withheld[0].text
        return "no coefficient is identifiable: " + "; ".join(f"{one.subject}: {one.text}" for one in withheld)


def coefficient_regression(
    experiments: tuple[Experiment, ...],
    response: str,
    regressors: tuple[str, ...],
    domain: Domain = "time",
    settings: Settings | None = None,
    responses: tuple[Experiment, ...] = (),
) -> CoefficientRegression:
    """Least squares of ``response`` on ``regressors`` (`terms`) over all ``experiments`` (Grauer Eq. 17 to 21).

    Samples without any of the signals are left out in the time domain; in the frequency domain short gaps are
    interpolated. Linearly dependent regressors are withheld, the others keep their numbers. The regressors of
    the ``responses`` to the input alone, one for each experiment and as long, are instruments.

    Raises:
        InputError: unknown names, unequal sampling intervals, long gaps, frequencies that the record cannot have.
    """
    settings = settings or Settings()
    design = settings.design(experiments, response, regressors)
    lengths = tuple(len(record.used) for record in design.records)
    if domain == "frequency":
        design = bridged(design, settings.longest_gap)
    instruments = settings.design(responses, response, regressors) if responses else None
    return solve(design, domain, settings, lengths, instruments)


def solve(
    design: Design, domain: Domain, settings: Settings, lengths: tuple[int, ...], instruments: Design | None = None
) -> CoefficientRegression:
    """The regression of a ``design`` whose experiments have ``lengths`` samples.

    Optional ``instruments`` have records as long as the design's.
    """
    if not design.samples:
        return _failed(design, domain, Finding("no_common_sample", "withheld", details={"response": design.response}))
    values = np.concatenate([record.response[record.used > 0] for record in design.records])
    if np.ptp(values) <= 0:
        details = {"response": design.response}
        return _failed(
            design, domain, Finding("constant_response", "withheld", value=float(values[0]), details=details)
        )
    wanted = equations(design, domain, settings)
    if design.samples <= len(wanted.names) + 2:
        counts = float(design.samples), float(len(wanted.names))
        return _failed(design, domain, Finding("too_few_samples", "withheld", "", *counts))
    diagnosis = collinearity(wanted.separate, design.names) if design.names else None
    withheld = _dependent(diagnosis) if diagnosis else ()
    retained = _independent(design, wanted.separate) if withheld else design.names
    solved = wanted if retained == design.names else equations(design.taking(retained), domain, settings)
    if not solved.names:
        return _failed(design, domain, withheld[0])
    blocks = solved.blocks
    if instruments is not None:
        band = settings._replace(frequencies=solved.frequencies)
        others = equations(instruments.taking(retained), domain, band).blocks
        blocks = tuple(b._replace(instruments=o.instruments) for b, o in zip(blocks, others, strict=True))
    try:
        fit = regress_records(blocks, "white" if settings.steady else settings.covariance)
    except np.linalg.LinAlgError:
        return _failed(design, domain, Finding("singular_regression", "withheld"))
    units, lost = design.parameter_units, {one.subject for one in withheld}
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    rows = zip(solved.names, solved.reported, fit.values, errors, strict=True)
    estimates = tuple(
        estimate(name, units.get(name, design.unit), float(value), float(error), fit.degrees)
        for name, reported, value, error in rows
        if reported and name not in lost
    )
    return CoefficientRegression(
        design.response, design.unit, domain, solved.names, fit.values, fit.covariance, fit.degrees, estimates,
        (*withheld, *_collinear(diagnosis, lost)), diagnosis, _split(fit, design, lengths),
        solved.frequencies, design.samples,
    )  # fmt: skip


def predict(result: CoefficientRegression, experiment: Experiment, settings: Settings | None = None) -> Array:
    """The response (N,) of ``result`` for another ``experiment``, without trends; NaN where a regressor is missing.

    Raises:
        InputError: the result has no numbers, or a regressor is missing.
    """
    if result.failure:
        raise InputError(f"{result.response}: {result.failure}")
    settings = settings or Settings()
    total = np.zeros(len(experiment.time))
    for name, value in zip(result.names, result.values, strict=True):
        if name == INTERCEPT:
            total += value
        elif " of " not in name:
            total += value * as_regressed(parse(name), experiment, settings.constants, settings.averaging)
    return total


def equations(design: Design, domain: Domain, settings: Settings) -> Equations:
    """The ``design``'s equations in the ``domain``; in the frequency domain without missing samples (`bridged`).

    Raises:
        InputError: unknown domain, frequencies that the record cannot have.
    """
    if domain not in ("time", "frequency"):
        raise InputError(f"domain '{domain}' is neither time nor frequency")
    order = settings.trend if settings.trend is not None else int(domain == "frequency")
    extra = nuisances(design.records, settings.intercept, order)
    names, reported = (*extra.names, *design.names), (*extra.reported, *(True for _ in design.names))
    pairs = list(zip(design.records, extra.columns, strict=True))
    if domain == "time":
        blocks = [_block(record, np.hstack((columns, record.regressors))) for record, columns in pairs]
        stacked = np.vstack([block.regressors * block.used[:, None] for block in blocks])
        separate = without(stacked[:, : len(extra.names)], stacked[:, len(extra.names) :])
        return Equations(names, reported, tuple(blocks), separate, np.zeros(0))
    chosen = default_frequencies(design) if settings.frequencies is None else settings.frequencies
    frequencies = check_frequencies(chosen, design.step)
    bands = [_in_band(record, columns, frequencies, design.step) for record, columns in pairs]
    separate = np.vstack([spectrum for _, spectrum in bands])
    return Equations(names, reported, tuple(block for block, _ in bands), separate, frequencies)


def default_frequencies(design: Design) -> Array:
    """Multiples of one over the longest record's length, Hz, up to `BAND_SHARE` of the regressors' variance."""
    longest = max(design.records, key=lambda record: len(record.used))
    count = len(longest.used)
    centered = longest.regressors - longest.regressors.mean(axis=0)
    power = np.abs(np.fft.rfft(centered, axis=0)[1 : (count + 1) // 2]) ** 2
    shares = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    last = int(np.max(np.argmax(shares >= BAND_SHARE, axis=0))) + 1
    least = min(2 * len(design.names), len(power))
    return np.asarray(np.arange(1, max(last, least) + 1) / (count * design.step))


def _block(record: Record, regressors: Array) -> RecordBlock:
    return RecordBlock(regressors, regressors, record.response, record.used)


def _in_band(record: Record, nuisance: Array, frequencies: Array, step: float) -> tuple[RecordBlock, Array]:
    """The record's block, and the transform of its regressors (2 F, r), real parts first."""
    steady = np.column_stack((np.ones(len(record.used)), nuisance))
    clean = without(steady, record.regressors)
    spectrum = transform(clean, frequencies, step)
    instruments = np.hstack((nuisance, without(steady, in_band(clean, frequencies, step))))
    block = _block(record, np.hstack((nuisance, record.regressors)))._replace(instruments=instruments)
    return block, np.vstack((spectrum.real, spectrum.imag))


def _dependent(diagnosis: Collinearity) -> tuple[Finding, ...]:
    """Regressors without a coefficient of their own."""
    found = {
        name: Finding("constant_regressor", "withheld", name)
        for name, inflation in zip(diagnosis.names, diagnosis.inflation, strict=True)
        if not np.isfinite(inflation)
    }
    for group in diagnosis.groups(DEPENDENT):
        for name in group:
            others = ", ".join(other for other in group if other != name)
            found[name] = Finding("dependent_regressors", "withheld", name, details={"others": others})
    return tuple(found.values())


def _collinear(diagnosis: Collinearity | None, lost: set[str]) -> tuple[Finding, ...]:
    groups = diagnosis.groups(NOTABLE) if diagnosis else ()
    index = float(diagnosis.indices[-1]) if diagnosis else 0.0
    return tuple(
        Finding("collinearity", "warning", group[0], index, NOTABLE, {"others": ", ".join(group)})
        for group in groups
        if not set(group) <= lost
    )


def _independent(design: Design, separate: Array) -> tuple[str, ...]:
    """The first of the design's names that are independent of those before them."""
    retained: list[int] = []
    for column in range(separate.shape[1]):
        tried = [*retained, column]
        diagnosis = collinearity(separate[:, tried], tuple(design.names[c] for c in tried))
        if np.all(diagnosis.indices <= DEPENDENT):
            retained = tried
    return tuple(design.names[column] for column in retained)


def _split(fit: Fit, design: Design, lengths: tuple[int, ...]) -> tuple[Array, ...]:
    """Residuals of each experiment (N_i,), NaN where not used."""
    parts, start = [], 0
    for record, length in zip(design.records, lengths, strict=True):
        part = np.full(length, np.nan)
        residuals = fit.residuals[start : start + len(record.used)]
        part[record.start : record.start + len(residuals)] = np.where(record.used > 0, residuals, np.nan)
        parts.append(part)
        start += len(residuals)
    return tuple(parts)


def _failed(design: Design, domain: Domain, finding: Finding) -> CoefficientRegression:
    nothing = np.zeros(0)
    findings = tuple(finding._replace(subject=name) for name in design.names or (design.response,))
    return CoefficientRegression(
        design.response, design.unit, domain, (), nothing, np.zeros((0, 0)), 1.0, (), findings, None,
        (), nothing, design.samples,
    )  # fmt: skip


def settings_of(request: Request) -> Settings:
    """Settings of a regression from the options of a ``request``, by the fields of `Settings`."""
    options = {name: value for name, value in request.options.items() if name in Settings._fields}
    return Settings(**{"constants": request.constants, **options})


def one_response(request: Request) -> str:
    """The response of a regression.

    Raises:
        InputError: not one output.
    """
    if len(request.outputs) != 1:
        raise InputError(f"a regression has one response, not {len(request.outputs)}")
    return request.outputs[0]


def regression_result(method: str, request: Request, result: CoefficientRegression, **more: Any) -> EstimationResult:
    """A regression as an `EstimationResult`, with its prediction of the maneuvers that are held out."""
    settings = settings_of(request)
    response = parse(result.response)
    series = []
    for one, residual in zip(request.experiments, result.residuals, strict=False):
        measured = as_regressed(response, one, settings.constants, settings.averaging)
        series.append(
            FitSeries(
                one.name,
                result.response,
                result.unit,
                one.time,
                measured,
                measured - residual,
                independent=one.steady,
            )
        )
    for one in request.held_out if result.estimates else ():
        measured = as_regressed(response, one, settings.constants, settings.averaging)
        predicted = predict(result, one, settings)
        series.append(
            FitSeries(
                one.name, result.response, result.unit, one.time, measured, predicted, True, independent=one.steady
            )
        )
    places = [result.names.index(one.name) for one in result.estimates]
    terms = " + ".join(name if name == INTERCEPT else f"[{name}] {name}" for name in result.names)
    return EstimationResult(
        method, equations=(f"{result.response} = {terms}",),
        status="converged" if result.estimates else "not identifiable", estimates=result.estimates,
        covariance=result.covariance[np.ix_(places, places)] if places else None,
        degrees=result.degrees,
        series=tuple(series), samples=result.samples, findings=result.findings, **more,
    )  # fmt: skip


def in_time_domain(request: Request) -> EstimationResult:
    """Equation error of a request in the time domain."""
    return _estimate("time", request)


def in_frequency_domain(request: Request) -> EstimationResult:
    """Equation error of a request in the frequency domain."""
    return _estimate("frequency", request)


def _estimate(domain: Domain, request: Request) -> EstimationResult:
    settings = settings_of(request)
    result = coefficient_regression(request.experiments, one_response(request), request.regressors, domain, settings)
    return regression_result(f"equation_error_{domain}", request, result)
