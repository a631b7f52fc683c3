"""Equation error in the frequency domain: each equation of motion is one complex linear regression.

Grauer Eq. 20 and 21 after a finite Fourier transform of the stroke-averaged records (Klein & Morelli,
Aircraft System Identification, 2006, ch. 7). The speeds u and w are not measured: they are integrated from
the specific forces and the pitch rate; the drift that the biases leave in them is a nuisance of each record.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Manoeuvre, Reference, lagged
from logs.identification.estimators.flight.modulation import LEAST_MANOEUVRES
from logs.identification.models.stroke_averaged import REGRESSORS
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread, by_scatter
from wingbeat.constants import STANDARD_GRAVITY

HIGHEST = 0.5
"""-; of the flapping frequency: the stroke average leaves little above it"""
DRIFT_ORDER = 2
SPEED_PASSES = 3
"""-; of putting the speeds found into the products that they were found with: a fourth changes 1e-4 of their range"""
HARMONICS = 3
"""-; of the flapping frequency that shake the speeds: an integral has little of the higher ones"""
WORST_CONDITION = 1e3
WEAKEST = 0.1
"""-; least correlation of what instruments tell with what regressors do: with less, noise makes the estimate"""
UNEXCITED = "the manoeuvres do not excite all of the model's states"


NOTHING = np.zeros(0)


class DerivativeFit(NamedTuple):
    """Derivatives of `logs.identification.models.stroke_averaged` as one method found them."""

    names: tuple[str, ...]
    """-; (p,)"""
    values: Array
    """as `longitudinal.UNITS`; (p,)"""
    spread: Spread
    """what they are worth"""
    scatter: Array
    """standard deviation of the residuals of each equation or output"""
    failure: str = ""
    """-; why the numbers may not be used, empty when they may"""
    lack: Array = NOTHING
    """by what a dynamic that the model lacks and the data ask for moves the values, (p,), empty where they do not"""
    explained: float = 1.0
    """-; share of the pitch rate's power by the elevator, 1 where it was not looked at"""
    swing: Array = NOTHING
    """factors (12,) of `modulation.swing`, empty where too few manoeuvres tell them"""


class Signals(NamedTuple):
    """Stroke averages of one manoeuvre."""

    regressors: Array
    """(M, 4); u m/s, w m/s, q rad/s, tail angle rad"""
    responses: Array
    """(M, 3); f_x m/s^2, f_z m/s^2 at the centre of mass, pitch acceleration rad/s^2"""


def signals(manoeuvre: Manoeuvre, reference: Reference, aircraft: Aircraft, flown: Array | None = None) -> Signals:
    """Stroke averages of what the equations of motion relate; u and w as `_speeds` reconstructs them.

    ``flown``, (M, 2 or more), are the stroke averages of u and w as a model flew them, None where none did.
    """
    q, a_x, a_z, _ = manoeuvre.raw.T
    q_dot = np.gradient(q, manoeuvre.time[1] - manoeuvre.time[0])
    f_x, f_z = a_x - aircraft.imu_z * q_dot, a_z + aircraft.imu_x * q_dot
    u, w = _speeds(manoeuvre, reference, (f_x, f_z), _trends(manoeuvre, flown))
    averages = manoeuvre.averaging @ np.column_stack((u, w, q, manoeuvre.tail, f_x, f_z, q_dot))
    return Signals(averages[:, :4], averages[:, 4:])


