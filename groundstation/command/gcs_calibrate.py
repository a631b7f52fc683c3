"""``wingbeat gcs URL calibrate``: calibrations on board with their messages."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from typing import Any

from avionics.link.dialect import mavlink
from avionics.messages import Calibration
from groundstation.command import options
from groundstation.command.gcs_param import print_parameters
from groundstation.command.gcs_session import Session, Verb, VerbParser
from groundstation.link.answers import NoAnswer
from groundstation.link.commands import CalibrationExchange, CommandExchange
from groundstation.link.exchange import Target
from groundstation.link.vehicle_state import StatusLine, new_events
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from wingbeat.message import Severity

PATIENCE = 600.0
"""s; timeout of a calibration: six sides, or a circle in flight, take several minutes"""
HELD = 1.0
"""s; delay of a warning, which may be the reason of a failure that follows"""
CANCEL = (0.0,) * 7
"""parameters of MAV_CMD_PREFLIGHT_CALIBRATION that cancel any calibration"""
CANCELS = 4
"""-; maximum number of cancel requests"""
CANCEL_WAIT = 0.7
"""s; timeout of the response to each: later messages about the calibration are not taken for a response"""
PREFLIGHT: dict[str, tuple[float, ...]] = {
    "accel": (0.0, 0.0, 0.0, 0.0, 1.0),
    "level": (0.0, 0.0, 0.0, 0.0, 2.0),
    "mag": (0.0, 1.0),
    "airspeed": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
}
"""parameters of MAV_CMD_PREFLIGHT_CALIBRATION, as defined by MAVLink"""
KINDS = {
    "accel": "accelerometer, at rest on each of its six sides",
    "level": "accelerometer, level and at rest",
    "mag": "magnetometer, turned about all axes",
    "airspeed": "pitot, covered, at rest; with --in-flight its scale, in a circle or both directions",
    "wings": "both wings at rest, level or at --angle",
    "battery": "battery with drives at rest; --voltage: measured at its terminals",
    "cancel": "end the calibration that runs",
}


JSON_KEYS = {"calibrate": "kind; said: list of lines; parameters: list of {name, value, type} that changed"}


def add_verbs(verbs: Any) -> None:
    """Add the sensors that can be calibrated."""
    parser = verbs.add_parser("calibrate", help="calibrate a sensor aboard")
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="|".join(KINDS), parser_class=VerbParser)
    added = {kind: kinds.add_parser(kind, help=text) for kind, text in KINDS.items()}
    added["airspeed"].add_argument("--in-flight", action="store_true", help="calibrate the scale from GPS velocity")
    added["wings"].add_argument(
        "--angle",
        type=options.number,
        default=0.0,
        metavar="DEG",
        help="angle of both wings, up positive (default: 0)",
    )
    added["battery"].add_argument(
        "--voltage",
        type=options.positive,
        default=0.0,
        metavar="V",
        help="battery voltage (default: scale unchanged)",
    )


def request(target: Target, chosen: argparse.Namespace) -> CalibrationExchange:
    """Build the command that starts the calibration."""
    in_flight = chosen.kind == "airspeed" and chosen.in_flight
    if chosen.kind in PREFLIGHT and not in_flight:
        command = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
        return CalibrationExchange(CommandExchange(target, command, PREFLIGHT[chosen.kind]))
    kind, given = {
        "airspeed": (Calibration.AIRSPEED, 0.0),
        "wings": (Calibration.WINGS, math.radians(getattr(chosen, "angle", 0.0))),
        "battery": (Calibration.BATTERY, getattr(chosen, "voltage", 0.0)),
    }[chosen.kind]
    return CalibrationExchange(CommandExchange(target, mavlink.MAV_CMD_WINGBEAT_CALIBRATE, (float(kind), given)))


def run(session: Session) -> None:
    """Calibrate; print the vehicle's messages and the parameters that changed."""
    kind = session.chosen.kind
    if kind == "cancel":
        return _cancel(session)
    with ProgressBar(f"calibrate {kind}", quiet=session.json) as bar:
        listener = _Listener(session, bar)
        changed = _calibrate(session, listener).changed
    if session.json:
        records = [tables.parameter_record(parameter) for parameter in changed]
        print_document({"kind": kind, "said": listener.texts, "parameters": records})
    else:
        print_parameters(session, changed)
    return None


def _calibrate(session: Session, listener: _Listener) -> CalibrationExchange:
    """Run the calibration to its end; an interruption cancels it.

    Raises:
        NoAnswer: denied, failed, or timed out.
    """
    try:
        return session.connection.run(request(session.target, session.chosen), listener.handle_event, PATIENCE)
    except KeyboardInterrupt:
        print(_outcome(cancel(session)), file=sys.stderr)
        raise
    except NoAnswer as failure:
        if listener.ended:
            raise
        raise NoAnswer(f"{failure}; {_outcome(cancel(session))}") from None


def cancel(session: Session) -> bool:
    """Cancel the calibration; return whether the vehicle has acknowledged that."""
    for _ in range(CANCELS):
        with contextlib.suppress(NoAnswer):
            session.connection.run(_cancellation(session), timeout=CANCEL_WAIT)
            return True
    return False


def _cancellation(session: Session) -> CommandExchange:
    return CommandExchange(session.target, mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, CANCEL)


def _outcome(cancelled: bool) -> str:
    if cancelled:
        return "calibration canceled"
    return "cancellation not confirmed: the calibration may continue"


def _cancel(session: Session) -> None:
    session.run_exchange(_cancellation(session), "calibrate cancel")
    if session.json:
        print_document({"kind": "cancel", "said": [], "parameters": []})
    else:
        print(_outcome(True))


class _Listener:
    """Collector of the vehicle's messages during a calibration.

    The reason of a refusal or failure is reported with the failure. A warning is therefore delayed, because it may be
    the reason of an end that follows at once.
    """

    def __init__(self, session: Session, bar: ProgressBar) -> None:
        self.texts: list[str] = []
        self.ended = False
        """whether the vehicle ended or denied the calibration"""
        self._session, self._bar = session, bar
        self._received = session.state.text_count
        self._waiting: list[StatusLine] = []
        self._since = 0.0

    def handle_event(self, exchange: CalibrationExchange) -> None:
        """Print new messages."""
        state, now = self._session.state, self._session.connection.now()
        if new := new_events(state, self._received):
            self.texts += [event.text for event in new]
            self._waiting += new
            self._since = now
        self._received = state.text_count
        self.ended = exchange.request.result is not None
        if not self._session.json and (exchange.request.in_progress or exchange.request.accepted):
            self._print(at_once=exchange.request.accepted or now - self._since >= HELD)
        self._bar.show(*exchange.progress())

    def _print(self, at_once: bool) -> None:
        while self._waiting and (at_once or self._waiting[0].severity > Severity.WARNING):
            print(self._waiting.pop(0).text, flush=True)


VERBS: dict[str, Verb] = {"calibrate": run}
