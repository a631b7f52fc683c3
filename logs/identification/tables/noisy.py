"""Regressors that are noise in part: their coefficients come out too near zero, and by how much."""

from __future__ import annotations

import numpy as np

from logs.identification.experiment import Experiment
from logs.identification.preparing.noise_level import noise_beside_steps
from logs.identification.regression.averaging import as_regressed
from logs.identification.regression.equation_error import Settings
from logs.identification.regression.terms import evaluate, parse
from logs.identification.results import Array

NOTABLE = 0.01
"""-; of a coefficient, by which noise in its regressor shrinks it"""
LEAST_SAMPLES = 32


def shrunk(names: tuple[str, ...], experiments: tuple[Experiment, ...], settings: Settings) -> list[str]:
    """A sentence for every regressor whose white noise shrinks its coefficient notably.

    Errors in variables (Klein & Morelli, Aircraft System Identification, 2006, sec. 5.1; Fuller, Measurement Error
    Models, 1987, sec. 1.1): least squares gives ``theta (1 - s^2 / v)``, s^2 the noise's variance and v that of
    what the other regressors do not tell of this one. Other noisy regressors count to first order only. An average
    that all columns went through leaves little of the noise.
    """
    terms, constants, averaging = [parse(name) for name in names], settings.constants, settings.averaging
    parts = [
        np.column_stack([as_regressed(term, one, constants, averaging) for term in terms])
        for one in experiments
        if terms
    ]
    left = [float(np.sum(averaging.weights**2)) if averaging else 1.0 for _ in terms]
    variances = [
        np.array([noise_beside_steps(evaluate(t, one, constants)) ** 2 for t in terms]) * left for one in experiments
    ]
    whole = [np.all(np.isfinite(part), axis=1) for part in parts]
    counts = np.array([kept.sum() for kept in whole], dtype=float)
    if not parts or counts.sum() < LEAST_SAMPLES:
        return []
    noise = np.sum([count * one for count, one in zip(counts, variances, strict=True)], axis=0) / counts.sum()
    columns = np.vstack([part[kept] for part, kept in zip(parts, whole, strict=True)])
    shares = [noise[i] / max(_own_variance(columns, i), 1e-300) for i in range(len(names))]
    return [
        f"{name} is measured with noise: it shrinks its coefficient by about {100 * min(share, 1):.2g} %, which the "
        'interval does not hold; smooth it, or use domain = "frequency" with a band'
        for name, share in zip(names, shares, strict=True)
        if share > NOTABLE
    ]  # fmt: skip


def _own_variance(columns: Array, place: int) -> float:
    """Of what the other columns (N, k) and an intercept do not tell of one."""
    others = np.column_stack((np.ones(len(columns)), np.delete(columns, place, axis=1)))
    scaled = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    own = columns[:, place]
    return float(np.var(own - scaled @ np.linalg.lstsq(scaled, own, rcond=None)[0]))
