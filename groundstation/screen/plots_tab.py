"""The third tab: plots of selected fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rich.console import RenderableType
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.suggester import SuggestFromList
from textual.widget import Widget
from textual.widgets import Input, Label

from groundstation.link.fields import Field, parse_field
from groundstation.link.traffic import Traffic
from groundstation.views.field_plot import COLORS, Trace, field_plot
from groundstation.views.printable import printable
from wingbeat.errors import InputError

MOST = 4
"""limit of the plots; one more replaces the oldest"""


class Plot(Widget):
    """Plot of one field over time."""

    def __init__(self, field: Field, color: str) -> None:
        super().__init__()
        self.field = field
        self.color = color
        self._points: list[tuple[float, float]] = []
        self._now = 0.0

    def show(self, traffic: Traffic, now: float) -> None:
        """Draw the present data."""
        self._points = traffic.series(self.field.message, self.field.name, self.field.element)
        self._now = now
        self.refresh()

    def render(self) -> RenderableType:
        """Render the plot in the size of the widget."""
        columns, rows = self.content_size
        trace = Trace(self.field.path, self.field.unit, self._points)
        return field_plot(trace, self._now, columns, rows, self.color) if columns > 20 and rows > 3 else ""


class PlotsTab(Vertical):
    """Tab with an input line for fields and up to `MOST` plots."""

    def __init__(self, fields: Iterable[str] = (), known: Callable[[], list[str]] = list) -> None:
        super().__init__()
        self._first = tuple(fields)
        self._known = known
        self._number = 0

    def compose(self) -> ComposeResult:
        """Compose the input line, the plots, and a hint if there is none."""
        yield Input(placeholder="MESSAGE.field, such as ATTITUDE.pitch", id="choice")
        yield Label(
            "no plots: p adds a field, enter on a field of tab 2 plots it, x removes the last",
            id="no-plots",
        )

    async def on_mount(self) -> None:
        """Add the plots given on the command line."""
        for path in self._first:
            await self.add(path)

    def prompt(self) -> None:
        """Prompt for a field, with the received fields as suggestions."""
        line = self.query_one(Input)
        line.suggester = SuggestFromList(self._known(), case_sensitive=False)
        line.focus()

    async def add(self, path: str) -> None:
        """Add a plot of a field.

        Raises:
            InputError: there is no such field.
        """
        field = parse_field(path)
        plots = list(self.query(Plot))
        if any(plot.field == field for plot in plots):
            return
        if len(plots) >= MOST:
            await plots[0].remove()
        self.query_one("#no-plots").display = False
        await self.mount(Plot(field, COLORS[self._number % len(COLORS)]))
        self._number += 1

    async def drop(self) -> None:
        """Remove the last plot."""
        plots = list(self.query(Plot))
        if plots:
            await plots[-1].remove()
        self.query_one("#no-plots").display = len(plots) <= 1

    async def on_input_submitted(self, event: Input.Submitted) -> None:
        """Plot the entered field, or show why it cannot be plotted."""
        try:
            await self.add(event.value)
        except InputError as reason:
            self.notify(printable(str(reason)), severity="error", markup=False)
            return
        event.input.clear()
        self.screen.set_focus(None)

    def show(self, traffic: Traffic, now: float) -> None:
        """Draw the present data."""
        for plot in self.query(Plot):
            plot.show(traffic, now)
