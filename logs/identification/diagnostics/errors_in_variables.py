"""Regressors that are noise in part: what that does to every coefficient, and intervals that hold it.

Least squares takes a regressor's noise for motion. With ``C`` the covariance of noise in the regressors X, ``c`` that
with the noise in the response, and moments ``Q = X^T X / N``, it finds ``Q^-1 ((Q - C) theta + c)`` where theta is
true (errors in variables: Klein & Morelli, Aircraft System Identification, 2006, sec. 5.1; Fuller, Measurement Error
Models, 1987, sec. 1.1 and 2.2). The coefficient of a regressor without noise is put off too where it moves with a
noisy one; a response made of a noisy regressor (C_D of alpha) has noise in common with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.fourier import in_band
from logs.identification.data.noise_level import noise_of_differences, third_differences
from logs.identification.estimators.equation_error import CoefficientRegression, Settings
from logs.identification.estimators.regressors import INTERCEPT, TREND, as_regressed
from logs.identification.estimators.terms import evaluate, parse
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, Estimate, estimate

FELT = 0.25
"""-; standard errors that noise in the regressors puts a coefficient off by, from which on it is said"""
LEAST_SHARE = 1e-4
"""-; of a coefficient, the same: less is the rounding of a table"""
MOSTLY = 0.5
"""-; share of noise in a combination of regressors, from which on it tells nothing of what they multiply"""
MOST = 0.9
"""-; share that is reckoned with at most"""
LEAST_SAMPLES = 32
OF_AIR = ("V", "rho", "qbar")
"""what regressors and responses are made dimensionless by: their noise counts for little"""
MADE_OF = {"C_L": ("alpha",), "C_D": ("alpha",)}
"""signals whose noise is in a response that is made of them, and may be in it as in the model"""
SLACK = 2.0
"""-; by how many times the residuals a regressor's noise may make up: a coefficient may be off by others'"""

register({
    "regressor_noise": Entry(
        "its regressor is mostly noise apart from what the others explain",
        "Errors in variables: noise is most of the variance of a combination of regressors.", "smooth it",
    )
})  # fmt: skip


def with_noise(
    result: CoefficientRegression, experiments: tuple[Experiment, ...], settings: Settings
) -> CoefficientRegression:
    """The regression with intervals that hold what white noise in the regressors does, and a line that says so.

    Noise is what differs between neighbouring samples and is no step. The values stay those of least squares; the
    bias is added to each standard error as one more of its own. A coefficient of which noise tells the most is none.
    """
    if result.failure:
        return result
    names = tuple(name for name in result.names if name != INTERCEPT and not name.startswith(TREND))
    parts = _columns(names, experiments, settings)
    if not names or sum(map(len, parts)) < LEAST_SAMPLES:
        return result
    moments, left = _moments(parts, result.frequencies, experiments[0].step)
    left *= _through_average(settings, result.frequencies, experiments[0].step)
    values = result.values[[result.names.index(name) for name in names]]
    most = _most(names, values, result, settings)
    noise, common = (left * one for one in _at_most(most, *_noise(names, result.response, experiments, settings)))
    bias, lost = _bias(moments, noise, common, values)
    off = dict(zip(names, bias.tolist(), strict=True)) | {INTERCEPT: -float(np.vstack(parts).mean(axis=0) @ bias)}
    refused = [name for name, gone in zip(names, lost, strict=True) if gone]
    kept = tuple(_widened(one, off, result) for one in result.estimates if one.name not in refused)
    before = {one.name for one in result.unidentified}
    found = tuple(Finding("regressor_noise", "withheld", name) for name in refused if name not in before)
    told = _said(kept, off, _noisy(names, moments, noise), bool(len(result.frequencies)))
    drowned = bool(refused) and all(one.name == INTERCEPT for one in kept)
    return result._replace(
        estimates=() if drowned else kept, findings=(*result.findings, *found), notes=(*result.notes, *told)
    )


def _columns(names: tuple[str, ...], experiments: tuple[Experiment, ...], settings: Settings) -> list[Array]:
    """Regressors (M_i, p) of the samples of each manoeuvre that have all of them."""
    parts = []
    for one in experiments if names else ():
        columns = [as_regressed(parse(name), one, settings.constants, settings.averaging) for name in names]
        part = np.column_stack(columns)
        parts.append(part[np.all(np.isfinite(part), axis=1)])
    return [part for part in parts if len(part)]


def _moments(parts: list[Array], frequencies: Array, step: float) -> tuple[Array, float]:
    """Moments (p, p) of the regressors about their means, and the share of white noise that is in them.

    In the frequency domain each manoeuvre's line is taken off too, and the noise is that of the band.
    """
    count = sum(map(len, parts))
    if not len(frequencies):
        whole = np.vstack(parts)
        whole = whole - whole.mean(axis=0)
        return np.asarray(whole.T @ whole / count), 1.0
    total = np.zeros((parts[0].shape[1],) * 2)
    for part in parts:
        line = np.vander(np.linspace(-1.0, 1.0, len(part)), 2)
        clean = part - line @ np.linalg.lstsq(line, part, rcond=None)[0]
        total += in_band(clean, frequencies, step).T @ clean
    return np.asarray((total + total.T) / (2.0 * count)), 2.0 * len(frequencies) * len(parts) / count


def _through_average(settings: Settings, frequencies: Array, step: float) -> float:
    """The share of white noise that an average over all columns leaves, of all of it or of that in a band."""
    if settings.averaging is None:
        return 1.0
    weights = settings.averaging.weights
    if not len(frequencies):
        return float(np.sum(weights**2))
    places = np.arange(len(weights)) - len(weights) // 2
    return float(np.mean((np.cos(2.0 * np.pi * step * np.outer(frequencies, places)) @ weights) ** 2))


def _noise(
    names: tuple[str, ...], response: str, experiments: tuple[Experiment, ...], settings: Settings
) -> tuple[Array, Array]:
    """Covariance (p, p) of the noise in the regressors, and that (p,) with the response's.

    A slope, odd about its sample, has no noise in common with averages, which are even.
    """
    asked = (*names, response) if settings.averaging is None else names
    terms = [parse(name) for name in asked]
    differences = np.vstack(
        [
            third_differences(np.column_stack([evaluate(term, one, settings.constants) for term in terms]))
            for one in experiments
        ]
    )
    covariance = _covariance(differences)
    p = len(names)
    return covariance[:p, :p], covariance[:p, p] if settings.averaging is None else np.zeros(p)


def _most(names: tuple[str, ...], values: Array, result: CoefficientRegression, settings: Settings) -> Array:
    """Standard deviation (p,) that noise in each regressor has at most: more would be left in the residuals.

    The third differences of a motion that is faster than its samples, or free of noise, are none. Infinite where that
    is not known: terms of one signal, or of one that the response is made of, can make up for one another's noise.
    """
    left = np.concatenate([one[np.isfinite(one)] for one in result.residuals] or [np.zeros(0)])
    if not len(left):
        return np.full(len(names), np.inf)
    shares = 1.0 if settings.averaging is None else float(np.sum(settings.averaging.weights**2))
    size = float(np.sqrt(np.mean(left**2) / shares))
    symbols = [{one for one in parse(name).powers if one not in (*settings.constants, *OF_AIR)} for name in names]
    made = set(MADE_OF.get(result.response, ()))
    alone = [
        not own & made and not any(own & other for other in (*symbols[:i], *symbols[i + 1 :]))
        for i, own in enumerate(symbols)
    ]
    return np.where(np.array(alone) & (values != 0.0), SLACK * size / np.maximum(np.abs(values), 1e-300), np.inf)


def _at_most(most: Array, noise: Array, common: Array) -> tuple[Array, Array]:
    """The ``noise`` (p, p), and what of it is in ``common`` (p,), with deviations of ``most`` (p,) at most."""
    level = np.sqrt(np.diag(noise))
    share = np.minimum(1.0, most / np.maximum(level, 1e-300))
    return noise * np.outer(share, share), common * share


def _covariance(differences: Array) -> Array:
    """Covariance (k, k) of the noise by third ``differences`` (N, k), such that steps count for little.

    That of two signals is had of their sum and their difference (Gnanadesikan & Kettenring, Biometrics 28, 1972).
    """
    levels = np.array([noise_of_differences(column) for column in differences.T])
    scaled = differences / np.where(levels > 0, levels, np.inf)
    found = np.diag(levels**2)
    for i in range(len(levels)):
        for j in range(i):
            both, apart = scaled[:, i] + scaled[:, j], scaled[:, i] - scaled[:, j]
            share = (noise_of_differences(both) ** 2 - noise_of_differences(apart) ** 2) / 4.0
            found[i, j] = found[j, i] = np.clip(share, -1.0, 1.0) * levels[i] * levels[j]
    return found


def _bias(moments: Array, noise: Array, common: Array, values: Array) -> tuple[Array, Array]:
    """What least squares is off by (k,), and whether noise tells the most of each coefficient (k,)."""
    size = np.sqrt(np.diag(moments))
    scale = np.where(size > 0, size, 1.0)
    lower = np.linalg.cholesky(moments / np.outer(scale, scale) + 1e-14 * np.eye(len(scale)))
    inverse = np.linalg.inv(lower) / scale
    shares, vectors = np.linalg.eigh(inverse @ noise @ inverse.T)
    shares = np.clip(shares, 0.0, MOST)
    across = inverse.T @ vectors
    # In these axes the moments are one and the noise is diagonal: (1 - share) true = found - common.
    found = np.linalg.solve(across, values)
    true = (found - across.T @ common) / (1.0 - shares)
    apart = across * (found - true)
    drowned = shares > MOSTLY
    weight = across**2
    lost = weight[:, drowned].sum(axis=1) > MOSTLY * weight.sum(axis=1)
    return np.asarray(apart.sum(axis=1)), np.asarray(lost)


def _widened(one: Estimate, off: Mapping[str, float], result: CoefficientRegression) -> Estimate:
    bias = off.get(one.name, 0.0)
    if not bias:
        return one
    degrees = float(result.degrees[result.names.index(one.name)])
    return estimate(one.name, one.unit, one.value, hypot(one.standard_error, bias), degrees)


def _noisy(names: tuple[str, ...], moments: Array, noise: Array) -> list[str]:
    """The regressors with noise that counts, beside what the others do not tell of each."""
    own = 1.0 / np.diag(np.linalg.pinv(moments))
    shares = np.diag(noise) / np.maximum(own, 1e-300)
    return [name for name, share in zip(names, shares, strict=True) if share >= max(0.1 * shares.max(), 1e-300)]


def _said(kept: tuple[Estimate, ...], off: Mapping[str, float], noisy: list[str], in_a_band: bool) -> tuple[str, ...]:
    """One line with what noise puts off notably."""
    told = []
    for one in kept:
        bias = off[one.name]
        rest = one.standard_error**2 - bias**2
        if one.name != INTERCEPT and bias**2 > FELT**2 * rest and abs(bias) > LEAST_SHARE * abs(one.value):
            share = 100 * bias / one.value
            told.append(f"{one.name} by about {share:+.2g} %" if abs(share) < 100 else f"{one.name} by all of it")
    if not told:
        return ()
    use = "a narrower band" if in_a_band else 'domain = "frequency" with a narrow band'
    return (
        f"noise in {', '.join(noisy)} puts off {', '.join(told)}, which the intervals hold; smooth it, or use {use}",
    )
