"""Chapters of any method's fit: numbers, correlations, measured beside modelled, residuals, prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby, zip_longest

import numpy as np

from logs.identification.findings import of_severity
from logs.identification.report.document import (
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
    Matrix,
    Plot,
    Series,
    Table,
)
from logs.identification.report.labels import meaning, number, sentence
from logs.identification.report.result_formatting import finding_line
from logs.identification.results import Array, EstimationResult, FitSeries
from logs.identification.statistics.collinearity import STRONG, strong_pairs
from logs.identification.statistics.fit_quality import BAND, autocorrelation, theil

MOST_FITS = 24
"""-; manoeuvres that are drawn: more would only make the page long; all are in the tables"""
LONGEST_LAG = 0.5
"""-; of the shortest record, in the autocorrelation"""
Truths = Mapping[str, float]


def parameters_chapter(fits: tuple[EstimationResult, ...], truths: Truths, controls: Sequence[str] = ()) -> Chapter:
    """Estimates with their intervals, as numbers and as pictures, and what was not identified, method by method.

    ``controls`` are the inputs, where they have names of their own.
    """
    return Chapter("Parameters", (), parts=tuple(_parameters(fit, truths, controls) for fit in fits))


def _pieces(fit: EstimationResult, held_out: bool) -> list[FitSeries]:
    """The fit's series of one kind that have something to compare."""
    pieces = [one for one in fit.series if one.held_out == held_out]
    return [one for one in pieces if np.isfinite(one.measured - one.model).sum() > 1]


def _parameters(fit: EstimationResult, truths: Truths, controls: Sequence[str]) -> Chapter:
    bars = tuple(Bar(e.name, e, truths.get(e.name), meaning(e.name, controls)) for e in fit.estimates)
    failed = (sentence(fit.failure.text),) if fit.failure is not None else ()
    lost = tuple(f"Not identified: {one.subject.replace('_', ' ')}: {one.text}." for one in fit.withheld)
    notes = [sentence(finding_line(one)) for kind in ("warning", "info") for one in of_severity(fit.findings, kind)]
    return Chapter(fit.title, (*failed, *lost, *notes), plots=(Intervals("", bars),) if bars else ())


def correlation_chapter(fits: tuple[EstimationResult, ...]) -> Chapter | None:
    """How far the errors of the estimates go together; None where no method tells it."""
    parts = tuple(_correlation(fit) for fit in fits if fit.correlation is not None and len(fit.estimates) > 1)
    note = (
        f"Near 1 or −1 only a combination of the two is well known; pairs beyond ±{STRONG:g} are listed. Their"
        " intervals hold all the same: they contain it."
    )
    return Chapter("Correlation of the estimates", (note,), parts=parts) if parts else None


def _correlation(fit: EstimationResult) -> Chapter:
    assert fit.correlation is not None
    names = tuple(e.name for e in fit.estimates)
    pairs = strong_pairs(names, fit.correlation)
    close = [f"{one} and {other} ({number(value, 0.1)})" for one, other, value in pairs]
    return Chapter(
        fit.title,
        (f"Hard to tell apart: {', '.join(close)}.",) if close else ("No pair is beyond that.",),
        plots=(Matrix("", names, fit.correlation),),
    )


def fits_chapter(fits: tuple[EstimationResult, ...]) -> Chapter | None:
    """Measured beside modelled, a plot for each output of each manoeuvre; None without any."""
    parts = tuple(_fit_parts(fit) for fit in fits if _pieces(fit, held_out=False))
    note = "Measured and modelled outputs of every manoeuvre, time from its start."
    return Chapter("Fits", (note,), parts=parts) if parts else None


def _fit_parts(fit: EstimationResult) -> Chapter:
    """The method's table of goodness and its plots."""
    pieces = _pieces(fit, held_out=False)
    drawn, notes = _drawn(pieces)
    return Chapter(fit.title, notes, (_goodness(pieces),), parts=drawn)


def _drawn(pieces: list[FitSeries]) -> tuple[tuple[Chapter, ...], tuple[str, ...]]:
    groups = [(name, list(group)) for name, group in groupby(pieces, key=lambda one: one.experiment)]
    parts = tuple(Chapter(name, plots=tuple(_fit_plot(one) for one in group)) for name, group in groups[:MOST_FITS])
    left = len(groups) - len(parts)
    return parts, (f"The first {MOST_FITS} manoeuvres are drawn; {left} more are in the table.",) if left else ()


def _fit_plot(one: FitSeries) -> Plot:
    said = "predicted" if one.held_out else "model"
    lines = (
        Series("measured", one.time, one.measured, MEASURED),
        Series(said, one.time, one.model, MODEL, DASHED if one.held_out else "line"),
    )
    return Plot("", "time", "s", one.output, one.unit, lines)


