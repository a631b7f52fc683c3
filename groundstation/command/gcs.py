"""``wingbeat gcs``: monitor and command a MAVLink vehicle; verbs in modules."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import ModuleType

from avionics.link.signing import Signing
from groundstation.command import (
    gcs_calibrate,
    gcs_excite,
    gcs_joystick,
    gcs_listen,
    gcs_mission,
    gcs_monitor,
    gcs_order,
    gcs_param,
    gcs_status,
    options,
)
from groundstation.command.gcs_session import Session, VerbParser
from groundstation.link.answers import NoAnswer
from groundstation.link.connection import Connection
from groundstation.link.recording import Recording, Where
from logs.names import RECORDINGS
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat gcs udpout:127.0.0.1:14550",
    "wingbeat gcs udpout:127.0.0.1:14550 web --open",
    "wingbeat gcs udpin:0.0.0.0:14550 mode ALTITUDE_HOLD",
    "wingbeat gcs udpin:0.0.0.0:14550 param set PITCH_P 0.8",
    "wingbeat gcs udpin:0.0.0.0:14550 --signing-key my.key arm",
    "wingbeat gcs tcp:127.0.0.1:5760 mission download flight.waypoints",
    "wingbeat gcs serial:/dev/ttyUSB0,57600 watch ATTITUDE.pitch VFR_HUD.airspeed",
    "wingbeat gcs udpin:0.0.0.0:14550 record test.mcap --duration 600",
    "wingbeat gcs udpin:0.0.0.0:14550 excite doublet elevator --amplitude 5 --width 0.2",
    "wingbeat gcs udpin:0.0.0.0:14550 excite multisine --elevator 3 --rudder 5 --period 10 --low 0.3 --high 2.5"
    " --loops active",
    "wingbeat gcs udpin:0.0.0.0:14550 calibrate battery --voltage 7.82",
    "wingbeat gcs joystick --list",
    "wingbeat gcs joystick --calibrate",
    "wingbeat gcs udpin:0.0.0.0:14550 joystick",
)
URL_HELP = (
    "udpin:HOST:PORT or tcpin: waits for a vehicle, udpout: or tcp: connects to one; serial:DEVICE,BAUD is a radio"
)
GROUPS: tuple[ModuleType, ...] = (
    gcs_monitor, gcs_status, gcs_order, gcs_param, gcs_mission, gcs_excite, gcs_calibrate, gcs_joystick,
    gcs_listen,
)  # fmt: skip
"""modules with ``add_verbs(verbs)``, tables ``VERBS`` and ``JSON_KEYS``, and ``prepare(chosen)`` if they read files
"""
PREPARATIONS = (
    gcs_order.prepare, gcs_param.prepare, gcs_mission.prepare, gcs_excite.prepare, gcs_joystick.prepare,
    gcs_listen.prepare,
)  # fmt: skip
"""checks before the vehicle is contacted"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    keys = {verbs: text for group in GROUPS for verbs, text in group.JSON_KEYS.items()}
    parser = options.build_parser("gcs", "Monitor and command any MAVLink vehicle.", EXAMPLES, keys)
    parser.add_argument("url", metavar="URL", help=URL_HELP)
    parser.add_argument(
        "--timeout",
        type=options.positive,
        default=5.0,
        metavar="S",
        help="timeout for the first heartbeat (default: 5)",
    )
    options.add_signing_key(parser, "default: no signing")
    parser.add_argument(
        "--record-to",
        type=Path,
        metavar="FOLDER",
        help="folder of the recording (default: recordings/, recordings/gcs-DATE/ for short verbs)",
    )
    parser.add_argument("--no-record", action="store_true", help="leave no recording")
    options.add_json(parser)
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", parser_class=VerbParser, help="monitor without one")
    for group in GROUPS:
        group.add_verbs(verbs)
    parser.set_defaults(verb="monitor", plot=[])
    return parser


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Raises:
        InputError: bad address, unknown mode, malformed or existing file.
        NoAnswer: no vehicle, a denied request, or a timeout.
    """
    chosen = build_parser().parse_args(gcs_joystick.with_url(arguments))
    for prepare in PREPARATIONS:
        prepare(chosen)
    if gcs_joystick.is_offline(chosen):
        return gcs_joystick.run_offline(chosen)
    recording = _recording(chosen)
    quiet = chosen.json or chosen.verb == "record" or not sys.stderr.isatty()
    connection = Connection(chosen.url, stays=_stays(chosen), signing=_signing(chosen))
    try:
        if recording is not None:
            connection.overhear(recording.handle_frame, recording.sent)
        return _run(Session(connection, chosen, recording))
    except (InputError, NoAnswer):
        # A failure is printed on one line.
        quiet = True
        raise
    finally:
        connection.close()
        _close(recording, quiet)


def _signing(chosen: argparse.Namespace) -> Signing | None:
    """Return the signing key of the command line.

    Its time stamps come from the clock of the ground: the file beside the key belongs to the vehicle.

    Raises:
        InputError: no such file, not a key, or a file that other users can read.
    """
    file = options.key_file(chosen.signing_key, None)
    return None if file is None else Signing(time.time, file.load_key())


def _stays(chosen: argparse.Namespace) -> bool:
    """Return whether a verb runs until it is interrupted.

    Such a verb is a ground station for the vehicle, and its silence is a link loss. A verb that listens for a limited
    time only is a query, after which a vehicle in flight must not return.
    """
    if chosen.verb in gcs_listen.VERBS:
        return gcs_listen.is_endless(chosen)
    return chosen.verb in gcs_monitor.VERBS or chosen.verb in gcs_joystick.VERBS


def _recording(chosen: argparse.Namespace) -> Recording | None:
    """Return the recording of the received messages.

    Raises:
        InputError: two options, or a verb and an option, that exclude each other.
    """
    if chosen.no_record and chosen.record_to is not None:
        raise InputError("--record-to and --no-record exclude each other")
    if chosen.verb == "record":
        if chosen.no_record or chosen.record_to is not None:
            option = "--no-record" if chosen.no_record else "--record-to"
            raise InputError(f"record and {option} exclude each other")
        return Recording(Where(chosen.url, chosen.file))
    if chosen.no_record:
        return None
    if _stays(chosen):
        return Recording(Where(chosen.url, folder=chosen.record_to or RECORDINGS))
    return Recording(Where(chosen.url, folder=chosen.record_to or _folder_of_the_day(), verb=_arguments(chosen)))


def _folder_of_the_day() -> Path:
    """Return the folder of the day, which collects the short recordings of single commands."""
    return RECORDINGS / f"gcs-{datetime.now():%Y%m%d}"


def _arguments(chosen: argparse.Namespace) -> str:
    """Return the verb and its action: ``param_set``."""
    return "_".join(filter(None, (chosen.verb, getattr(chosen, "action", ""))))


def _close(recording: Recording | None, quiet: bool) -> None:
    """Close the recording, and print its path on a terminal."""
    if recording is None:
        return
    recording.close()
    if recording.failure:
        print(f"wingbeat: recording failed: {recording.failure}", file=sys.stderr)
    elif not quiet:
        for file in recording.files:
            print(f"recorded in {file}", file=sys.stderr)


def _run(session: Session) -> int:
    verb = next(group.VERBS[session.chosen.verb] for group in GROUPS if session.chosen.verb in group.VERBS)
    if session.chosen.verb not in gcs_monitor.VERBS:
        session.connection.find_vehicle(session.chosen.timeout)
    return verb(session) or 0
