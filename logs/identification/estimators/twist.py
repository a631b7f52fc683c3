"""Twist of a wing that is let go or stepped: damping from the overshoot, and both constants from the whole course.

Gerdes Eq. 17 turns the overshoot of a step into the damping ratio, ``zeta = L / sqrt(pi^2 + L^2)`` with
``L = -ln(PO / 100)``; several peaks give L as the slope of their logarithms (log decrement). Eq. 16, with the rate
in its second term that the print calls theta_0, gives natural frequency and damping from a record. L is what noise
disturbs evenly, so intervals are made in it and carried over. Table 6's wing A: its overshoot of 0.20 % is 0.892, not
the printed 0.96, and is within the noise of any gauge: without an error of the peaks no interval is given.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from logs.identification.data.experiment import Experiment
from logs.identification.data.noise_level import noise_with_steps
from logs.identification.estimators.servo import ServoModel
from logs.identification.results import Array, Estimate, Unidentified, estimate, student_factor
from logs.identification.statistics.hac import Linear, autocorrelated
from wingbeat.errors import InputError

DAMPING, NATURAL = "twist_damping", "twist_natural_frequency"
LEAST_SAMPLES = 16
LINEAR = 3
"""-; amplitudes and rest position, fitted beside the two constants"""
GUESSES = (0.05, 0.2, 0.5, 0.8)
"""-; damping ratios from which the fit begins"""
HELD = 8.0
"""-; deviations of its noise within which of the greatest excursion it is still held"""
CLEARLY = 0.5
"""-; share of the greatest excursion that `HELD` must be below for the release to be seen by it"""
STARTS, LATEST = 12, 0.5
"""-; samples from which the swing is tried to begin where it is not seen, and the last one's share of the record"""
CHANCE = 1e-4
"""-; share of records of noise alone in which a swing is found"""
CLEAR = 2.0
"""-; standard errors by which an overshoot must stand above zero"""


def ratio_of(decrement: float) -> float:
    """Damping ratio of the logarithm L of successive half cycles' ratio (Gerdes Eq. 17)."""
    return decrement / math.hypot(math.pi, decrement)


def damping_from_overshoot(
    peak: float, steady: float, peak_error: float, steady_error: float
) -> Estimate | Unidentified:
    """Damping ratio from the greatest value and the settled one of a step (Gerdes Eq. 17, Table 6).

    Args:
        peak: of the twist (rad) or the rate (rad/s) that overshoots.
        steady: what it settles at, in the same unit.
        peak_error: standard error of ``peak``.
        steady_error: standard error of ``steady``.

    Raises:
        InputError: a number that is not finite, a steady value of zero, or a negative error.
    """
    if not all(math.isfinite(x) for x in (peak, steady, peak_error, steady_error)) or steady == 0.0:
        raise InputError("the overshoot needs a finite peak and a finite steady value that is not 0")
    if min(peak_error, steady_error) < 0.0 or peak_error + steady_error == 0.0:
        raise InputError("the overshoot's interval needs the standard error of peak or steady value, above 0")
    overshoot = peak / steady - 1.0
    error = math.hypot(peak_error, (overshoot + 1.0) * steady_error) / abs(steady)
    if overshoot <= CLEAR * error:
        return Unidentified(
            DAMPING, f"the overshoot of {100 * overshoot:.2g} % is within its error of {100 * error:.2g} %"
        )
    if overshoot >= 1.0:
        return Unidentified(DAMPING, f"an overshoot of {100 * overshoot:.3g} % is that of no damped step")
    return _ratio(-math.log(overshoot), error / overshoot, math.inf)


def damping_from_peaks(peaks: Array, steady: float, error: float) -> Estimate | Unidentified:
    """Damping ratio from successive extremes of a decaying swing, high and low in turn (log decrement).

    Args:
        peaks: rad or rad/s; (n,), n of 2 or more, in their order.
        steady: what it settles at, in the same unit.
        error: standard error of each, in the same unit.

    Raises:
        InputError: fewer than two extremes, a number that is not finite, or no error.
    """
    swings = np.asarray(peaks, dtype=float) - steady
    if len(swings) < 2 or not np.all(np.isfinite(swings)) or not error > 0.0:
        raise InputError("the decay needs two extremes or more, finite, and their standard error above 0")
    if np.any(swings[1:] * swings[:-1] >= 0):
        raise InputError("the extremes must lie above and below the steady value in turn")
    sizes = np.abs(swings)
    clear = int(np.argmin(sizes > CLEAR * error)) if np.any(sizes <= CLEAR * error) else len(sizes)
    if clear < 2:
        return Unidentified(
            DAMPING, "the second extreme is within its error: the swing does not stand out of the noise"
        )
    design = np.column_stack((np.ones(clear), -np.arange(clear))) * (sizes[:clear] / error)[:, None]
    information = np.linalg.inv(design.T @ design)
    decrement = float((information @ design.T @ (np.log(sizes[:clear]) * sizes[:clear] / error))[1])
    spread = math.sqrt(information[1, 1])
    if decrement <= CLEAR * spread:
        return Unidentified(DAMPING, "the swing does not decay by more than its error")
    return _ratio(decrement, spread, math.inf)


