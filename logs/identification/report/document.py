"""What a report is made of, whoever draws it: chapters of notes, tables and plots.

A room tells its result as a `Chapter`; `logs/identification/report` draws it as a page. Numbers are in the units that
their columns and axes say. Arrays are taken as they are: the drawing thins them.
"""

from __future__ import annotations

from typing import NamedTuple

from logs.identification.results import Array, Estimate

MEASURED, MODEL, TRUTH, OTHER = "measured", "model", "truth", "other"
"""what a line is of: its colour"""
LINE, DASHED, POINTS, STEMS, STEPS = "line", "dashed", "points", "stems", "steps"
"""how a line is drawn; `STEMS` stand on zero, `STEPS` hold each y from its x to the next (a histogram)"""

Cell = str | float | None
"""one cell of a table; None where there is nothing to say"""


class Table(NamedTuple):
    """Rows of cells, each as long as ``columns``."""

    columns: tuple[str, ...]
    """-; heads, with units"""
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    """-; a sentence above it"""


class Series(NamedTuple):
    """One line of a plot."""

    label: str
    """-; in the legend; none if empty"""
    x: Array
    """(N,), as the plot's x; need not rise for `POINTS`"""
    y: Array
    """(N,), as the plot's y; NaN leaves a gap"""
    role: str = MODEL
    """-; MEASURED, MODEL, TRUTH or OTHER"""
    style: str = LINE
    """-; LINE, DASHED, POINTS, STEMS or STEPS"""


class Band(NamedTuple):
    """A shaded band between two lines, as a 95 % interval."""

    label: str
    """-; in the legend; none if empty"""
    x: Array
    """(N,), as the plot's x"""
    low: Array
    """(N,), as the plot's y"""
    high: Array
    """(N,), as the plot's y"""


class Plot(NamedTuple):
    """Lines over a common axis."""

    title: str
    x: str
    """-; what the x axis is"""
    x_unit: str
    """-; "s", "rad"; "-" for none"""
    y: str
    """-; what the y axis is"""
    y_unit: str
    series: tuple[Series, ...]
    bands: tuple[Band, ...] = ()


class Bar(NamedTuple):
    """One row of `Intervals`."""

    label: str
    """-; whose number it is"""
    estimate: Estimate
    truth: float | None = None
    """as the estimate's unit, where it is known"""
    meaning: str = ""
    """-; what it stands for, where that is not what its name stands for on every page"""


class Intervals(NamedTuple):
    """Estimates with their 95 % intervals below each other.

    Neighbours of the same name and unit share an axis (one number by several methods); others have one each.
    """

    title: str
    bars: tuple[Bar, ...]


class Matrix(NamedTuple):
    """A square of numbers from -1 to 1, such as correlations."""

    title: str
    names: tuple[str, ...]
    """-; (p,)"""
    values: Array
    """-; (p, p)"""


class Chapter(NamedTuple):
    """One part of the report: its notes, then its tables, its plots, and the parts below it."""

    title: str
    notes: tuple[str, ...] = ()
    """a sentence each"""
    tables: tuple[Table, ...] = ()
    plots: tuple[Plot | Intervals | Matrix, ...] = ()
    parts: tuple[Chapter, ...] = ()