def _speeds(
    manoeuvre: Manoeuvre, reference: Reference, forces: tuple[Array, Array], trends: tuple[float | None, float | None]
) -> tuple[Array, Array]:
    """Airspeeds u and w (N,) in m/s by the kinematics as they are (Klein & Morelli, ch. 10, data compatibility).

    The speeds in the products u q and w q are those of every sample, not the reference's: w is the small
    difference of f_z and u q, and the 2 % by which the input moves u become 4 % of w, in step with it, which no
    instrument takes out. The means are those of the manoeuvre's airspeed along the reference's direction. The bias
    of each sensor is taken for the one that leaves the speeds their ``trends`` in m/s^2, or, where those are not
    known, as they began. A trend that is wrong is no polynomial any more once it is multiplied with the pitch rate:
    what it leaves is even in the input, cancels over inputs of both signs, and makes the manoeuvres look at odds.

    What shakes in step with the wings is taken out of speeds and pitch rate before they are multiplied: the
    derivatives are those of the averaged motion, whose kinematics output error has too. On average the shaking
    multiplies to a constant, which the bias takes (averaging to first order, see `modulation`). Out of the speeds
    alone was not enough: their changes times a shaking pitch rate were 0.3 % of w, and of a lightly damped aircraft's
    frequency 0.1 %, as wide as its interval.
    """
    q, pitch = manoeuvre.raw[:, 0], manoeuvre.raw[:, 3]
    step = manoeuvre.time[1] - manoeuvre.time[0]
    share = manoeuvre.airspeed / np.hypot(reference.u, reference.w)
    means = share * reference.u, share * reference.w
    u, w = (np.full(len(q), mean) for mean in means)
    shaking = _shaking(manoeuvre)
    slow_q = q - shaking @ (shaking.T @ q)
    for _ in range(SPEED_PASSES):
        changes = (speed - mean - shaking @ (shaking.T @ speed) for speed, mean in zip((u, w), means, strict=True))
        turned_u, turned_w = (mean * q + change * slow_q for change, mean in zip(changes, means, strict=True))
        rates = (
            forces[0] - turned_w - STANDARD_GRAVITY * np.sin(pitch),
            forces[1] + turned_u + STANDARD_GRAVITY * np.cos(pitch),
        )
        integrated = (_integrate(rate - rate.mean(), step) for rate in rates)
        drifted = [_with_trend(manoeuvre, one, trend) for one, trend in zip(integrated, trends, strict=True)]
        u, w = (mean + one - one.mean() for mean, one in zip(means, drifted, strict=True))
    return u, w


def _shaking(manoeuvre: Manoeuvre) -> Array:
    """Orthonormal waves (N, 2 `HARMONICS`) in step with the wings, orthogonal to a straight line."""
    turn = 2 * np.pi * np.outer(manoeuvre.strokes - manoeuvre.strokes[0], np.arange(1, HARMONICS + 1))
    line = np.vander(np.linspace(-1, 1, len(turn)), 2)
    basis: Array = np.linalg.qr(np.hstack((line, np.sin(turn), np.cos(turn))))[0][:, 2:]
    return basis


def _trends(manoeuvre: Manoeuvre, flown: Array | None) -> tuple[float | None, float | None]:
    """Of the ``flown`` averages of u and w, m/s^2."""
    return (None, None) if flown is None else (_slope(manoeuvre.at, flown[:, 0]), _slope(manoeuvre.at, flown[:, 1]))


def _slope(at: Array, values: Array) -> float:
    """Of the straight line nearest to ``values`` (M,) at times ``at`` (M,) in s."""
    about = at - at.mean()
    return float(about @ values / (about @ about))


def _with_trend(manoeuvre: Manoeuvre, values: Array, trend: float | None) -> Array:
    """``values`` (N,) of the samples with a straight line added, so that their stroke averages have the ``trend``."""
    if trend is None:
        return values
    tilted: Array = values + (trend - _slope(manoeuvre.at, manoeuvre.averaging @ values)) * manoeuvre.time
    return tilted


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


def _without_drift(manoeuvre: Manoeuvre, columns: Array) -> tuple[Array, int]:
    """``columns`` (M, k) in the frequency domain, (2 F, k), orthogonal to a polynomial drift; and what that cost."""
    position = np.linspace(-1, 1, len(manoeuvre.at))
    drift = np.column_stack([position**power for power in range(1, DRIFT_ORDER + 1)])
    basis = np.linalg.qr(fourier(manoeuvre, drift))[0]
    both = fourier(manoeuvre, columns)
    return both - basis @ (basis.T @ both), basis.shape[1]


def equation_error(
    manoeuvres: tuple[Manoeuvre, ...],
    reference: Reference,
    aircraft: Aircraft,
    names: tuple[str, ...],
    instruments: list[Array] | None = None,
) -> DerivativeFit:
    """Derivatives ``names`` from all manoeuvres at once (Grauer Eq. 20, 21).

    The integrated speeds carry the sensors' noise, which least squares takes for a smaller derivative.
    ``instruments``, (M, 8) of each manoeuvre, are the regressors without that noise and `modulation.products`, as a
    model that was flown along has them: with them the estimate is that of instrumental variables (Klein & Morelli,
    ch. 5).
    """
    known: list[Array | None] = [None] * len(manoeuvres) if instruments is None else [*instruments]
    found = [signals(m, reference, aircraft, one) for m, one in zip(manoeuvres, known, strict=True)]
    pieces = [_without_drift(m, np.hstack(pair)) for m, pair in zip(manoeuvres, found, strict=True)]
    both, axes, kept = np.vstack([piece[0] for piece in pieces]), _axes(names), _kept(names)
    bounds = np.cumsum([0] + [len(piece[0]) for piece in pieces])
    rows = _Rows(both[:, :4][:, kept], both[:, :4][:, kept], both[:, 4:][:, axes], bounds, pieces[0][1])
    if instruments is not None:
        flown = np.vstack([_without_drift(m, z)[0] for m, z in zip(manoeuvres, instruments, strict=True)])
        rows = rows._replace(clean=flown[:, :4][:, kept])
        rows = rows.more(flown[:, 4:]) if len(manoeuvres) >= LEAST_MANOEUVRES else rows
    fit = _regressed(rows, len(kept))
    return failed(names, UNEXCITED) if fit is None else fit._replace(names=names)


