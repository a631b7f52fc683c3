"""Torque and power models of the drive servos (Gerdes Eq. 11 and 12) from strain gauges, encoders and power sensors.

Torque (Eq. 11), ``mean(|tau_left|, |tau_right|) = K_tau I + K_tau0`` with the current I that both servos share.
A servo whose torque is below what its idle current gives sits on a floor where the line does not hold;
a stroke mean mixes both, so the fit is on the 100 Hz samples in which both servos are loaded. Whether they
are is judged from the current and from the difference of the torques, not from their mean: judging by the
fitted quantity itself would bias it.

Power (Eq. 12, per servo: P/2 at I/2), centred and over stroke means, the form in which the paper uses it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from avionics.quantities import BadInput
from logs.identification.data import DriveData
from logs.identification.regression.least_squares import Fit, regress
from logs.identification.results import Array, Estimate, Unidentified, estimate, student_factor
from logs.strokes import interval_mean, stroke_cuts, stroke_means

Mask = NDArray[np.bool_]
LEAST_SAMPLES = 40
FINE = 8
"""-; instants inside a burst at which the torque's size is taken"""
MARGIN = 0.04
"""N m; above the floor, for gauge noise and the inside of the burst"""
HIGHEST_INFLATION = 25.0
"""-; a regressor that is explained by the others so well (variance inflation) is not identifiable"""
TERMS = {"C_A": "W", "C_B": "W/A", "C_C": "W/V", "C_F": "W/A/V", "C_G": "W/A^2", "C_H": "W/V^2"}
MEANING = {
    "C_C": "voltage",
    "C_F": "product of current and voltage",
    "C_G": "current squared",
    "C_H": "voltage squared",
}


class ServoModel(NamedTuple):
    """One fitted servo model."""

    estimates: tuple[Estimate, ...]
    """what the data gives"""
    unidentified: tuple[Unidentified, ...]
    """what it does not, and why"""
    centre_current: float
    """A; C_D, added to the current of one servo (0 for the torque)"""
    centre_voltage: float
    """V; C_E, added to the voltage (0 for the torque)"""
    residual: float
    """N m or W; standard deviation"""
    samples: int
    """-; bursts or strokes"""


class ServoResult(NamedTuple):
    """Torque and power model of the drive servos; None for one that was not asked for."""

    torque: ServoModel | None
    power: ServoModel | None


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
    steady: Mask
    """-; (N,), True where neither torque changes its sign around the burst"""


def _bursts(data: DriveData) -> _Bursts:
    inside = (data.power_time - data.window >= data.torque_time[0]) & (data.power_time <= data.torque_time[-1])
    inside[[0, -1]] = False
    end = data.power_time[inside]
    instants = end[:, None] - data.window * (1 - (np.arange(FINE) + 0.5) / FINE)
    around = end[:, None] + np.array([-2.0, -1.0, 0.0, 1.0]) * max(data.window, 0.005)
    sides, steady = [], np.ones(len(end), dtype=bool)
    for torque in (data.torque_left, data.torque_right):
        signs = np.sign(np.interp(around, data.torque_time, torque))
        steady &= np.abs(signs.sum(axis=1)) == signs.shape[1]
        sides.append(np.abs(CubicSpline(data.torque_time, torque)(instants)))
    left, right = sides
    expected = (np.roll(data.current, 1) + np.roll(data.current, -1)) / 2
    return _Bursts(data.current[inside], expected[inside], left, right, np.max(np.abs(left - right), axis=1), steady)


def identify_torque(data: DriveData) -> ServoModel:
    """K_tau and K_tau0 of Gerdes Eq. 11.

    Raises:
        BadInput: too few samples in which both servos are loaded.
    """
    bursts = _bursts(data)
    torque = (bursts.left + bursts.right).mean(axis=1) / 2
    floor, slope, offset = _preliminary(bursts.current, torque, bursts.steady)
    if slope * (float(np.max(bursts.current)) - _idle(bursts.current)) < MARGIN:
        return _blind(float(np.std(torque)), len(torque))
    for _ in range(5):
        used = _loaded(bursts, slope, offset, floor)
        if used.sum() < LEAST_SAMPLES:
            break
        slope, offset = np.polyfit(bursts.current[used], torque[used], 1)
        floor = offset + slope * _idle(bursts.current)
    used = _loaded(bursts, slope, offset, floor)
    if used.sum() < LEAST_SAMPLES:
        raise BadInput(
            f"both drive servos are loaded in only {int(used.sum())} samples; the torque model needs {LEAST_SAMPLES}"
        )
    return _torque_model(bursts, torque, used.astype(float))


def _idle(current: Array) -> float:
    """Current (A) that both servos together never fall below."""
    return float(np.quantile(current, 0.005))


