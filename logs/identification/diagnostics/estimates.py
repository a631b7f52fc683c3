"""Diagnostics of estimates: signs, disagreement of methods, noise and sampling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from math import hypot

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.signal_errors import noise_of_differences, third_differences
from logs.identification.diagnostics import Context
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from logs.identification.estimators.regressors import INTERCEPT, as_regressed
from logs.identification.estimators.terms import evaluate, parse
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import CONFIDENCE, Array, Estimate, EstimationResult
from logs.identification.sources.table.quantities import SIGNALS
from logs.identification.statistics.covariance import unbiased_pole

LEAST_RUN = 16
"""-; samples in a row with every input"""
STEP_CHANGE, REST = 0.2, 0.03
"""-; of an input's range: change between two samples, and the changes next to it, of an input held by a computer"""
FASTEST_TURN = 1.0
"""rad; phase that a mode may turn between two samples if the input between them is unknown"""
LEAST_PERIODS = 4.9
"""-; of the mode in all records together (Klein & Morelli 2006, ch. 9: record length of SIDPAC)"""

register({
    "zoh_input": Entry(
        "{subject} changes in steps but is interpolated linearly",
        "A command of a computer is constant between samples (zero-order hold).",
        "set zoh_inputs = [...] if it is constant between samples",
    ),
    "sampling": Entry(
        "{subject} changes by {percent:.0f} % of its range between samples; intervals widened",
        "The input is sampled too slowly: a line and a cubic between its samples give different estimates.",
        "record at a higher rate",
    ),
    "aliased_mode": Entry(
        "a mode at {value:.3g} rad/s has only {samples:.1f} samples in a period",
        "The mode is faster than half the sampling rate, or too fast for an input unknown between samples.",
        "record at a higher rate",
    ),
    "short_record": Entry(
        "the records hold {value:.2g} periods of the mode (recommended: {limit:.2g})",
        "Frequency and damping of a short record have wide intervals that may be too narrow still.",
        "record longer, or several maneuvers",
    ),
})  # fmt: skip


def jumps(values: Array) -> bool:
    """Whether an input (N,) changes in steps between two samples and rests before and after, as with a hold."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_RUN or not np.ptp(known) > 0:
        return False
    changes = np.abs(np.diff(known)) / float(np.ptp(known))
    places = np.flatnonzero(changes[1:-1] > STEP_CHANGE) + 1
    return len(places) > 0 and bool(np.all(changes[places - 1] < REST) and np.all(changes[places + 1] < REST))


def largest_change(name: str, experiments: Sequence[Experiment]) -> float:
    """Largest change of an input between two measured samples, as a fraction of its range; 0 of a held one."""
    largest = 0.0
    for one in experiments:
        values = np.asarray(one.signals.get(name, np.zeros(0)), dtype=np.float64)
        if jumps(values):
            return 0.0
        known = values[np.isfinite(values)]
        span = float(np.ptp(known)) if len(known) > 1 else 0.0
        largest = max(largest, float(np.max(np.abs(np.diff(known)))) / span if span else 0.0)
    return largest


def coarse_inputs(names: Sequence[str], experiments: Sequence[Experiment], least: float = STEP_CHANGE) -> list[str]:
    """Inputs whose course between samples is unknown: they change by more than ``least`` of their range."""
    return [name for name in names if largest_change(name, experiments) > least]


def sampling_finding(name: str, experiments: Sequence[Experiment]) -> Finding:
    """The finding of an input whose course between samples changes the estimates."""
    change = largest_change(name, experiments)
    return Finding("sampling", "warning", name, change, STEP_CHANGE, {"percent": 100.0 * change})


def aliased_mode(frequency: float, step: float) -> Finding:
    """Why a mode of ``frequency`` (rad/s), sampled every ``step`` s, has no number."""
    samples = 2.0 * math.pi / (frequency * step)
    return Finding("aliased_mode", "withheld", "", frequency, math.pi / step, {"samples": samples})


def stepwise_inputs(context: Context) -> tuple[Finding, ...]:
    """Inputs that change in steps but are interpolated linearly."""
    lines = [name for name in context.inputs if name not in context.zoh_inputs]
    return tuple(
        Finding("zoh_input", "warning", name)
        for name in lines
        if any(name in one.signals and jumps(one.signals[name]) for one in context.experiments)
    )


def short_records(context: Context) -> tuple[Finding, ...]:
    """Records that hold less than `LEAST_PERIODS` of the mode found."""
    derived = () if context.result is None else context.result.derived
    frequency = next((one.value for one in derived if one.name == "short_period_frequency"), 0.0)
    length = sum(float(one.time[-1] - one.time[0]) for one in context.experiments)
    periods = frequency * length / (2.0 * math.pi)
    if 0.0 < periods < LEAST_PERIODS:
        return (Finding("short_record", "warning", "", periods, LEAST_PERIODS),)
    return ()


SIGNS = {
    "Z_alpha": -1, "M_q": -1, "X_u": -1, "Y_beta": -1, "L_p": -1, "N_r": -1, "C_D_0": 1, "C_L_alpha": 1,
    "C_m_q": -1, "C_Z_alpha": -1, "C_Y_beta": -1, "C_l_p": -1, "C_n_r": -1,
}  # fmt: skip
"""expected sign by parameter (Etkin & Reid, Dynamics of Flight, 1996, ch. 5)"""
AXES = {"alpha_dot": "Z", "q_dot": "M", "p_dot": "L", "r_dot": "N", "beta_dot": "Y"}
"""derivative's axis by the response of a regression"""
NOISE_SHIFT, NOISE_SHARE = 0.25, 1e-4
"""-; bias by noise in the regressors over the standard error and over the coefficient, above which it is reported"""
LARGEST_NOISE, MOSTLY_NOISE = 0.9, 0.5
"""-; largest share of noise in a combination of regressors that is corrected for, and that is reported"""
LEAST_SAMPLES = 32
COLORED, FEWEST_SAMPLES = 0.5, 30.0
"""-; autocorrelation of residuals at lag 1 from which, and effective samples below which they are reported"""

