"""What a reconstructed flight path must not be believed: scales of sensors that read nothing, signals at odds.

A sensor nearer to one that reads nothing than to one that reads what is there has no scale. Else a scale is the slope
of what a vane tells over what the kinematics tell. Errors of the latter lower it: with the residuals' slow part all
the kinematics' fault, it is too small by the factor 1 + (slow residual variance) / (variance told), and where none of
it is, by nothing (Frisch's bounds; Fuller, Measurement Error Models, 1987, section 1.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len

from logs.identification.data.noise_level import noise_beside_steps
from logs.identification.estimators.flight_path.decimation import thinned, windows_of
from logs.identification.estimators.flight_path.errors import noise_of_inputs
from logs.identification.estimators.flight_path.fit import Fit, fitted, optimum, unlikely, unscaled
from logs.identification.estimators.flight_path.records import Problem
from logs.identification.estimators.flight_path.sensors import NO_GAIN, SPEEDS
from logs.identification.models.rigid_body import INPUTS
from logs.identification.results import Array, Unidentified

SURE = 2.0
"""-; standard errors that a sensor's gain must be from none"""
BY_CHANCE = 3.0
"""-; standard deviations of what noise makes, up to which it is no contradiction"""
UNEXPLAINED = 0.1
"""-; of every output's variance, that a known mistake may leave, as in `diagnostics.consistency_checks`"""


class _Followed(NamedTuple):
    """How one output is followed over all records, each about its own mean."""

    told: float
    """variance, as the unit squared"""
    slow: float
    """the same, of the residuals without their white noise"""
    noise: float
    """the same, of that noise"""
    off: float
    """-; mean square of the residuals, offsets of whole records included, over the variance of the measured"""
    share: float
    """-; slope of the measured over the told; below 1/2 the told is further from the measured than its mean is"""
    error: float
    """-; standard error of `share`, the rest being no part of the told but as coloured"""


def _followed(problem: Problem, fit: Fit, channel: str) -> _Followed:
    column = problem.channels.index(channel)
    pieces: list[Array] = []
    noise = off = spread = 0.0
    for record, path in zip(problem.records, fit.paths, strict=True):
        used, left = record.used[:, column] > 0, path.residuals[:, column]
        if np.any(used):
            both = np.column_stack((record.outputs[:, column] - left, left))
            pieces.append(np.where(used[:, None], both - both[used].mean(axis=0), 0.0))
            noise += noise_beside_steps(np.where(used, left, np.nan)) ** 2 * np.count_nonzero(used)
            off += float(np.sum(left[used] ** 2))
            spread += float(np.sum((pieces[-1].sum(axis=1)) ** 2))
    told, left = np.concatenate(pieces).T
    count, power = sum(np.sum(record.used[:, column]) for record in problem.records), max(told @ told, 1e-30)
    share = 1.0 + float(told @ left) / power
    error = np.sqrt(sum(_chance(one[:, 0], one[:, 1] - (share - 1.0) * one[:, 0]) for one in pieces)) / power
    slow = max(float(left @ left) - noise, 0.0)
    return _Followed(
        float(power / count), float(slow / count), float(noise / count), off / max(spread, 1e-30), share, float(error)
    )


def _chance(told: Array, rest: Array) -> float:
    """Variance of the sum of ``told`` (N,) times a noise of the autocovariance that ``rest`` (N,) has."""
    size = next_fast_len(2 * len(told))
    both = np.abs(np.fft.fft(told, size)) ** 2 * np.abs(np.fft.fft(rest, size)) ** 2
    return float(np.sum(both) / size / len(told))


# --- scales ---------------------------------------------------------------------------------------------


def unread_among(problem: Problem, fit: Fit, covariance: Array) -> Unidentified | None:
    """The output's scale that these records tell least; None where all are told."""
    worst: tuple[float, Unidentified] | None = None
    for k, asked in enumerate(problem.parameters):
        if asked.kind != "scale" or asked.channel in INPUTS:
            continue
        gain, error = float(fit.values.errors[k]) - NO_GAIN, float(np.sqrt(covariance[k, k]))
        followed = _followed(problem, fit, asked.channel)
        lowered = gain * followed.slow / max(followed.told, 1e-30)
        # Anywhere between nothing and all of it.
        excess = float(np.hypot(error, lowered / np.sqrt(12.0))) / asked.limit
        reason = f"what the kinematics leave of {asked.channel} may have lowered it by up to {lowered:.2g}"
        if gain < max(SURE * error, 0.5):
            reads = "backwards" if gain < -SURE * error else "next to nothing (a scale of -1)"
            excess, reason = np.inf, f"in these records {asked.channel} would read {reads}"
        if excess > 1 and (worst is None or excess > worst[0]):
            worst = (excess, Unidentified(asked.name, reason))
    return None if worst is None else worst[1]


