"""Natural frequency and damping of a wing's twist after a release or step (Gerdes Eq. 16).

Separable least squares of a damped oscillation; amplitude, phase and rest position are nuisance parameters. In the
second term of Eq. 16 the print has theta_0 for the rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from logs.identification.data.experiment import Experiment
from logs.identification.data.noise_level import noise_with_steps
from logs.identification.estimators.separable import SeparableRecord, log_squares, orthonormal, solve
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, EstimationResult, linear_result
from logs.identification.statistics.covariance import ParameterUncertainty, colored_covariance, information, propagate
from wingbeat.errors import InputError

DAMPING, NATURAL = "twist_damping", "twist_natural_frequency"
EQUATIONS = (
    "twist = exp(-zeta omega t) (A cos(omega_d t) + B sin(omega_d t)) + rest, omega_d = omega sqrt(1 - zeta^2)"
    " (Gerdes Eq. 16)",
)
MIN_SAMPLES = 16
FREQUENCIES, DAMPINGS = 80, (0.05, 0.2, 0.5, 0.8)
"""-; grid of start values"""
LOCKED = 8.0
"""-; standard deviations of the noise about the greatest excursion, within which the wing is not released"""
SIGNIFICANCE = 1e-4
"""-; p-value of the oscillation over the grid"""


class Swing(NamedTuple):
    """A release as measured and by Eq. 16."""

    time: Array
    """s; (N,), from the release on"""
    measured: Array
    """as the signal; (N,), NaN if not measured"""
    model: Array
    """as the signal; (N,)"""


def identify_twist(test: Experiment, signal: str = "twist") -> EstimationResult:
    """Natural frequency, damping ratio and damped frequency from a release or step; NaN samples are left out.

    Raises:
        InputError: no such signal, too few samples.
    """
    if signal not in test.signals:
        raise InputError(f"the test {test.name} has no signal {signal!r}; it has {', '.join(test.signals)}")
    time, swing = _from_release(test.time, np.asarray(test.signals[signal], dtype=float))
    known = np.isfinite(swing)
    count = int(known.sum())
    if count < MIN_SAMPLES:
        raise InputError(f"the test {test.name} has {count} samples after its release, fewer than {MIN_SAMPLES}")
    if float(np.ptp(swing[known])) == 0.0:
        return _withheld("the twist does not move", 0.0, count)
    used = known.astype(np.float64)[:, None]
    values = np.where(known, swing, 0.0)[:, None]

    def build(at: Array) -> list[SeparableRecord]:
        basis = orthonormal(_columns(time, math.exp(min(at[0], 50.0)), float(at[1])) * used)
        return [SeparableRecord(values, (basis,), (basis[:, :0],))]

    turns = np.geomspace(0.3, len(time) / 4.0, FREQUENCIES)
    starts = [np.array([math.log(2 * math.pi * turn / time[-1]), z]) for turn in turns for z in DAMPINGS]
    fit = solve(build, min(starts, key=lambda start: log_squares(build, start)))
    deviation, fitted = float(fit.deviation[0]), fit.nuisances + len(fit.values)
    if not 0.0 < fit.values[1] < 0.995:
        return _withheld("the twist does not swing: its damping ratio is 1 or more, or below 0", deviation, count)
    inverse = np.asarray(np.linalg.pinv(information(fit.sensitivities)), dtype=np.float64)
    covariance, degrees = colored_covariance(fit.residuals, [used], fit.sensitivities, inverse, fitted)
    about = float(np.sum((swing[known] - swing[known].mean()) ** 2))
    squares = float(np.sum(fit.residuals[0] ** 2)) * deviation**2
    ratio = (about / max(squares, 1e-300) - 1.0) * degrees / (fitted - 1)
    spread = ParameterUncertainty(covariance, degrees)
    lost = not np.all(np.isfinite(covariance)) or spread.standard_errors[1] > 0.5 * fit.values[1]
    if lost or fdtrc(fitted - 1, degrees, ratio) * len(starts) > SIGNIFICANCE:
        return _withheld("the swing does not stand out of the noise", deviation, count)

    def numbers(at: Array) -> Array:
        natural = math.exp(at[0])
        return np.array([natural, at[1], natural * math.sqrt(max(1.0 - at[1] ** 2, 0.0))])

    names = {NATURAL: "rad/s", DAMPING: "-", "twist_damped_frequency": "rad/s"}
    central, worth = propagate(numbers, fit.values, spread)
    return _result(worth.estimates(names, central), (), deviation, count)


def swing_of(test: Experiment, signal: str, natural: float, damping: float) -> Swing:
    """Gerdes Eq. 16 with ``natural`` frequency (rad/s) and ``damping`` (-); amplitude, phase and rest are fitted."""
    time, swing = _from_release(test.time, np.asarray(test.signals[signal], dtype=float))
    known, columns = np.isfinite(swing), _columns(time, natural, damping)
    model = columns @ np.linalg.lstsq(columns[known], swing[known], rcond=None)[0]
    return Swing(np.asarray(test.time[len(test.time) - len(time) :]), swing, np.asarray(model))


def _from_release(time: Array, values: Array) -> tuple[Array, Array]:
    """The record from the last sample near the greatest excursion from the final rest."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return time[:0], values[:0]
    rest = float(np.median(values[known[-max(len(known) // 5, 1) :]]))
    excursion = np.abs(values[known] - rest)
    top = int(np.argmax(excursion))
    released = excursion[top:] <= excursion[top] - LOCKED * noise_with_steps(values[known])
    free = np.flatnonzero(released[:-1] & released[1:])  # two in a row: one may be an outlier
    first = int(known[top + max(int(free[0]) - 1, 0)]) if len(free) else int(known[top])
    return time[first:] - time[first], values[first:]


def _columns(time: Array, natural: float, damping: float) -> Array:
    """Columns (N, 3): cosine and sine of Eq. 16, and the rest position."""
    damped = natural * math.sqrt(max(1.0 - damping**2, 1e-9))
    decay = np.exp(np.clip(-damping * natural * time, -300.0, 300.0))
    return np.column_stack((decay * np.cos(damped * time), decay * np.sin(damped * time), np.ones_like(time)))


def _withheld(reason: str, deviation: float, count: int) -> EstimationResult:
    lost = tuple(not_estimated(name, reason) for name in (NATURAL, DAMPING))
    return _result((), lost, deviation, count)


def _result(
    parameters: tuple[Estimate, ...], withheld: tuple[Finding, ...], deviation: float, count: int
) -> EstimationResult:
    return linear_result(
        "twist", parameters, withheld, residual_deviation=deviation, samples=count, title="twist", equations=EQUATIONS
    )
