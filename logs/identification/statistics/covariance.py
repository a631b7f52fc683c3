"""Covariance of parameters with colored residuals, with unequal variances, and from the dispersion between records.

Colored residuals: Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J.
Guidance 20(1), 1997, with Parzen's window, after prewhitening by a first-order
filter (Andrews & Monahan, Econometrica 60, 1992). What is computed from parameters has errors by the delta method.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from logs.identification.results import Array, Estimate, estimates

LAG_FRACTION = 0.15
"""-; of the longest record: lags of the autocovariance"""
MAX_POLE = 0.97
"""-; of the prewhitening filter"""
MIN_CLUSTERS = 5
"""-; records, from which the dispersion between them is estimated"""
MAX_CONDITION = 1e12
MAX_LEVERAGE = 0.999
"""-; of one record in a direction, in the correction of its residuals"""
Arrays = list[Array]


class Autocovariance(NamedTuple):
    """Autocovariance of residuals, tapered."""

    lags: Array
    """(L, m, m); of m outputs at lags 0 to L - 1, times the window"""
    effective: float
    """-; number of independent samples with the same information about the variance"""


def parzen(lags: int) -> Array:
    """Parzen's window at lags 0 to ``lags`` - 1."""
    x = np.arange(lags) / lags
    window: Array = np.where(x <= 0.5, 1 - 6 * x**2 * (1 - x), 2 * (1 - x) ** 3)
    return window


def autocovariance(residuals: Arrays, used: Arrays, lags: int) -> Autocovariance:
    """Autocovariance over records of ``residuals`` (N_i, m), zero where ``used`` (N_i, m) is 0.

    Sums are divided by the number of samples, so that the spectrum is nowhere negative (Priestley, Spectral Analysis
    and Time Series, 1981, 5.3.3).
    """
    outputs = residuals[0].shape[1]
    sums, pairs = np.zeros((lags, outputs, outputs)), np.zeros((lags, outputs, outputs))
    for values, mask in zip(residuals, used, strict=True):
        count = min(lags, len(mask))
        sums[:count] += _correlations(values, count)
        pairs[:count] += np.rint(_correlations(mask, count))
    samples = np.sqrt(np.diag(pairs[0]))
    tapered = sums / np.maximum(np.outer(samples, samples), 1.0) * parzen(lags)[:, None, None]
    effective = 0.0
    for output in range(outputs):
        covariance, counts = tapered[:, output, output], pairs[:, output, output]
        if covariance[0] > 0:
            squared = (covariance / covariance[0]) ** 2 * counts
            effective += float(counts[0] ** 2 / (squared[0] + 2 * np.sum(squared[1:])))
    return Autocovariance(tapered, effective)


def _correlations(values: Array, lags: int) -> Array:
    """Sums (lags, m, m) over n of ``values[n, i] values[n + lag, j]`` for ``values`` (N, m), by Fourier transform."""
    from scipy.fft import irfft, next_fast_len, rfft  # takes 0.1 s

    length = next_fast_len(len(values) + lags, real=True)
    spectrum = rfft(values, length, axis=0)
    sums: Array = irfft(np.conj(spectrum)[:, :, None] * spectrum[:, None, :], length, axis=0)[:lags]
    return sums


