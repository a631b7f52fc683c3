"""Equation error in the frequency domain: each equation of motion is one complex linear regression.

Grauer Eq. 20 and 21 after a finite Fourier transform of the stroke-averaged records (Klein & Morelli,
Aircraft System Identification, 2006, ch. 7). The speeds u and w are not measured: they are integrated from
the specific forces and the pitch rate; the drift that the biases leave in them is a nuisance of each record.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data import Aircraft
from logs.identification.longitudinal import REGRESSORS
from logs.identification.manoeuvre import GRAVITY, Manoeuvre, Reference, lagged
from logs.identification.results import Array

HIGHEST = 0.5
"""-; of the flapping frequency: the stroke average leaves little above it"""
DRIFT_ORDER = 2
WORST_CONDITION = 1e3


class DerivativeFit(NamedTuple):
    """Derivatives of `logs.identification.longitudinal` as one method found them."""

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
    """Stroke averages of what the equations of motion relate; u and w by integration from zero."""
    q, a_x, a_z, pitch = manoeuvre.raw.T
    step = manoeuvre.time[1] - manoeuvre.time[0]
    q_dot = np.gradient(q, step)
    f_x, f_z = a_x - aircraft.imu_z * q_dot, a_z + aircraft.imu_x * q_dot
    tilt = pitch - pitch.mean()
    u_dot = f_x - reference.w * q - GRAVITY * np.cos(reference.pitch) * tilt
    w_dot = f_z + reference.u * q - GRAVITY * np.sin(reference.pitch) * tilt
    u, w = (_integrate(rate - rate.mean(), step) for rate in (u_dot, w_dot))
    averages = manoeuvre.averaging @ np.column_stack((u, w, q, manoeuvre.tail, f_x, f_z, q_dot))
    return Signals(averages[:, :4], averages[:, 4:])


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
    manoeuvres: tuple[Manoeuvre, ...], reference: Reference, aircraft: Aircraft, names: tuple[str, ...]
) -> DerivativeFit:
    """Derivatives ``names`` from all manoeuvres at once (Grauer Eq. 20, 21)."""
    pieces = [_without_drift(m, signals(m, reference, aircraft)) for m in manoeuvres]
    axes, kept = _axes(names), _kept(names)
    design = np.vstack([piece[0] for piece in pieces])[:, kept]
    response = np.vstack([piece[1] for piece in pieces])[:, axes]
    degrees = float(len(design) - sum(piece[2] for piece in pieces) - len(kept))
    scale = np.linalg.norm(design, axis=0)
    if degrees < 1 or not np.all(scale > 0) or np.linalg.cond(design / scale) > WORST_CONDITION:
        return failed(names, "the manoeuvres do not excite all of the model's states")
    inverse = np.linalg.inv(design.T @ design)
    values = inverse @ design.T @ response
    residuals = response - design @ values
    variance = residuals.T @ residuals / degrees
    return DerivativeFit(names, values.T.ravel(), np.kron(variance, inverse), degrees, np.sqrt(np.diag(variance)))


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
