"""``wingbeat gcs``: watch and command any MAVLink vehicle."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from avionics.link.dialect import mavlink
from avionics.quantities import BadInput, counted
from groundstation.command import gcs_calibrate, gcs_excite, options
from groundstation.link import commands, missions, mode_change, modes, parameter_list, parameters, waypoints
from groundstation.link.answers import NoAnswer
from groundstation.link.connection import AnyExchange, Connection
from groundstation.link.vehicle_state import new_events
from groundstation.views import monitor, tables
from groundstation.views.json_document import print_document
from groundstation.views.mission import mission_record, print_mission
from groundstation.views.progress import ProgressBar

FORCE = 21196.0
"""MAVLink's magic number that disarms in flight"""

EXAMPLES = (
    "wingbeat gcs udpin:0.0.0.0:14550 monitor",
    "wingbeat gcs udpin:0.0.0.0:14550 mode ALTITUDE_HOLD",
    "wingbeat gcs udpin:0.0.0.0:14550 param set PITCH_P 0.8",
    "wingbeat gcs tcp:127.0.0.1:5760 mission download flight.waypoints",
    "wingbeat gcs udpin:0.0.0.0:14550 excite doublet elevator --amplitude 5 --width 0.2",
    "wingbeat gcs udpin:0.0.0.0:14550 excite multisine --elevator 3 --rudder 5 --period 10 --low 0.3 --high 2.5"
    " --loops active",
    "wingbeat gcs udpin:0.0.0.0:14550 calibrate battery --voltage 7.82",
)
JSON_KEYS = {
    "monitor": "one object a line, as status",
    "status": "the telemetry by name, SI and radians, null where nothing was heard; mode, modes",
    "arm, disarm, mode": "done, mode, armed",
    "param list": "parameters: list of {name, value, type}",
    "param get, set": "name, value, type",
    "param save, load": "file; parameters: list of {name, value, type}, saved or changed",
    "excite": "done, mode, armed",
    "calibrate": "kind; said: list of lines; parameters: list of {name, value, type} that changed",
    "mission": "items: list of {number, does, north, east, latitude, longitude, altitude, altitude_above, duration,"
    " heading, radius, turns, acceptance, jump_to, repeats, excitation}, SI and radians, null for none, beside"
    " {frame, command, parameters, x, y, z, autocontinue} of MISSION_ITEM_INT; file where one was written",
    "excitation": "of an item: {shape, elevator (rad), throttle, rudder (rad), width (s), settle (s), repeats,"
    " low (Hz), high (Hz), loops}; width: of a step, of a sweep, or the period of a multisine",
}


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    parser = options.build_parser("gcs", "Watch and command any MAVLink vehicle.", EXAMPLES, JSON_KEYS)
    parser.add_argument("url", metavar="URL", help="udpin:HOST:PORT, udpout:, tcp:, tcpin: or serial:DEVICE,BAUD")
    parser.add_argument(
        "--timeout", type=options.positive, default=5.0, metavar="S", help="wait for a heartbeat (5 s)"
    )
    options.add_json(parser)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=_VerbParser)
    verbs.add_parser("monitor", help="live view of the flight, until Ctrl-C")
    verbs.add_parser("status", help="listen for two seconds, print what the vehicle says")
    verbs.add_parser("arm", help="let the wings move")
    verbs.add_parser("disarm", help="stop the wings").add_argument(
        "--force", action="store_true", help="even in flight"
    )
    verbs.add_parser("mode", help="change the flight mode").add_argument("name", metavar="NAME")
    _add_parameter_verbs(verbs.add_parser("param", help="list, get, set, save or load parameters"))
    _add_mission_verbs(verbs.add_parser("mission", help="show, download or upload the mission"))
    gcs_excite.add_verbs(verbs.add_parser("excite", help="fly an identification input"), _VerbParser)
    gcs_calibrate.add_verbs(verbs.add_parser("calibrate", help="calibrate a sensor aboard"), _VerbParser)
    return parser


