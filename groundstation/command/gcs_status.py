"""``wingbeat gcs URL status``: the telemetry once."""

from __future__ import annotations

from typing import Any

from groundstation.command.gcs_session import Session, Verb
from groundstation.link.traffic import Traffic, quality_record
from groundstation.views import monitor
from groundstation.views.json_document import print_document

JSON_KEYS = {
    "status": "the telemetry by name, SI and radians, null where nothing was heard; mode, modes, stage, events;"
    " link: {messages_per_s, bytes_per_s, loss, lost, doubled, heard, latency, bad_bytes}",
}
LISTENED = 2.0
"""s; duration of listening to telemetry"""


def add_verbs(verbs: Any) -> None:
    """Add the verb."""
    verbs.add_parser("status", help="receive for two seconds and print the telemetry")


def show(session: Session) -> None:
    """Listen, and print the view or the document."""
    traffic = Traffic()
    session.connection.overhear(traffic.handle_frame)
    names = session.read_mode_names()
    session.connection.listen(LISTENED)
    state = session.state._replace(mode_names=tuple(names.items()))
    quality = traffic.quality(session.connection.now())
    if session.json:
        bad_bytes = session.connection.bad_bytes
        print_document({**monitor.state_record(state), "link": quality_record(quality._replace(bad_bytes=bad_bytes))})
    else:
        monitor.print_once(session.connection.url, state, quality)


VERBS: dict[str, Verb] = {"status": show}
