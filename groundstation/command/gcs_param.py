"""``wingbeat gcs URL param``: list, get, set, compare, save and load parameters."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.command.gcs_session import Session, Verb, VerbParser, check_new
from groundstation.link import parameter_list, parameters
from groundstation.link.answers import NoAnswer
from groundstation.link.vehicle_state import is_wingbeat_vehicle
from groundstation.views import tables
from groundstation.views.json_document import print_document
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean, pluralize

JSON_KEYS = {
    "param list": "parameters: list of {name, value, type}",
    "param get, set": "name, value, type",
    "param diff": "file; same; differences: list of {name, file, vehicle}, null where one has it not",
    "param save": "file; parameters: list of {name, value, type}",
    "param load": "file; parameters: list of {name, value, type, before} that changed",
}
ACTIONS = "list|get|set|diff|save|load"


def add_verbs(verbs: Any) -> None:
    """Add the actions."""
    parser = verbs.add_parser("param", help="list, get, set, diff, save or load parameters")
    actions = parser.add_subparsers(dest="action", required=True, metavar=ACTIONS, parser_class=VerbParser)
    actions.add_parser("list", help="every parameter").add_argument("pattern", nargs="?", default="", metavar="PART")
    actions.add_parser("get", help="one parameter").add_argument("name", metavar="NAME")
    setting = actions.add_parser("set", help="change one parameter")
    setting.add_argument("name", metavar="NAME")
    setting.add_argument("value", metavar="VALUE", type=options.number)
    for action, text in (
        ("diff", "differences from a file; exit code 1 if there are any"),
        ("save", "write all to a new file"),
        ("load", "set those of a file that differ"),
    ):
        actions.add_parser(action, help=text).add_argument("file", type=Path, metavar="FILE")


def prepare(chosen: argparse.Namespace) -> None:
    """Read or check files before the vehicle is contacted.

    Raises:
        InputError: malformed, or an existing output file.
    """
    if chosen.verb == "param" and chosen.action in ("load", "diff"):
        chosen.values = parameter_list.read(chosen.file)
    if chosen.verb == "param" and chosen.action == "save":
        check_new(chosen.file)


def run(session: Session) -> int | None:
    """Run one action."""
    return ACTION[session.chosen.action](session)


def bytewise(session: Session) -> bool:
    """Return whether the vehicle sends integers bytewise, from its capabilities or its autopilot type."""
    session.request_version()
    return parameters.is_bytewise(session.state)


def _download(session: Session) -> list[parameters.Parameter]:
    download = parameters.ParameterDownload(session.target, bytewise(session))
    return sorted(session.run_exchange(download, "parameters").values.values())


def _list(session: Session) -> None:
    pattern = session.chosen.pattern
    requested = [parameter for parameter in _download(session) if pattern.lower() in parameter.name.lower()]
    print_parameters(session, requested)
    if not requested and not session.json:
        print(f"no parameter name contains {pattern!r}", file=sys.stderr)


def _read(session: Session, encoding: bool) -> parameters.Parameter:
    name = session.chosen.name
    try:
        known = session.run_exchange(parameters.ParameterRead(session.target, name, encoding), name).value
    except NoAnswer as refusal:
        raise NoAnswer(f"{refusal}{_near(session, name)}") from None
    if known is None:
        raise NoAnswer(f"no response for parameter {name}")
    return known


def _near(session: Session, name: str) -> str:
    """Return a hint with the most similar Wingbeat parameter; empty for other vehicles."""
    if not is_wingbeat_vehicle(session.connection.state):
        return ""
    from avionics.parameters import parameter_table
    from avionics.vehicles import load_vehicle

    return did_you_mean(name.upper(), parameter_table(load_vehicle(options.DEFAULT_VEHICLE).gains))


def _get(session: Session) -> None:
    _print_one(session, _read(session, bytewise(session)))


def _set(session: Session) -> None:
    encoding, value = bytewise(session), session.chosen.value
    known = _read(session, encoding)
    _check_value(known, value, encoding)
    write = parameters.ParameterWrite(session.target, known, value, encoding)
    _print_one(session, session.run_exchange(write, known.name).answer or known)


def _print_one(session: Session, known: parameters.Parameter) -> None:
    if session.json:
        print_document(tables.parameter_record(known))
    else:
        print(f"{known.name} = {known.value:.7g}")


def _diff(session: Session) -> int:
    """Compare a file with the vehicle in both directions."""
    current: dict[str, float] = {parameter.name: parameter.value for parameter in _download(session)}
    requested: dict[str, float] = session.chosen.values
    names = [name for name in sorted({*current, *requested}) if _differs(requested.get(name), current.get(name))]
    if session.json:
        rows = [{"name": name, "file": requested.get(name), "vehicle": current.get(name)} for name in names]
        print_document({"file": str(session.chosen.file), "same": not names, "differences": rows})
        return int(bool(names))
    for name in names:
        print(f"{name:<16}  file {_shown(requested.get(name))}   vehicle {_shown(current.get(name))}")
    print(f"{pluralize(len(names), 'difference')} from {session.chosen.file}", file=sys.stderr)
    return int(bool(names))


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.7g}"


def _differs(first: float | None, second: float | None) -> bool:
    if first is None or second is None:
        return True
    return not parameters.same(first, second)


def _save(session: Session) -> None:
    current = _download(session)
    parameter_list.write(session.chosen.file, session.target, current)
    _report(session, current, f"{pluralize(len(current), 'parameter')} written to {session.chosen.file}")


def _load(session: Session) -> None:
    """Set the values that differ; a parameter that the vehicle lacks is rejected before any is set."""
    encoding = bytewise(session)
    current = {parameter.name: parameter for parameter in _download(session)}
    unknown = sorted(set(session.chosen.values) - set(current))
    if unknown:
        raise InputError(
            f"the vehicle has no parameter {unknown[0]} of {session.chosen.file}{did_you_mean(unknown[0], current)}"
        )
    for name, value in session.chosen.values.items():
        _check_value(current[name], value, encoding)
    changed = []
    for name, value in session.chosen.values.items():
        if _differs(value, current[name].value):
            write = parameters.ParameterWrite(session.target, current[name], value, encoding)
            changed.append(session.run_exchange(write, name).answer or current[name])
    if session.json:
        rows = [{**tables.parameter_record(each), "before": current[each.name].value} for each in changed]
        print_document({"file": str(session.chosen.file), "parameters": rows})
        return
    for each in changed:
        print(f"{each.name:<16}  {_shown(current[each.name].value)} -> {_shown(each.value)}")
    print(f"{pluralize(len(changed), 'parameter')} changed")


def _report(session: Session, current: Sequence[parameters.Parameter], text: str) -> None:
    if session.json:
        records = [tables.parameter_record(parameter) for parameter in current]
        print_document({"file": str(session.chosen.file), "parameters": records})
    else:
        print(text)


def _check_value(known: parameters.Parameter, value: float, encoding: bool) -> None:
    try:
        parameters.encode_value(value, known.kind, encoding)
    except ValueError as error:
        raise InputError(f"parameter {known.name}: {error}") from None


def print_parameters(session: Session, requested: Sequence[parameters.Parameter]) -> None:
    """Print parameters as lines, or as a document."""
    if session.json:
        print_document({"parameters": [tables.parameter_record(parameter) for parameter in requested]})
        return
    for parameter in requested:
        print(f"{parameter.name:<16}  {parameter.value:.7g}")


ACTION: dict[str, Verb] = {"list": _list, "get": _get, "set": _set, "diff": _diff, "save": _save, "load": _load}
VERBS: dict[str, Verb] = {"param": run}
