"""``wingbeat gcs URL watch`` and ``record``: telemetry as lines or as a file."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from pathlib import Path
from typing import Any

from avionics.link.dialect import mavlink
from groundstation.command import options
from groundstation.command.gcs_session import Session, Verb, check_new
from groundstation.link.answers import NoAnswer
from groundstation.link.commands import CommandExchange
from groundstation.link.fields import Field, parse_field
from groundstation.link.frames import Arrival, message_class
from groundstation.link.heartbeat_monitor import HeartbeatMonitor
from groundstation.link.recording import boot_stamp
from groundstation.link.station import Station
from groundstation.link.vehicle_state import VehicleState
from groundstation.views import monitor, wording
from groundstation.views.json_document import plain, print_document, print_line
from groundstation.views.progress import ProgressBar
from wingbeat.errors import InputError
from wingbeat.text import pluralize

JSON_KEYS = {
    "watch": "one object a line: time (s of the vehicle, null before its first stamp) and every field asked for",
    "record": "file, messages, duration (s), silence (s; of it, in gaps of 5 s and more), lost, loss",
}


def add_verbs(verbs: Any) -> None:
    """Add both verbs."""
    watch = verbs.add_parser("watch", help="print fields as they come")
    watch.add_argument(
        "fields", nargs="+", metavar="MSG.FIELD", help="such as ATTITUDE.pitch BATTERY_STATUS.voltages[0]"
    )
    watch.add_argument("--count", type=int, metavar="N", help="end after so many lines")
    watch.add_argument("--rate", type=options.positive, metavar="HZ", help="ask for the messages that often")
    record = verbs.add_parser("record", help="record everything to a new file, until Ctrl-C")
    record.add_argument("file", type=Path, metavar="OUT.mcap")
    for parser in (watch, record):
        parser.add_argument(
            "--duration", type=options.positive, default=math.inf, metavar="S", help="end after so long"
        )


def prepare(chosen: argparse.Namespace) -> None:
    """Check fields and files before the vehicle is contacted.

    Raises:
        InputError: an unknown field, a file that exists or does not end in .mcap.
    """
    if chosen.verb == "watch":
        chosen.asked = [parse_field(text) for text in chosen.fields]
        if chosen.count is not None and chosen.count < 1:
            raise InputError("--count must be at least 1")
    if chosen.verb == "record":
        check_new(chosen.file, (".mcap",))


def is_endless(chosen: argparse.Namespace) -> bool:
    """Return whether only Ctrl-C ends the verb."""
    return math.isinf(chosen.duration) and getattr(chosen, "count", None) is None


class _Watch:
    """Printer of a line for each of the selected messages."""

    def __init__(self, session: Session, fields: list[Field]) -> None:
        self.lines = 0
        self._session, self._fields = session, fields
        self._requested = {field.message for field in fields}

    def handle_frame(self, arrival: Arrival) -> None:
        """Print one frame, unless all requested lines are printed."""
        message, most = arrival.message, self._session.chosen.count
        if message is None or message.get_type() not in self._requested or (most is not None and self.lines >= most):
            return
        if arrival.frame.system != self._session.state.system:
            return
        self.lines += 1
        here = [(field, field.value(message)) for field in self._fields if field.message == message.get_type()]
        stamp = boot_stamp(message)
        now = self._session.state.time if stamp is None else stamp
        if self._session.json:
            print_line({"time": now, **{field.path: plain(_clean(value)) for field, value in here}})
        else:
            values = "  ".join(f"{field.path} {_shown(value)} {field.unit}".rstrip() for field, value in here)
            print(f"{wording.clock(now):>8}  {values}", flush=True)


def _clean(value: Any) -> Any:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text.partition("\0")[0] if isinstance(text, str) else text


def _shown(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else f"{_clean(value)}"


def watch(session: Session) -> None:
    """Print fields until the number of lines, the time limit, or Ctrl-C is reached.

    Raises:
        NoAnswer: none was received.
    """
    watcher = _Watch(session, session.chosen.asked)
    if session.chosen.rate is not None:
        _request_rate(session, session.chosen.rate)
    session.connection.overhear(watcher.handle_frame)
    most, heartbeat_monitor = session.chosen.count, _attend(session)

    def enough(state: VehicleState) -> bool:
        _report(heartbeat_monitor, session.connection.now())
        return most is not None and watcher.lines >= most

    session.connection.listen(session.chosen.duration, enough)
    if not watcher.lines:
        names = ", ".join(sorted({field.message for field in session.chosen.asked}))
        raise NoAnswer(f"no {names} received within {session.chosen.duration:g} s; request the message with --rate")


def _attend(session: Session) -> HeartbeatMonitor:
    """Check for a loss of heartbeats."""
    heartbeat_monitor = HeartbeatMonitor(lambda: session.state, session.connection.now())
    session.connection.overhear(heartbeat_monitor.handle_frame)
    return heartbeat_monitor


def _report(heartbeat_monitor: HeartbeatMonitor, now: float) -> None:
    """Report changes of the heartbeat state on stderr."""
    for line in heartbeat_monitor.news(now):
        print(line, file=sys.stderr, flush=True)


def _request_rate(session: Session, rate: float) -> None:
    """Send SET_MESSAGE_INTERVAL for each of the messages.

    Raises:
        NoAnswer: the vehicle denied the request.
    """
    for name in sorted({field.message for field in session.chosen.asked}):
        number = float(message_class(name).id)  # type: ignore[union-attr]
        wanted = (number, 1e6 / rate)
        command = CommandExchange(session.target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, wanted)
        session.run_exchange(command, f"requesting {name}")


def record(session: Session) -> None:
    """Record until the time limit or Ctrl-C, and report the number of messages.

    Raises:
        InputError: the disk failed.
    """
    station = Station(session.connection)
    began, duration, heartbeat_monitor = session.connection.now(), session.chosen.duration, _attend(session)
    with contextlib.suppress(KeyboardInterrupt), ProgressBar("recording", quiet=session.json, reporting=True) as bar:
        while (elapsed := session.connection.now() - began) < duration:
            if not station.poll():
                session.connection.wait()
            _report(heartbeat_monitor, session.connection.now())
            bar.show(elapsed, duration if math.isfinite(duration) else 0, _progress(station, elapsed))
    quality = station.picture().quality
    recording = session.recording
    assert recording is not None
    recording.close()
    if recording.failure:
        raise InputError(recording.failure)
    now = session.connection.now()
    elapsed, silence = now - began, heartbeat_monitor.silence(now)
    if session.json:
        ended = {"file": str(session.chosen.file), "messages": recording.messages, "duration": elapsed}
        print_document({**ended, "silence": silence, "lost": quality.lost, "loss": quality.loss})
        return
    silent = f", silent for {wording.duration(silence)}" if silence else ""
    print(
        f"{pluralize(recording.messages, 'message')} in {wording.duration(elapsed)}{silent}, {quality.lost} lost:",
        recording.path,
    )


def _progress(station: Station, elapsed: float) -> str:
    quality = station.picture().quality
    return f"recording {wording.duration(elapsed)}, {quality.received} messages, {monitor.link_note(quality)}"


VERBS: dict[str, Verb] = {"watch": watch, "record": record}
