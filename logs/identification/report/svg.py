"""A plot as inline SVG: axes with round numbers, lines, points, stems, steps and bands; colours are the page's."""

from __future__ import annotations

import html
import math
from typing import NamedTuple

import numpy as np

from logs.identification.report.document import DASHED, LINE, POINTS, STEMS, STEPS, Band, Plot, Series
from logs.identification.report.labels import drawn_words
from logs.identification.report.labels import unit as raised
from logs.identification.results import Array

MOST_POINTS = 2500
"""-; of a scatter: more would only hide each other"""
DIGIT = 6.5
"""px; width of a digit on an axis"""
LEFT, RIGHT, TOP, BELOW = 52.0, 12.0, 20.0, 36.0
"""px; around the axes, for the numbers and names"""


class Size(NamedTuple):
    """Of a whole plot."""

    width: float
    """px"""
    height: float
    """px"""


NARROW, WIDE = Size(360.0, 215.0), Size(1090.0, 260.0)


class Axis(NamedTuple):
    """One axis: the numbers at its ends, where those are in px, and the numbers that are written."""

    low: float
    """as the plot's axis"""
    high: float
    """as the plot's axis"""
    start: float
    """px; of ``low``"""
    end: float
    """px; of ``high``"""
    ticks: tuple[float, ...]
    """as the plot's axis"""

    def place(self, values: Array) -> Array:
        """px of ``values`` (N,)."""
        placed: Array = self.start + (values - self.low) / (self.high - self.low) * (self.end - self.start)
        return placed


def drawn(plot: Plot, size: Size) -> str:
    """The SVG of a plot that has anything finite to show, else a line that says so."""
    extent = _extent(plot)
    if extent is None:
        return '<p class="none">Nothing finite to draw.</p>'
    (left, right), (low, high) = extent
    across = _across(left, right, size)
    up = axis(*_airy(low, high), size.height - BELOW, TOP, 4)
    parts = [_frame(plot, across, up, size)]
    parts += [_band(band, across, up) for band in plot.bands]
    parts += [_series(series, across, up) for series in plot.series]
    words = html.escape(f"{plot.title}: {plot.y} against {plot.x}", quote=True)
    return (
        f'<svg viewBox="0 0 {size.width:g} {size.height:g}" role="img" aria-label="{words}">'
        + "".join(parts)
        + "</svg>"
    )


def _across(left: float, right: float, size: Size) -> Axis:
    """The axis below, with as many numbers as stand there apart from one another."""
    for about in range(6 if size.width > 500 else 5, 1, -1):
        found = axis(left, right, LEFT, size.width - RIGHT, about)
        widths = DIGIT * np.array([len(written(one, _step(found))) for one in found.ticks])
        if np.all(np.diff(found.place(np.array(found.ticks))) > 0.5 * (widths[1:] + widths[:-1]) + DIGIT):
            break
    return found


def axis(low: float, high: float, start: float, end: float, about: int) -> Axis:
    """An axis over [``low``, ``high``] with about so many round numbers on it, no fewer than one less."""
    if high - low <= 1e-9 * max(abs(high), abs(low), 1e-12):
        margin = 0.5 * abs(high) or 1.0
        low, high = low - margin, high + margin
    step = round_step((high - low) / about)
    while len(ticks := _ticks(low, high, step)) < about - 1:
        step = round_step(0.4 * step)
    return Axis(low, high, start, end, ticks)


def _ticks(low: float, high: float, step: float) -> tuple[float, ...]:
    """Multiples of ``step`` in [``low``, ``high``]."""
    first = math.ceil(low / step - 1e-9)
    return tuple(k * step for k in range(first, math.floor(high / step + 1e-9) + 1))


def round_step(step: float) -> float:
    """The next of 1, 2, 5 times a power of ten that is not below ``step``."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1 - 1e-9))


def written(value: float, step: float) -> str:
    """A tick's number with the digits that its ``step`` needs."""
    if value == 0.0 or abs(value) < 1e-9 * step:
        return "0"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(step) + 1e-9) + 1
    if abs(value) >= 1e6 or step >= 1e5 or (step < 1e-3 and digits <= 3):
        mantissa, _, exponent = f"{value:.3g}".partition("e")
        return f"{mantissa}e{int(exponent)}" if exponent else mantissa
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}".replace("-", "−")


def labelled(name: str, unit: str) -> str:
    """An axis' name with its unit, as SVG text."""
    told = raised(unit)
    return drawn_words(name) + (f" ({told})" if told else "")


def _airy(low: float, high: float) -> tuple[float, float]:
    margin = 0.06 * (high - low)
    return low - margin, high + margin


