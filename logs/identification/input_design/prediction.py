"""Predicted standard errors after a planned maneuver, with noise of the sensors and gusts.

The Cramer-Rao bound of output error (Klein & Morelli, Aircraft System Identification, 2006, ch. 6 and 9.3), with a
free initial state and a bias of each output. The outputs of a flapping aircraft are averaged over strokes: adjacent
averages share samples, so the bound is that of least squares with colored noise. In gusts the residuals are colored
by the aircraft's motion; their covariance is that of a stationary gust through the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.sparse import csr_array, eye_array

from logs.identification.data.maneuvers import OUTPUT_STEP, Maneuver
from logs.identification.data.resampling import averaging_matrix
from logs.identification.input_design.response import OUTPUTS, Prior, Response, Waveform, respond
from logs.identification.models.modes import short_period_of
from logs.identification.models.stroke_averaged import LONGITUDINAL, UNITS, matrices
from logs.identification.results import Array
from logs.identification.statistics.covariance import (
    Autocovariance,
    ParameterUncertainty,
    colored_information,
    propagate,
)
from wingbeat.errors import InputError

WORST_CONDITION = 1e12
FORGOTTEN = 1e-3
"""-; correlation of gusts below which lags are left out"""
MODE_UNITS = {"short_period_frequency": "rad/s", "short_period_damping": "-"}


class Gust(NamedTuple):
    """Turbulence, first-order along and across the path (after Dryden, MIL-F-8785C)."""

    sigma: float
    """m/s; standard deviation of each component"""
    scale: float = 20.0
    """m; length over which it is correlated"""


class Predicted(NamedTuple):
    """One parameter, and what will be uncertain about it."""

    name: str
    """-; symbol of a derivative, or of the mode"""
    unit: str
    """-; its unit"""
    value: float
    """as `unit`; of the prior"""
    standard_error: float
    """as `unit`; predicted"""


def predicted_covariance(prior: Prior, planned: Waveform, response: Response, gust: Gust | None = None) -> Array:
    """Covariance (12, 12) of the derivatives after one maneuver.

    Raises:
        InputError: the maneuver does not tell all derivatives apart, or gusts on an aircraft whose motion grows.
    """
    if prior.residuals is not None and prior.wing_period and gust is None:
        return _covariance_by_residuals(prior, [(planned, response)], prior.residuals)
    averaging, windy = _averaging(prior, planned), gust is not None and gust.sigma > 0.0
    gusts = _gust_autocovariance(prior, gust, len(planned.time)) if gust is not None and windy else None
    noise = np.array(prior.noise) * np.sqrt(float(np.mean(averaging.power(2).sum(axis=1))))
    if gusts is not None:
        noise = np.sqrt(noise**2 + np.diag(gusts.lags[0]))
    averaged = _averaged(averaging, response.sensitivities) / noise[:, None]
    free = _without(_nuisances(averaging, response.starts, noise), averaged)
    inverse = _inverse_information(free)
    weights = np.stack([averaging.T @ free[:, i] for i in range(len(OUTPUTS))], axis=1) / noise[:, None]
    core = np.einsum("nip,i,niq->pq", weights, np.square(prior.noise), weights)
    if gusts is not None:
        core = core + colored_information([_coarser(weights, _stride(prior))], gusts)
    covariance: Array = inverse @ core @ inverse
    return covariance


def _inverse_information(free: Array) -> Array:
    """Inverse (p, p) of the information of sensitivities (M, m, p).

    Raises:
        InputError: it is singular.
    """
    information = np.einsum("nip,niq->pq", free, free)
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0) or np.linalg.cond(information / np.outer(size, size)) > WORST_CONDITION:
        raise InputError("this input does not tell all derivatives apart: make it longer, or of more frequencies")
    inverse: Array = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    return inverse


def _covariance_by_residuals(
    prior: Prior, maneuvers: Sequence[tuple[Waveform, Response]], residuals: Autocovariance
) -> Array:
    """Covariance (12, 12) of least squares with colored residuals of an earlier flight (Morelli & Klein, 1997)."""
    noise, free = np.sqrt(np.diag(residuals.lags[0])), []
    for planned, response in maneuvers:
        averaging = _averaging(prior, planned)
        averaged = _averaged(averaging, response.sensitivities) / noise[:, None]
        free.append(_without(_nuisances(averaging, response.starts, noise), averaged))
    inverse = _inverse_information(np.concatenate(free))
    core = colored_information([one / noise[:, None] for one in free], residuals)
    covariance: Array = prior.inflation**2 * inverse @ core @ inverse
    return covariance


def inflation(prior: Prior, maneuvers: Sequence[Maneuver], errors: Mapping[str, float]) -> float:
    """Standard errors of a flight over those predicted for its own inputs, quadratic mean over the derivatives.

    It contains what the prediction neglects: differences between maneuvers beyond the residuals' autocovariance.

    Args:
        prior: of the flight, with its residuals.
        maneuvers: of the flight.
        errors: standard errors by derivative that the flight left.
    """
    names = [name for name in LONGITUDINAL if errors.get(name, 0.0) > 0.0]
    if prior.residuals is None or not prior.wing_period or not names:
        return 1.0
    flown = []
    for one in maneuvers:
        margin = prior.wing_period / 2 + 2 * prior.step
        planned = Waveform(one.command_time, one.command, margin, float(one.command_time[-1]) - margin)
        flown.append((planned, respond(prior, planned)))
    try:
        covariance = _covariance_by_residuals(prior._replace(inflation=1.0), flown, prior.residuals)
    except InputError:
        return 1.0
    bounds = dict(zip(LONGITUDINAL, np.sqrt(np.diag(covariance)), strict=True))
    return float(np.sqrt(np.mean([(errors[name] / bounds[name]) ** 2 for name in names])))


def predict(prior: Prior, covariance: Array, repeats: int = 1) -> tuple[Predicted, ...]:
    """The mode's frequency and damping, then every derivative, after ``repeats`` of a maneuver.

    Raises:
        InputError: the prior has no short period.
    """
    covariance = covariance / repeats

    def mode(values: Array) -> Array:
        return np.array(short_period_of(matrices(LONGITUDINAL, values, prior.reference, prior.aircraft).a))

    try:
        both, uncertainty = propagate(mode, prior.values, ParameterUncertainty(covariance, np.inf))
    except ValueError as error:
        raise InputError(f"the prior model has no short period: {error}") from None
    rows = zip(
        (*MODE_UNITS, *LONGITUDINAL),
        (*both, *prior.values),
        (*uncertainty.standard_errors, *np.sqrt(np.diag(covariance))),
        strict=True,
    )
    return tuple(Predicted(n, (UNITS | MODE_UNITS)[n], float(value), float(error)) for n, value, error in rows)


def _stride(prior: Prior) -> int:
    """Samples over which gusts and their response hardly change."""
    return max(round(OUTPUT_STEP / prior.step), 1)


def _coarser(weights: Array, stride: int) -> Array:
    """Sums (N / stride, m, p) of ``weights`` (N, m, p) over ``stride`` samples each."""
    summed: Array = np.add.reduceat(weights, np.arange(0, len(weights), stride), axis=0)
    return summed


def _averaging(prior: Prior, planned: Waveform) -> csr_array:
    """From samples to what is fitted: stroke averages, or the samples themselves."""
    if not prior.wing_period:
        return csr_array(eye_array(len(planned.time)))
    at = np.arange(planned.start, planned.end, OUTPUT_STEP)
    return averaging_matrix(planned.time, np.full(len(at), prior.wing_period), at)


def _averaged(averaging: csr_array, columns: Array) -> Array:
    """Averages (M, m, k) of ``columns`` (N, m, k)."""
    flat: Array = averaging @ columns.reshape(len(columns), -1)
    return flat.reshape(-1, *columns.shape[1:])


def _nuisances(averaging: csr_array, starts: Array, noise: Array) -> Array:
    """Columns (M, m, 4 + m) of the initial state and of a bias of each output, in standard deviations."""
    free = _averaged(averaging, starts) / noise[:, None]
    biases = np.broadcast_to(np.eye(free.shape[1]), (len(free), free.shape[1], free.shape[1]))
    return np.concatenate((free, biases), axis=2)


def _without(nuisances: Array, columns: Array) -> Array:
    """``columns`` (M, m, k) less what the nuisances can explain of them."""
    flat, known = columns.reshape(-1, columns.shape[2]), nuisances.reshape(-1, nuisances.shape[2])
    left, sizes, _ = np.linalg.svd(known / np.linalg.norm(known, axis=0), full_matrices=False)
    basis = left[:, sizes > 1e-8 * sizes[0]]
    rest: Array = (flat - basis @ (basis.T @ flat)).reshape(columns.shape)
    return rest


def _gust_autocovariance(prior: Prior, gust: Gust, samples: int) -> Autocovariance:
    """Autocovariance (L, 3, 3) of the outputs in gusts along x and z, by lag in strides of `_stride`."""
    model, pole = prior.model(), prior.reference.airspeed / gust.scale
    force = prior.values.reshape(3, 4)[:, :2]
    x, z, m = force
    at_imu = np.array([np.zeros(2), x + prior.aircraft.imu_z * m, z - prior.aircraft.imu_x * m])
    whole = np.block([[model.a, np.vstack((-force, np.zeros(2)))], [np.zeros((2, 4)), -pole * np.eye(2)]])
    if np.max(np.linalg.eigvals(whole).real) >= 0.0:
        raise InputError("the prior model's motion grows by itself: its errors in gusts cannot be predicted")
    drive = np.diag([0.0, 0.0, 0.0, 0.0, 1.0, 1.0]) * 2.0 * pole * gust.sigma**2
    spread = solve_continuous_lyapunov(whole, -drive)
    c = np.hstack((model.c[: len(OUTPUTS)], -at_imu))
    once, power, lags = expm(whole * prior.step * _stride(prior)), np.eye(6), []
    for _ in range(0, samples, _stride(prior)):
        lags.append(c @ spread @ power.T @ c.T)
        power = once @ power
        if np.max(np.abs(power)) < FORGOTTEN:
            break
    return Autocovariance(np.array(lags), 0.0)
