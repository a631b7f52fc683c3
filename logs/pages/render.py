"""Pages of HTML from the templates of this package."""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from markupsafe import Markup, escape

from logs.new_files import claim, draft, settle
from logs.pages.document import Bar, Cell, Chapter, Interval, Intervals, Plot, Table
from logs.pages.labels import meaning, number, rich, symbol, unit
from logs.pages.plots import plot_data
from wingbeat.errors import InputError

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
UPLOT, UPLOT_STYLE = TEMPLATES / "uPlot.iife.min.js", TEMPLATES / "uPlot.min.css"
AXES = TEMPLATES / "axes.js"
"""colors, numbers and axes of all plots"""
CONTROLS = TEMPLATES / "controls.css"
"""buttons, and titles of plots with their values"""
NUMERIC = re.compile(r"(in )?\(?[-+−]?\d+(\.\d+)?(e[-+−]?\d+)?\)?( ?[%°*]| of \d+( \*)?| \(.* to .*\))?|")
"""number as text: 12, (−0.31), 0.58 (0.44 to 0.71), in 15 of 26"""
SAME_SIZE = 20.0
"""-; largest over smallest number of a column, up to which they have a common number of decimals"""


@cache
def environment(*folders: Path) -> Environment:
    """Return the templates of this package and of ``folders``, with escaping of all text."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # takes 0.1 s, which a flight need not wait for

    paths = [*folders, TEMPLATES]
    made = Environment(
        loader=FileSystemLoader(paths),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    made.filters |= {"rich": lambda text: Markup(rich(text)), "symbol": lambda name: Markup(symbol(name))}
    return made


def render(
    template: str, styles: Iterable[Path], scripts: Iterable[Path], folders: tuple[Path, ...], **data: Any
) -> str:
    """Fill a template that extends ``base.html`` with the contents of files and ``data``.

    The content security policy permits these scripts by their hashes and nothing else.
    """
    codes = ["\n" + "\n".join(path.read_text(encoding="utf-8") for path in scripts)]
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}'" for code in codes
    )
    style = "\n".join(path.read_text(encoding="utf-8") for path in (TEMPLATES / "theme.css", *styles))
    filled = environment(*folders).get_template(template)
    return filled.render(style=Markup(style), scripts=[Markup(code) for code in codes], hashes=Markup(hashes), **data)


def page(title: str, facts: Iterable[str], chapters: tuple[Chapter, ...], signed: bool = False) -> str:
    """Return a page of ``chapters`` below ``title`` and ``facts``, ``signed`` with a line for a signature."""
    plots: list[dict[str, Any]] = []
    body = [_chapter(chapter, f"c{place}", plots) for place, chapter in enumerate(chapters, 1)]
    styles = (UPLOT_STYLE, TEMPLATES / "chapters.css")
    scripts = (AXES, TEMPLATES / "plots.js", UPLOT) if plots else ()
    return render(
        "chapters.html",
        styles,
        scripts,
        (),
        title=title,
        facts=list(facts),
        chapters=body,
        plots=plots,
        signed=signed,
    )


def write_page(
    path: Path, title: str, facts: Iterable[str], chapters: tuple[Chapter, ...], signed: bool = False
) -> int:
    """Write `page` to ``path``, which must not exist; return its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    refuse_existing(path)
    return write_text(path, page(title, facts, chapters, signed))


def write_text(path: Path, text: str) -> int:
    """Write a complete new file; return its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    content = text.encode()
    with draft(path) as (file, name):
        rest = memoryview(content)
        while rest:
            rest = rest[file.write(rest) :]
        settle(file)
        claim(name, path)
    return len(content)


def refuse_existing(path: Path) -> None:
    """Refuse a path that cannot be written, before the long work.

    Raises:
        InputError: it exists, or its folder does not.
    """
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}")


class _Plot(NamedTuple):
    """Figure of the template."""

    kind: str
    """``plot`` or ``intervals``"""
    title: str
    y: Markup
    """name and unit of the y axis"""
    place: int | None
    """index of its data; None if there is nothing to plot"""
    wide: bool
    rows: list[dict[str, Any]]
    """of intervals"""
    has_truth: bool
    has_meaning: bool


def _chapter(chapter: Chapter, key: str, plots: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the values of the template for one chapter; the data of its plots is appended to ``plots``."""
    figures = [
        _figure(one, key, sum(isinstance(p, Plot) for p in chapter.plots) == 1, plots) for one in chapter.plots
    ]
    return {
        "key": key,
        "title": chapter.title,
        "findings": chapter.findings,
        "notes": chapter.notes,
        "tables": [_table(table) for table in chapter.tables],
        "intervals": [one for one in figures if one.kind == "intervals"],
        "plots": [one for one in figures if one.kind == "plot"],
        "parts": [_chapter(part, f"{key}.{place}", plots) for place, part in enumerate(chapter.parts, 1)],
    }


