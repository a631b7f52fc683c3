"""Bench of a drive and a wing: torque-speed line, damped oscillation of the twist.

A motor at full drive gives ``tau = (tau_s V - tau_s / omega_0 V_n omega) / V_n``: linear in voltage and rate, its
stall torque and no-load speed both in proportion to the voltage. A wing asks for ``tau = c omega`` at a steady rate
(the torque constant of Table 5, N m s/rad); while it flaps, its inertia takes part.

Separable least squares of a damped oscillation; amplitude, phase and rest position are nuisance parameters. In the
second term of Eq. 16 the print has theta_0 for the rate.
"""

from __future__ import annotations

import math
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import fdtrc

from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.data.resampling import GAP_STEPS, Channel, even
from logs.identification.data.signal_errors import noise_with_steps
from logs.identification.estimators.least_squares import Fit, regress
from logs.identification.estimators.separable import SeparableRecord, log_squares, orthonormal, solve
from logs.identification.estimators.servo import EXACT, widened
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, EstimationResult, estimate, linear_result, student_factor
from logs.identification.statistics.covariance import ParameterUncertainty, colored_covariance, information, propagate
from logs.strokes import stroke_cuts
from wingbeat.errors import InputError

EQUATIONS = (
    "At full drive torque = stall_torque V / nominal - torque_speed_slope speed, both in the direction of the drive"
    " (Gerdes Fig. 9)",
    "no_load_speed = stall_torque / torque_speed_slope, at the nominal voltage",
)
LEAST_SAMPLES = 20
LEAST_STROKES = 10
"""-; of wings whose load is to be told: held in a hand, or thrown with still drives, they tell nothing of it"""
LEAST_SPREAD = 0.05
"""-; of the greatest rate or voltage: what varies less tells no slope of its own"""
LARGEST, CLEAR = 0.9, 0.2
"""-; quantile of the sizes that counts as the largest, and the share of it that is no noise"""
PER_STROKE = 5.0
"""-; samples of a stroke that torque and motion are brought to, which leaves what moves at one and a half times its
frequency or less: a servo's corrections fold among what the readings have of the harmonics"""
HIGHEST_INFLATION = 10.0
"""-; of the acceleration by the angle (variance inflation), above which nothing tells inertia from stiffness"""
ALIKE = "the wings beat at one frequency, at which inertia and stiffness look alike"
CONSTANTS = {"stall_torque": "N m", "no_load_speed": "rad/s", "torque_speed_slope": "N m s/rad"}
LOAD = ("wing_torque_constant", "wing_inertia")


def identify_torque_speed(
    torque: Array, rate: Array, voltage: Array, nominal: float | None = None
) -> EstimationResult:
    """Stall torque, no-load speed and slope of a servo at full drive, at ``nominal`` volts (the mean without).

    Args:
        torque: N m; (N,), of one servo driven as hard as it can be, on a bench or in those parts of a flight.
        rate: rad/s; (N,).
        voltage: V; (N,).
        nominal: V.

    Samples that are not finite are left out. Where the voltage does not vary, the line through it is found.

    Raises:
        InputError: lengths that differ, too few samples.
    """
    columns = [np.asarray(values, dtype=float) for values in (torque, rate, voltage)]
    if len({values.shape for values in columns}) != 1:
        raise InputError("torque, rate and voltage must have the same number of samples")
    good = np.all(np.isfinite(columns), axis=0)
    if good.sum() < LEAST_SAMPLES:
        raise InputError(
            f"torque, speed and voltage have {int(good.sum())} samples together; a line needs {LEAST_SAMPLES}"
        )
    torque, rate, voltage = (np.where(good, values, 0.0) for values in columns)
    about = float(np.mean(voltage[good])) if nominal is None else nominal
    if about <= 0.0 or np.ptp(np.abs(rate[good])) < LEAST_SPREAD * np.max(np.abs(rate[good])):
        return _refused("the rate does not vary", torque[good])
    if _opposed(torque[good], rate[good]):
        return _refused("torque and speed have opposite signs: one of them is to be turned round", torque[good])
    way = turning(torque, rate)
    design = np.column_stack((voltage / about, -rate * way))
    try:
        fit = regress(design, torque * way, good.astype(float))
    except np.linalg.LinAlgError:
        return _refused("voltage and rate do not vary apart", torque[good])
    return _constants(fit, int(good.sum()))


def turning(torque: Array, rate: Array) -> Array:
    """-; (N,), 1 or -1: which way a servo at full drive is driven, by ``torque`` in N m and ``rate`` in rad/s.

    By the sum of both, each in shares of its largest: at a stall the speed is only noise, and its sign made a torque
    of 2.2 N m one of -2.2; at no load the torque is.
    """
    shares = torque / max(_largest(torque), 1e-300) + rate / max(_largest(rate), 1e-300)
    return np.asarray(np.where(shares < 0.0, -1.0, 1.0), dtype=np.float64)


