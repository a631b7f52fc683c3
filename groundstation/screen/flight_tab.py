"""The first tab: horizon, tapes, messages and panels."""

from __future__ import annotations

from rich.console import RenderableType
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical

from groundstation.link.station import Picture
from groundstation.screen.panel import Panel
from groundstation.views import panels
from groundstation.views.flight_view import track_plot
from groundstation.views.history import History, remember
from groundstation.views.horizon import horizon
from groundstation.views.tape import AIRSPEED, ALTITUDE, tape


class FlightTab(Horizontal):
    """Tab with the flight instruments."""

    history = History()

    def compose(self) -> ComposeResult:
        """Compose instruments on the left, panels on the right."""
        with Vertical(id="left"):
            with Horizontal(id="instruments"):
                yield Panel(airspeed, id="airspeed")
                yield Panel(attitude, id="horizon")
                yield Panel(altitude, id="altitude")
            yield Panel(heading, id="heading")
            yield Panel(panels.sayings, "messages", id="sayings")
        with Vertical(id="right"):
            yield Panel(panels.flapping, "wings", id="flapping")
            yield Panel(panels.power, "power", id="power")
            yield Panel(panels.mission, "mission", id="mission")
            yield Panel(self._track, "track", id="track")
            yield Panel(panels.link, "link", id="link")

    def _track(self, picture: Picture, columns: int, rows: int) -> RenderableType:
        return track_plot(self.history, columns, rows - 1) if rows > 3 else ""

    def show(self, picture: Picture) -> None:
        """Draw the present data."""
        self.history = remember(self.history, picture.state)
        for panel in self.query(Panel):
            panel.show(picture)


def airspeed(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Draw the airspeed tape."""
    return tape(AIRSPEED, picture.state.airspeed, None, columns, rows)


def altitude(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Draw the altitude tape with its setpoint."""
    return tape(ALTITUDE, picture.state.altitude, picture.state.altitude_setpoint, columns, rows)


def attitude(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Draw the artificial horizon."""
    return horizon(picture.state.roll, picture.state.pitch, columns, rows)


def heading(picture: Picture, columns: int, rows: int) -> RenderableType:
    """Draw roll, pitch, heading and climb rate as numbers."""
    return panels.heading(picture, columns)