def _figure(plot: Plot | Intervals, key: str, alone: bool, plots: list[dict[str, Any]]) -> _Plot:
    if isinstance(plot, Intervals):
        rows = list(_interval_rows(plot))
        true, named = (
            any(bar.truth is not None for bar in plot.bars),
            any(row["group"] is None and row["meaning"] for row in rows),
        )
        return _Plot("intervals", plot.title, Markup(), None, True, rows, true, named)
    data, place = plot_data(plot, key), None
    if data is not None:
        place = len(plots)
        plots.append(data)
    y_unit = unit(plot.y_unit)
    y = Markup(rich(plot.y) + (f" ({y_unit})" if y_unit else ""))
    return _Plot("plot", plot.title, y, place, alone or plot.wide, [], False, False)


# --- tables ---------------------------------------------------------------------------------------------------------


def _table(table: Table) -> dict[str, Any]:
    columns = list(zip(*table.rows, strict=True)) if table.rows else [() for _ in table.columns]
    right = [bool(column) and all(map(_is_number, column)) for column in columns]
    places = [_places(column) for column in columns]
    rows = [[_cell(cell, count) for cell, count in zip(row, places, strict=True)] for row in table.rows]
    return {"caption": table.caption, "columns": list(zip(table.columns, right, strict=True)), "rows": rows}


def _is_number(cell: Cell) -> bool:
    """Whether a cell is right-aligned: a number, a number as text, or empty."""
    return not isinstance(cell, str) or NUMERIC.fullmatch(cell) is not None


def _places(column: tuple[Cell, ...]) -> int | None:
    """Common number of decimals of a column, four digits of the largest; None if the sizes differ widely."""
    sizes = [abs(cell) for cell in column if isinstance(cell, float) and math.isfinite(cell) and cell]
    if not sizes or max(sizes) > SAME_SIZE * min(sizes) or all(size.is_integer() for size in sizes):
        return None
    return min(max(3 - math.floor(math.log10(max(sizes))), 0), 9)


def _cell(cell: Cell, places: int | None) -> Markup:
    if cell is None:
        return Markup()
    if not isinstance(cell, float):
        return Markup(rich(cell).replace("^2", "²"))
    if places is None or not math.isfinite(cell) or not cell:
        return Markup(number(cell))
    return Markup(f"{cell:.{places}f}".replace("-", "−"))


# --- estimates with intervals ---------------------------------------------------------------------------------------


def _interval_rows(plot: Intervals) -> Iterator[dict[str, Any]]:
    """Rows of a table of estimates; a group of one parameter by several methods has a heading."""
    for (name, _), group in groupby(plot.bars, key=lambda bar: (bar.estimate.name, bar.estimate.unit)):
        bars = list(group)
        scale = _scale(bars)
        grouped = any(bar.label != name for bar in bars)
        if grouped:
            yield {"group": Markup(symbol(name)), "meaning": meaning(name)}
        for bar in bars:
            yield _interval_row(bar, scale, grouped)


def _interval_row(bar: Bar, scale: tuple[float, float], grouped: bool) -> dict[str, Any]:
    one, step = bar.estimate, bar.estimate.standard_error
    truth = bar.truth if bar.truth is not None and math.isfinite(bar.truth) else None
    return {
        "group": None,
        "label": escape(bar.label) if grouped else Markup(symbol(bar.label)),
        "meaning": "" if grouped else bar.meaning or meaning(one.name),
        "value": number(one.value, step),
        "interval": f"{number(one.low, step)} to {number(one.high, step)}",
        "truth": "" if bar.truth is None else number(bar.truth, step),
        "outside": bar.truth is not None and not one.contains(bar.truth),
        "unit": Markup(unit(one.unit)),
        "zero": _percent(0.0, scale) if scale[0] < 0.0 < scale[1] else None,
        "bar": _bar(one, scale),
        "dot": _percent(one.value, scale) if math.isfinite(one.value) else None,
        "tick": None if truth is None else _percent(truth, scale),
    }


def _bar(one: Interval, scale: tuple[float, float]) -> tuple[float, float] | None:
    """Start and width of an interval in percent; None if it is not finite."""
    if not math.isfinite(one.low + one.high):
        return None
    start = _percent(one.low, scale)
    return start, max(round(_percent(one.high, scale) - start, 2), 0.5)


def _percent(value: float, scale: tuple[float, float]) -> float:
    low, high = scale
    return round(100.0 * (min(max(value, low), high) - low) / (high - low), 2)


def _scale(bars: list[Bar]) -> tuple[float, float]:
    """Ends of the axis: of one parameter with zero, of several estimates of a parameter about these."""
    values = [v for bar in bars for v in (bar.estimate.low, bar.estimate.high) if math.isfinite(v)]
    values += [bar.truth for bar in bars if bar.truth is not None and math.isfinite(bar.truth)]
    if len(bars) == 1:
        values.append(0.0)
    low, high = min(values, default=0.0), max(values, default=1.0)
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return low - margin, high + margin
