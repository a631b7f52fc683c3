"""Contents of a page: chapters of findings, notes, tables, estimates and plots."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MEASURED, MODEL, TRUTH, OTHER = "measured", "model", "truth", "other"
"""roles of a series, which determine its color"""
LINE, DASHED, POINTS, STEMS, STEPS = "line", "dashed", "points", "stems", "steps"
"""styles of a series; `STEMS` start at zero, `STEPS` keep each y from its x to the next (histogram)"""

Cell = str | float | None
"""cell of a table; None for an empty one"""


class Interval(Protocol):
    """Estimate with a 95 % interval, such as `logs.identification.results.Estimate`."""

    @property
    def name(self) -> str:
        """Symbol in the source's equation."""

    @property
    def unit(self) -> str:
        """Unit; "-" for none."""

    @property
    def value(self) -> float:
        """Estimate."""

    @property
    def standard_error(self) -> float:
        """Standard error."""

    @property
    def low(self) -> float:
        """Lower end of the interval."""

    @property
    def high(self) -> float:
        """Upper end of the interval."""

    def contains(self, truth: float) -> bool:
        """Whether ``truth`` lies inside the interval."""


class Remark(NamedTuple):
    """Finding as shown on a page."""

    severity: str
    """``info``, ``warning``, ``error`` or ``withheld``"""
    code: str
    """key of the catalog of findings; empty for none"""
    text: str
    remedy: str = ""
    """-; what to do, one clause"""


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
    """(N,), as the plot's x; ascending except for `POINTS`"""
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
    marks: tuple[tuple[float, str], ...] = ()
    """x and label of vertical lines, such as the start of each maneuver"""
    wide: bool = False
    """-; over the width of the page"""


class Bar(NamedTuple):
    """One row of `Intervals`."""

    label: str
    """-; name of the parameter, or of the method if several are compared"""
    estimate: Interval
    truth: float | None = None
    """as the estimate's unit; None if unknown"""
    meaning: str = ""
    """-; replaces the common meaning of the name"""


class Intervals(NamedTuple):
    """Estimates with their 95 % intervals, one row each.

    Adjacent rows of the same name and unit share an axis (one parameter by several methods).
    """

    title: str
    bars: tuple[Bar, ...]


class Chapter(NamedTuple):
    """One part of a page: its findings, notes, tables and plots, then its subchapters."""

    title: str
    notes: tuple[str, ...] = ()
    """a sentence each"""
    tables: tuple[Table, ...] = ()
    plots: tuple[Plot | Intervals, ...] = ()
    parts: tuple[Chapter, ...] = ()
    findings: tuple[Remark, ...] = ()
