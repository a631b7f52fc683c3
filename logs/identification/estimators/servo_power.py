"""Power model of the drive servos (Gerdes Eq. 12, per servo: P/2 at I/2) from gauges, encoders and power sensors.

Centered and over stroke means, the form in which the paper uses it.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.estimators.least_squares import CovarianceKind, Fit, regress
from logs.identification.estimators.servo import with_gauge_errors
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, EstimationResult, estimate, linear_result, student_factor
from logs.identification.statistics.covariance import at_least, heteroscedastic_covariance
from logs.strokes import interval_mean, stroke_cuts, stroke_means
from wingbeat.errors import InputError

METHOD = "power"
EQUATIONS = (
    "P = C_A + C_B I + C_C V + C_F (I + C_D)(V + C_E) + C_G (I + C_D)^2 + C_H (V + C_E)^2 (Gerdes Eq. 12)",
    "P_0 is the power at the mean current and voltage, -C_D and -C_E",
)
LEAST_STROKES = 40
MIN_READINGS = 20
HIGHEST_INFLATION = 25.0
"""-; a regressor that is explained by the others so well (variance inflation) is not identifiable"""
NOISE_SHARE = 0.05
"""-; of the variance between strokes: so much of a slope is lost to noise in what it is per"""
VAGUE = "its 95 % interval spans zero: too little variation in this log"
GAUGES_VAGUE = "its 95 % interval, with what the gauges' calibrations left, spans zero"
NO_SLOPE = "without C_B nothing tells the power away from the center, of which it is the value at no current"
CONSTANTS = ("P_0", "C_A")
TERMS = {"C_A": "W", "C_B": "W/A", "C_C": "W/V", "C_F": "W/A/V", "C_G": "W/A^2", "C_H": "W/V^2"}
MEANING = {
    "C_C": "voltage",
    "C_F": "product of current and voltage",
    "C_G": "current squared",
    "C_H": "voltage squared",
}


class _Strokes(NamedTuple):
    """Stroke means per servo."""

    current: Array
    """A"""
    voltage: Array
    """V"""
    power: Array
    """W; mechanical output"""
    noise: tuple[float, float]
    """-; share of the variance of current and voltage between strokes that is the measurement's own"""


def _stroke_means(data: DriveData) -> _Strokes:
    if not len(data.wing_time):
        raise InputError("the log has no motion of the wings (/main/wing), which the power model needs")
    half = data.window / 2
    first = max(data.power_time[0], data.torque_time[0], data.wing_time[0]) + half
    last = min(data.power_time[-1] - half, data.torque_time[-1], data.wing_time[-1])
    cuts = stroke_cuts(data.wing_time, data.strokes) if np.ptp(data.strokes) > 2 else np.zeros(0)
    cuts = cuts[(cuts >= first) & (cuts <= last)]
    if len(cuts) < LEAST_STROKES:
        raise InputError(f"the log has {len(cuts)} wing strokes; the power model needs {LEAST_STROKES}")
    center = data.power_time - half
    power = np.zeros(len(data.torque_time))
    for torque, rate in ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right)):
        power += torque * np.interp(data.torque_time, data.wing_time, rate)
    flapping = np.diff(cuts) < 3 * np.median(np.diff(cuts))
    columns = interval_mean(center, np.column_stack((data.current, data.voltage)), cuts[:-1], cuts[1:])[flapping]
    return _Strokes(
        columns[:, 0] / 2, columns[:, 1], stroke_means(data.torque_time, power, cuts)[flapping] / 2,
        _noise_shares(data, cuts, columns.var(axis=0)),
    )  # fmt: skip


def _noise_shares(data: DriveData, cuts: Array, variance: Array) -> tuple[float, float]:
    """How much of the ``variance`` (2,) of stroke means is noise, by every other burst against those between."""
    stroke = np.searchsorted(cuts, data.power_time - data.window / 2) - 1
    inside = (stroke >= 0) & (stroke < len(cuts) - 1)
    halves = []
    for part in (0, 1):
        chosen = inside & (np.arange(len(stroke)) % 2 == part)
        count = np.maximum(np.bincount(stroke[chosen], minlength=len(cuts) - 1), 1)
        sums = [np.bincount(stroke[chosen], v[chosen], len(cuts) - 1) for v in (data.current, data.voltage)]
        halves.append(np.array(sums) / count)
    # Neighbors of a sample differ by the motion within the stroke too; the next stroke's do so alike.
    own = np.var(halves[0] - halves[1], axis=1) / 4
    current, voltage = np.where(variance > 0, own / np.where(variance > 0, variance, 1.0), np.inf)
    return float(current), float(voltage)