def _extent(plot: Plot) -> tuple[tuple[float, float], tuple[float, float]] | None:
    xs, ys = [], []
    for one in plot.series:
        there = np.isfinite(one.x) & np.isfinite(one.y)
        xs.append(one.x[there])
        ys.append(one.y[there])
        if one.style in (STEMS, STEPS):
            ys.append(np.zeros(1))
    if not sum(len(x) for x in xs):
        return None
    for band in plot.bands:
        ys += [band.low[np.isfinite(band.low)], band.high[np.isfinite(band.high)]]
    x, y = np.concatenate(xs), np.concatenate(ys)
    return (float(x.min()), float(x.max())), (float(y.min()), float(y.max()))


def _frame(plot: Plot, across: Axis, up: Axis, size: Size) -> str:
    floor, lines = size.height - BELOW, []
    for tick, x in zip(across.ticks, across.place(np.array(across.ticks)), strict=True):
        lines.append(f'<path class="grid" d="M{x:.1f} {TOP:g}V{floor:g}"/>')
        text = written(tick, _step(across))
        lines.append(f'<text x="{x:.1f}" y="{floor + 14:g}" text-anchor="middle">{text}</text>')
    for tick, y in zip(up.ticks, up.place(np.array(up.ticks)), strict=True):
        lines.append(
            f'<path class="{"zero" if tick == 0 else "grid"}" d="M{LEFT:g} {y:.1f}H{size.width - RIGHT:g}"/>'
        )
        lines.append(f'<text x="{LEFT - 6:g}" y="{y + 4:.1f}" text-anchor="end">{written(tick, _step(up))}</text>')
    middle = (LEFT + size.width - RIGHT) / 2
    lines.append(f'<text class="name" x="4" y="12">{labelled(plot.y, plot.y_unit)}</text>')
    name = labelled(plot.x, plot.x_unit)
    lines.append(f'<text class="name" x="{middle:g}" y="{size.height - 5:g}" text-anchor="middle">{name}</text>')
    return "".join(lines)


def _step(one: Axis) -> float:
    return one.ticks[1] - one.ticks[0] if len(one.ticks) > 1 else max(abs(one.ticks[0]) if one.ticks else 0.0, 1e-12)


def _band(band: Band, across: Axis, up: Axis) -> str:
    there = np.isfinite(band.low) & np.isfinite(band.high)
    x, low, high = across.place(band.x[there]), up.place(band.low[there]), up.place(band.high[there])
    if not len(x):
        return ""
    points = [f"{a:.1f},{b:.1f}" for a, b in zip(x, high, strict=True)]
    points += [f"{a:.1f},{b:.1f}" for a, b in zip(x[::-1], low[::-1], strict=True)]
    return f'<polygon class="band" points="{" ".join(points)}"/>'


def _series(one: Series, across: Axis, up: Axis) -> str:
    x, y = across.place(np.asarray(one.x, dtype=np.float64)), up.place(np.asarray(one.y, dtype=np.float64))
    kind = f"{one.role} {one.style}"
    if one.style == POINTS:
        return f'<path class="{kind}" d="{_dots(x, y)}"/>'
    if one.style == STEMS:
        zero = float(up.place(np.zeros(1))[0])
        path = "".join(f"M{a:.1f} {zero:.1f}V{b:.1f}" for a, b in zip(x, y, strict=True) if np.isfinite(a + b))
        return f'<path class="{kind}" d="{path}"/>'
    if one.style == STEPS:
        return f'<path class="{kind}" d="{_steps(x, y, float(up.place(np.zeros(1))[0]))}"/>'
    assert one.style in (LINE, DASHED)
    return f'<path class="{kind}" d="{_line(x, y)}"/>'


def _dots(x: Array, y: Array) -> str:
    there = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(there) > MOST_POINTS:
        there = there[np.linspace(0, len(there) - 1, MOST_POINTS).astype(int)]
    # A line of no length with round ends is a dot, at a third of a circle's text.
    return "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[there], y[there], strict=True))


def _steps(x: Array, y: Array, floor: float) -> str:
    path = [f"M{x[0]:.1f} {floor:.1f}"]
    path += [f"V{b:.1f}H{end:.1f}" for b, end in zip(y[:-1], x[1:], strict=True)]
    return "".join(path) + f"V{floor:.1f}Z"


def _line(x: Array, y: Array) -> str:
    path, pen = [], "M"
    for a, b in zip(*_thinned(x, y), strict=True):
        if not np.isfinite(a + b):
            pen = "M"
            continue
        path.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return "".join(path)


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """The line with the least and the greatest of every half px: what is drawn stays as it is."""
    span = float(np.nanmax(x) - np.nanmin(x)) if np.any(np.isfinite(x)) else 0.0
    columns = max(int(2 * span), 1)
    if len(x) <= 3 * columns:
        return x, y
    kept: set[int] = {0, len(x) - 1}
    for piece in np.array_split(np.arange(len(x)), columns):
        values = y[piece]
        if np.all(np.isfinite(values)):
            kept |= {int(piece[np.argmin(values)]), int(piece[np.argmax(values)])}
        else:
            kept |= {int(i) for i in piece[:2]}
    chosen = np.array(sorted(kept))
    return x[chosen], y[chosen]
