"""Torque model of the drive servos (Gerdes Eq. 11), and the effect of calibration errors on intervals.

A scale or a zero that is wrong throughout leaves no trace in the residuals. Its effect is what one standard deviation
of each sensor moves the estimates by (GUM, JCGM 100:2008, 5.1.3): by the sensitivity where the estimate is linear in
the reading, else by fitting again. The squares are added to those of the random errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.estimators.least_squares import CovarianceKind, regress
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import (
    Array,
    Estimate,
    EstimationResult,
    estimate,
    estimates,
    linear_result,
    student_factor,
)
from wingbeat.errors import InputError

Mask = NDArray[np.bool_]
METHOD, EQUATIONS = "servo", ("torque = K_tau I + K_tau0 (Gerdes Eq. 11)",)
LEAST_SAMPLES = 40
MIN_READINGS = 20
FINE = 8
"""-; instants inside a burst at which the torque's size is taken"""
MARGIN = 0.04
"""N m; above the floor, for gauge noise"""
EXACT = GaugeErrors()
SMOOTH = 0.5
"""-; share of the loaded samples that is used"""


Fit = Callable[[DriveData], EstimationResult]


def with_gauge_errors(fit: Fit, data: DriveData, gauges: GaugeErrors) -> EstimationResult:
    """The model that ``fit`` makes of ``data``, its intervals widened by what the calibrations left.

    ``fit`` must fit the same terms every time.
    """
    model = fit(data)
    return widened(model, [_shift(model, fit(changed)) for changed in _changed(data, gauges)])


def widened(model: EstimationResult, shifts: Sequence[Sequence[float]]) -> EstimationResult:
    """The model with intervals that hold the ``shifts`` of its estimates (one row per sensor error)."""
    moved = zip(*shifts, strict=True) if shifts else ((0.0,) for _ in model.estimates)
    return model._replace(
        estimates=tuple(_widened(one, math.hypot(*by)) for one, by in zip(model.estimates, moved, strict=True))
    )


def _shift(model: EstimationResult, other: EstimationResult) -> list[float]:
    """By how much each estimate moved; an estimate that was lost counts as not moved."""
    moved = {one.name: one.value for one in other.estimates}
    return [moved.get(one.name, one.value) - one.value for one in model.estimates]


def _changed(data: DriveData, gauges: GaugeErrors) -> list[DriveData]:
    """The data with one sensor at a time one standard deviation off."""
    zero, scale = gauges.torque_zero, 1.0 + gauges.torque_scale
    every = (
        (zero, data._replace(torque_left=data.torque_left + zero)),
        (zero, data._replace(torque_right=data.torque_right + zero)),
        (gauges.torque_scale, data._replace(torque_left=data.torque_left * scale)),
        (gauges.torque_scale, data._replace(torque_right=data.torque_right * scale)),
        (gauges.current_zero, data._replace(current=data.current + gauges.current_zero)),
        (gauges.current_scale, data._replace(current=data.current * (1.0 + gauges.current_scale))),
        (gauges.voltage_scale, data._replace(voltage=data.voltage * (1.0 + gauges.voltage_scale))),
    )
    return [changed for error, changed in every if error]


def _widened(one: Estimate, systematic: float) -> Estimate:
    half = math.hypot(one.high - one.value, student_factor(math.inf) * systematic)
    error = math.hypot(one.standard_error, systematic)
    return one._replace(standard_error=error, low=one.value - half, high=one.value + half)


# --- torque (Gerdes Eq. 11) -------------------------------------------------------------------------------------


class _Bursts(NamedTuple):
    """Torques during each current burst."""

    current: Array
    """A; (N,)"""
    expected: Array
    """A; (N,), mean of the bursts before and after: the same current without the burst's own noise"""
    left: Array
    """N m; (N, FINE), size"""
    right: Array
    """N m; (N, FINE), size"""
    gap: Array
    """N m; (N,), largest difference of the two sizes"""
    dip: Array
    """N m; (N,), how far below its own mean either size falls within the burst"""
    bend: Array
    """N m; (N,), third difference of the four readings about the burst, of the torque that bends more"""
    slope: Array
    """N m/s; (N,), of the mean of both sizes during the burst"""
    steady: Mask
    """-; (N,), True where neither torque changes its sign around the burst"""
    signs: tuple[Array, Array]
    """-; (N,), of the torques at the burst's end, left and right"""


