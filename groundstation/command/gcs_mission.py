"""``wingbeat gcs URL mission``: show, download, upload and compare missions."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home
from avionics.missions.files import LISTS
from groundstation.command.gcs_session import Session, Verb, VerbParser, check_new
from groundstation.link import missions, waypoints
from groundstation.link.answers import NoAnswer
from groundstation.link.vehicle_state import new_events
from groundstation.views.json_document import print_document
from groundstation.views.mission import difference_lines, mission_record, print_mission
from wingbeat.message import Severity
from wingbeat.text import pluralize

JSON_KEYS = {
    "mission": "items: list of {number, does, north, east, latitude, longitude, altitude, altitude_above, duration,"
    " heading, radius, turns, acceptance, jump_to, repeats, excitation, airspeed}, SI and radians, null for none,"
    " beside {frame, command, parameters, x, y, z, autocontinue} of MISSION_ITEM_INT; file where one was written",
    "excitation": "of an item: {shape, elevator (rad), throttle, rudder (rad), width (s), settle (s), repeats,"
    " low (Hz), high (Hz), loops}; width: of a step, of a sweep, or the period of a multisine",
    "mission diff": "file; same; differences: list of {part, number, file, vehicle}, items as above or null",
}
REMARKS = 0.5
"""s; timeout for the vehicle's comments on an upload"""
WRITTEN = (*LISTS, ".plan")
"""suffixes of the output files: lists as `QGC WPL 110`, and QGroundControl's plan"""
PARTS = (
    ("fence", mavlink.MAV_MISSION_TYPE_FENCE, "the fence", "fence item"),
    ("rally", mavlink.MAV_MISSION_TYPE_RALLY, "the rally points", "rally point"),
    ("mission", mavlink.MAV_MISSION_TYPE_MISSION, "the mission", "mission item"),
)
"""parts of an upload in the order of transfer: the fence is active before the mission"""


def add_verbs(verbs: Any) -> None:
    """Add the actions."""
    parser = verbs.add_parser("mission", help="show, download, upload or diff the mission")
    metavar = "show|download|upload|diff"
    actions = parser.add_subparsers(dest="action", required=True, metavar=metavar, parser_class=VerbParser)
    actions.add_parser("show", help="print the vehicle's mission")
    for action, text in (
        ("download", "write it to a new file"),
        ("upload", "send a mission file"),
        ("diff", "differences from a file; exit code 1 if there are any"),
    ):
        actions.add_parser(action, help=text).add_argument("file", type=Path, metavar="FILE")


def prepare(chosen: argparse.Namespace) -> None:
    """Check the files before the vehicle is contacted.

    Raises:
        InputError: malformed, or an existing output file.
    """
    if chosen.verb != "mission" or chosen.action == "show":
        return
    if chosen.action == "download":
        check_new(chosen.file, WRITTEN)
    else:
        waypoints.read(chosen.file)


def run(session: Session) -> int | None:
    """Run one action."""
    return ACTION[session.chosen.action](session)


def _convention(session: Session) -> waypoints.Convention:
    session.identify_vehicle()
    return waypoints.convention_of(session.state.autopilot, session.state.is_wingbeat)


def _content(session: Session) -> waypoints.Upload:
    """Return the file's content in the convention of this vehicle."""
    convention = _convention(session)
    home = session.home() if waypoints.needs_home(session.chosen.file, convention) else None
    content = waypoints.read_upload(session.chosen.file, convention, home)
    for note in content.notes:
        print(note, file=sys.stderr)
    return content


