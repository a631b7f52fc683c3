"""Equation error in the frequency domain: each equation of motion is one complex linear regression.

Grauer Eq. 20 and 21 after a finite Fourier transform of the stroke-averaged records (Klein & Morelli,
Aircraft System Identification, 2006, ch. 7). The speeds u and w are not measured: they are integrated from
the specific forces and the pitch rate; the drift that the biases leave in them is a nuisance of each record.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from avionics.constants import STANDARD_GRAVITY
from logs.identification.data import Aircraft
from logs.identification.modes.errors import Spread, with_scatter
from logs.identification.modes.longitudinal import REGRESSORS
from logs.identification.preparing.manoeuvre import Manoeuvre, Reference, lagged
from logs.identification.results import Array

HIGHEST = 0.5
"""-; of the flapping frequency: the stroke average leaves little above it"""
DRIFT_ORDER = 2
SPEED_PASSES = 3
"""-; of putting the speeds found into the products that they were found with: a fourth changes 1e-4 of their range"""
WORST_CONDITION = 1e3


class DerivativeFit(NamedTuple):
    """Derivatives of `logs.identification.modes.longitudinal` as one method found them."""

    names: tuple[str, ...]
    """-; (p,)"""
    values: Array
    """as `longitudinal.UNITS`; (p,)"""
    covariance: Array
    """(p, p)"""
    degrees: float
    """-; effective degrees of freedom"""
    scatter: Array
    """standard deviation of the residuals of each equation or output"""
    failure: str = ""
    """-; why the numbers may not be used, empty when they may"""


class Signals(NamedTuple):
    """Stroke averages of one manoeuvre."""

    regressors: Array
    """(M, 4); u m/s, w m/s, q rad/s, tail angle rad"""
    responses: Array
    """(M, 3); f_x m/s^2, f_z m/s^2 at the centre of mass, pitch acceleration rad/s^2"""


def signals(manoeuvre: Manoeuvre, reference: Reference, aircraft: Aircraft) -> Signals:
    """Stroke averages of what the equations of motion relate; u and w as `_speeds` reconstructs them."""
    q, a_x, a_z, _ = manoeuvre.raw.T
    q_dot = np.gradient(q, manoeuvre.time[1] - manoeuvre.time[0])
    f_x, f_z = a_x - aircraft.imu_z * q_dot, a_z + aircraft.imu_x * q_dot
    u, w = _speeds(manoeuvre, reference, f_x, f_z)
    averages = manoeuvre.averaging @ np.column_stack((u, w, q, manoeuvre.tail, f_x, f_z, q_dot))
    return Signals(averages[:, :4], averages[:, 4:])


def _speeds(manoeuvre: Manoeuvre, reference: Reference, f_x: Array, f_z: Array) -> tuple[Array, Array]:
    """Airspeeds u and w (N,) in m/s by the kinematics as they are (Klein & Morelli, ch. 10, data compatibility).

    The speeds in the products u q and w q are those of every sample, not the reference's: w is the small
    difference of f_z and u q, and the 2 % by which the input moves u become 4 % of w, in step with it, which no
    instrument takes out. Each sensor's bias is taken for the one that leaves the speeds no trend, the means for
    those of the manoeuvre's airspeed along the reference's direction.
    """
    q, pitch = manoeuvre.raw[:, 0], manoeuvre.raw[:, 3]
    step = manoeuvre.time[1] - manoeuvre.time[0]
    share = manoeuvre.airspeed / np.hypot(reference.u, reference.w)
    means = share * reference.u, share * reference.w
    u, w = (np.full(len(q), mean) for mean in means)
    for _ in range(SPEED_PASSES):
        rates = f_x - w * q - STANDARD_GRAVITY * np.sin(pitch), f_z + u * q + STANDARD_GRAVITY * np.cos(pitch)
        u, w = (_about(mean, _integrate(rate - rate.mean(), step)) for mean, rate in zip(means, rates, strict=True))
    return u, w


def _about(mean: float, values: Array) -> Array:
    moved: Array = mean + values - values.mean()
    return moved


def _integrate(rate: Array, step: float) -> Array:
    return np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) * step / 2)))


def fourier(manoeuvre: Manoeuvre, columns: Array) -> Array:
    """Finite Fourier transform of ``columns`` (M, k) at the record's own frequencies: (2 F, k), real first."""
    length = manoeuvre.at[-1] - manoeuvre.at[0]
    frequencies = np.arange(1, max(int(HIGHEST / manoeuvre.period * length), 1) + 1) / length
    kernel = np.exp(-2j * np.pi * np.outer(frequencies, manoeuvre.at - manoeuvre.at[0]))
    weights = np.gradient(manoeuvre.at)
    weights[[0, -1]] /= 2
    transform = kernel @ (columns * weights[:, None]) / np.sqrt(length)
    stacked: Array = np.vstack((transform.real, transform.imag))
    return stacked