def _ratio(decrement: float, error: float, degrees: float) -> Estimate:
    """The damping ratio with its interval, even in the decrement."""
    half = student_factor(degrees) * error
    slope = math.pi**2 / (math.pi**2 + decrement**2) ** 1.5
    low, high = ratio_of(max(decrement - half, 0.0)), ratio_of(decrement + half)
    return Estimate(DAMPING, "-", ratio_of(decrement), slope * error, low, high)


def identify_twist(test: Experiment, signal: str = "twist") -> ServoModel:
    """Natural frequency and damping ratio by least squares of Gerdes Eq. 16 to a release or step.

    The record is used from its greatest excursion on: let go there, the wing swings freely about where it comes
    to rest. Angle and rate at that moment and the rest are found with the constants. What was not measured (NaN) is
    left out.

    Raises:
        InputError: no such signal, too few samples.
    """
    if signal not in test.signals:
        raise InputError(f"the test {test.name} has no signal {signal!r}; it has {', '.join(test.signals)}")
    time, swing = _from_release(test.time, np.asarray(test.signals[signal], dtype=float))
    measured = np.isfinite(swing)
    if measured.sum() < LEAST_SAMPLES:
        raise InputError(
            f"the test {test.name} has {int(measured.sum())} samples after its release, fewer than {LEAST_SAMPLES}"
        )
    if float(np.ptp(swing[measured])) == 0.0:
        return _nothing("the twist does not move", 0.0, int(measured.sum()))
    return _fitted(time, swing, measured)


class Swing(NamedTuple):
    """A release beside Eq. 16."""

    time: Array
    """s; (N,), as the test's, from the release on"""
    measured: Array
    """as the signal; (N,), NaN where not measured"""
    model: Array
    """as the signal; (N,)"""


def swing_of(test: Experiment, signal: str, natural: float, damping: float) -> Swing:
    """Gerdes Eq. 16 with ``natural`` frequency (rad/s) and ``damping`` (-), angle, rate and rest the test's own."""
    time, swing = _from_release(test.time, np.asarray(test.signals[signal], dtype=float))
    measured = np.isfinite(swing)
    columns = _columns(time, natural, damping)
    model = columns @ np.linalg.lstsq(columns[measured], swing[measured], rcond=None)[0]
    return Swing(np.asarray(test.time[len(test.time) - len(time) :]), swing, np.asarray(model))