def _preliminary(current: Array, torque: Array, steady: Mask) -> tuple[float, float, float]:
    """Floor, slope and offset from the upper half of the currents, where both servos are surely loaded."""
    high = steady & (current > np.quantile(current, 0.6))
    if high.sum() < LEAST_SAMPLES or np.ptp(current) <= 0:
        raise BadInput(
            "the drive current does not vary: no flapping in this log from which to learn the torque model"
        )
    slope, offset = (float(c) for c in np.polyfit(current[high], torque[high], 1))
    return offset + slope * _idle(current), slope, offset


def _loaded(bursts: _Bursts, slope: float, offset: float, floor: float) -> Mask:
    """Where the weaker servo, half the difference below the mean that the current tells, is above its floor."""
    weaker = offset + slope * bursts.expected - bursts.gap / 2
    loaded: Mask = bursts.steady & (weaker > floor + MARGIN)
    return loaded


def _torque_model(bursts: _Bursts, torque: Array, used: Array) -> ServoModel:
    centre = float(np.average(bursts.current, weights=used))
    regressors, instruments = (
        np.column_stack((np.ones(len(torque)), current - centre)) for current in (bursts.current, bursts.expected)
    )
    fit = regress(regressors, torque, used, 50, instruments)
    slope, error = fit.values[1], float(np.sqrt(fit.covariance[1, 1]))
    gradient = np.array([1.0, -centre])
    offset, offset_error = gradient @ fit.values, float(np.sqrt(gradient @ fit.covariance @ gradient))
    spread = float(np.sqrt(np.average(fit.residuals**2, weights=used)))
    if abs(slope) < student_factor(fit.degrees) * error:
        return _blind(spread, int(used.sum()))
    found = (
        estimate("K_tau", "N m/A", float(slope), error, fit.degrees),
        estimate("K_tau0", "N m", float(offset), offset_error, fit.degrees),
    )
    return ServoModel(found, (), 0.0, 0.0, spread, int(used.sum()))


def _blind(spread: float, samples: int) -> ServoModel:
    refused = Unidentified("K_tau", "the torque does not follow the current in this log")
    return ServoModel((), (refused,), 0.0, 0.0, spread, samples)


class _Strokes(NamedTuple):
    """Stroke means per servo."""

    current: Array
    """A"""
    voltage: Array
    """V"""
    power: Array
    """W; mechanical output"""


def _stroke_means(data: DriveData) -> _Strokes:
    if not len(data.wing_time):
        raise BadInput("the log has no motion of the wings (/main/wing), which the power model needs")
    half = data.window / 2
    first = max(data.power_time[0], data.torque_time[0], data.wing_time[0]) + half
    last = min(data.power_time[-1] - half, data.torque_time[-1], data.wing_time[-1])
    cuts = stroke_cuts(data.wing_time, data.strokes) if np.ptp(data.strokes) > 2 else np.zeros(0)
    cuts = cuts[(cuts >= first) & (cuts <= last)]
    if len(cuts) < LEAST_SAMPLES:
        raise BadInput(f"the log has {len(cuts)} wing strokes; the power model needs {LEAST_SAMPLES}")
    centre = data.power_time - half
    power = np.zeros(len(data.torque_time))
    for torque, rate in ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right)):
        power += torque * np.interp(data.torque_time, data.wing_time, rate)
    flapping = np.diff(cuts) < 3 * np.median(np.diff(cuts))
    columns = interval_mean(centre, np.column_stack((data.current, data.voltage)), cuts[:-1], cuts[1:])[flapping]
    return _Strokes(columns[:, 0] / 2, columns[:, 1], stroke_means(data.torque_time, power, cuts)[flapping] / 2)


def identify_power(
    data: DriveData,
    centre_current: float | None = None,
    centre_voltage: float | None = None,
    terms: tuple[str, ...] | None = None,
) -> ServoModel:
    """The identifiable coefficients of Gerdes Eq. 12, centred on C_D and C_E as given or on the data's own means.

    ``terms`` fixes the coefficients that are fitted; without it those are left out that the regressors'
    collinearity or their own standard error makes meaningless.

    Raises:
        BadInput: too few strokes.
    """
    strokes = _stroke_means(data)
    c_d = -float(strokes.current.mean()) if centre_current is None else centre_current
    c_e = -float(strokes.voltage.mean()) if centre_voltage is None else centre_voltage
    columns = _regressors(strokes, c_d, c_e)
    dropped: tuple[Unidentified, ...] = ()
    kept = terms
    if kept is None:
        kept, dropped = _identifiable(columns, strokes.power)
    fit = _fit(columns, strokes.power, kept)
    found = _coefficients(fit, kept, c_d, c_e)
    return ServoModel(found, dropped, c_d, c_e, float(np.std(fit.residuals)), len(strokes.power))