def _bursts(data: DriveData) -> _Bursts:
    inside = (data.power_time - data.window >= data.torque_time[0]) & (data.power_time <= data.torque_time[-1])
    inside[[0, -1]] = False
    end = data.power_time[inside]
    instants = end[:, None] - data.window * (1 - (np.arange(FINE) + 0.5) / FINE)
    around = end[:, None] + np.array([-2.0, -1.0, 0.0, 1.0]) * max(data.window, 0.005)
    sides, ends, steady = [], list[Array](), np.ones(len(end), dtype=bool)
    for torque in (data.torque_left, data.torque_right):
        signs = np.sign(np.interp(around, data.torque_time, torque))
        steady &= np.abs(signs.sum(axis=1)) == signs.shape[1]
        ends.append(signs[:, 2])
        sides.append(np.abs(CubicSpline(data.torque_time, torque)(instants)))
    left, right = sides
    dip = np.max([(side.mean(axis=1) - side.min(axis=1)) * FINE / (FINE - 1) for side in sides], axis=0)
    expected = (np.roll(data.current, 1) + np.roll(data.current, -1)) / 2
    gap = np.max(np.abs(left - right), axis=1)
    span = (instants[:, -1] - instants[:, 0]) if data.window else np.ones(len(end))
    slope = ((left + right)[:, -1] - (left + right)[:, 0]) / 2 / span
    bend = _bend(data, end - data.window / 2)
    return _Bursts(
        data.current[inside], expected[inside], left, right, gap, dip, bend, slope, steady, (ends[0], ends[1])
    )


def _bend(data: DriveData, at: Array) -> Array:
    """Greater third difference (N m) of the two torques' readings about each time of ``at`` (N,)."""
    before = np.searchsorted(data.torque_time, at) - 2
    bends = [np.abs(np.diff(torque, 3)) for torque in (data.torque_left, data.torque_right)]
    bend: Array = np.maximum(*bends)[np.clip(before, 0, len(bends[0]) - 1)]
    return bend


def identify_torque(data: DriveData, gauges: GaugeErrors = EXACT) -> EstimationResult:
    """K_tau and K_tau0 of Gerdes Eq. 11, with intervals that hold what the ``gauges`` have wrong.

    Raises:
        InputError: too few samples in which both servos are loaded.
    """
    fitted = _fitted(data, gauges)
    again = _fitted(data._replace(torque_time=data.torque_time + fitted.lead), gauges) if fitted.lead else fitted
    return widened(again.model, again.shifts)


class _Fitted(NamedTuple):
    """The model, and what must be added to the torques' times to make them those of the current."""

    model: EstimationResult
    lead: float
    """s"""
    shifts: tuple[tuple[float, ...], ...] = ()
    """as the estimates; by one standard deviation of each sensor"""


def _fitted(data: DriveData, gauges: GaugeErrors) -> _Fitted:
    """One fit."""
    bursts = _bursts(data)
    torque = (bursts.left + bursts.right).mean(axis=1) / 2
    floor, slope, offset = _preliminary(bursts.current, torque, bursts.steady)
    if slope * (float(np.max(bursts.current)) - _idle(bursts.current)) < MARGIN:
        return _Fitted(_blind(float(np.std(torque)), len(torque)), 0.0)
    for _ in range(5):
        used = _enough(_loaded(bursts, slope, offset, floor))
        slope, offset = np.polyfit(bursts.current[used], torque[used], 1)
        floor = offset + slope * _idle(bursts.current)
    used = _enough(_loaded(bursts, slope, offset, floor))
    return _torque_model(
        bursts, torque, (used & (bursts.bend <= np.quantile(bursts.bend[used], SMOOTH))).astype(float), gauges
    )


def _enough(used: Mask) -> Mask:
    if used.sum() * SMOOTH < LEAST_SAMPLES:
        raise InputError(
            f"both drive servos are loaded in only {int(used.sum())} samples; the torque model needs"
            f" {math.ceil(LEAST_SAMPLES / SMOOTH)}"
        )
    return used


def _idle(current: Array) -> float:
    """Current (A) that both servos together never fall below."""
    return float(np.quantile(current, 0.005))