register({
    "unusual_sign": Entry(
        "{subject} = {value:.3g} has the opposite sign of a conventional aircraft",
        "Damping, lift slope or drag have the other sign with their whole interval.",
        "check sign, unit and position of the sensors",
    ),
    "disagreement": Entry(
        "{subject}: {one:.4g} by {first}, {other:.4g} by {second} (limit {limit:.2g})",
        "Two methods differ by more than their intervals allow: at least one of them has a wrong model.",
        "compare their findings; with turbulence prefer filter error",
    ),
    "errors_in_variables": Entry(
        "noise in regressors biases {subject} by {percent:+.2g} %; intervals widened",
        "White noise in a regressor biases least squares (Klein & Morelli 2006, sec. 5.1; Fuller 1987).",
        'smooth in [prepare], or use domain = "frequency"',
    ),
    "few_independent_samples": Entry(
        "residuals have {value:.1f} independent samples (correlation {pole:.2f}): interval too narrow",
        "The correlation time of the residuals is long beside the record: n (1 - r) / (1 + r) effective samples. The"
        " interval of a constant term covers the truth less often than stated; those of derivatives do not change.",
        "record longer, or add the regressor that the residuals lack",
    ),
    "noisy_regressor": Entry(
        "{subject} is mostly noise ({percent:.0f} %)",
        "The motion that a regressor has independent of the others is less than its noise.",
        "smooth it in [prepare], or excite it more",
    ),
})  # fmt: skip


def unusual_signs(context: Context) -> tuple[Finding, ...]:
    """Estimates whose whole interval has the sign that no conventional aircraft has."""
    if context.result is None:
        return ()
    return tuple(
        Finding("unusual_sign", "warning", one.name, one.value)
        for name, one in derivatives_of(context.result)
        if (sign := SIGNS.get(name)) and max(sign * one.low, sign * one.high) < 0.0
    )


