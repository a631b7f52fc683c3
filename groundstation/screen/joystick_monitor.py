"""The live screen with the sticks of a joystick."""

from __future__ import annotations

from rich.console import RenderableType
from textual.app import ComposeResult
from textual.widgets import Footer

from groundstation.joystick.control import ManualControl
from groundstation.link.station import Picture
from groundstation.screen.monitor import Monitor
from groundstation.screen.panel import Panel
from groundstation.views.joystick import stick_bars


class JoystickMonitor(Monitor):
    """Screen with a station and the sticks; handles keys."""

    TITLE = "wingbeat gcs joystick"

    def __init__(self, control: ManualControl) -> None:
        super().__init__(control.station)
        self._control = control

    def compose(self) -> ComposeResult:
        """Compose the monitor's widgets, with the sticks above the keys."""
        for widget in super().compose():
            if isinstance(widget, Footer):
                yield Panel(self._sticks, "joystick", id="sticks")
            yield widget

    def _sticks(self, picture: Picture, columns: int, rows: int) -> RenderableType:
        return stick_bars(self._control.status, picture, columns)

    def poll(self) -> None:
        """Receive, read the device and send the sticks."""
        self._control.poll()

    def draw(self) -> None:
        """Draw the monitor and the sticks."""
        super().draw()
        picture = self.station.picture()
        for panel in self.query("#sticks").results(Panel):
            panel.show(picture)
