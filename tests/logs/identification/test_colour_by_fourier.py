"""Autocovariances and coloured information by Fourier transform are the sums over lags that they stand for."""

from __future__ import annotations

import numpy as np

from logs.identification.accuracy.colour import colour_of, coloured_information, parzen

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