def _from_release(time: Array, values: Array) -> tuple[Array, Array]:
    """The record from the greatest excursion from where it ends; a wing that is held there is let go at the end."""
    finite = np.flatnonzero(np.isfinite(values))
    if not len(finite):
        return time[:0], values[:0]
    rest = float(np.median(values[finite[-max(len(finite) // 5, 1) :]]))
    away = np.abs(values[finite] - rest)
    top = int(np.argmax(away))
    gone = away[top:] <= away[top] - HELD * noise_with_steps(values[finite])
    # Two in a row: one held sample that is far out began the swing while the wing was still held.
    free = np.flatnonzero(gone[:-1] & gone[1:])
    last = int(free[0]) if len(free) else 1
    later = finite[top:]
    first = int(later[max(last - 1, 0)])
    if HELD * noise_with_steps(values[finite]) > CLEARLY * away[top]:
        first = int(later[_fits_from(time[later], values[later])])
    return time[first:] - time[first], values[first:]


def _fits_from(time: Array, values: Array) -> int:
    """From which sample on the wing is free: before it a constant and from it on Eq. 16 fit ``values`` (N,) best.

    Where noise is a large part of the excursion, nothing else tells: begun while the wing was held, 60 rad/s came out
    as 34 +- 7. The next place after the best is taken, for the wing was let go between two.
    """
    places = np.unique(np.linspace(0.0, LATEST * len(values), STARTS).astype(int))
    places = places[len(values) - places >= LEAST_SAMPLES]
    squares = [_squares(time, values, int(place)) for place in places]
    best = int(np.argmin(squares)) if squares else 0
    return int(places[min(best + 1, len(places) - 1)]) if best else 0


def _squares(time: Array, values: Array, free: int) -> float:
    """What a constant leaves of the samples before the one that is ``free``, and Eq. 16 from it on."""
    since = time[free:] - time[free]
    swing = min(_search(since, values[free:], guess)[1] for guess in (GUESSES[0], GUESSES[2]))
    return 2.0 * swing + (free * float(np.var(values[:free])) if free else 0.0)


def _columns(time: Array, natural: float, damping: float) -> Array:
    """Columns (N, 3): cosine and sine of Eq. 16, and the rest."""
    damped = natural * math.sqrt(max(1.0 - damping**2, 1e-9))
    decay = np.exp(-damping * natural * time)
    return np.column_stack((decay * np.cos(damped * time), decay * np.sin(damped * time), np.ones_like(time)))


def _residuals(constants: Array, time: Array, values: Array) -> Array:
    """What Eq. 16 leaves, with the best angle, rate and rest."""
    columns = _columns(time, math.exp(constants[0]), float(constants[1]))
    left: Array = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return left


def _fitted(time: Array, swing: Array, measured: Array) -> ServoModel:
    at, values = time[measured], swing[measured]
    best = min((_search(at, values, guess) for guess in GUESSES), key=lambda found: found[1])[0]
    residuals, count = _residuals(best, at, values), len(values)
    spread = float(np.std(residuals))
    if not 0.0 < best[1] < 0.995:
        return _nothing("the twist does not swing: its damping ratio is 1 or more, or below 0", spread, count)
    jacobian = np.column_stack([_slope(best, at, values, index) for index in (0, 1)])
    covariance, degrees = _covariance(jacobian, residuals, time, measured)
    errors = np.sqrt(np.diag(covariance))
    lost = not np.all(np.isfinite(errors)) or errors[0] > 0.5 or best[1] - CLEAR * errors[1] <= 0.0
    if lost or not _stands_out(values, residuals, degrees):
        return _nothing("the swing does not stand out of the noise", spread, count)
    natural = math.exp(best[0])
    half = student_factor(degrees) * errors[0]
    frequency = Estimate(
        NATURAL, "rad/s", natural, natural * errors[0], natural * math.exp(-half), natural * math.exp(half)
    )
    damping = float(best[1])
    decrement = math.pi * damping / math.sqrt(1.0 - damping**2)
    ratio = _ratio(decrement, math.pi / (1.0 - damping**2) ** 1.5 * float(errors[1]), degrees)
    damped = natural * math.sqrt(1.0 - damping**2)
    gradient = np.array([damped, -natural * damping / math.sqrt(1.0 - damping**2)])
    ringing = estimate(
        "twist_damped_frequency", "rad/s", damped, math.sqrt(float(gradient @ covariance @ gradient)), degrees
    )
    return ServoModel((frequency, ratio, ringing), (), 0.0, 0.0, spread, count)


def _stands_out(values: Array, residuals: Array, degrees: float) -> bool:
    """Whether Eq. 16 explains more than the best of all swings does of noise alone.

    Of white noise a sine of one frequency takes chi-square of two degrees of freedom, above T by chance exp(-T / 2);
    the search tries about as many frequencies as there are samples, at `GUESSES` of the damping.
    """
    least = 2.0 * math.log(len(values) * len(GUESSES) / CHANCE)
    rest = float(np.sum((values - np.mean(values)) ** 2))
    return (rest / max(float(residuals @ residuals), 1e-300) - 1.0) * degrees > least


def _search(time: Array, values: Array, damping: float) -> tuple[Array, float]:
    """Log of the natural frequency and damping ratio from a guess, and the squares that they leave."""
    span = float(time[-1])
    turns = np.geomspace(0.3, len(time) / 4.0, 80)
    starts = [math.log(2 * math.pi * turn / span) for turn in turns]
    nearest = min(starts, key=lambda one: float(np.sum(_residuals(np.array([one, damping]), time, values) ** 2)))
    bounds = ([starts[0] - 1.0, 1e-4], [starts[-1] + 1.0, 0.999])
    found = least_squares(_residuals, (nearest, damping), bounds=bounds, x_scale=(0.1, 0.1), args=(time, values))
    return found.x, float(found.cost)


def _slope(constants: Array, time: Array, values: Array, index: int) -> Array:
    width = np.zeros(2)
    width[index] = 1e-5
    change = _residuals(constants + width, time, values) - _residuals(constants - width, time, values)
    slope: Array = change / 2e-5
    return slope


def _covariance(jacobian: Array, residuals: Array, time: Array, measured: Array) -> tuple[Array, float]:
    """Covariance (2, 2) for autocorrelated residuals, and its degrees of freedom."""
    full, left = np.zeros((len(time), 2)), np.zeros(len(time))
    full[measured], left[measured] = jacobian, residuals
    record = Linear(full @ np.linalg.pinv(jacobian.T @ jacobian), np.linalg.qr(full)[0], left, measured.astype(float))
    found = autocorrelated((record,))
    return found.covariance, max(float(found.degrees.min()) - LINEAR, 1.0)


def _nothing(why: str, spread: float, count: int) -> ServoModel:
    return ServoModel((), tuple(Unidentified(name, why) for name in (NATURAL, DAMPING)), 0.0, 0.0, spread, count)
