"""``wingbeat gcs URL monitor|web``: live screen, lines without a terminal, or a page for a browser."""

from __future__ import annotations

import signal
import sys
import webbrowser
from types import FrameType
from typing import TYPE_CHECKING, Any

from groundstation.command import ending, options
from groundstation.command.gcs_session import Session, Verb
from groundstation.link.fields import parse_field
from groundstation.link.station import Station
from groundstation.views import monitor
from groundstation.views.json_document import print_line
from groundstation.views.terminal import open_console

if TYPE_CHECKING:
    from textual.app import App

WEB_PORT = 8766
"""default port of the web view; the live server for Foxglove has 8765"""
JSON_KEYS = {"monitor": "one object a line, as status", "web": "url"}


def add_verbs(verbs: Any) -> None:
    """Add the verbs; the monitor is the default."""
    parser = verbs.add_parser("monitor", help="live screen of the flight, until q or Ctrl-C (default verb)")
    parser.add_argument(
        "--plot", action="append", default=[], metavar="MSG.FIELD", help="plot this field at the start (repeatable)"
    )
    parser = verbs.add_parser("web", help="live view and commands in a browser of this machine, until Ctrl-C")
    parser.add_argument(
        "--port", type=options.port, default=WEB_PORT, metavar="N", help=f"port of the page (default: {WEB_PORT})"
    )
    parser.add_argument("--open", action="store_true", help="open the page in the default browser")


def show(session: Session) -> int:
    """Show the link: a screen on a terminal, otherwise lines, or with ``--json`` one JSON object a second."""
    station = _station(session)
    plots = [parse_field(path).path for path in session.chosen.plot]
    if session.json or not open_console().is_terminal:
        monitor.watch_lines(station, session.json)
        return 0
    # The import of Textual takes a third of a second, so it is deferred to the screen.
    from groundstation.screen.monitor import Monitor

    return run_screen(Monitor(station, plots))


def serve(session: Session) -> int:
    """Serve the web view until Ctrl-C.

    Raises:
        InputError: the port is not available.
    """
    from groundstation.web.feed import Feed
    from groundstation.web.server import WebServer
    from groundstation.web.view import page, serve_station

    feed = Feed()
    with WebServer(page(), feed, session.chosen.port) as server:
        if session.json:
            print_line({"url": server.url})
        else:
            print(f"web view: {server.url}   (Ctrl-C ends it)", flush=True)
        if session.chosen.open and not webbrowser.open(server.url):
            print("no browser found: open the address above", file=sys.stderr)
        serve_station(_station(session), feed, server, _report)
    return 0


def _report(failure: str) -> None:
    print(f"wingbeat: web view: {failure.strip().splitlines()[-1]}; the link continues", file=sys.stderr)


def _station(session: Session) -> Station:
    """Return the station of a session, with the path of its recording."""
    station = Station(session.connection)
    if session.recording is not None:
        recording = session.recording
        station.recording = lambda: recording.path
    return station


def run_screen(screen: App[None]) -> int:
    """Run a screen until it is closed or the process is ended; return the exit code."""

    def leave(number: int, frame: FrameType | None) -> None:
        screen.exit(return_code=128 + number)

    # A KeyboardInterrupt in the event loop of the screen would not restore the terminal; asyncio prevents it only for
    # Python's own handler of Ctrl-C.
    numbers = (signal.SIGINT, *ending.SIGNALS)
    handlers = {number: handler for number in numbers if callable(handler := signal.getsignal(number))}
    for number in handlers:
        signal.signal(number, leave)
    try:
        screen.run()
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return screen.return_code or 0


VERBS: dict[str, Verb] = {"monitor": show, "web": serve}
