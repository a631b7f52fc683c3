"""Autocovariances and coloured information by Fourier transform are the sums over lags that they stand for."""

from __future__ import annotations

import numpy as np

from logs.identification.statistics.residual_autocorrelation import colour_of, coloured_information, parzen

LAGS = 31


def test_they_are_the_sums_over_lags() -> None:
    rng = np.random.default_rng(0)
    used = [(rng.random((count, 2)) > 0.1).astype(float) for count in (300, 101)]
    residuals = [rng.normal(size=mask.shape) * mask for mask in used]
    slopes = [rng.normal(size=(*mask.shape, 3)) for mask in used]
    colour = colour_of(residuals, used, LAGS)
    information = np.zeros((3, 3))
    for lag, taper in enumerate(parzen(LAGS)):
        products = sum(r[: len(r) - lag].T @ r[lag:] for r in residuals)
        pairs = sum(m[: len(m) - lag].T @ m[lag:] for m in used)
        np.testing.assert_allclose(colour.covariances[lag], taper * products / pairs, atol=1e-12)
        for s in slopes:
            term = np.einsum("nip,ij,njq->pq", s[: len(s) - lag], colour.covariances[lag], s[lag:])
            information += term if lag == 0 else term + term.T
    np.testing.assert_allclose(coloured_information(slopes, colour), information, rtol=1e-9)


def test_a_definite_colour_has_no_spectrum_below_zero() -> None:
    """GIVEN differenced noise with gaps, which holds nothing slow THEN only the mean over pairs is negative.

    Sensitivities that are slow would have had a negative variance.
    """
    rng = np.random.default_rng(3)
    lowest = {True: [], False: []}
    for _ in range(20):
        residuals = np.diff(rng.normal(size=(201, 2)), axis=0)
        used = (rng.uniform(size=(200, 2)) < 0.9).astype(np.float64)
        for definite, found in lowest.items():
            colour = colour_of([residuals * used], [used], 60, definite=definite)
            spectra = np.fft.fft(colour.covariances, 512, axis=0)
            spectra = spectra + np.conj(spectra.transpose(0, 2, 1)) - colour.covariances[0]
            found.append(float(np.min(np.linalg.eigvalsh(spectra))))
    assert min(lowest[True]) > -1e-12
    assert min(lowest[False]) < -1e-3