def _regressors(strokes: _Strokes, c_d: float, c_e: float) -> dict[str, Array]:
    i, v = strokes.current + c_d, strokes.voltage + c_e
    return {"C_A": np.ones_like(i), "C_B": i, "C_C": v, "C_F": i * v, "C_G": i * i, "C_H": v * v}


def _fit(columns: dict[str, Array], power: Array, terms: tuple[str, ...]) -> Fit:
    scale = {term: float(np.sqrt(np.mean(columns[term] ** 2))) or 1.0 for term in terms}
    design = np.column_stack([columns[term] / scale[term] for term in terms])
    fit = regress(design, power, np.ones_like(power), least_lags=10)
    inverse = np.diag([1 / scale[term] for term in terms])
    return fit._replace(values=inverse @ fit.values, covariance=inverse @ fit.covariance @ inverse)


def _inflation(columns: dict[str, Array], terms: tuple[str, ...], term: str) -> float:
    """Variance inflation of ``term`` by the other ``terms``; infinite for one that does not vary."""
    others = np.column_stack([columns[other] for other in terms if other != term])
    column = columns[term]
    rest = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    spread = float(np.sum((column - column.mean()) ** 2))
    left = float(rest @ rest)
    return np.inf if left <= 1e-12 * float(column @ column) else spread / left


def _identifiable(columns: dict[str, Array], power: Array) -> tuple[tuple[str, ...], tuple[Unidentified, ...]]:
    """Backward elimination, highest terms first: collinear ones, then those whose interval spans zero."""
    kept, dropped = tuple(TERMS), []
    while True:
        candidates = [term for term in reversed(kept) if term != "C_A"]
        worst = max(candidates, key=lambda t: _rank(columns, kept, t), default=None)
        if worst is None or _inflation(columns, kept, worst) <= HIGHEST_INFLATION:
            break
        dropped.append(Unidentified(worst, _collinear(worst, _inflation(columns, kept, worst))))
        kept = tuple(term for term in kept if term != worst)
    while True:
        fit = _fit(columns, power, kept)
        ratio = np.abs(fit.values) / np.sqrt(np.diag(fit.covariance))
        weak = [(r, t) for r, t in zip(ratio, kept, strict=True) if t != "C_A" and r < student_factor(fit.degrees)]
        if not weak:
            return kept, tuple(dropped)
        term = min(weak)[1]
        dropped.append(Unidentified(term, "its 95 % interval spans zero: too little variation in this log"))
        kept = tuple(other for other in kept if other != term)


def _rank(columns: dict[str, Array], kept: tuple[str, ...], term: str) -> float:
    """Which collinear term goes first: of those above the limit the highest of Eq. 12, so the current stays last."""
    order = ("C_B", "C_G", "C_C", "C_F", "C_H").index(term)
    return float(order + 1) if _inflation(columns, kept, term) > HIGHEST_INFLATION else 0.0


def _collinear(term: str, inflation: float) -> str:
    what = MEANING.get(term, "current")
    if not np.isfinite(inflation):
        return f"the {what} does not vary on its own in this log"
    return f"the {what} follows the other terms (variance inflation {inflation:.0f}): vary it on its own"


def _coefficients(fit: Fit, terms: tuple[str, ...], c_d: float, c_e: float) -> tuple[Estimate, ...]:
    """Eq. 12's coefficients from the centred ones: its C_B I + C_C V is not centred, so C_A takes the difference."""
    gradient = np.zeros((len(terms), len(terms)))
    np.fill_diagonal(gradient, 1.0)
    for index, term in enumerate(terms):
        if term in ("C_B", "C_C"):
            gradient[0, index] = c_d if term == "C_B" else c_e
    values = gradient @ fit.values
    errors = np.sqrt(np.diag(gradient @ fit.covariance @ gradient.T))
    found = [
        estimate(t, TERMS[t], float(v), float(e), fit.degrees) for t, v, e in zip(terms, values, errors, strict=True)
    ]
    centred = estimate("P_0", "W", float(fit.values[0]), float(np.sqrt(fit.covariance[0, 0])), fit.degrees)
    return (centred, *found)


def power_truth(data: DriveData, measured: ServoModel) -> dict[str, float]:
    """The coefficients that ``measured`` has, by the same regression on true drive ``data``: name to value."""
    terms = tuple(e.name for e in measured.estimates if e.name in TERMS)
    model = identify_power(data, measured.centre_current, measured.centre_voltage, terms)
    return {e.name: e.value for e in model.estimates}
