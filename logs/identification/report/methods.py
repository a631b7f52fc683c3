"""Chapter of one estimation method: parameters, correlations, fit, residuals and validation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from logs.identification.findings import CATALOG, Finding
from logs.identification.results import Array, Estimate, EstimationResult, FitSeries
from logs.identification.statistics.fit_quality import BAND, STRONG, autocorrelation, strong_pairs, theil
from logs.pages.document import (
    DASHED,
    MEASURED,
    MODEL,
    OTHER,
    STEMS,
    STEPS,
    Band,
    Bar,
    Cell,
    Chapter,
    Intervals,
    Plot,
    Remark,
    Series,
    Table,
)
from logs.pages.labels import capitalized, meaning, sentence, spaced

LARGEST_PAIRS = 5
"""limit of the listed correlations"""
LONGEST_LAG = 0.5
"""-; of the shortest record, in the autocorrelation"""
SEPARATION = 0.03
"""-; gap between maneuvers in a plot, of their total length"""
Truths = Mapping[str, float]


def remark(finding: Finding) -> Remark:
    """Return a finding as shown on a page."""
    named = not finding.subject or finding.subject in finding.text
    text = sentence(finding.text if named else f"{spaced(finding.subject)}: {finding.text}")
    remedy = CATALOG[finding.code].remedy if finding.severity != "info" else ""
    return Remark(finding.severity, finding.code, text, remedy)


def remarks(findings: Iterable[Finding]) -> tuple[Remark, ...]:
    """Return findings as shown on a page, the most severe first, each text once with all its subjects."""
    order = ("withheld", "warning", "info")
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for one in sorted(findings, key=lambda one: order.index(one.severity)):
        groups.setdefault((one.severity, one.code, one.line), []).append(one)
    return tuple(
        remark(same[0] if len(same) == 1 else same[0]._replace(subject=", ".join(one.subject for one in same)))
        for same in groups.values()
    )


def missing_remarks(missing: Iterable[Finding]) -> tuple[Remark, ...]:
    """Return parameters without an estimate as shown on a page."""
    return tuple(
        Remark("withheld", "not_estimated", sentence(f"{spaced(one.subject)}: {one.text}")) for one in missing
    )


def intervals(
    estimates: Iterable[Estimate], truths: Truths = MappingProxyType({}), controls: Sequence[str] = ()
) -> tuple[Intervals, ...]:
    """Return the table of ``estimates``; empty without any. ``controls`` are the inputs of the model."""
    bars = tuple(Bar(one.name, one, truths.get(one.name), meaning(one.name, controls)) for one in estimates)
    return (Intervals("", bars),) if bars else ()


def method_chapter(fit: EstimationResult, truths: Truths, controls: Sequence[str] = (), note: str = "") -> Chapter:
    """Return everything about one result; ``controls`` are its inputs, ``note`` describes the validation."""
    parts = (_correlation(fit), _comparison(fit, held_out=False), _residuals(fit), _comparison(fit, True, note))
    return Chapter(
        capitalized(fit.title), plots=intervals(fit.estimates, truths, controls), findings=remarks(fit.findings),
        parts=tuple(part for part in parts if part is not None),
    )  # fmt: skip


def _correlation(fit: EstimationResult) -> Chapter | None:
    """Return the largest correlations of the estimates; None if all are weak."""
    if fit.correlation is None or len(fit.estimates) < 2:
        return None
    pairs = strong_pairs(tuple(e.name for e in fit.estimates), fit.correlation)
    rows = tuple((spaced(one), spaced(other), value) for one, other, value in pairs[:LARGEST_PAIRS])
    caption = f"The {len(rows)} largest of {len(pairs)} correlations beyond ±{STRONG:g}. The intervals include them."
    table = Table(("parameter", "and", "correlation"), rows, caption)
    return Chapter("Correlation of the estimates", tables=(table,)) if rows else None


def _pieces(fit: EstimationResult, held_out: bool) -> list[FitSeries]:
    """Return the series of fitted or predicted outputs with at least two samples of both."""
    pieces = [one for one in fit.series if one.held_out == held_out]
    return [one for one in pieces if np.isfinite(one.measured - one.model).sum() > 1]


def _outputs(pieces: Iterable[FitSeries]) -> dict[tuple[str, str], list[FitSeries]]:
    """Return the series by output and unit."""
    groups: dict[tuple[str, str], list[FitSeries]] = {}
    for one in pieces:
        groups.setdefault((one.output, one.unit), []).append(one)
    return groups


def _comparison(fit: EstimationResult, held_out: bool, note: str = "") -> Chapter | None:
    """Return measured and modeled outputs: goodness of fit and one plot for each output, maneuvers in sequence."""
    pieces = _pieces(fit, held_out)
    notes = (note,) if note else ()
    title = "Validation on held-out maneuvers" if held_out else "Measured and modeled outputs"
    if not pieces:
        return Chapter(title, notes) if notes else None
    plots = tuple(_fit_plot(output, unit, same) for (output, unit), same in _outputs(pieces).items())
    return Chapter(title, notes, (_goodness(pieces),), plots)


def _fit_plot(output: str, unit: str, pieces: Sequence[FitSeries]) -> Plot:
    time, starts = sequence(pieces)
    measured, model = (_joined([getattr(one, key) for one in pieces]) for key in ("measured", "model"))
    held_out = pieces[0].held_out
    lines = (
        Series("measured", time, measured, MEASURED),
        Series("predicted" if held_out else "model", time, model, MODEL, DASHED if held_out else "line"),
    )
    marks = (
        tuple((start, one.experiment) for start, one in zip(starts, pieces, strict=True)) if len(pieces) > 1 else ()
    )
    return Plot(
        "", "time, maneuvers in sequence" if marks else "time", "s", output, unit, lines, (), marks, wide=True
    )


def sequence(pieces: Sequence[FitSeries]) -> tuple[Array, list[float]]:
    """Return the time of all series in sequence, with a sample of each gap between them, and their starts (s)."""
    gap = SEPARATION * sum(float(one.time[-1] - one.time[0]) for one in pieces) / len(pieces)
    times, starts, start = [], list[float](), 0.0 if len(pieces) > 1 else float(pieces[0].time[0])
    for one in pieces:
        starts.append(start)
        local = start + one.time - one.time[0]
        times.append(np.append(local, local[-1] + gap / 2))
        start = float(local[-1]) + gap
    return np.concatenate(times), starts


def _joined(columns: Sequence[Array]) -> Array:
    """Return columns in sequence, each followed by a gap."""
    return np.concatenate([np.append(one, np.nan) for one in columns])


def _goodness(pieces: Sequence[FitSeries]) -> Table:
    """Return R², RMS residual and Theil's coefficient of each output over its maneuvers."""
    rows: list[tuple[Cell, ...]] = []
    for (output, unit), same in _outputs(pieces).items():
        measured, model = (np.concatenate([getattr(one, key) for one in same]) for key in ("measured", "model"))
        steady = np.concatenate([np.full(len(one.time), one.steady) for one in same])
        fractions = theil(measured - steady, model - steady)[:4]
        r_squared, *rest = (round(value, 5) for value in (_r_squared(same), *fractions))
        rms = float(np.sqrt(np.nanmean((measured - model) ** 2)))
        rows.append((output, "" if unit == "-" else unit, meaning(output), r_squared, rms, *rest))
    caption = (
        "R² about the mean of each maneuver. Theil's U: 0 for a perfect model, below 0.25 to 0.3 for a good one."
    )
    columns = ("output", "unit", "", "R²", "RMS residual", "Theil U", "bias", "variance", "covariance")
    return Table(columns, tuple(rows), caption)