# --- signals at odds ------------------------------------------------------------------------------------


def contradiction(problem: Problem, fit: Fit, input_noise: Mapping[str, float] | None) -> str:
    """Why the signals are not those of one motion, empty where they may be."""
    every = {channel: _followed(problem, fit, channel) for channel in problem.channels}
    poor = [channel for channel, one in every.items() if one.off > 1.0]
    if not poor:
        return ""
    unit = _speed_unit(problem, fit)
    odd = poor if unit else _odd_in_windows(problem, fit, input_noise)
    if not odd:
        return ""
    said = f"the kinematics follow {', '.join(odd)} worse than a constant would: these signals are not of one motion"
    return f"{said}; {unit or 'is a unit, a sign or a place wrong?'}"


def _odd_in_windows(problem: Problem, fit: Fit, input_noise: Mapping[str, float] | None) -> list[str]:
    """`_certainly_odd`, of the whole records or of short ones with first states of their own."""
    odd = _certainly_odd(problem, fit, input_noise)
    short, values = windows_of(problem, fit.values, fit.paths)
    if odd or len(short.records) == len(problem.records):
        return odd
    again = optimum(short, values)
    return [] if again is None else _certainly_odd(short, again, input_noise)


def _certainly_odd(problem: Problem, fit: Fit, input_noise: Mapping[str, float] | None) -> list[str]:
    """Outputs followed worse than by a constant by no chance, in a motion that all noise does not make or hide."""
    every = {channel: _followed(problem, fit, channel) for channel in problem.channels}
    noise = dict(zip(problem.channels, _by_noise(problem, fit, input_noise), strict=True))
    return [
        channel for channel, one in every.items()
        if one.share + BY_CHANCE * one.error < 0.5 and one.told > BY_CHANCE**2 * (noise[channel] + one.noise)
    ]  # fmt: skip


def _by_noise(problem: Problem, fit: Fit, input_noise: Mapping[str, float] | None) -> Array:
    """Mean variance (m,) of what the inputs' white noise makes of every output along the records.

    Of the path from its first state; the fit takes its share of that, so this is no less than what is left.
    """
    total = np.zeros(len(problem.channels))
    for index, slope in enumerate(fit.slopes):
        noise = np.diag(noise_of_inputs(problem, fit.values, index, input_noise) ** 2)
        carry, gain = slope.steps
        spread = np.zeros((9, 9))
        for k, by_state in enumerate(slope.by_state):
            total += np.einsum("mi,ij,mj->m", by_state, spread, by_state)
            if k < len(carry):
                spread = carry[k] @ spread @ carry[k].T + gain[k] @ noise @ gain[k].T
    counts = np.sum([np.sum(record.used, axis=0) for record in problem.records], axis=0)
    mean: Array = total / counts
    return mean


def _speed_unit(problem: Problem, fit: Fit) -> str:
    """The unit of the airspeed with which all outputs are explained, as a question; empty where there is none.

    By sensors without scales: a vane that may read nothing is explained with any airspeed.
    """
    problem = thinned(problem)
    plain = optimum(problem, fit.values)
    found = []
    samples = float(sum(np.sum(one.used[:, problem.channels.index("airspeed")]) for one in problem.records))
    for unit, factor in SPEEDS.items():
        for told, is_in, times in (("m/s", unit, factor), (unit, "m/s", 1.0 / factor)):
            other = _with_airspeed(problem, 1.0 / times)
            better = fitted(unscaled(other))
            if better is not None and _explained(other, better):
                # Per number as it was told: a larger unit's smaller residuals are no better.
                found.append((unlikely(other, better) + samples * np.log(times), told, is_in, times))
    best = min(found, default=None)
    if best is None or (plain is not None and best[0] >= unlikely(problem, plain)):
        return ""
    return f"V is {best[3]:.2g} times what all others say: is it in {best[2]}, not in {best[1]}?"


def _explained(problem: Problem, fit: Fit) -> bool:
    """Whether every output's motion is explained, its white noise apart."""
    every = (_followed(problem, fit, channel) for channel in problem.channels)
    return all(one.slow <= UNEXPLAINED * one.told for one in every)


def _with_airspeed(problem: Problem, factor: float) -> Problem:
    """The airspeed times ``factor``."""
    at = problem.channels.index("airspeed")
    scaled = np.where(np.arange(len(problem.channels)) == at, factor, 1.0)
    return problem._replace(records=tuple(one._replace(outputs=one.outputs * scaled) for one in problem.records))