class _Rows(NamedTuple):
    """The equations of all manoeuvres, transformed, drifts taken out."""

    design: Array
    """(N, r)"""
    clean: Array
    """(N, r); instruments"""
    response: Array
    """(N, axes)"""
    bounds: Array
    """-; (K + 1,), rows at which the manoeuvres begin"""
    drifts: int
    """-; taken out of each manoeuvre"""

    def more(self, columns: Array) -> _Rows:
        """With ``columns`` (N, k) that are their own instruments."""
        design, clean = (np.hstack((part, columns)) for part in (self.design, self.clean))
        return self._replace(design=design, clean=clean)


def _regressed(rows: _Rows, count: int) -> DerivativeFit | None:
    """Values of the first ``count`` columns and, in the spread, what they are worth; None where not determined."""
    design, clean = rows.design, rows.clean
    degrees = float(len(design) - rows.drifts * (len(rows.bounds) - 1) - design.shape[1])
    scale = np.linalg.norm(design, axis=0)
    if degrees < 1 or not np.all(scale > 0) or np.linalg.cond(design / scale) > WORST_CONDITION:
        return None
    if clean is not design and not _least_correlation(clean, design) > WEAKEST:
        return None
    inverse = np.linalg.inv(clean.T @ design)
    values = inverse @ clean.T @ rows.response
    residuals = rows.response - design @ values
    within = Spread(_uneven(inverse[:count] @ clean.T, residuals * np.sqrt(len(design) / degrees)), degrees)
    spread = by_scatter(within, [residuals[a:b] for a, b in pairwise(rows.bounds)], _sensitivities(rows, count))
    scatter: Array = np.sqrt(np.sum(residuals**2, axis=0) / degrees)
    return DerivativeFit((), values[:count].T.ravel(), spread, scatter)


def _sensitivities(rows: _Rows, count: int) -> list[Array]:
    """(N_i, axes, axes x count); of each manoeuvre's responses to the values, the other columns taken out.

    As far as instruments tell the regressors: they make of the estimate one by least squares (two stages: Theil,
    Economic Forecasts and Policy, 1958).
    """
    told = _along(rows.clean, rows.design)
    slopes, axes = told[:, :count] - _along(told[:, count:], told[:, :count]), rows.response.shape[1]
    wide = np.asarray(np.kron(np.eye(axes), slopes), dtype=np.float64).reshape(axes, len(slopes), -1).swapaxes(0, 1)
    return [wide[a:b] for a, b in pairwise(rows.bounds)]


def _along(columns: Array, values: Array) -> Array:
    """What of ``values`` (N, k) lies in the space of ``columns`` (N, l)."""
    basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    return np.asarray(basis @ (basis.T @ values))


def _least_correlation(clean: Array, design: Array) -> float:
    """The least canonical correlation of instruments and regressors, (N, r) each; NaN where an instrument is nothing.

    Instruments that lack a direction of the regressors divide their noise by nearly nothing (Staiger & Stock,
    Econometrica 65, 1997).
    """
    sizes = np.linalg.norm(clean, axis=0)
    if not np.all(np.isfinite(clean)) or not np.all(sizes > 0):
        return float("nan")
    bases = [np.linalg.qr(part / np.linalg.norm(part, axis=0))[0] for part in (clean, design)]
    return float(np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[-1])


def _uneven(weights: Array, residuals: Array) -> Array:
    """Covariance of the values, axis by axis, by ``weights`` (p, N) of ``residuals`` (N, axes).

    The noise of a derivative grows with frequency: each row counts with its own square (White, Econometrica 48,
    1980). Neighbouring rows are not independent, so that the errors come out too large, of frequency and damping
    up to 1.4 times: where there are records enough the scatter between them takes their place.
    """
    parts = np.einsum("pn,na->apn", weights, residuals).reshape(-1, weights.shape[1])
    covariance: Array = parts @ parts.T
    return covariance


def failed(names: tuple[str, ...], why: str) -> DerivativeFit:
    """A fit without numbers, and why."""
    size = len(names)
    return DerivativeFit(names, np.full(size, np.nan), Spread(np.full((size, size), np.nan), 1.0), np.zeros(0), why)


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
