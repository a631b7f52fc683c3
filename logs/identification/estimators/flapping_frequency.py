"""Flapping frequency against throttle: ``f = f_0 + s (T - T_c) + c (T - T_c)^2 + v (V - V_c)``, and the dead zone.

Only stretches count in which the throttle stands still: after a change the motor takes its time. In each the strokes
are counted over whole strokes. Curvature and voltage are taken up where the partial F of the term says so (Klein &
Morelli, Aircraft System Identification, 2006, ch. 5.4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import fdtri

from logs.identification.estimators.least_squares import Fit, regress
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, EstimationResult, estimates, linear_result
from logs.identification.statistics.covariance import at_least, heteroscedastic_covariance
from logs.strokes import stroke_cuts
from wingbeat.errors import InputError

EQUATION = "f = f_0 + s (T - T_c) + c (T - T_c)^2 + v (V - V_c)"
BAND = 0.02
"""-; within which a throttle stands still"""
SETTLE = 0.6
"""s; after a change of throttle, left out"""
LEAST_STROKES = 3
LEAST_SEGMENTS = 4
CHANCE = 0.02
"""-; at which a term of the fit is taken up though there is none"""
LEAST_RANGE = 0.05
"""-; of throttle over all stretches"""
TERMS = {"flapping_frequency": "Hz", "throttle_slope": "Hz", "throttle_curvature": "Hz", "voltage_slope": "Hz/V"}
DEAD = "dead_zone"


class ThrottleData(NamedTuple):
    """Throttle, strokes and voltage of one record, on time bases of their own (s)."""

    throttle_time: Array
    """s; (N,)"""
    throttle: Array
    """-; (N,), 0 to 1"""
    wing_time: Array
    """s; (K,)"""
    strokes: Array
    """-; (K,), since the first sample, never decreasing"""
    voltage_time: Array
    """s; (L,), empty where the voltage was not measured"""
    voltage: Array
    """V; (L,)"""


class Segment(NamedTuple):
    """A stretch of constant throttle."""

    begin: float
    """s; settled"""
    end: float
    """s"""
    throttle: float
    """-"""
    frequency: float
    """Hz; 0 where the wings stood still"""
    strokes: int
    """-; counted"""
    voltage: float
    """V; NaN where it was not measured"""


class FrequencyResult(NamedTuple):
    """Frequency against throttle."""

    result: EstimationResult
    """fixed: T_c (-) and, with the voltage in the model, V_c (V)"""
    segments: tuple[Segment, ...]


def steady_segments(data: ThrottleData) -> tuple[Segment, ...]:
    """Every stretch in which the throttle stands still for long enough to count strokes, or to see none."""
    good = np.isfinite(data.throttle)
    time, throttle = data.throttle_time[good], data.throttle[good]
    cuts = stroke_cuts(data.wing_time, data.strokes) if np.ptp(data.strokes) > 1 else np.zeros(0)
    found = []
    for first, last in _constant_spans(throttle, time):
        begin, end = float(time[first]) + SETTLE, float(time[last])
        if end - begin < SETTLE:
            continue
        segment = _counted(data, cuts, begin, end, float(np.mean(throttle[first : last + 1])))
        if segment is not None:
            found.append(segment)
    return tuple(found)


def _constant_spans(throttle: Array, time: Array) -> list[tuple[int, int]]:
    """First and last sample of stretches within `BAND`, each as long as it goes, none over a gap."""
    spans, first, step = [], 0, float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    low = high = throttle[0] if len(throttle) else 0.0
    for k, value in enumerate(throttle.tolist()):
        low, high = min(low, value), max(high, value)
        if high - low > BAND or (k and time[k] - time[k - 1] > 10 * step):
            spans.append((first, k - 1))
            first, low, high = k, value, value
    return [*spans, (first, len(throttle) - 1)] if len(throttle) else []


def _counted(data: ThrottleData, cuts: Array, begin: float, end: float, throttle: float) -> Segment | None:
    """The stretch with its strokes; None where they were not watched all along, or are too few to tell."""
    if begin < data.wing_time[0] or end > data.wing_time[-1]:
        return None
    inside, seen = cuts[(cuts >= begin) & (cuts <= end)], (data.voltage_time >= begin) & (data.voltage_time <= end)
    voltage = float(np.nanmean(data.voltage[seen])) if np.any(np.isfinite(data.voltage[seen])) else np.nan
    turned = float(np.ptp(np.interp((begin, end), data.wing_time, data.strokes)))
    if turned < 0.1:
        return Segment(begin, end, throttle, 0.0, 0, voltage)
    if len(inside) <= LEAST_STROKES:
        return None
    count = len(inside) - 1
    return Segment(begin, end, throttle, count / float(inside[-1] - inside[0]), count, voltage)


def identify_frequency(data: ThrottleData) -> FrequencyResult:
    """Frequency at the mean throttle, its slope, and what else the record tells.

    Raises:
        InputError: no throttle, wings that were not watched, too few stretches.
    """
    if not len(data.throttle_time) or not len(data.wing_time):
        raise InputError("flapping frequency against throttle needs both the throttle and the wings' motion")
    if float(np.nanmax(data.throttle) - np.nanmin(data.throttle)) < BAND:
        raise InputError(
            "the throttle does not move: it does not set how fast these wings beat, or was never changed"
        )
    segments = steady_segments(data)
    flapping = [s for s in segments if s.frequency > 0]
    if len(flapping) < LEAST_SEGMENTS:
        raise InputError(
            f"the throttle stands still in {len(flapping)} stretches with flapping wings;"
            f" frequency against throttle needs {LEAST_SEGMENTS}"
        )
    return fit_segments(segments)


def fit_segments(segments: tuple[Segment, ...], terms: tuple[str, ...] | None = None) -> FrequencyResult:
    """The model of ``segments``; ``terms`` are fitted, or those with a significant partial F.

    Raises:
        InputError: the terms are linearly dependent.
    """
    flapping = [s for s in segments if s.frequency > 0]
    throttle, frequency, voltage, strokes = (
        np.array([getattr(s, name) for s in flapping], dtype=float)
        for name in ("throttle", "frequency", "voltage", "strokes")
    )
    centers = [float(np.average(values, weights=strokes)) for values in (throttle, voltage)]
    x, v = throttle - centers[0], voltage - centers[1]
    columns = dict(zip(TERMS, (np.ones_like(x), x, x * x, v), strict=True))
    regression = _Regression(columns, frequency, np.sqrt(strokes / strokes.mean()))
    chosen, reasons = (terms, {}) if terms else _chosen(regression, float(np.ptp(throttle)))
    try:
        fit = regression.fit(chosen)
    except np.linalg.LinAlgError:
        raise InputError("the stretches of throttle do not tell these terms apart") from None
    found = list(estimates({name: TERMS[name] for name in chosen}, fit.values, fit.covariance, fit.degrees))
    lost = [not_estimated(name, reason) for name, reason in reasons.items()]
    dead = _dead_zone(segments)
    if isinstance(dead, Estimate):
        found.append(dead)
    else:
        lost.append(dead)
    deviation = float(np.sqrt(fit.residuals @ fit.residuals / fit.degrees))
    fixed = {"T_c": centers[0]} | ({"V_c": centers[1]} if "voltage_slope" in chosen else {})
    result = linear_result(
        "frequency", tuple(found), lost, residual_deviation=deviation, samples=len(flapping),
        title="flapping frequency", equations=(EQUATION,), fixed=fixed,
    )  # fmt: skip
    return FrequencyResult(result, segments)


class _Regression(NamedTuple):
    """Least squares of the frequencies, weighted by the number of strokes."""

    columns: dict[str, Array]
    frequency: Array
    root: Array
    """-; (N,), root of the weights"""

    def fit(self, terms: tuple[str, ...]) -> Fit:
        """Least squares on ``terms``; a fast beat scatters by more hertz than a slow one: HC3."""
        design = np.column_stack([self.columns[term] for term in terms]) * self.root[:, None]
        ones = np.ones(len(design))
        fit = regress(design, self.frequency * self.root, ones, covariance="white")
        inverse = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
        scatter = heteroscedastic_covariance(inverse, design, fit.residuals, ones)
        return fit._replace(covariance=at_least(fit.covariance, scatter))


def frequency_truth(model: FrequencyResult, throttles: Array, frequencies: Array) -> dict[str, float]:
    """The same fit on the true frequencies (Hz; (k,)) at ``throttles`` (k,), linear between: name to value."""
    terms = tuple(found.name for found in model.result.estimates if found.name in TERMS)
    true = tuple(
        s._replace(frequency=float(np.interp(s.throttle, throttles, frequencies))) if s.frequency else s
        for s in model.segments
    )
    return {found.name: found.value for found in fit_segments(true, terms).result.estimates if found.name in TERMS}


def _chosen(regression: _Regression, reach: float) -> tuple[tuple[str, ...], dict[str, str]]:
    """Terms with a significant partial F, and why the others are left out."""
    chosen: tuple[str, ...] = ("flapping_frequency",)
    if reach < LEAST_RANGE:
        why = f"the throttle varies by {reach:.2g} only"
        return chosen, dict.fromkeys(("throttle_slope", "throttle_curvature"), why)
    chosen, reasons = (*chosen, "throttle_slope"), {}
    for term in ("throttle_curvature", "voltage_slope"):
        why = _insignificant(regression, (*chosen, term))
        if why:
            reasons[term] = why
        else:
            chosen = (*chosen, term)
    return chosen, reasons


def _insignificant(regression: _Regression, terms: tuple[str, ...]) -> str:
    """Why the last of ``terms`` is left out; empty if it is significant."""
    count = len(regression.frequency)
    if not np.all(np.isfinite(regression.columns[terms[-1]])):
        return "the voltage was not measured"
    if count <= len(terms):
        return f"{count} stretches are too few to tell it"
    design = np.column_stack([regression.columns[term] for term in terms]) * regression.root[:, None]
    try:
        fit = regress(design, regression.frequency * regression.root, np.ones(count), covariance="white")
    except np.linalg.LinAlgError:
        return "it cannot be told from the other terms"
    ratio = float(fit.values[-1] ** 2 / max(fit.covariance[-1, -1], 1e-300))
    needed = float(fdtri(1.0, fit.degrees, 1 - CHANCE))
    return "" if ratio > needed else f"its partial F of {ratio:.2g} is below {needed:.2g}"


def _dead_zone(segments: tuple[Segment, ...]) -> Estimate | Finding:
    """Between the greatest throttle at which the wings stood and the least at which they flapped."""
    flapping = [s.throttle for s in segments if s.frequency > 0]
    still = [s.throttle for s in segments if s.frequency == 0 and (not flapping or s.throttle < min(flapping))]
    if not still or not flapping:
        return not_estimated(DEAD, "no throttle was held at which the wings stood still")
    low, high = max(still), min(flapping)
    # Nothing is known of where between the two it lies: a uniform distribution.
    return Estimate(DEAD, "-", (low + high) / 2, (high - low) / np.sqrt(12.0), low, high)