def colored_information(sensitivities: Arrays, residuals: Autocovariance) -> Array:
    """Sum over lags of S(i)^T Gamma(i - j) S(j) for ``sensitivities`` (N_i, m, p): (p, p)."""
    from scipy.fft import next_fast_len, rfft

    parameters = sensitivities[0].shape[2]
    total = np.zeros((parameters, parameters))
    for sensitivity in sensitivities:
        ahead = residuals.lags[: len(sensitivity)].copy()
        ahead[0] /= 2.0  # lag 0 counts once, the others on both sides
        size = next_fast_len(len(sensitivity) + len(ahead), real=True)
        weights, values = np.conj(rfft(ahead, size, axis=0)), rfft(sensitivity, size, axis=0)
        weights[1 : (size + 1) // 2] *= 2.0  # and the negative frequencies
        half = (values.reshape(-1, parameters).conj().T @ (weights @ values).reshape(-1, parameters)).real / size
        total += half + half.T
    return total


def colored_covariance(
    residuals: Arrays, used: Arrays, sensitivities: Arrays, inverse: Array, fitted: int, bounded: bool = True
) -> tuple[Array, float]:
    """Covariance (p, p) of least squares with colored residuals, and its effective degrees of freedom.

    ``residuals`` (N_i, m) and ``used`` (N_i, m), 1 or 0, by record; ``sensitivities`` (N_i, m, p), nuisance
    parameters projected out; ``inverse`` (p, p) of the information matrix; ``fitted``: number of parameters and
    nuisance parameters. A ``bounded`` covariance is at least that for white residuals.
    """
    lags = max(int(LAG_FRACTION * max(len(one) for one in residuals)), 1) + 1
    effective, count = autocovariance(residuals, used, lags).effective, sum(float(mask.sum()) for mask in used)
    degrees = max(effective - fitted, 1.0)
    variance = bounded * sum(float(np.sum(one**2)) for one in residuals) / max(count - fitted, 1.0)
    white = inverse @ information(sensitivities) @ inverse * variance
    residuals, used, filtered = _prewhitened(residuals, used, sensitivities)
    colored = inverse @ colored_information(filtered, autocovariance(residuals, used, lags)) @ inverse
    return at_least(colored * (effective / degrees), white), degrees


def _prewhitened(residuals: Arrays, used: Arrays, sensitivities: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    """Residuals of each output through the first-order filter that makes them nearly white.

    The sensitivities pass the adjoint of its inverse, so that the information does not change.
    """
    residuals, used, sensitivities = ([one.copy() for one in each] for each in (residuals, used, sensitivities))
    for output in range(residuals[0].shape[1]):
        pairs = [(r[:, output], u[:, output]) for r, u in zip(residuals, used, strict=True)]
        if not any(np.any(u[1:] * u[:-1]) for _, u in pairs):
            continue
        products = sum(float(np.sum(r[1:] * r[:-1])) for r, _ in pairs)
        squares = sum(float(np.sum(r[:-1] ** 2 * u[1:])) for r, u in pairs)
        count = sum(float(np.sum(u[1:] * u[:-1])) for _, u in pairs)
        pole = float(np.clip(unbiased_pole(products / max(squares, 1e-300), count), -MAX_POLE, MAX_POLE))
        for r, u, s in zip(residuals, used, sensitivities, strict=True):
            if not len(r):
                continue
            both = u[1:, output] * u[:-1, output]
            r[1:, output] = (r[1:, output] - pole * r[:-1, output]) * both
            r[0, output], u[0, output], u[1:, output] = 0.0, 0.0, both
            s[:, output] = lfilter([1.0], [1.0, -pole], s[::-1, output], axis=0)[::-1]
    return residuals, used, sensitivities


def unbiased_pole(pole: float, samples: float) -> float:
    """Autocorrelation at lag 1 of residuals about a mean, without the bias of a short record.

    A positive one is low by (1 + 3 pole) / samples (Marriott & Pope, Biometrika 41, 1954).
    """
    return (samples * pole + 1.0) / (samples - 3.0) if pole > 0.0 and samples > 3.0 else pole


def cluster_covariance(residuals: Arrays, sensitivities: Arrays, prior: Array | None = None) -> Array | None:
    """Covariance (p, p) from the dispersion between records, CR2; None of fewer than `MIN_CLUSTERS`.

    It contains errors of the model's structure. ``prior`` (p, p) is the information of a prior. Bell & McCaffrey,
    Survey Methodology 28(2), 2002.
    """
    if len(residuals) < MIN_CLUSTERS:
        return None
    records = np.array([information([one]) for one in sensitivities])
    prior = np.zeros_like(records[0]) if prior is None else prior
    total = records.sum(axis=0) + prior
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    root = vectors / np.sqrt(np.maximum(values, values[-1] / MAX_CONDITION)) / scale[:, None]
    inverse = root @ root.T
    covariance: Array = inverse @ prior @ inverse
    for leverage, s, r in zip(root.T @ records @ root, sensitivities, residuals, strict=True):
        values, vectors = np.linalg.eigh(leverage)
        score = root.T @ np.einsum("nip,ni->p", s, r)
        corrected = root @ (vectors @ (vectors.T @ score / np.sqrt(1.0 - np.minimum(values, MAX_LEVERAGE))))
        covariance += np.outer(corrected, corrected)
    return covariance


def record_covariance(
    residuals: Arrays, used: Arrays, sensitivities: Arrays, inverse: Array, fitted: int, prior: Array | None = None
) -> tuple[Array, Array]:
    """Covariance (p, p) of a fit to several records, and degrees of freedom (p,).

    That for colored residuals with the ``prior`` information (p, p), and at least that of the dispersion between
    records.
    """
    covariance, effective = colored_covariance(residuals, used, sensitivities, inverse, fitted)
    if prior is not None:
        covariance = covariance + inverse @ prior @ inverse
    degrees, between = np.full(len(inverse), effective), cluster_covariance(residuals, sensitivities, prior)
    if between is None:
        return covariance, degrees
    wider = np.diag(between) > np.diag(covariance)
    return at_least(covariance, between), np.where(wider, np.minimum(len(residuals) - 1.0, degrees), degrees)


def information(sensitivities: Arrays) -> Array:
    """Sum of S^T S over ``sensitivities`` (N_i, m, p): (p, p)."""
    total: Array = sum(np.einsum("nip,niq->pq", s, s) for s in sensitivities)
    return total


def at_least(covariance: Array, other: Array) -> Array:
    """``covariance`` (p, p) scaled up to the standard errors of the ``other`` (p, p) where those are larger."""
    with np.errstate(over="ignore"):
        ratio = np.sqrt(np.maximum(np.diag(other) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    scaled: Array = covariance * np.outer(ratio, ratio)
    return scaled


def heteroscedastic_covariance(inverse: Array, design: Array, residuals: Array, weights: Array) -> Array:
    """Covariance (p, p) of least squares with unequal variances: HC3 (MacKinnon & White, J. Econometrics 29, 1985).

    ``inverse`` (p, p) is that of ``design^T W design``, ``weights`` (N,) the diagonal of W, ``design`` (N, p).
    """
    leverage = weights * np.einsum("np,pq,nq->n", design, inverse, design)
    scores = design * (weights * residuals / np.maximum(1.0 - leverage, 1e-6))[:, None]
    covariance: Array = inverse @ (scores.T @ scores) @ inverse
    return covariance


def is_determined(matrix: Array) -> bool:
    """Whether an information ``matrix`` (p, p) is regular."""
    scale = np.sqrt(np.diag(matrix))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(matrix / np.outer(scale, scale)) < MAX_CONDITION)


class ParameterUncertainty(NamedTuple):
    """Covariance of parameters and its degrees of freedom."""

    covariance: Array
    """(p, p)"""
    degrees: float
    """-; effective degrees of freedom"""

    @property
    def standard_errors(self) -> Array:
        """Standard errors (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def transformed(self, gradient: Array) -> ParameterUncertainty:
        """Uncertainty of functions with the ``gradient`` (k, p) by the parameters, to first order."""
        return self._replace(covariance=gradient @ self.covariance @ gradient.T)

    def part(self, chosen: slice) -> ParameterUncertainty:
        """Uncertainty of the ``chosen`` parameters."""
        return self._replace(covariance=self.covariance[chosen, chosen])

    def estimates(self, names: dict[str, str], values: Array) -> tuple[Estimate, ...]:
        """One `Estimate` per entry of ``names`` (name to unit), from ``values`` (p,)."""
        return estimates(names, values, self.covariance, self.degrees)


def propagate(
    function: Callable[[Array], Array], values: Array, uncertainty: ParameterUncertainty
) -> tuple[Array, ParameterUncertainty]:
    """Value (k,) of ``function(values)`` and its uncertainty by the delta method (central differences)."""
    central, columns = function(values), []
    for index, error in enumerate(uncertainty.standard_errors):
        width = 0.01 * error if error > 0 else 1e-6
        ahead, behind = values.copy(), values.copy()
        ahead[index] += width
        behind[index] -= width
        columns.append((function(ahead) - function(behind)) / (2 * width))
    return central, uncertainty.transformed(np.column_stack(columns))