def _r_squared(pieces: Sequence[FitSeries]) -> float:
    """Return R² about the mean of each maneuver; NaN if the measurement is constant."""
    residual = sum(float(np.nansum((one.measured - one.model) ** 2)) for one in pieces)
    total = sum(float(np.nansum((one.measured - np.nanmean(one.measured)) ** 2)) for one in pieces)
    return 1.0 - residual / total if total > 0.0 else float("nan")


def _residuals(fit: EstimationResult) -> Chapter | None:
    """Return autocorrelation and distribution of the residuals of each output; None without any fit."""
    plots: list[Plot] = []
    for (output, unit), same in _outputs(_pieces(fit, held_out=False)).items():
        residuals = [one.measured - one.model for one in same]
        if not same[0].independent:
            plots.append(_autocorrelation_plot(output, residuals, float(same[0].time[1] - same[0].time[0])))
        plots.append(_histogram(output, unit, np.concatenate(residuals)))
    note = "Residual: measured minus model. 95 % of the autocorrelation of white residuals lies in the band."
    return Chapter("Residuals", (note,), plots=tuple(plots)) if plots else None


def _autocorrelation_plot(output: str, residuals: Sequence[Array], step: float) -> Plot:
    lags = max(int(LONGEST_LAG * min(len(one) for one in residuals)), 1)
    values, pairs = autocorrelation(list(residuals), lags)
    half = BAND / np.sqrt(np.maximum(pairs, 1.0))
    lag = np.asarray(step * np.arange(lags + 1), dtype=np.float64)
    series = (Series("", lag, values, OTHER, STEMS),)
    band = Band("95 % band of white noise", lag, -half, half)
    return Plot("", "lag", "s", f"autocorrelation of the residual of {output}", "-", series, (band,))


def _histogram(output: str, unit: str, residuals: Array) -> Plot:
    finite = residuals[np.isfinite(residuals)]
    counts, edges = np.histogram(finite, bins=min(max(int(np.sqrt(len(finite))), 5), 40), density=True)
    deviation = float(finite.std())
    series = [Series("residuals", edges, np.append(counts, 0.0), OTHER, STEPS)]
    if deviation > 0.0:
        x = np.linspace(edges[0], edges[-1], 81)
        normal = np.exp(-0.5 * ((x - finite.mean()) / deviation) ** 2) / (deviation * np.sqrt(2.0 * np.pi))
        series.append(Series("normal distribution", x, normal, MODEL))
    return Plot(
        "", f"residual of {output}", unit, f"probability density of the residual of {output}", "-", tuple(series)
    )