def _largest(values: Array) -> float:
    """The size that a tenth of the measured ``values`` (N,) exceeds: one reading gone wrong does not set it."""
    sizes = np.abs(values[np.isfinite(values)])
    return float(np.quantile(sizes, LARGEST)) if len(sizes) else 0.0


def _opposed(torque: Array, rate: Array) -> bool:
    """Whether torque and speed mostly have opposite signs where neither is within its noise: no servo drives so."""
    clear = (np.abs(torque) > CLEAR * _largest(torque)) & (np.abs(rate) > CLEAR * _largest(rate))
    return bool(np.sum(torque[clear] * rate[clear] < 0.0) > 0.5 * np.sum(clear))


def _constants(fit: Fit, samples: int) -> EstimationResult:
    stall, slope = fit.values
    errors = np.sqrt(np.diag(fit.covariance))
    spread = float(np.std(fit.residuals))
    if not (slope > student_factor(fit.degrees) * errors[1] and stall > 0.0):
        return _refused("the torque does not fall with the rate: the servo was not at its bound", fit.residuals)
    speed, worth = propagate(
        lambda v: np.array([v[0] / v[1]]), fit.values, ParameterUncertainty(fit.covariance, fit.degrees)
    )
    values = (float(stall), float(speed[0]), float(slope))
    deviations = (float(errors[0]), float(worth.standard_errors[0]), float(errors[1]))
    found = tuple(
        estimate(name, unit, value, error, fit.degrees)
        for (name, unit), value, error in zip(CONSTANTS.items(), values, deviations, strict=True)
    )
    return _line(found, (), spread, samples)


def _refused(why: str, torque: Array) -> EstimationResult:
    lost = tuple(not_estimated(name, why) for name in CONSTANTS)
    return _line((), lost, float(np.std(torque)), len(torque))


def _line(
    parameters: tuple[Estimate, ...], withheld: tuple[Finding, ...], spread: float, samples: int
) -> EstimationResult:
    return linear_result(
        "torque_speed", parameters, withheld, residual_deviation=spread, samples=samples, title="torque-speed line",
        equations=EQUATIONS,
    )  # fmt: skip


def identify_load(data: DriveData, gauges: GaugeErrors = EXACT) -> EstimationResult:
    """The torque constant of Gerdes Table 5 and the wing's inertia, from both wings' torques and motion.

    ``tau = c omega + J omega' + k (angle) + tau_0``: the angle is the rate's integral without its drift. Inertia is
    with the air's apparent mass, and both with what the membrane's twist makes of them at the flapping frequency.
    Only what lies between the first stroke and the last counts. The intervals hold what the ``gauges`` of the torque
    have wrong.

    Raises:
        InputError: no motion of the wings, too few strokes or samples.
    """
    flapping, pace = _while_flapping(data)
    rows = _sides(data, flapping, pace)
    samples = int(min(row.used.sum() for row in rows))
    if samples < LEAST_SAMPLES:
        raise InputError(f"torque and motion of the wings are known together for {samples} samples while they flap")
    if min(float(np.ptp(row.regressors[:, 0])) for row in rows) < 1.0:
        lost = tuple(not_estimated(name, "the wings do not move") for name in LOAD)
        return _load_result((), lost, 0.0, samples)
    fits = [regress(row.regressors, row.torque, row.used) for row in rows]
    # The mean of two sides, each in proportion to its cell's scale; a zero is in tau_0.
    shifts = [[float(gauges.torque_scale * fit.values[index]) / 2.0 for index in range(len(LOAD))] for fit in fits]
    model = widened(_mean_load(fits, samples), shifts)
    alike = max(_inflation(row) for row in rows) > HIGHEST_INFLATION
    reasons = {
        one.name: ALIKE if alike and one.name == LOAD[1] else "its 95 % interval spans zero"
        for one in model.estimates
        if one.contains(0.0) or (alike and one.name == LOAD[1])
    }
    kept = tuple(one for one in model.estimates if one.name not in reasons)
    return _load_result(kept, tuple(starmap(not_estimated, reasons.items())), model.residual_deviation, samples)


def _load_result(
    parameters: tuple[Estimate, ...], withheld: tuple[Finding, ...], spread: float, samples: int
) -> EstimationResult:
    return linear_result(
        "load", parameters, withheld, residual_deviation=spread, samples=samples, title="wing load",
        equations=("torque = c omega + J omega' + k angle + tau_0 (Gerdes Table 5)",),
    )  # fmt: skip


