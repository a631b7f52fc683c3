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
"""s; a long list over a slow link takes as long as it takes: silence ends it, not this"""


class VerbParser(options.VerbParser):
    """A verb's parser; the common options may stand behind the verb too."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--record-to", type=Path, default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--no-record", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--timeout", type=options.positive, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


class Session(NamedTuple):
    """One command line on one vehicle."""

    connection: Connection
    chosen: argparse.Namespace
    recording: Recording | None = None
    """where what is heard goes; None with ``--no-record``"""

    @property
    def target(self) -> Target:
        """Whom to speak to."""
        return self.connection.target

    @property
    def state(self) -> VehicleState:
        """What is known of the vehicle now."""
        return self.connection.state

    @property
    def json(self) -> bool:
        """Whether one JSON document is asked for."""
        return bool(self.chosen.json)

    def run_exchange(self, exchange: AnyExchange, label: str) -> AnyExchange:
        """Drive an exchange to its end and show how far it is.

        Raises:
            NoAnswer: it failed.
        """
        with ProgressBar(label, quiet=self.json, reporting=True) as bar:
            return self.connection.run(exchange, lambda now: bar.show(*now.progress()), LONG)

    def read_mode_names(self) -> dict[int, str]:
        """Names of the modes as the vehicle announces them, kept in the state; empty where it has none to tell."""
        return dict(self.run_exchange(request_mode_names(self.target), "asking for modes").names)

    def request(self, message_id: int, enough: Callable[[VehicleState], bool]) -> None:
        """Ask for one message, and listen for it; a refusal or silence is no failure."""
        if enough(self.state):
            return
        command = CommandExchange(self.target, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))
        try:
            self.run_exchange(command, "asking")
            self.connection.listen(3.0, enough)
        except NoAnswer:
            return

    def identify_vehicle(self) -> None:
        """Learn whether the vehicle is ours, which may call itself another autopilot."""
        if not is_wingbeat_vehicle(self.state):
            self.request_version()

    def request_version(self) -> None:
        """Ask for AUTOPILOT_VERSION: what it is, and how it encodes whole numbers."""
        self.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, lambda state: state.capabilities is not None)

    def home(self) -> Home:
        """Where the vehicle's home is.

        Raises:
            NoAnswer: it does not say.
        """
        self.request(mavlink.MAVLINK_MSG_ID_HOME_POSITION, lambda state: state.home is not None)
        home = self.state.home
        if home is None:
            raise NoAnswer("home position unknown: wait for a GPS fix")
        return home

    def done(self, text: str) -> None:
        """Say that an order was carried out."""
        if self.json:
            print_document({"done": text, "mode": modes.mode_key(self.state), "armed": self.state.armed})
        else:
            print(text)


Verb = Callable[[Session], int | None]
"""does what one verb asks for; an exit code other than 0 where it has one"""


def check_new(file: Path, endings: Sequence[str] = ()) -> None:
    """Refuse a file that is there, or whose folder is not, or whose name has none of ``endings`` where there are any.

    Raises:
        InputError: it cannot be written anew, or not in the format that its name promises.
    """
    if endings and file.suffix not in endings:
        raise InputError(f"{file}: its name must end in {' or '.join(endings)}, the formats that can be written")
    if file.exists():
        raise InputError(f"{file} exists already; choose another name")
    if not file.absolute().parent.is_dir():
        raise InputError(f"folder {file.absolute().parent} does not exist")