def identify_power(
    data: DriveData,
    centre_current: float | None = None,
    centre_voltage: float | None = None,
    terms: tuple[str, ...] | None = None,
) -> EstimationResult:
    """The identifiable coefficients of Gerdes Eq. 12, centered on C_D and C_E as given or on the data's own means.

    ``terms`` fixes the coefficients that are fitted and told; without it those are left out that the regressors'
    collinearity or their own standard error makes meaningless, and the constants `P_0` and `C_A` where nothing tells
    them.

    Raises:
        InputError: too few strokes.
    """
    return _power_model(_stroke_means(data), centre_current, centre_voltage, terms)


def power_of_readings(current: Array, voltage: Array, power: Array, steady: bool = True) -> EstimationResult:
    """The coefficients of Gerdes Eq. 12 from readings (N,) of one servo on a bench, in A, V and W.

    ``steady`` readings are independent of one another.

    Raises:
        InputError: too few readings.
    """
    known = np.isfinite(current) & np.isfinite(voltage) & np.isfinite(power)
    if known.sum() < MIN_READINGS:
        raise InputError(f"{int(known.sum())} readings have current, voltage and power; {MIN_READINGS} are needed")
    readings = _Strokes(current[known], voltage[known], power[known], (0.0, 0.0))
    return _power_model(readings, None, None, None, "white" if steady else "autocorrelated")


def _power_model(
    strokes: _Strokes,
    centre_current: float | None,
    centre_voltage: float | None,
    terms: tuple[str, ...] | None,
    covariance: CovarianceKind = "autocorrelated",
) -> EstimationResult:
    c_d = -float(strokes.current.mean()) if centre_current is None else centre_current
    c_e = -float(strokes.voltage.mean()) if centre_voltage is None else centre_voltage
    columns = _regressors(strokes.current + c_d, strokes.voltage + c_e)
    dropped: tuple[Finding, ...] = ()
    chosen = terms
    if chosen is None:
        chosen, noisy = _measured(strokes)
        chosen, weak = _identifiable(columns, strokes.power, chosen, covariance)
        dropped = (*noisy, *weak)
    fit = _fit(columns, strokes.power, chosen, covariance)
    estimates = _coefficients(fit, chosen, c_d, c_e)
    model = linear_result(
        METHOD, estimates, dropped, residual_deviation=float(np.std(fit.residuals)), samples=len(strokes.power),
        title="servo power", equations=EQUATIONS, fixed={"C_D": c_d, "C_E": c_e},
    )  # fmt: skip
    return _without_vague(model) if terms is None else model


def power_with_gauge_errors(
    data: DriveData, gauges: GaugeErrors, centre_current: float | None = None, centre_voltage: float | None = None
) -> EstimationResult:
    """`identify_power` with intervals that hold what the sensors' calibrations left.

    Raises:
        InputError: too few strokes.
    """
    model = identify_power(data, centre_current, centre_voltage)
    center, dropped = (model.fixed["C_D"], model.fixed["C_E"]), list(model.withheld)
    terms = _terms(model)
    while True:
        fit = partial(identify_power, centre_current=center[0], centre_voltage=center[1], terms=terms)
        widened = with_gauge_errors(fit, data, gauges)
        vague = [one for one in widened.estimates if one.name in terms[1:] and one.contains(0.0)]
        if not vague:
            refused = tuple(one for one in dropped if one.subject not in CONSTANTS)
            return _without_vague(widened._replace(findings=refused))
        worst = min(vague, key=lambda one: abs(one.value) / one.standard_error).name
        dropped.append(not_estimated(worst, GAUGES_VAGUE))
        terms = tuple(term for term in terms if term != worst)


def _terms(model: EstimationResult) -> tuple[str, ...]:
    """What was fitted, of `TERMS`: the constant always is, told or not."""
    return ("C_A", *(one.name for one in model.estimates if one.name in TERMS and one.name != "C_A"))


def _without_vague(model: EstimationResult) -> EstimationResult:
    """The model without the constants that the data does not tell: with none of C_B there is nothing along which to
    go from the center's power to that at no current."""
    refused = [not_estimated(e.name, VAGUE) for e in model.estimates if e.name in CONSTANTS and e.contains(0.0)]
    if "C_B" not in _terms(model):
        refused = [*(one for one in refused if one.subject != "C_A"), not_estimated("C_A", NO_SLOPE)]
    lost = {one.subject for one in refused}
    kept = tuple(one for one in model.estimates if one.name not in lost)
    return model._replace(estimates=kept, findings=(*model.findings, *refused))