def few_independent_samples(context: Context) -> tuple[Finding, ...]:
    """Residuals that are correlated over a large part of the record: effective number of samples of their mean.

    It is n (1 - r) / (1 + r) with the autocorrelation r at lag 1 (Bayley & Hammersley, J. R. Stat. Soc. Suppl. 8,
    1946).
    """
    series = () if context.result is None else [one for one in context.result.series if not one.held_out]
    records = [one.measured - one.model for one in series if not one.independent and np.isfinite(one.model).all()]
    records = [one[np.isfinite(one)] - np.nanmean(one) for one in records if np.isfinite(one).sum() > 1]
    squares = sum(float(one[:-1] @ one[:-1]) for one in records)
    if not squares > 0.0:
        return ()
    count = sum(len(one) for one in records)
    pole = min(unbiased_pole(sum(float(one[1:] @ one[:-1]) for one in records) / squares, count), 1.0)
    effective = count * (1.0 - pole) / (1.0 + pole)
    if pole < COLORED or effective >= FEWEST_SAMPLES:
        return ()
    details = {"pole": pole}
    return (Finding("few_independent_samples", "warning", INTERCEPT, effective, FEWEST_SAMPLES, details),)


def derivatives_of(result: EstimationResult) -> list[tuple[str, Estimate]]:
    """The estimates by the name of the derivative; those of a regression are named by regressor."""
    response = result.response
    if not response:
        return [(one.name, one) for one in result.estimates]
    axis = AXES.get(response, response if response.startswith("C_") else "")
    if not axis:
        return []
    found = []
    for one in result.estimates:
        suffix = "0" if one.name == INTERCEPT else one.name.partition("*")[0]
        plain = one.name in (INTERCEPT, suffix) or one.name.endswith(("*c/2V", "*b/2V"))
        if plain and not (axis == "Z" and suffix == "q"):
            found.append((f"{axis}_{suffix}", one))
    return found


def disagreements(context: Context) -> tuple[Finding, ...]:
    """Parameters that two methods of the map give outside the interval of their difference (Bonferroni)."""
    from scipy.special import ndtri

    single = context.inputs[0] if len(context.inputs) == 1 else ""
    values: dict[tuple[str, str], list[tuple[str, Estimate]]] = {}
    for result in context.results:
        for name, one in derivatives_of(result):
            common = f"{name.removesuffix(single)}delta" if single and name.endswith(f"_{single}") else name
            values.setdefault((common, _dimension(one.unit)), []).append((result.title or result.method, one))
    pairs = [(name, *pair) for (name, _), found in values.items() for pair in combinations(found, 2)]
    tail = (1.0 - CONFIDENCE) / 2.0
    wider = float(ndtri(tail / max(len(pairs), 1)) / ndtri(tail)) if pairs else 1.0
    found = []
    for name, (first, one), (second, other) in pairs:
        allowed = wider * hypot(one.high - one.low, other.high - other.low) / 2.0
        if abs(one.value - other.value) > allowed:
            details = {"first": first, "second": second, "one": one.value, "other": other.value}
            found.append(Finding("disagreement", "warning", name, abs(one.value - other.value), allowed, details))
    return tuple(found)


def _dimension(unit: str) -> str:
    """A unit without radians, which are dimensionless."""
    return unit.replace("rad/s", "1/s").replace("rad", "1").replace("(", "").replace(")", "").replace("1/1", "1")