def _upload(session: Session) -> None:
    """Upload the mission, and fence and rally points if the file has them."""
    content = _content(session)
    sent: list[str] = []
    said = session.state.text_count
    for part, mission_type, name, noun in PARTS:
        items = getattr(content, part)
        if items:
            # The new fence is also checked against the old mission, so only the comments on the last part count.
            said = session.state.text_count
            try:
                session.run_exchange(
                    missions.MissionUpload(session.target, items, mission_type=mission_type), f"sending {name}"
                )
            except NoAnswer as failure:
                aboard = f"; on board from this file: {' and '.join(sent)}" if sent else ""
                raise NoAnswer(f"{failure}{aboard}") from None
            sent.append(pluralize(len(items), noun))
    session.connection.listen(REMARKS)
    for event in new_events(session.state, said):
        if event.severity <= Severity.WARNING:
            print(event.text, file=sys.stderr)
    _report(session, content.mission, f"sent {' and '.join(reversed(sent)) or 'nothing'}", None)


def _read(session: Session, mission_type: int, name: str) -> tuple[missions.Item, ...]:
    download = missions.MissionDownload(session.target, mission_type=mission_type)
    return session.run_exchange(download, f"reading {name}").items


def _read_mission(session: Session) -> tuple[missions.Item, ...]:
    return _read(session, mavlink.MAV_MISSION_TYPE_MISSION, "the mission")


def _show(session: Session) -> None:
    _report(session, _read_mission(session), "", None)


def _download(session: Session) -> None:
    """Download a plain list, or a plan with fence, rally points and home."""
    file, items = session.chosen.file, _read_mission(session)
    if file.suffix == ".plan":
        home: Home = session.home()
        fence = _read(session, mavlink.MAV_MISSION_TYPE_FENCE, "the fence")
        rally = _read(session, mavlink.MAV_MISSION_TYPE_RALLY, "the rally points")
        convention = _convention(session)
        waypoints.write_plan(file, waypoints.without_first(waypoints.Upload(items, fence, rally), convention), home)
    else:
        waypoints.write(file, items)
    _report(session, items, f"{pluralize(len(items), 'item')} written to {file}", file)


def _diff(session: Session) -> int:
    """Compare the uploadable content of the file with the vehicle's, except home, which the vehicle sets."""
    convention = _convention(session)
    wanted = waypoints.without_first(_content(session), convention)
    rows: list[tuple[str, int, missions.Item | None, missions.Item | None]] = []
    for part, mission_type, name, _ in reversed(PARTS):
        items = getattr(wanted, part)
        if part == "mission" or items:
            aboard = _read(session, mission_type, name)
            if part == "mission":
                aboard = waypoints.without_first(waypoints.Upload(aboard), convention).mission
            rows += [(part, *row) for row in waypoints.differences(*_comparable(session, items, aboard))]
    if session.json:
        print_document(
            {"file": str(session.chosen.file), "same": not rows, "differences": [_row(*row) for row in rows]}
        )
        return int(bool(rows))
    for part, number, file_items, vehicle_items in rows:
        print("\n".join(difference_lines(part, number, file_items, vehicle_items)))
    print(f"{pluralize(len(rows), 'difference')} from {session.chosen.file}", file=sys.stderr)
    return int(bool(rows))


def _comparable(session: Session, *lists: tuple[missions.Item, ...]) -> list[tuple[missions.Item, ...]]:
    """Return the lists with global positions if only one of them has positions in meters from home."""
    if len({any(map(waypoints.is_local, items)) for items in lists}) == 1:
        return list(lists)
    home = session.home()
    return [tuple(waypoints.on_globe(item, home) for item in items) for items in lists]


def _row(
    part: str, number: int, file_items: missions.Item | None, vehicle_items: missions.Item | None
) -> dict[str, Any]:
    file, vehicle = (None if item is None else mission_record(number, item) for item in (file_items, vehicle_items))
    return {"part": part, "number": number, "file": file, "vehicle": vehicle}


def _report(session: Session, items: Sequence[missions.Item], text: str, file: Path | None) -> None:
    if session.json:
        records = [mission_record(number, item) for number, item in enumerate(items)]
        print_document({"items": records, "file": None if file is None else str(file)})
    elif text:
        print(text)
    else:
        print_mission(items, _convention(session).home_first)


ACTION: dict[str, Verb] = {"show": _show, "download": _download, "upload": _upload, "diff": _diff}
VERBS: dict[str, Verb] = {"mission": run}
