"""Session of a ``wingbeat gcs`` verb: vehicle, options and output."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home
from groundstation.command import options
from groundstation.link import modes
from groundstation.link.answers import NoAnswer
from groundstation.link.commands import CommandExchange
from groundstation.link.connection import AnyExchange, Connection
from groundstation.link.exchange import Target
from groundstation.link.mode_change import request_mode_names
from groundstation.link.recording import Recording
from groundstation.link.vehicle_state import VehicleState, is_wingbeat_vehicle
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from wingbeat.errors import InputError

LONG = 3600.0
"""s; limit of a long transfer: silence ends it earlier"""


class VerbParser(options.VerbParser):
    """Parser of a verb; the common options may follow the verb too."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--record-to", type=Path, default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--no-record", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--timeout", type=options.positive, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


class Session(NamedTuple):
    """One command line for one vehicle."""

    connection: Connection
    chosen: argparse.Namespace
    recording: Recording | None = None
    """recording of the received messages; None with ``--no-record``"""

    @property
    def target(self) -> Target:
        """Target of commands."""
        return self.connection.target

    @property
    def state(self) -> VehicleState:
        """Present state of the vehicle."""
        return self.connection.state

    @property
    def json(self) -> bool:
        """Whether one JSON document is requested."""
        return bool(self.chosen.json)

    def run_exchange(self, exchange: AnyExchange, label: str) -> AnyExchange:
        """Run an exchange to its end and show its progress.

        Raises:
            NoAnswer: it failed.
        """
        with ProgressBar(label, quiet=self.json, reporting=True) as bar:
            return self.connection.run(exchange, lambda now: bar.show(*now.progress()), LONG)

    def read_mode_names(self) -> dict[int, str]:
        """Read the names of the vehicle's modes into the state; empty if it has none."""
        return dict(self.run_exchange(request_mode_names(self.target), "asking for modes").names)

    def request(self, message_id: int, enough: Callable[[VehicleState], bool]) -> None:
        """Request one message and wait for it; a denial or timeout is not an error."""
        if enough(self.state):
            return
        command = CommandExchange(self.target, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))
        try:
            self.run_exchange(command, "asking")
            self.connection.listen(3.0, enough)
        except NoAnswer:
            return

    def identify_vehicle(self) -> None:
        """Determine whether the vehicle is a Wingbeat flight computer, which may report another autopilot type."""
        if not is_wingbeat_vehicle(self.state):
            self.request_version()

    def request_version(self) -> None:
        """Request AUTOPILOT_VERSION: identity, and encoding of integers."""
        self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, lambda state: state.capabilities is not None)

    def home(self) -> Home:
        """Return the home position of the vehicle.

        Raises:
            NoAnswer: the vehicle does not send it.
        """
        self.request(mavlink.MAVLINK_MSG_ID_HOME_POSITION, lambda state: state.home is not None)
        home = self.state.home
        if home is None:
            raise NoAnswer("home position unknown: wait for a GPS fix")
        return home

    def done(self, text: str) -> None:
        """Report that a command was executed."""
        if self.json:
            print_document({"done": text, "mode": modes.mode_key(self.state), "armed": self.state.armed})
        else:
            print(text)


Verb = Callable[[Session], int | None]
"""runs one verb; returns an exit code if it is not 0"""


def check_new(file: Path, endings: Sequence[str] = ()) -> None:
    """Check that a file can be created.

    It must not exist, its folder must exist, and its suffix must be one of ``endings``, if there are any.

    Raises:
        InputError: it cannot be created, or its suffix is not supported.
    """
    if endings and file.suffix not in endings:
        raise InputError(f"{file}: its name must end in {' or '.join(endings)}, the formats that can be written")
    if file.exists():
        raise InputError(f"{file} exists already; choose another name")
    if not file.absolute().parent.is_dir():
        raise InputError(f"folder {file.absolute().parent} does not exist")
