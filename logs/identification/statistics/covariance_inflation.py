"""Covariances that are widened where another way to see the scatter promises less."""

from __future__ import annotations

import numpy as np

from logs.identification.results import Array


def not_below(covariance: Array, other: Array) -> Array:
    """``covariance`` (p, p) scaled up to the standard errors of the ``other`` (p, p) where those are larger.

    With the covariance for white residuals as the other, a short record promises no more than they do.
    """
    with np.errstate(over="ignore"):  # a variance of nothing is not widened to a number
        ratio = np.sqrt(np.maximum(np.diag(other) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    scaled: Array = covariance * np.outer(ratio, ratio)
    return scaled


def uneven(inverse: Array, design: Array, residuals: Array, weights: Array) -> Array:
    """Covariance (p, p) of least squares where some samples scatter more than others.

    HC3 of MacKinnon & White, J. Econometrics 29, 1985. ``inverse`` (p, p) is that of ``design^T W design``, the
    ``weights`` (N,) are W's diagonal; ``design`` is (N, p), the ``residuals`` (N,).
    """
    leverage = weights * np.einsum("np,pq,nq->n", design, inverse, design)
    scores = design * (weights * residuals / np.maximum(1.0 - leverage, 1e-6))[:, None]
    covariance: Array = inverse @ (scores.T @ scores) @ inverse
    return covariance