def _regressors(i: Array, v: Array) -> dict[str, Array]:
    """Columns of the terms by current ``i`` (A) and voltage ``v`` (V) about the center."""
    return {"C_A": np.ones_like(i), "C_B": i, "C_C": v, "C_F": i * v, "C_G": i * i, "C_H": v * v}


def _fit(
    columns: dict[str, Array], power: Array, terms: tuple[str, ...], covariance: CovarianceKind = "autocorrelated"
) -> Fit:
    scale = {term: float(np.sqrt(np.mean(columns[term] ** 2))) or 1.0 for term in terms}
    design = np.column_stack([columns[term] / scale[term] for term in terms])
    fit = regress(design, power, np.ones_like(power), covariance=covariance)
    # Strong strokes scatter more than weak ones: their noise is the gauges' times the rate.
    inner = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
    scatter = heteroscedastic_covariance(inner, design, fit.residuals, np.ones_like(power))
    fit = fit._replace(covariance=at_least(fit.covariance, scatter))
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


def _measured(strokes: _Strokes) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Terms whose current and voltage differ between strokes by more than their noise, which flattens slopes."""
    needs = {"C_B": (0,), "C_G": (0,), "C_C": (1,), "C_H": (1,), "C_F": (0, 1)}
    bad = [index for index in (0, 1) if not strokes.noise[index] <= NOISE_SHARE]
    dropped = tuple(
        not_estimated(term, f"the {('current', 'voltage')[lost[0]]} varies from stroke to stroke by little but noise")
        for term, need in needs.items()
        if (lost := [index for index in need if index in bad])
    )
    refused = {entry.subject for entry in dropped}
    return tuple(term for term in TERMS if term not in refused), dropped


def _identifiable(
    columns: dict[str, Array], power: Array, kept: tuple[str, ...], covariance: CovarianceKind
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Backward elimination, highest terms first: collinear ones, then those whose interval spans zero."""
    dropped: list[Finding] = []
    while True:
        candidates = [term for term in reversed(kept) if term != "C_A"]
        worst = max(candidates, key=lambda t: _rank(columns, kept, t), default=None)
        if worst is None or _inflation(columns, kept, worst) <= HIGHEST_INFLATION:
            break
        dropped.append(not_estimated(worst, _collinear(worst, _inflation(columns, kept, worst))))
        kept = tuple(term for term in kept if term != worst)
    while True:
        fit = _fit(columns, power, kept, covariance)
        ratio = np.abs(fit.values) / np.sqrt(np.diag(fit.covariance))
        weak = [(r, t) for r, t in zip(ratio, kept, strict=True) if t != "C_A" and r < student_factor(fit.degrees)]
        if not weak:
            return kept, tuple(dropped)
        term = min(weak)[1]
        dropped.append(not_estimated(term, VAGUE))
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
    """Eq. 12's coefficients from the centered ones: its C_B I + C_C V is not centered, which changes C_A."""
    gradient = np.zeros((len(terms), len(terms)))
    np.fill_diagonal(gradient, 1.0)
    for index, term in enumerate(terms):
        if term in ("C_B", "C_C"):
            gradient[0, index] = c_d if term == "C_B" else c_e
    values = gradient @ fit.values
    errors = np.sqrt(np.diag(gradient @ fit.covariance @ gradient.T))
    one = [
        estimate(t, TERMS[t], float(v), float(e), fit.degrees) for t, v, e in zip(terms, values, errors, strict=True)
    ]
    centered = estimate("P_0", "W", float(fit.values[0]), float(np.sqrt(fit.covariance[0, 0])), fit.degrees)
    return (centered, *one)


def power_of(model: EstimationResult, current: Array, voltage: Array) -> Array:
    """Eq. 12 in W about its center by ``current`` (A) and ``voltage`` (V) of one servo (N,); NaN without P_0."""
    values = {one.name: one.value for one in model.estimates}
    columns = {"P_0": np.ones(len(current))} | _regressors(current + model.fixed["C_D"], voltage + model.fixed["C_E"])
    total = sum(values.get(name, 0.0) * column for name, column in columns.items() if name != "C_A")
    return np.asarray(total if "P_0" in values else np.full(len(current), np.nan))


def power_truth(data: DriveData, measured: EstimationResult) -> dict[str, float]:
    """The coefficients that ``measured`` has, by the same regression on true drive ``data``: name to value."""
    model = identify_power(data, measured.fixed["C_D"], measured.fixed["C_E"], _terms(measured))
    told = {e.name for e in measured.estimates}
    return {e.name: e.value for e in model.estimates if e.name in told}