class _VerbParser(options.Parser):
    """A verb's parser; the common options may stand behind the verb too."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        self.add_argument("--timeout", type=options.positive, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def _add_parameter_verbs(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(
        dest="action", required=True, metavar="list|get|set|save|load", parser_class=_VerbParser
    )
    actions.add_parser("list", help="every parameter").add_argument("pattern", nargs="?", default="", metavar="PART")
    actions.add_parser("get", help="one parameter").add_argument("name", metavar="NAME")
    setting = actions.add_parser("set", help="change one parameter")
    setting.add_argument("name", metavar="NAME")
    setting.add_argument("value", metavar="VALUE", type=options.number)
    actions.add_parser("save", help="write all to a new file").add_argument("file", type=Path, metavar="FILE")
    actions.add_parser("load", help="set those of a file that differ").add_argument("file", type=Path, metavar="FILE")


def _add_mission_verbs(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(
        dest="action", required=True, metavar="show|download|upload", parser_class=_VerbParser
    )
    actions.add_parser("show", help="print the vehicle's mission")
    actions.add_parser("download", help="write it to a new file").add_argument("file", type=Path, metavar="FILE")
    actions.add_parser("upload", help="send a mission file").add_argument("file", type=Path, metavar="FILE")


def run(arguments: Sequence[str]) -> int:
    """Do what one command line asks for.

    Raises:
        BadInput: bad address, unknown mode, malformed or existing file.
        NoAnswer: no vehicle, a refusal, or silence.
    """
    chosen = build_parser().parse_args(arguments)
    _check_files(chosen)
    connection = Connection(chosen.url, stays=chosen.verb == "monitor")
    try:
        if chosen.verb == "monitor":
            return monitor.watch(connection, as_json=chosen.json)
        connection.find_vehicle(chosen.timeout)
        if chosen.verb == "mission":
            _mission(connection, chosen)
        else:
            VERBS[chosen.verb](connection, chosen)
    finally:
        connection.close()
    return 0


def _check_files(chosen: argparse.Namespace) -> None:
    """Read or refuse files and inputs before the vehicle is spoken to."""
    if chosen.verb == "excite":
        chosen.asked = gcs_excite.excitation_of(chosen)
    if chosen.verb == "param" and chosen.action == "load":
        chosen.values = parameter_list.read(chosen.file)
    if chosen.verb == "param" and chosen.action == "save":
        _check_new(chosen.file)
    if chosen.verb != "mission" or chosen.action == "show":
        return
    if chosen.action == "upload":
        waypoints.read(chosen.file)
        return
    _check_new(chosen.file)


def _check_new(file: Path) -> None:
    if file.exists():
        raise BadInput(f"{file} exists already; choose another name")
    if not file.absolute().parent.is_dir():
        raise BadInput(f"folder {file.absolute().parent} does not exist")


def _run(connection: Connection, exchange: AnyExchange, label: str, chosen: argparse.Namespace) -> AnyExchange:
    with ProgressBar(label, quiet=chosen.json) as bar:
        return connection.run(exchange, lambda now: bar.show(*now.progress()))


def _status(connection: Connection, chosen: argparse.Namespace) -> None:
    names = _ask_mode_names(connection, chosen)
    connection.listen(2.0)
    state = connection.state._replace(mode_names=tuple(names.items()))
    if chosen.json:
        print_document(monitor.state_record(state))
    else:
        monitor.print_once(connection.url, state)


def _ask_mode_names(connection: Connection, chosen: argparse.Namespace) -> dict[int, str]:
    exchange = _run(connection, mode_change.request_mode_names(connection.target), "asking for modes", chosen)
    return dict(exchange.names)


def _arm(connection: Connection, chosen: argparse.Namespace) -> None:
    arming = chosen.verb == "arm"
    force = FORCE if getattr(chosen, "force", False) else 0.0
    command = commands.CommandExchange(
        connection.target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (float(arming), force)
    )
    _run(connection, command, chosen.verb, chosen)
    connection.listen(3.0, lambda state: state.armed == arming)
    if connection.state.armed != arming:
        raise NoAnswer(f"the vehicle accepted to {chosen.verb}, but its heartbeat does not show it")
    _done(connection, chosen, "armed" if arming else "disarmed")


def _mode(connection: Connection, chosen: argparse.Namespace) -> None:
    names = _ask_mode_names(connection, chosen)
    known = modes.known_modes(connection.state._replace(mode_names=tuple(names.items())))
    wanted = chosen.name.upper().replace(" ", "_").replace("-", "_")
    if wanted not in known:
        raise BadInput(
            f"the vehicle has no mode {chosen.name!r}; it has {', '.join(sorted(known)) or 'none it names'}"
        )
    change = mode_change.change_mode(connection.target, known[wanted], modes.uses_main_and_sub(connection.state))
    _run(connection, change, f"mode {wanted}", chosen)
    _done(connection, chosen, f"mode {wanted}")


def _done(connection: Connection, chosen: argparse.Namespace, text: str) -> None:
    if chosen.json:
        state = connection.state
        print_document({"done": text, "mode": modes.mode_key(state), "armed": state.armed})
    else:
        print(text)


def _excite(connection: Connection, chosen: argparse.Namespace) -> None:
    _run(connection, gcs_excite.request(connection.target, chosen.asked), f"excite {chosen.shape}", chosen)
    _done(connection, chosen, f"excite {chosen.shape} accepted")


def _calibrate(connection: Connection, chosen: argparse.Namespace) -> None:
    said: list[str] = []
    heard = connection.state.said

    def watch(exchange: commands.CalibrationExchange) -> None:
        nonlocal heard
        for event in new_events(connection.state, heard):
            said.append(event.text)
            if not chosen.json:
                print(event.text, flush=True)
        heard = connection.state.said
        bar.show(*exchange.progress())

    request = gcs_calibrate.request(connection.target, chosen)
    with ProgressBar(f"calibrate {chosen.kind}", quiet=chosen.json) as bar:
        changed = connection.run(request, watch, gcs_calibrate.PATIENCE).changed
    if chosen.json:
        records = [tables.parameter_record(parameter) for parameter in changed]
        print_document({"kind": chosen.kind, "said": said, "parameters": records})
        return
    _print_parameters(changed, chosen)


def _download(connection: Connection, chosen: argparse.Namespace) -> list[parameters.Parameter]:
    download = parameters.ParameterDownload(connection.target, connection.state.autopilot == modes.PX4)
    return sorted(_run(connection, download, "parameters", chosen).values.values())


def _param_file(connection: Connection, chosen: argparse.Namespace) -> None:
    """Save all parameters, or load those that differ; a name that the vehicle does not have is refused first."""
    held = _download(connection, chosen)
    if chosen.action == "save":
        parameter_list.write(chosen.file, connection.target, held)
        changed, text = held, f"{counted(len(held), 'parameter')} written to {chosen.file}"
    else:
        changed = _load(connection, chosen, {parameter.name: parameter for parameter in held})
        text = f"{counted(len(changed), 'parameter')} changed"
    if chosen.json:
        records = [tables.parameter_record(parameter) for parameter in changed]
        print_document({"file": str(chosen.file), "parameters": records})
    else:
        print(text)


def _load(
    connection: Connection, chosen: argparse.Namespace, held: dict[str, parameters.Parameter]
) -> list[parameters.Parameter]:
    bytewise = connection.state.autopilot == modes.PX4
    unknown = sorted(set(chosen.values) - set(held))
    if unknown:
        raise BadInput(f"the vehicle has no parameter {unknown[0]} of {chosen.file}")
    changed = []
    for name, value in chosen.values.items():
        _check_value(held[name], value, bytewise)
        if value != held[name].value:
            write = parameters.ParameterWrite(connection.target, held[name], value, bytewise)
            changed.append(_run(connection, write, name, chosen).answer or held[name])
    return changed


def _param(connection: Connection, chosen: argparse.Namespace) -> None:
    bytewise = connection.state.autopilot == modes.PX4
    if chosen.action in ("save", "load"):
        _param_file(connection, chosen)
        return
    if chosen.action == "list":
        listed = _download(connection, chosen)
        wanted = [parameter for parameter in listed if chosen.pattern.lower() in parameter.name.lower()]
        _print_parameters(wanted, chosen)
        return
    read = parameters.ParameterRead(connection.target, chosen.name, bytewise)
    known = _run(connection, read, chosen.name, chosen).value
    if known is None:
        raise NoAnswer(f"no answer about parameter {chosen.name}")
    if chosen.action == "set":
        _check_value(known, chosen.value, bytewise)
        write = parameters.ParameterWrite(connection.target, known, chosen.value, bytewise)
        known = _run(connection, write, chosen.name, chosen).answer or known
    if chosen.json:
        print_document(tables.parameter_record(known))
    else:
        print(f"{known.name} = {known.value:.7g}")


def _check_value(known: parameters.Parameter, value: float, bytewise: bool) -> None:
    try:
        parameters.encode_value(value, known.kind, bytewise)
    except ValueError as error:
        raise BadInput(f"parameter {known.name}: {error}") from None


def _print_parameters(wanted: Sequence[parameters.Parameter], chosen: argparse.Namespace) -> None:
    if chosen.json:
        print_document({"parameters": [tables.parameter_record(parameter) for parameter in wanted]})
        return
    for parameter in wanted:
        print(f"{parameter.name:<16}  {parameter.value:.7g}")
    if not wanted and chosen.verb == "param":
        print(f"no parameter's name contains {chosen.pattern!r}", file=sys.stderr)


def _mission(connection: Connection, chosen: argparse.Namespace) -> None:
    if chosen.action == "upload":
        _upload(connection, chosen)
        return
    items = _download_items(connection, chosen, mavlink.MAV_MISSION_TYPE_MISSION, "the mission")
    if chosen.action == "download":
        _write(connection, chosen, items)
        _report_mission(items, f"{counted(len(items), 'item')} written to {chosen.file}", chosen.file, chosen)
        return
    _report_mission(items, "", None, chosen)


def _upload(connection: Connection, chosen: argparse.Namespace) -> None:
    """The mission; fence and rally points where the file has them."""
    ours = connection.state.autopilot == mavlink.MAV_AUTOPILOT_GENERIC
    content = waypoints.read_upload(chosen.file, ours)
    for note in content.notes:
        print(note, file=sys.stderr)
    for mission_type, name, items in (
        (mavlink.MAV_MISSION_TYPE_FENCE, "the fence", content.fence),
        (mavlink.MAV_MISSION_TYPE_RALLY, "the rally points", content.rally),
        (mavlink.MAV_MISSION_TYPE_MISSION, "the mission", content.mission),
    ):
        if items:
            upload = missions.MissionUpload(connection.target, items, mission_type=mission_type)
            _run(connection, upload, f"sending {name}", chosen)
    parts = ((content.mission, "mission item"), (content.fence, "fence item"), (content.rally, "rally point"))
    text = " and ".join(counted(len(part), name) for part, name in parts if part)
    _report_mission(content.mission, f"sent {text or 'nothing'}", None, chosen)


def _download_items(
    connection: Connection, chosen: argparse.Namespace, mission_type: int, name: str
) -> tuple[missions.Item, ...]:
    download = missions.MissionDownload(connection.target, mission_type=mission_type)
    return _run(connection, download, f"reading {name}", chosen).items


def _write(connection: Connection, chosen: argparse.Namespace, items: tuple[missions.Item, ...]) -> None:
    """A plain list, or a plan with fence, rally points and home."""
    if chosen.file.suffix != ".plan":
        waypoints.write(chosen.file, items)
        return
    connection.run(
        commands.CommandExchange(
            connection.target, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(mavlink.MAVLINK_MSG_ID_HOME_POSITION),)
        )
    )
    connection.listen(3.0, lambda state: state.home is not None)
    home = connection.state.home
    if home is None:
        raise NoAnswer("the vehicle does not say where its home is, and a plan needs it: write a .waypoints list")
    fence = _download_items(connection, chosen, mavlink.MAV_MISSION_TYPE_FENCE, "the fence")
    rally = _download_items(connection, chosen, mavlink.MAV_MISSION_TYPE_RALLY, "the rally points")
    waypoints.write_plan(chosen.file, waypoints.Upload(items, fence, rally), home)


def _report_mission(items: Sequence[missions.Item], text: str, file: Path | None, chosen: argparse.Namespace) -> None:
    if chosen.json:
        records = [mission_record(number, item) for number, item in enumerate(items)]
        print_document({"items": records, "file": None if file is None else str(file)})
    elif text:
        print(text)
    else:
        print_mission(items)


VERBS: dict[str, Callable[[Connection, argparse.Namespace], None]] = {
    "status": _status,
    "arm": _arm,
    "disarm": _arm,
    "mode": _mode,
    "param": _param,
    "excite": _excite,
    "calibrate": _calibrate,
}
