"""Variable projection: nonlinear least squares with the linear unknowns eliminated at every step.

Golub & Pereyra, SIAM J. Numer. Anal. 10(2), 1973. Amplitudes, offsets and drifts of each record and gains that all
records share are linear; frequency, damping and delay are not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from logs.identification.results import Array

PASSES = 2
"""-; of estimating the outputs' variances anew (relaxation of the likelihood)"""
EVALUATIONS = 400
TOLERANCE = 1e-6
DEPENDENT = 1e-10
"""-; of the largest: a combination of shared columns that is shorter tells nothing"""


class Piece(NamedTuple):
    """One record at given nonlinear parameters."""

    measured: Array
    """(n, m)"""
    own: tuple[Array, ...]
    """m of (n, l); what has a coefficient of its own in this record"""
    shared: tuple[Array, ...]
    """m of (n, g); what has one coefficient in all records, g may be 0"""


class SeparableFit(NamedTuple):
    """The nonlinear parameters at the optimum."""

    values: Array
    """(p,)"""
    residuals: list[Array]
    """(n_i, m); in standard deviations"""
    sensitivities: list[Array]
    """(n_i, m, p); of the model, linear unknowns projected out, in standard deviations"""
    linear: int
    """-; how many unknowns were projected out"""
    deviation: Array
    """(m,); standard deviation of the outputs' residuals"""
    gains: tuple[Array, ...]
    """m of (g,); the shared coefficients"""
    failure: str = ""
    """-; why the numbers may not be used"""


Build = Callable[[Array], list[Piece]]


def residuals_at(build: Build, values: Array) -> tuple[list[Array], tuple[Array, ...]]:
    """Residuals (n_i, m) with all linear unknowns at their optimum, and the shared ones, m of (g,)."""
    pieces = build(values)
    bases = _bases({id(own): own for piece in pieces for own in piece.own})
    columns, gains = [], []
    for output in range(len(pieces[0].own)):
        column, gain = _output_residuals(pieces, output, bases)
        columns.append(column)
        gains.append(gain)
    bounds = np.cumsum([len(piece.measured) for piece in pieces])[:-1]
    return np.split(np.column_stack(columns), bounds), tuple(gains)


def _output_residuals(pieces: list[Piece], output: int, bases: dict[int, Array]) -> tuple[Array, Array]:
    own, design, scale = _without_own(pieces, output, bases)
    rests = [
        piece.measured[:, output] - basis @ (basis.T @ piece.measured[:, output])
        for piece, basis in zip(pieces, own, strict=True)
    ]
    rest = np.concatenate(rests)
    if not design.shape[1]:
        return rest, np.zeros(0)
    gains = np.linalg.lstsq(design / scale, rest, rcond=DEPENDENT)[0] / scale
    return rest - design @ gains, gains


def _without_own(pieces: list[Piece], output: int, bases: dict[int, Array]) -> tuple[list[Array], Array, Array]:
    """Bases of what is each record's own, what is shared without it (n, g), and the columns' lengths (g,)."""
    own = [bases[id(piece.own[output])] for piece in pieces]
    designs = [
        piece.shared[output] - basis @ (basis.T @ piece.shared[output])
        for piece, basis in zip(pieces, own, strict=True)
    ]
    design = np.vstack(designs)
    return own, design, np.maximum(np.linalg.norm(design, axis=0), 1e-300)


def _bases(distinct: dict[int, Array]) -> dict[int, Array]:
    """An orthonormal basis of the columns of each array (n, l); those of one shape in one go."""
    bases: dict[int, Array] = {}
    for shape in {own.shape for own in distinct.values()}:
        alike = {key: own for key, own in distinct.items() if own.shape == shape}
        stack = np.stack(list(alike.values()))
        stack = stack / np.maximum(np.abs(stack).max(axis=1, keepdims=True), 1e-300)  # squares of 1e200 overflow
        norms = np.maximum(np.linalg.norm(stack, axis=1, keepdims=True), 1e-300)
        bases.update(zip(alike, np.linalg.qr(stack / norms)[0], strict=True))
    return bases