def with_regressor_noise(
    result: EstimationResult, experiments: tuple[Experiment, ...], settings: Settings
) -> tuple[EstimationResult, tuple[Finding, ...]]:
    """The bias by white noise in the regressors, added to each standard error.

    Least squares gives ``theta - Q^-1 C theta`` with ``Q`` the moments of the regressors and ``C`` the covariance of
    their noise (errors in variables: Klein & Morelli 2006, sec. 5.1). The noise is what differs between neighboring
    samples, and at most what the residuals allow.
    """
    names = regressors_of(result)
    if not names:
        return result, ()
    columns = [
        np.column_stack([as_regressed(parse(n), one, settings.constants, settings.averaging) for n in names])
        for one in experiments
    ]
    rows = np.vstack([part[np.all(np.isfinite(part), axis=1)] for part in columns])
    if len(rows) < LEAST_SAMPLES:
        return result, ()
    centered = rows - rows.mean(axis=0)
    moments = centered.T @ centered / len(rows)
    values = np.array([result.value(name) for name in names])
    noise = np.diag(_noise(names, values, result, experiments, settings) ** 2)
    own = np.diag(noise) * np.diag(np.linalg.pinv(moments))
    inverse = np.linalg.pinv(moments - min(1.0, LARGEST_NOISE / max(own.max(), 1e-300)) * noise)
    bias = inverse @ noise @ values
    off = dict(zip(names, bias.tolist(), strict=True)) | {INTERCEPT: -float(rows.mean(axis=0) @ bias)}
    found = []
    for name, share in zip(names, own, strict=True):
        if share > MOSTLY_NOISE:
            details = {"percent": 100.0 * min(share, 1.0)}
            found.append(Finding("noisy_regressor", "warning", name, float(share), MOSTLY_NOISE, details))
    for one in result.estimates:
        shift = off.get(one.name, 0.0)
        significant = abs(shift) > max(NOISE_SHIFT * one.standard_error, NOISE_SHARE * abs(one.value))
        if one.name != INTERCEPT and significant:
            percent = -100.0 * shift / one.value if one.value else 0.0
            found.append(Finding("errors_in_variables", "warning", one.name, -shift, None, {"percent": percent}))
    kept = tuple(_with_shift(one, off.get(one.name, 0.0)) for one in result.estimates)
    return result._replace(estimates=kept), tuple(found)


def _noise(
    names: tuple[str, ...],
    values: Array,
    result: EstimationResult,
    experiments: tuple[Experiment, ...],
    settings: Settings,
) -> Array:
    """Standard deviation (p,) of white noise in each regressor after the averaging."""
    terms = [parse(name) for name in names]
    tables = [np.column_stack([evaluate(term, one, settings.constants) for term in terms]) for one in experiments]
    found = np.array([noise_of_differences(column) for column in np.vstack(list(map(third_differences, tables))).T])
    weights = np.ones(1) if settings.averaging is None else settings.averaging.weights
    found = found * float(np.sqrt(np.sum(weights**2)))
    residuals = np.concatenate([one.measured - one.model for one in result.series if not one.held_out])
    most = float(np.nanstd(residuals)) / np.maximum(np.abs(values), 1e-300)
    return np.asarray(np.minimum(found, most))


def _with_shift(one: Estimate, shift: float) -> Estimate:
    if not shift or not one.standard_error > 0.0:
        return one
    error = hypot(one.standard_error, shift)
    half = (one.high - one.low) / 2.0 * error / one.standard_error
    return one._replace(standard_error=error, low=one.value - half, high=one.value + half)


def with_input_sampling(
    result: EstimationResult, experiments: tuple[Experiment, ...], settings: Settings, domain: str
) -> tuple[EstimationResult, tuple[Finding, ...]]:
    """The change of each coefficient with another course between samples in the averages, in its interval."""
    others = None if settings.averaging is None else settings.averaging.others
    names = regressors_of(result)
    if settings.averaging is None or others is None or not names:
        return result, ()
    symbols = dict.fromkeys(s for n in names for s in parse(n).powers if s not in SIGNALS)
    coarse = coarse_inputs([s for s in symbols if all(s in one.signals for one in experiments)], experiments)
    other = coefficient_regression(
        experiments, result.series[0].output, names, "time" if domain == "time" else "frequency",
        settings._replace(averaging=settings.averaging._replace(weights=others)),
    )  # fmt: skip
    values = {one.name: one.value for one in other.estimates}
    change = {one.name: one.value - values.get(one.name, one.value) for one in result.estimates}
    kept = tuple(_with_shift(one, (2.0 if coarse else 1.0) * change[one.name]) for one in result.estimates)
    significant = any(abs(change[one.name]) > NOISE_SHIFT * one.standard_error for one in result.estimates)
    findings = tuple(sampling_finding(name, experiments) for name in coarse) if significant else ()
    return result._replace(estimates=kept), findings


def regressors_of(result: EstimationResult) -> tuple[str, ...]:
    """Regressors with a coefficient, without the intercepts."""
    return tuple(one.name for one in result.estimates if one.name != INTERCEPT and " of " not in one.name)
