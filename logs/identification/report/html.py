"""Chapters as one page of HTML with everything in it: needs no network, opens from the disk, prints."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

from logs.identification.report.document import Bar, Cell, Chapter, Intervals, Matrix, Plot, Series, Table
from logs.identification.report.labels import meaning, number, rich, symbol, unit
from logs.identification.report.svg import NARROW, WIDE, drawn

FOLDER = Path(__file__).parent
NUMERIC = re.compile(r"(in )?\(?[-+−]?\d+(\.\d+)?(e[-+−]?\d+)?\)?( ?[%°*]| of \d+( \*)?| \(.* to .*\))?|")
"""a number in words: 12, (−0.31), 0.58 (0.44 to 0.71), in 15 of 26"""
OF_ONE_SIZE = 20.0
"""-; the largest number of a column over the least, up to which they have decimals in common"""
BAR_WIDTH, BAR_HEIGHT = 240.0, 18.0
"""px; of the picture of an interval"""


def page(title: str, facts: Iterable[str], chapters: tuple[Chapter, ...]) -> str:
    """The whole page: ``title``, one line of ``facts``, a table of contents and the ``chapters``."""
    style = (FOLDER / "page.css").read_text(encoding="utf-8")
    numbered = [(f"c{i + 1}", chapter) for i, chapter in enumerate(chapters)]
    contents = "".join(f'<li><a href="#{key}">{html.escape(one.title)}</a></li>' for key, one in numbered)
    body = "".join(f'<section id="{key}">{_chapter(one, 2)}</section>' for key, one in numbered)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline';"
        ' img-src data:">\n<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f'<header><h1 id="vehicle">{html.escape(title)}</h1><p>{html.escape("  ·  ".join(facts))}</p></header>\n'
        f"<nav><ol>{contents}</ol></nav>\n<main>{body}</main>\n</body>\n</html>\n"
    )


def _chapter(chapter: Chapter, level: int) -> str:
    """One chapter and, a heading lower, its parts."""
    heading = f"<h{level}>{rich(chapter.title)}</h{level}>"
    notes = "".join(f"<p>{rich(note)}</p>" for note in chapter.notes)
    tables = "".join(_table(table) for table in chapter.tables)
    pictures = [_picture(plot, len(chapter.plots) == 1) for plot in chapter.plots]
    plots = f'<div class="plots">{"".join(pictures)}</div>' if pictures else ""
    parts = "".join(f'<div class="part">{_chapter(part, min(level + 1, 4))}</div>' for part in chapter.parts)
    return heading + notes + tables + plots + parts


def _table(table: Table) -> str:
    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    right = [
        all(map(_is_number, (row[i] for row in table.rows))) and bool(table.rows) for i in range(len(table.columns))
    ]
    heads = "".join(
        f"<th{_right(numeric)}>{html.escape(column)}</th>"
        for column, numeric in zip(table.columns, right, strict=True)
    )
    places = [_places([row[i] for row in table.rows]) for i in range(len(table.columns))]
    rows = "".join(
        "<tr>"
        + "".join(
            f"<td{_right(side)}>{_cell(cell, count)}</td>"
            for cell, side, count in zip(row, right, places, strict=True)
        )
        + "</tr>"
        for row in table.rows
    )
    return f'<div class="wide"><table>{caption}<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>'


def _is_number(cell: Cell) -> bool:
    """Whether a cell stands to the right: a number, one in words, or nothing."""
    return not isinstance(cell, str) or NUMERIC.fullmatch(cell) is not None


def _right(numeric: bool) -> str:
    return ' class="number"' if numeric else ""


def _places(column: list[Cell]) -> int | None:
    """Decimals that every number of a column has, four digits of the largest; None where they are of many sizes."""
    sizes = [abs(cell) for cell in column if isinstance(cell, float) and math.isfinite(cell) and cell]
    if not sizes or max(sizes) > OF_ONE_SIZE * min(sizes) or all(size.is_integer() for size in sizes):
        return None
    return min(max(3 - math.floor(math.log10(max(sizes))), 0), 9)


def _cell(cell: Cell, places: int | None) -> str:
    if cell is None:
        return ""
    if not isinstance(cell, float):
        return rich(cell).replace("^2", "²")
    if places is None or not math.isfinite(cell) or not cell:
        return number(cell)
    return f"{cell:.{places}f}".replace("-", "−")


def _picture(plot: Plot | Intervals | Matrix, alone: bool) -> str:
    if isinstance(plot, Intervals):
        return _intervals(plot)
    if isinstance(plot, Matrix):
        return _matrix(plot)
    keys = [_key(one) for one in plot.series if one.label] + [
        f'<span><i class="key band"></i>{html.escape(band.label)}</span>' for band in plot.bands if band.label
    ]
    legend = f'<div class="legend">{"".join(keys)}</div>' if keys else ""
    caption = f"<figcaption>{rich(plot.title)}</figcaption>" if plot.title else ""
    return (
        f"<figure{' class=wide' if alone else ''}>{caption}{legend}{drawn(plot, WIDE if alone else NARROW)}</figure>"
    )


def _key(one: Series) -> str:
    return f'<span><i class="key {one.role} {one.style}"></i>{html.escape(one.label)}</span>'


def _intervals(plot: Intervals) -> str:
    """A row each: name, number, interval, its picture, the truth; neighbours of one name share a scale."""
    known = any(bar.truth is not None for bar in plot.bars)
    rows = []
    for (name, _), group in groupby(plot.bars, key=lambda bar: (bar.estimate.name, bar.estimate.unit)):
        bars = list(group)
        scale = _scale(bars)
        if any(bar.label != name for bar in bars):
            rows.append(f'<tr><th class="group" colspan="{7 if known else 6}">{_heading(name)}</th></tr>')
        rows += [_bar(bar, scale, name, known) for bar in bars]
        rows.append(_scale_row(scale, known))
    heads = ["", "estimate", "95 % interval", "", *(["true"] if known else []), "unit", ""]
    sides = ("", "number", "number", "", *(("number",) if known else ()), "", "")
    head = "".join(f'<th class="{side}">{text}</th>' for text, side in zip(heads, sides, strict=True))
    caption = f"<caption>{html.escape(plot.title)}</caption>" if plot.title else ""
    legend = '<i class="key estimate"></i>estimate and 95 % interval' + (
        '<i class="key truth tick"></i>true value' if known else ""
    )
    return (
        f'<div class="wide intervals"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody>'
        f'</table><p class="legend">{legend}<i class="key zeroline"></i>zero</p></div>'
    )


def _heading(name: str) -> str:
    told = meaning(name)
    return symbol(name) + (f' <span class="dim">{html.escape(told)}</span>' if told else "")


def _scale(bars: list[Bar]) -> tuple[float, float]:
    """Both ends of the axis: of one number, with zero in it; of the same by several methods, about them."""
    values = [v for bar in bars for v in (bar.estimate.low, bar.estimate.high) if math.isfinite(v)]
    values += [bar.truth for bar in bars if bar.truth is not None and math.isfinite(bar.truth)]
    if len(bars) == 1:
        values.append(0.0)
    low, high = min(values, default=0.0), max(values, default=1.0)
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return low - margin, high + margin


def _scale_row(scale: tuple[float, float], known: bool) -> str:
    """Numbers below the pictures of a group, where they begin and end."""
    step = 0.05 * (scale[1] - scale[0])
    ends = "".join(f"<span>{number(one, step)}</span>" for one in scale)
    behind = "<td></td>" * (3 if known else 2)
    return f'<tr class="scale"><td></td><td></td><td></td><td><div>{ends}</div></td>{behind}</tr>'


def _bar(bar: Bar, scale: tuple[float, float], name: str, known: bool) -> str:
    one, step = bar.estimate, bar.estimate.standard_error
    label = symbol(bar.label) if bar.label == name else html.escape(bar.label)
    cells = [
        f"<td>{label}</td>",
        f'<td class="number">{number(one.value, step)}</td>',
        f'<td class="number">{number(one.low, step)} to {number(one.high, step)}</td>',
        f"<td>{_bar_picture(bar, scale)}</td>",
    ]
    if known:
        inside = bar.truth is None or one.contains(bar.truth)
        truth = "" if bar.truth is None else number(bar.truth, step)
        cells.append(f'<td class="number{"" if inside else " out"}">{truth}</td>')
    told = bar.meaning or (meaning(one.name) if bar.label == name else "")
    cells += [f'<td class="unit">{unit(one.unit)}</td>', f'<td class="dim">{rich(told)}</td>']
    return "<tr>" + "".join(cells) + "</tr>"


def _bar_picture(bar: Bar, scale: tuple[float, float]) -> str:
    low, high = scale

    def place(value: float) -> float:
        return (min(max(value, low), high) - low) / (high - low) * BAR_WIDTH

    one, middle = bar.estimate, BAR_HEIGHT / 2
    parts = [f'<path class="grid" d="M0 {middle:g}H{BAR_WIDTH:g}"/>']
    if low < 0.0 < high:
        parts.append(f'<path class="zero" d="M{place(0.0):.1f} 1V{BAR_HEIGHT - 1:g}"/>')
    if math.isfinite(one.low + one.high):
        width = max(place(one.high) - place(one.low), 1.0)
        parts.append(f'<rect class="interval" x="{place(one.low):.1f}" y="5" width="{width:.1f}" height="8" rx="2"/>')
    if math.isfinite(one.value):
        parts.append(f'<circle class="estimate" cx="{place(one.value):.1f}" cy="{middle:g}" r="3.5"/>')
    if bar.truth is not None and math.isfinite(bar.truth):
        parts.append(f'<path class="truth tick" d="M{place(bar.truth):.1f} 1V{BAR_HEIGHT - 1:g}"/>')
    return f'<svg class="bar" viewBox="0 0 {BAR_WIDTH:g} {BAR_HEIGHT:g}" aria-hidden="true">{"".join(parts)}</svg>'


def _matrix(plot: Matrix) -> str:
    """Its lower triangle, shaded by size."""
    heads = "".join(f"<th><span>{symbol(name)}</span></th>" for name in plot.names)
    rows = []
    for i, name in enumerate(plot.names):
        cells = "".join(_shaded(float(plot.values[i, j])) if j <= i else "<td></td>" for j in range(len(plot.names)))
        rows.append(f"<tr><th>{symbol(name)}</th>{cells}</tr>")
    caption = f"<caption>{html.escape(plot.title)}</caption>" if plot.title else ""
    return (
        f'<div class="wide"><table class="matrix">{caption}<thead><tr><th></th>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _shaded(value: float) -> str:
    if not math.isfinite(value):
        return "<td>–</td>"
    colour = "0 114 178" if value >= 0 else "213 94 0"
    text = f"{value:.2f}".replace("-", "−")
    return f'<td style="background:rgb({colour} / {0.75 * min(abs(value), 1.0):.2f})">{text}</td>'