def _preliminary(current: Array, torque: Array, steady: Mask) -> tuple[float, float, float]:
    """Floor, slope and offset from the upper half of the currents, where both servos are surely loaded."""
    high = steady & (current > np.quantile(current, 0.6))
    if high.sum() < LEAST_SAMPLES or np.ptp(current) <= 0:
        raise InputError(
            "the drive current does not vary: no flapping in this log from which to learn the torque model"
        )
    slope, offset = (float(c) for c in np.polyfit(current[high], torque[high], 1))
    return offset + slope * _idle(current), slope, offset


def _loaded(bursts: _Bursts, slope: float, offset: float, floor: float) -> Mask:
    """Where the weaker servo, half the difference below the mean that the current tells, stays above its floor."""
    weaker = offset + slope * bursts.expected - bursts.gap / 2 - bursts.dip
    loaded: Mask = bursts.steady & (weaker > floor + MARGIN)
    return loaded


def _torque_model(bursts: _Bursts, torque: Array, used: Array, gauges: GaugeErrors) -> _Fitted:
    lagging = np.ptp(bursts.slope[used > 0]) > 0
    columns = (bursts.slope,) if lagging else ()
    regressors, instruments = (
        np.column_stack((current, np.ones(len(torque)), *columns)) for current in (bursts.current, bursts.expected)
    )
    fit = regress(regressors, torque, used, instruments)
    (slope, offset), errors = fit.values[:2], np.sqrt(np.diag(fit.covariance))
    spread = float(np.sqrt(np.average(fit.residuals**2, weights=used)))
    if not abs(slope) > student_factor(fit.degrees) * errors[0]:
        return _Fitted(_blind(spread, int(used.sum())), 0.0)
    found = (
        estimate("K_tau", "N m/A", float(slope), float(errors[0]), fit.degrees),
        estimate("K_tau0", "N m", float(offset), float(errors[1]), fit.degrees),
    )
    lead = float(fit.values[2]) if lagging else 0.0
    # Linear in the torque of either side; the zero of a cell counts by the sign of its torque.
    sides = [side.mean(axis=1) for side in (bursts.left, bursts.right)]
    changes = [gauges.torque_scale * side / 2 for side in sides]
    changes += [gauges.torque_zero * sign / 2 for sign in bursts.signs]
    weighted = (instruments * used[:, None]).T
    of_torque = np.linalg.solve(weighted @ regressors, weighted @ np.column_stack(changes))[:2].T
    of_current = ((-slope * gauges.current_scale, 0.0), (0.0, -slope * gauges.current_zero))
    shifts = tuple((float(of_slope), float(of_offset)) for of_slope, of_offset in (*of_torque, *of_current))
    return _Fitted(_result(found, (), spread, int(used.sum())), lead, shifts)


def _blind(spread: float, samples: int) -> EstimationResult:
    return _result(
        (), (not_estimated("K_tau", "the torque does not follow the current in this log"),), spread, samples
    )


def _result(
    parameters: tuple[Estimate, ...], withheld: tuple[Finding, ...], spread: float, samples: int
) -> EstimationResult:
    """The result of `METHOD`; ``spread`` of the residuals in N m."""
    return linear_result(
        METHOD,
        parameters,
        withheld,
        residual_deviation=spread,
        samples=samples,
        title="servo torque",
        equations=EQUATIONS,
    )


def torque_of_readings(current: Array, torque: Array, steady: bool = True) -> EstimationResult:
    """K_tau and K_tau0 of Gerdes Eq. 11 from readings (N,) of one loaded servo on a bench, in A and N m.

    ``steady`` readings are independent of one another.

    Raises:
        InputError: too few readings.
    """
    known = np.isfinite(current) & np.isfinite(torque)
    if known.sum() < MIN_READINGS:
        raise InputError(f"{int(known.sum())} readings have current and torque; {MIN_READINGS} are needed")
    design = np.column_stack((current[known], np.ones(int(known.sum()))))
    kind: CovarianceKind = "white" if steady else "autocorrelated"
    try:
        fit = regress(design, torque[known], np.ones(len(design)), covariance=kind)
    except np.linalg.LinAlgError:
        lost = tuple(not_estimated(name, "the current does not vary") for name in ("K_tau", "K_tau0"))
        return _result((), lost, 0.0, len(design))
    values = estimates({"K_tau": "N m/A", "K_tau0": "N m"}, fit.values, fit.covariance, fit.degrees)
    return _result(values, (), float(np.std(fit.residuals)), len(design))
