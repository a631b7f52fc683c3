"""The web view of a station: page, server, and the loop that joins them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from groundstation.link.exchange import Exchange
from groundstation.link.orders import ORDERS, change_to
from groundstation.link.station import Station
from groundstation.web.feed import COLUMNS, Feed
from groundstation.web.server import PERIOD, SOCKET, WebCommand, WebServer
from groundstation.web.spectrum import ImuSpectrum
from logs.pages.render import AXES, CONTROLS, UPLOT, UPLOT_STYLE, render
from wingbeat.errors import InputError

FOLDER = Path(__file__).parent
SPECTRUM_PERIOD = 0.5
"""s; interval of the spectra"""
SCRIPTS = ("instruments.js", "track.js", "page.js")


def page() -> str:
    """Return the HTML of the page, without network access other than its WebSocket."""
    scripts, styles = (
        [AXES, UPLOT, *(FOLDER / name for name in SCRIPTS)],
        [UPLOT_STYLE, CONTROLS, FOLDER / "page.css"],
    )
    orders = {label: {"question": one.question, "warning": one.warning} for label, one in ORDERS.items()}
    settings = {"orders": orders, "columns": COLUMNS, "socket": SOCKET}
    return render("page.html", styles, scripts, (FOLDER,), title="Wingbeat ground view", settings=settings)


def serve_station(station: Station, feed: Feed, server: WebServer, report: Callable[[str], None]) -> None:
    """Poll the link, update the feed and execute commands of browsers until Ctrl-C.

    ``report`` is called with the traceback of a failure of the server, after which the link continues.
    """
    connection = station.connection
    spectrum = ImuSpectrum(connection)
    due, spectrum_due, reported = connection.now(), connection.now(), ""
    while True:
        if not station.poll():
            connection.wait()
        for command in server.commands():
            execute(station, command, spectrum)
        if connection.now() >= due:
            due = connection.now() + PERIOD
            feed.update(station.picture())
        if connection.now() >= spectrum_due:
            spectrum_due = connection.now() + SPECTRUM_PERIOD
            feed.update_spectrum(spectrum.document())
            request = spectrum.due() if connection.state.system is not None else None
            if request is not None:
                connection.begin(request, lambda ended: _note_failure(station, ended))
        if server.failure != reported:
            reported = server.failure
            report(reported)


def _note_failure(station: Station, ended: Exchange) -> None:
    if ended.failure:
        station.note(f"vibration: {ended.failure}", failed=True)


def execute(station: Station, command: WebCommand, spectrum: ImuSpectrum) -> None:
    """Start a command; its result, or the reason why it cannot start, becomes a notice."""
    connection = station.connection
    if connection.state.system is None:
        station.note(f"{command.name}: no vehicle on the link", failed=True)
    elif command.name == "spectrum":
        spectrum.want()
    elif command.name == "mission":
        station.read_mission()
    elif command.name == "mode":
        label = f"mode {command.argument}"
        try:
            station.command(label, change_to(connection, command.argument), label)
        except InputError as error:
            station.note(str(error), failed=True)
    elif command.name in ORDERS:
        order = ORDERS[command.name]
        station.command(command.name, order.build(connection), order.done)
