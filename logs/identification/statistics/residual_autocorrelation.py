"""The colour of residuals: their autocovariance, tapered, and what it makes of the information in the data.

Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997,
with the lags tapered by Parzen's window.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array


class Colour(NamedTuple):
    """Autocovariance of residuals, tapered, by lag."""

    covariances: Array
    """(L, m, m); of m outputs at lags 0 to L - 1, times the taper"""
    effective: float
    """-; the number of independent samples that carry as much knowledge of the residuals' variance"""


def parzen(lags: int) -> Array:
    """Parzen's lag window at lags 0 to ``lags`` - 1, zero from lag ``lags`` on."""
    x = np.arange(lags) / lags
    window: Array = np.where(x <= 0.5, 1 - 6 * x**2 * (1 - x), 2 * (1 - x) ** 3)
    return window


def flat_top(flat: int, lags: int) -> Array:
    """Lag window of ones up to lag ``flat`` that falls to zero at lag ``lags`` (Politis & Romano, J. Time Series
    Anal. 16, 1995)."""
    falling = np.arange(lags - flat) / max(lags - flat, 1)
    window: Array = np.concatenate((np.ones(flat), 1 - falling))
    return window


def colour_of(
    residuals: list[Array], used: list[Array], lags: int, flat: int = 0, *, definite: bool = False
) -> Colour:
    """Autocovariance over records of ``residuals`` (N_i, m), zero where ``used`` (N_i,) or (N_i, m) is 0.

    Noise that a moving average of ``flat`` samples went through is correlated that far for sure: Parzen's window
    would take a quarter of its power at low frequencies. Up to there the lags then count in full.

    The mean at a lag is over the pairs that there are. Its spectrum may be below zero; it is nowhere with Parzen's
    window where the sum is divided by the number of samples instead, ``definite`` (Priestley, Spectral Analysis and
    Time Series, 1981, 5.3.3).
    """
    outputs = residuals[0].shape[1]
    sums, pairs = np.zeros((lags, outputs, outputs)), np.zeros((lags, outputs, outputs))
    for values, mask in zip(residuals, used, strict=True):
        reach = min(lags, len(mask))
        whole = mask if mask.ndim == 2 else np.repeat(mask[:, None], outputs, axis=1)
        sums[:reach] += _correlations(values, reach)
        pairs[:reach] += np.rint(_correlations(whole, reach))
    samples = np.sqrt(np.diag(pairs[0]))
    raw = sums / np.maximum(np.outer(samples, samples) if definite else pairs, 1.0)
    window = flat_top(flat, lags) if 0 < flat < lags else parzen(lags)
    tapered = raw * window[:, None, None]
    return Colour(tapered, _effective(tapered, pairs))


def _correlations(values: Array, lags: int) -> Array:
    """Sums (lags, m, m) over n of ``values[n, i] values[n + lag, j]`` for ``values`` (N, m).

    By Fourier transform: a flight of ten minutes has 60,000 samples and 6,000 lags.
    """
    from scipy.fft import irfft, next_fast_len, rfft  # takes 0.1 s, which a flight need not wait for

    length = next_fast_len(len(values) + lags, real=True)
    spectrum = rfft(values, length, axis=0)
    product = np.conj(spectrum)[:, :, None] * spectrum[:, None, :]
    sums: Array = irfft(product, length, axis=0)[:lags]
    return sums


def _effective(tapered: Array, pairs: Array) -> float:
    """Independent samples, summed over the outputs: pairs of samples count by their squared correlation."""
    total = 0.0
    for output in range(tapered.shape[1]):
        covariance, counts = tapered[:, output, output], pairs[:, output, output]
        if covariance[0] > 0:
            squared = (covariance / covariance[0]) ** 2 * counts
            total += float(counts[0] ** 2 / (squared[0] + 2 * np.sum(squared[1:])))
    return total


def coloured_information(sensitivities: list[Array], colour: Colour) -> Array:
    """Sum over lags of S(i)^T Gamma(i - j) S(j) for ``sensitivities`` (N_i, m, p): (p, p)."""
    from scipy.fft import next_fast_len, rfft

    parameters = sensitivities[0].shape[2]
    total = np.zeros((parameters, parameters))
    for sensitivity in sensitivities:
        ahead = colour.covariances[: len(sensitivity)].copy()
        ahead[0] /= 2.0  # lag 0 is counted once, every other on both sides
        size = next_fast_len(len(sensitivity) + len(ahead), real=True)
        weights, values = np.conj(rfft(ahead, size, axis=0)), rfft(sensitivity, size, axis=0)
        weights[1 : (size + 1) // 2] *= 2.0  # of these frequencies the negative are as much
        half = (values.reshape(-1, parameters).conj().T @ (weights @ values).reshape(-1, parameters)).real / size
        total += half + half.T
    return total