def _while_flapping(data: DriveData) -> tuple[NDArray[np.bool_], float]:
    """At which of the torque's times the wings flap, their motion known; and how many samples a second are of use."""
    if not len(data.wing_time):
        raise InputError("the log has no motion of the wings (/main/wing), which the wing's load needs")
    cuts = stroke_cuts(data.wing_time, data.strokes) if np.ptp(data.strokes) > 1 else np.zeros(0)
    if len(cuts) <= LEAST_STROKES:
        raise InputError(f"the wings made {max(len(cuts) - 1, 0)} strokes; their load needs {LEAST_STROKES}")
    flapping = (data.torque_time >= cuts[0]) & (data.torque_time <= cuts[-1])
    if flapping.sum() < LEAST_SAMPLES:
        raise InputError(f"the log has {int(flapping.sum())} torque readings while the wings flap")
    return flapping, PER_STROKE / float(np.median(np.diff(cuts)))


class _Side(NamedTuple):
    """One wing, every signal through the same low pass."""

    torque: Array
    """N m; (N,)"""
    regressors: Array
    """(N, 4); rate rad/s, acceleration rad/s^2, angle rad, one"""
    used: Array
    """-; (N,), 1.0 where all are known, 0.0 elsewhere, where they are zero"""


def _inflation(side: _Side) -> float:
    """Variance inflation of the acceleration's coefficient."""
    known = side.regressors[side.used > 0.0, :-1]
    left = known - known.mean(axis=0)
    others = left[:, [0, 2]]
    rest = left[:, 1] - others @ np.linalg.lstsq(others, left[:, 1])[0]
    return float(np.sum(left[:, 1] ** 2) / max(float(np.sum(rest**2)), 1e-300))


def _sides(data: DriveData, flapping: NDArray[np.bool_], pace: float) -> list[_Side]:
    """The left wing and the right."""
    sides = ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right))
    return [_side(data, torque, rate, flapping, pace) for torque, rate in sides]


def _side(data: DriveData, torque: Array, rate: Array, flapping: NDArray[np.bool_], pace: float) -> _Side:
    """Torque and motion while the wings are ``flapping`` (N,), at about ``pace`` Hz.

    A torque that the servo's corrections shake and an acceleration that is smoothed by being a slope are of different
    frequencies: regressed on each other as they are, the inertia was up to a half too small.
    """
    time, now = data.wing_time, data.torque_time[flapping]
    smooth = CubicSpline(time, rate)
    turned = smooth.antiderivative()(now)
    angle = turned - np.polyval(np.polyfit(now - now[0], turned, 1), now - now[0])
    at = now[:: max(1, round(1.0 / (pace * float(np.median(np.diff(now))))))]
    signals = {"torque": torque[flapping], "rate": smooth(now), "acceleration": smooth(now, 1), "angle": angle}
    after = np.clip(np.searchsorted(time, now), 1, len(time) - 1)
    unknown = time[after] - time[after - 1] > GAP_STEPS * float(np.median(np.diff(time)))
    columns = [
        even(Channel(name, "", now, np.where(unknown, np.nan, values)), at, 0.0) for name, values in signals.items()
    ]
    used = np.all(np.isfinite(columns), axis=0)
    known = np.where(used, columns, 0.0)
    return _Side(known[0], np.column_stack((*known[1:], used)), used.astype(float))


def _mean_load(fits: list[Fit], samples: int) -> EstimationResult:
    """Mean of the two wings; their difference is part of the error."""
    found: list[Estimate] = []
    for index, (name, unit) in enumerate(zip(LOAD, ("N m s/rad", "kg m^2"), strict=True)):
        values = np.array([fit.values[index] for fit in fits])
        own = float(np.mean([fit.covariance[index, index] for fit in fits])) / 2.0
        error = np.sqrt(own + float(np.var(values, ddof=1)) / 2.0)
        found.append(estimate(name, unit, float(values.mean()), float(error), min(fit.degrees for fit in fits)))
    spread = float(np.sqrt(np.mean([np.var(fit.residuals) for fit in fits])))
    return _load_result(tuple(found), (), spread, samples)


def load_truth(data: DriveData, measured: EstimationResult) -> dict[str, float]:
    """What ``measured`` tells of the wings' load, by the same regression on true drive ``data``: name to value.

    Raises:
        InputError: as `identify_load`.
    """
    told = {found.name for found in measured.estimates}
    return {found.name: found.value for found in identify_load(data).estimates if found.name in told}


DAMPING, NATURAL = "twist_damping", "twist_natural_frequency"
RELEASE = (
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
        "twist", parameters, withheld, residual_deviation=deviation, samples=count, title="twist", equations=RELEASE
    )
