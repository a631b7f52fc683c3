"""A widget that renders a view as a pure function of state and size."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import RenderableType
from textual.widget import Widget

from groundstation.link.station import Picture
from groundstation.views.terminal import Printable

View = Callable[[Picture, int, int], RenderableType]
"""(snapshot, columns, rows) to the drawing"""


class Panel(Widget):
    """View in a frame; ``show`` redraws it."""

    def __init__(self, view: View, title: str = "", id: str | None = None) -> None:
        super().__init__(id=id)
        self._view = view
        self._picture = Picture()
        self.border_title = title

    def show(self, picture: Picture) -> None:
        """Draw the present data."""
        self._picture = picture
        self.refresh()

    def render(self) -> RenderableType:
        """Render the view in the size of the widget."""
        columns, rows = self.content_size
        return Printable(self._view(self._picture, columns, rows)) if columns > 0 and rows > 0 else ""