def _goodness(pieces: list[FitSeries]) -> Table:
    """R^2, root mean square residual and Theil's coefficient of each output over its manoeuvres."""
    rows: list[tuple[Cell, ...]] = []
    for output, unit in dict.fromkeys((one.output, one.unit) for one in pieces):
        own = [one for one in pieces if one.output == output]
        measured, model = (np.concatenate([getattr(one, key) for one in own]) for key in ("measured", "model"))
        steady = np.concatenate([np.full(len(one.time), one.steady) for one in own])
        shares = theil(measured - steady, model - steady)[:4]
        r_squared, *rest = (round(share, 5) for share in (_r_squared(own), *shares))
        rows.append(
            (
                output,
                "" if unit == "-" else unit,
                meaning(output),
                r_squared,
                float(np.sqrt(np.nanmean((measured - model) ** 2))),
                *rest,
            )
        )
    columns = ("output", "unit", "", "R²", "RMS residual", "Theil U", "of it bias", "variance", "covariance")
    told = (
        "R² about each manoeuvre's mean. Theil's inequality coefficient U: 0 is a perfect match, 1 the worst, below"
        " 0.25 to 0.3 is taken for good; its shares should be near 0 for bias and variance, near 1 for covariance."
    )
    return Table(columns, tuple(rows), told)


def _r_squared(pieces: list[FitSeries]) -> float:
    """About each manoeuvre's own mean, so that offsets between manoeuvres explain nothing; NaN without variance."""
    left = sum(float(np.nansum((one.measured - one.model) ** 2)) for one in pieces)
    spread = sum(float(np.nansum((one.measured - np.nanmean(one.measured)) ** 2)) for one in pieces)
    return 1.0 - left / spread if spread > 0.0 else float("nan")


def residuals_chapter(fits: tuple[EstimationResult, ...]) -> Chapter | None:
    """Residuals in time, their autocorrelation and distribution, output by output; None without any fit."""
    parts = tuple(_residual_parts(fit) for fit in fits if _pieces(fit, held_out=False))
    notes = (
        "Measured minus model, all manoeuvres one after another. Were they white, 95 % of the autocorrelation would"
        " lie in the band. Averages over a stroke are correlated over a stroke whatever the model; the intervals of"
        " the parameters take the colour into account.",
    )
    return Chapter("Residuals", notes, parts=parts) if parts else None


def _residual_parts(fit: EstimationResult) -> Chapter:
    pieces = _pieces(fit, held_out=False)
    plots: list[Plot] = []
    for output, unit in dict.fromkeys((one.output, one.unit) for one in pieces):
        plots += _residual_plots(output, unit, [one for one in pieces if one.output == output])
    return Chapter(fit.title, plots=tuple(plots))


def _residual_plots(output: str, unit: str, pieces: list[FitSeries]) -> list[Plot]:
    residuals = [one.measured - one.model for one in pieces]
    step = float(pieces[0].time[1] - pieces[0].time[0])
    # A gap between manoeuvres keeps them apart.
    strung = np.concatenate([np.append(residual, np.nan) for residual in residuals])
    in_time = Plot(
        f"{output}: in time", "time, manoeuvres strung together", "s", f"residual of {output}", unit,
        (Series("", np.asarray(step * np.arange(len(strung)), dtype=np.float64), strung, OTHER),),
    )  # fmt: skip
    return [
        in_time,
        _autocorrelation_plot(output, residuals, step),
        _histogram(output, unit, np.concatenate(residuals)),
    ]


def _autocorrelation_plot(output: str, residuals: list[Array], step: float) -> Plot:
    lags = max(int(LONGEST_LAG * min(len(one) for one in residuals)), 1)
    values, pairs = autocorrelation(residuals, lags)
    half = BAND / np.sqrt(np.maximum(pairs, 1.0))
    at = np.asarray(step * np.arange(lags + 1), dtype=np.float64)
    band = Band("95 % band of white noise", at, -half, half)
    series = (Series("", at, values, OTHER, STEMS),)
    return Plot(f"{output}: autocorrelation", "lag", "s", "autocorrelation", "-", series, (band,))


def _histogram(output: str, unit: str, residuals: Array) -> Plot:
    there = residuals[np.isfinite(residuals)]
    counts, edges = np.histogram(there, bins=min(max(int(np.sqrt(len(there))), 5), 40), density=True)
    spread = float(there.std())
    bars = Series("residuals", edges, np.append(counts, 0.0), OTHER, STEPS)
    series = [bars]
    if spread > 0.0:
        x = np.linspace(edges[0], edges[-1], 81)
        normal = np.exp(-0.5 * ((x - there.mean()) / spread) ** 2) / (spread * np.sqrt(2.0 * np.pi))
        series.append(Series("normal of the same spread", x, normal, MODEL))
    return Plot(f"{output}: distribution", f"residual of {output}", unit, "density", "-", tuple(series))


def validation_chapter(fits: tuple[EstimationResult, ...], notes: Sequence[str] = ()) -> Chapter | None:
    """Held-out maneuvers as each result predicts them, with a note for each; None without any."""
    parts = []
    for fit, note in zip_longest(fits, notes[: len(fits)], fillvalue=""):
        if isinstance(fit, str):
            continue
        pieces, said = _pieces(fit, held_out=True), (note,) if isinstance(note, str) and note else ()
        if pieces:
            drawn, more = _drawn(pieces)
            parts.append(Chapter(fit.title, (*said, *more), (_goodness(pieces),), parts=drawn))
        elif said:
            parts.append(Chapter(fit.title, said))
    return Chapter("Validation on held-out manoeuvres", parts=tuple(parts)) if parts else None