def squares(build: Build, values: Array) -> float:
    """Sum over the outputs of the logarithm of the residuals' squares: the concentrated likelihood of ``values``."""
    residuals, _ = residuals_at(build, values)
    return float(np.sum(np.log(np.sum(np.vstack(residuals) ** 2, axis=0) + 1e-300)))


def solve(build: Build, start: Array, precision: Array | None = None) -> SeparableFit:
    """The nonlinear parameters from ``start`` (p,) by Levenberg-Marquardt.

    ``precision`` (p,) is one over the standard deviation of a Gaussian prior about zero, 0 without one.
    """
    values, deviation = start, np.ones(1)
    for _ in range(PASSES):
        residuals, _ = residuals_at(build, values)
        deviation = np.maximum(np.sqrt(np.mean(np.vstack(residuals) ** 2, axis=0)), 1e-300)
        weighted = _weighted(build, deviation, precision)
        found = least_squares(
            weighted, values, method="lm", x_scale="jac", xtol=TOLERANCE, ftol=TOLERANCE, max_nfev=EVALUATIONS
        )
        values = found.x
    residuals, gains = residuals_at(build, values)
    failure = "" if found.success and np.all(np.isfinite(found.jac)) else "the fit did not converge"
    bounds = np.cumsum([len(piece) for piece in residuals])
    jacobian = found.jac[: bounds[-1] * len(deviation)]
    slopes = np.split(-jacobian.reshape(-1, len(deviation), len(values)), bounds[:-1])
    pieces = build(values)
    linear = sum(own.shape[1] for piece in pieces for own in piece.own) + sum(len(gain) for gain in gains)
    return SeparableFit(values, [r / deviation for r in residuals], slopes, linear, deviation, gains, failure)


def joint_sensitivities(build: Build, fit: SeparableFit) -> list[Array]:
    """Sensitivities (n_i, m, p + g) of a ``fit``'s outputs to its nonlinear and shared linear parameters.

    In standard deviations, with each record's linear nuisance parameters projected out.
    """
    pieces, steps = build(fit.values), np.maximum(np.abs(fit.values), 1e-2) * 1e-6
    bases = _bases({id(own): own for piece in pieces for own in piece.own})
    moved = [(build(fit.values + step), build(fit.values - step)) for step in np.diag(steps)]
    p, total = len(fit.values), sum(map(len, fit.gains))
    sensitivities = [np.zeros((*piece.measured.shape, p + total)) for piece in pieces]
    column = p
    for output, gains in enumerate(fit.gains):
        for n, piece in enumerate(pieces):
            own, shared = piece.own[output], piece.shared[output]
            nuisance = np.linalg.lstsq(own, piece.measured[:, output] - shared @ gains, rcond=None)[0].astype(
                np.float64
            )
            models = [[_model(one[n], output, nuisance, gains) for one in both] for both in moved]
            slopes = [(ahead - behind) / (2 * step) for (ahead, behind), step in zip(models, steps, strict=True)]
            basis, whole = bases[id(own)], np.column_stack((*slopes, shared))
            rest = (whole - basis @ (basis.T @ whole)) / fit.deviation[output]
            sensitivities[n][:, output, :p] = rest[:, :p]
            sensitivities[n][:, output, column : column + len(gains)] = rest[:, p:]
        column += len(gains)
    return sensitivities


def _model(piece: Piece, output: int, nuisance: Array, gains: Array) -> Array:
    return np.asarray(piece.own[output] @ nuisance + piece.shared[output] @ gains)


def _weighted(build: Build, deviation: Array, precision: Array | None) -> Callable[[Array], Array]:
    def weighted(values: Array) -> Array:
        flat: Array = (np.vstack(residuals_at(build, values)[0]) / deviation).ravel()
        return flat if precision is None else np.concatenate((flat, values * precision))

    return weighted