def _without_drift(manoeuvre: Manoeuvre, pair: Signals) -> tuple[Array, Array, int]:
    """Regressors and responses in the frequency domain, orthogonal to a polynomial drift; and what that cost."""
    position = np.linspace(-1, 1, len(manoeuvre.at))
    drift = np.column_stack([position**power for power in range(1, DRIFT_ORDER + 1)])
    basis = np.linalg.qr(fourier(manoeuvre, drift))[0]
    both = fourier(manoeuvre, np.hstack(pair))
    rest = both - basis @ (basis.T @ both)
    count = pair.regressors.shape[1]
    return rest[:, :count], rest[:, count:], basis.shape[1]


def equation_error(
    manoeuvres: tuple[Manoeuvre, ...],
    reference: Reference,
    aircraft: Aircraft,
    names: tuple[str, ...],
    instruments: list[Array] | None = None,
) -> DerivativeFit:
    """Derivatives ``names`` from all manoeuvres at once (Grauer Eq. 20, 21).

    The integrated speeds carry the sensors' noise, which least squares takes for a smaller derivative.
    ``instruments``, (M, 4) of each manoeuvre, are the regressors without that noise, as a model that was flown
    along has them: with them the estimate is that of instrumental variables (Klein & Morelli, ch. 5).
    """
    pieces = [_without_drift(m, signals(m, reference, aircraft)) for m in manoeuvres]
    axes, kept = _axes(names), _kept(names)
    design = np.vstack([piece[0] for piece in pieces])[:, kept]
    response = np.vstack([piece[1] for piece in pieces])[:, axes]
    degrees = float(len(design) - sum(piece[2] for piece in pieces) - len(kept))
    scale = np.linalg.norm(design, axis=0)
    if degrees < 1 or not np.all(scale > 0) or np.linalg.cond(design / scale) > WORST_CONDITION:
        return failed(names, "the manoeuvres do not excite all of the model's states")
    clean = design
    if instruments is not None:
        pairs = zip(manoeuvres, instruments, strict=True)
        clean = np.vstack([_without_drift(m, Signals(z, z))[0] for m, z in pairs])[:, kept]
    inverse = np.linalg.inv(clean.T @ design)
    values = inverse @ clean.T @ response
    residuals = response - design @ values
    scatter: Array = np.sqrt(np.sum(residuals**2, axis=0) / degrees)
    bounds = np.cumsum([0] + [len(piece[0]) for piece in pieces])
    scores = [_score(clean[a:b], residuals[a:b]) for a, b in pairwise(bounds)]
    variance = residuals.T @ residuals / degrees
    covariance = np.asarray(np.kron(variance, inverse @ (clean.T @ clean) @ inverse.T), dtype=np.float64)
    spread = with_scatter(Spread(covariance, degrees), np.kron(np.eye(len(variance)), inverse), scores)
    return DerivativeFit(names, values.T.ravel(), spread.covariance, spread.degrees, scatter)


def _score(clean: Array, residuals: Array) -> Array:
    """Gradient (axes x kept,) of one manoeuvre's squares."""
    gradient: Array = (clean.T @ residuals).T.ravel()
    return gradient


def failed(names: tuple[str, ...], why: str) -> DerivativeFit:
    """A fit without numbers, and why."""
    size = len(names)
    return DerivativeFit(names, np.full(size, np.nan), np.full((size, size), np.nan), 1.0, np.zeros(0), why)


def _axes(names: tuple[str, ...]) -> list[int]:
    return [row for row, axis in enumerate("XZM") if any(name.startswith(axis) for name in names)]


def _kept(names: tuple[str, ...]) -> list[int]:
    return [column for column, regressor in enumerate(REGRESSORS) if f"M_{regressor}" in names]


def likely_lag(
    manoeuvres: tuple[Manoeuvre, ...], reference: Reference, aircraft: Aircraft, names: tuple[str, ...]
) -> float:
    """Time constant (s) of the tail with which the pitching-moment equation fits best, of 0 to 0.2 s."""

    def scatter(constant: float) -> float:
        tried = aircraft._replace(tail_time_constant=constant)
        fit = equation_error(tuple(lagged(m, tried) for m in manoeuvres), reference, tried, names)
        return float("inf") if fit.failure else float(fit.scatter[-1])

    return min((0.005 * k for k in range(41)), key=scatter)
