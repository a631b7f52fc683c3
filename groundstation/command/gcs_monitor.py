"""``wingbeat gcs URL monitor``: live screen, or lines without a terminal."""

from __future__ import annotations

import signal
from types import FrameType
from typing import TYPE_CHECKING, Any

from groundstation.command import ending
from groundstation.command.gcs_session import Session, Verb
from groundstation.link.fields import parse_field
from groundstation.link.station import Station
from groundstation.views import monitor
from groundstation.views.terminal import open_console

if TYPE_CHECKING:
    from textual.app import App

JSON_KEYS = {"monitor": "one object a line, as status"}


def add_verbs(verbs: Any) -> None:
    """Add the verb, which is the default."""
    parser = verbs.add_parser("monitor", help="live screen of the flight, until q or Ctrl-C (default verb)")
    parser.add_argument(
        "--plot", action="append", default=[], metavar="MSG.FIELD", help="plot this field at the start (repeatable)"
    )


def show(session: Session) -> int:
    """Show the link: a screen on a terminal, otherwise lines, or with ``--json`` one JSON object a second."""
    station = Station(session.connection)
    if session.recording is not None:
        recording = session.recording
        station.recording = lambda: recording.path
    plots = [parse_field(path).path for path in session.chosen.plot]
    if session.json or not open_console().is_terminal:
        monitor.watch_lines(station, session.json)
        return 0
    # The import of Textual takes a third of a second, so it is deferred to the screen.
    from groundstation.screen.monitor import Monitor

    return run_screen(Monitor(station, plots))


def run_screen(screen: App[None]) -> int:
    """Run a screen until it is closed or the process is ended; return the exit code."""

    def leave(number: int, frame: FrameType | None) -> None:
        screen.exit(return_code=128 + number)

    # A KeyboardInterrupt in the event loop of the screen would not restore the terminal.
    for number in ending.SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, leave)
    screen.run()
    return screen.return_code or 0


VERBS: dict[str, Verb] = {"monitor": show}
