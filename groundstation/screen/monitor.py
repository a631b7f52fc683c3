"""The live screen: three tabs, state line and keys."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Footer, TabbedContent, TabPane

from groundstation.link import modes
from groundstation.link.connection import Connection
from groundstation.link.exchange import Exchange
from groundstation.link.orders import ORDERS, change_to
from groundstation.link.station import Picture, Station, new_notes
from groundstation.screen.dialogs import Confirmation, ModeChoice
from groundstation.screen.flight_tab import FlightTab
from groundstation.screen.messages_tab import MessagesTab
from groundstation.screen.panel import Panel
from groundstation.screen.plots_tab import PlotsTab
from groundstation.views import panels
from groundstation.views.printable import printable

POLL = 0.01
"""s; polling interval of the link"""
REFRESH = 0.1
"""s; interval of the flight display"""
SLOW = 5
"""updates of the flight display per update of messages and plots"""


class Monitor(App[None]):
    """Screen with a station; handles keys."""

    TITLE = "wingbeat gcs"
    CSS_PATH = "monitor.tcss"
    ENABLE_COMMAND_PALETTE = False
    HORIZONTAL_BREAKPOINTS = [(0, "-slim"), (66, "-narrow"), (110, "-wide")]
    VERTICAL_BREAKPOINTS = [(0, "-low"), (30, "-high"), (38, "-tall")]
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("1", "tab('flight')", "Flight", show=False),  # the tabs say it themselves
        Binding("2", "tab('messages')", "Inspect", show=False),
        Binding("3", "tab('plots')", "Plots", show=False),
        Binding("a", "arm", "Arm"),
        Binding("d", "disarm", "Disarm"),
        Binding("m", "mode", "Mode"),
        Binding("r", "return_home", "Return"),
        Binding("l", "land", "Land"),
        Binding("K", "kill", "Kill"),
        Binding("p", "plot", "Plot"),
        Binding("x", "drop_plot", "Drop plot", show=False),
        Binding("u", "read_mission", "Read mission", show=False),
        Binding("escape", "blur", "", show=False),
        Binding("q", "quit", "Quit"),
    ]

    def __init__(
        self, station: Station, plots: Iterable[str] = (), clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__()
        self.station = station
        self._plots = tuple(plots)
        self._clock = clock
        self._count = 0
        self._recorded = 0

    def compose(self) -> ComposeResult:
        """Compose the status line, the tabs, the keys."""
        yield Panel(lambda picture, columns, rows: panels.status_line(picture, columns), id="status")
        with TabbedContent(initial="flight"):
            with TabPane("1 Flight", id="flight"):
                yield FlightTab()
            with TabPane("2 Inspect", id="messages"):
                yield MessagesTab()
            with TabPane("3 Plots", id="plots"):
                yield PlotsTab(self._plots, self._known_fields)
        yield Footer(compact=True)

    def on_ready(self) -> None:
        """Start receiving and drawing once the screen exists."""
        self.run_worker(self._listen(), exclusive=True)
        self.set_interval(REFRESH, self.draw)
        if self._plots:
            self.action_tab("plots")

    async def _listen(self) -> None:
        while True:
            self.poll()
            await asyncio.sleep(POLL)

    def poll(self) -> None:
        """Receive pending messages and send due ones."""
        self.station.poll()

    def draw(self) -> None:
        """Draw the visible tab and the status line."""
        picture = self.station.picture()
        for panel in self.query("#status").results(Panel):
            panel.show(picture)
        if len(self.query("FlightTab, MessagesTab, PlotsTab")) < 3:
            return  # the screen is being built, or taken down
        self._announce(picture)
        self._count += 1
        active = self.query_one(TabbedContent).active
        if active == "flight":
            self.query_one(FlightTab).show(picture)
        elif self._count % SLOW == 0:
            now = self._clock()
            if active == "messages":
                self.query_one(MessagesTab).show(self.station.traffic.rows(now))
            else:
                self.query_one(PlotsTab).show(self.station.traffic, now)

    def _announce(self, picture: Picture) -> None:
        """Show the result of a command on any tab."""
        for note in new_notes(picture, self._recorded):
            self.notify(printable(note.text), severity="error" if note.failed else "information", markup=False)
        self._recorded = picture.note_count

    def _known_fields(self) -> list[str]:
        rows = self.station.traffic.rows(self._clock())
        return [f"{row.name}.{name}" for row in rows if row.message is not None for name in row.message.fieldnames]

    # --- keys -------------------------------------------------------------------------------------------

    def action_tab(self, name: str) -> None:
        """Switch to another tab."""
        self.query_one(TabbedContent).active = name
        self.screen.set_focus(self.query_one("#kinds") if name == "messages" else None)
        self._count = -1  # draw it at once

    def action_blur(self) -> None:
        """Leave the input line."""
        self.screen.set_focus(None)

    def _order(self, label: str, confirm: bool = False) -> None:
        """Start a command of `ORDERS`, with ``confirm`` after a confirmation."""
        order = ORDERS[label]

        def answered(yes: bool | None) -> None:
            if yes:
                self._start(label, order.build, order.done)

        if confirm:
            self.push_screen(Confirmation(order.question, order.warning), answered)
        else:
            answered(True)

    def _start(self, label: str, build: Callable[[Connection], Exchange], done: str) -> None:
        if self.station.connection.state.system is None:
            self.notify("no vehicle is heard", severity="warning")
            return
        self.station.command(label, build(self.station.connection), done)

    def action_arm(self) -> None:
        """Arm, after a confirmation."""
        self._order("arm", confirm=True)

    def action_disarm(self) -> None:
        """Disarm; a vehicle in flight denies it."""
        self._order("disarm")

    def action_kill(self) -> None:
        """Stop the wings at once, after a confirmation."""
        self._order("kill", confirm=True)

    def action_return_home(self) -> None:
        """Return home and land or loiter, depending on the vehicle."""
        self._order("return")

    def action_land(self) -> None:
        """Land."""
        self._order("land")

    def action_mode(self) -> None:
        """Choose a mode."""
        state = self.station.connection.state
        names = sorted(modes.known_modes(state))

        def chosen(name: str | None) -> None:
            if name is not None:
                self._start(f"mode {name}", lambda connection: change_to(connection, name), f"mode {name}")

        self.push_screen(ModeChoice(names, modes.mode_key(state)), chosen)

    def action_read_mission(self) -> None:
        """Download the mission again."""
        self.station.read_mission()

    def action_plot(self) -> None:
        """Enter a field to plot."""
        self.action_tab("plots")
        self.query_one(PlotsTab).prompt()

    async def action_drop_plot(self) -> None:
        """Remove the last plot."""
        await self.query_one(PlotsTab).drop()

    async def on_messages_tab_chosen(self, event: MessagesTab.Chosen) -> None:
        """Plot a field of the inspector."""
        await self.query_one(PlotsTab).add(event.path)
        self.action_tab("plots")
