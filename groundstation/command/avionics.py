"""``wingbeat avionics``: the flight computer alone."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from avionics import parameters, topics
from avionics.board.board import BoardSilent
from avionics.board.cores import pin_to_core
from avionics.board.hil import HilBoard
from avionics.board.parameter_file import Loaded, ParameterFile, default_path, key_path
from avionics.guidance.mission import Mission
from avionics.link.ground import Files, GroundLink
from avionics.link.key_file import load_signing
from avionics.link.vehicle import load_identity
from avionics.messages import Command, Severity
from avionics.missions.files import load_flight_plan
from avionics.missions.script import plan_commands, scripted_start
from avionics.quantities import BadInput, counted
from avionics.recorder import Recorder
from avionics.vehicles import FlightVehicle, load_vehicle
from groundstation.command import options
from groundstation.command.onboard import Onboard
from groundstation.command.told import Account, Flown, ToldBoard, event_record
from groundstation.views.json_document import print_document
from logs.attached import FLIGHT_VEHICLE, PARAMETERS
from logs.names import new_recording
from logs.recorder import McapRecorder
from sim_bridge.flight.flight import fault_commands

STOPPED = "stopped with Ctrl-C"
EXAMPLES = (
    "wingbeat avionics --board hil:tcp:127.0.0.1:4560 --gcs udpin:0.0.0.0:14550",
    "wingbeat avionics --board hil:tcp:127.0.0.1:4560 --gcs serial:/dev/ttyUSB0,57600 --identity ardupilot",
    "wingbeat avionics --board hil:serial:/dev/ttyACM0,921600 --vehicle my_bird.toml",
)
JSON_KEYS = {
    "vehicle": "name",
    "board": "address",
    "links": "list of addresses of links for ground stations",
    "log": "path of the recording",
    "frames": "sensor frames read",
    "time": "s; since boot, of the last sensor frame",
    "ended": "why it ended, one line",
    "events": "list of {time, severity, source, text}; s since boot",
}


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    summary = "The flight computer alone: sensors and servos over a board, ground stations over MAVLink."
    parser = options.build_parser("avionics", summary, EXAMPLES, JSON_KEYS)
    options.add_vehicle(parser)
    parser.add_argument("--board", required=True, metavar="hil:URL", help="where sensors and servos are")
    options.add_mission(parser)
    options.add_gcs(parser)
    options.add_identity(parser)
    options.add_signing_key(parser, "kept in the user's folder")
    parser.add_argument("--log", type=Path, metavar="FILE", help="a new file (default: recordings/VEHICLE-TIME.mcap)")
    options.add_parameters(parser, "kept in the user's folder")
    parser.add_argument("--start", action="store_true", help="arm and switch to AUTO 2 s after boot")
    options.add_json(parser)
    parser.add_argument("--fault", action="append", default=[], type=options.fault, help=argparse.SUPPRESS)
    parser.add_argument("--epoch-ns", type=int, metavar="NS", help=argparse.SUPPRESS)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Fly until the board says that the world is over, and say on stderr what happens aboard.

    Raises:
        BadInput: unknown vehicle, malformed mission, port in use, existing log, nobody at the board's address.
    """
    chosen = build_parser().parse_args(arguments)
    identity = load_identity(chosen.identity)
    vehicle = load_vehicle(chosen.vehicle)
    plan = load_flight_plan(chosen.mission)
    kept = None
    if chosen.parameters != options.NO_PARAMETERS:
        kept = ParameterFile(Path(chosen.parameters or default_path(vehicle.name)), vehicle)
    loaded = Loaded(vehicle, "", False) if kept is None else kept.load()
    vehicle = loaded.vehicle
    signing = load_signing(options.key_file(chosen.signing_key, key_path(vehicle.name)))
    path = chosen.log or new_recording(vehicle.name)
    # Beside a world that shares the recordings' time it is `wingbeat fly` that tells.
    account = Account(quiet=chosen.json or chosen.epoch_ns is not None)
    with contextlib.ExitStack() as stack:
        recorder = McapRecorder(path, start_epoch_ns=chosen.epoch_ns)
        stack.callback(recorder.close)
        note_inputs(recorder, vehicle, plan.mission)
        commands = (*plan_commands(plan), *script(chosen))
        onboard = Onboard(vehicle, plan.mission, recorder, commands)
        if kept is not None:
            onboard.keep_parameters(kept)
        _tell(onboard, loaded)
        link = GroundLink(chosen.gcs, onboard.view, identity, files=Files(kept, signing, path.parent))
        stack.callback(_close, link, recorder)
        for line in opening(chosen, vehicle, len(plan.mission), path):
            account.say(line)
        flown, ended = _fly(chosen.board, onboard, link, account)
    account.say(f"over after {flown.time:.1f} s: {ended}; recorded in {path}")
    if chosen.json:
        print_document(_document(chosen, onboard, path, flown, ended))
    if ended == STOPPED:
        raise KeyboardInterrupt
    return 0


def opening(chosen: argparse.Namespace, vehicle: FlightVehicle, items: int, path: Path) -> list[str]:
    """What is said before the board answers: who flies, and over which links."""
    links = [f"ground stations on {url}" for url in chosen.gcs] or ["no link for a ground station: --gcs opens one"]
    return [
        f"{vehicle.title}, mission {chosen.mission} of {counted(items, 'item')}",
        *links,
        f"recording to {path}",
        f"waiting for the board on {chosen.board}",
    ]


def _document(chosen: argparse.Namespace, onboard: Onboard, path: Path, flown: Flown, ended: str) -> dict[str, Any]:
    """The keys of `JSON_KEYS`."""
    return {
        "vehicle": chosen.vehicle,
        "board": chosen.board,
        "links": chosen.gcs,
        "log": str(path),
        "frames": flown.frames,
        "time": flown.time,
        "ended": ended,
        "events": [event_record(event) for event in onboard.view.events(0)],
    }


def _close(link: GroundLink, recorder: Recorder) -> None:
    """Release the ports; what went over them is the last that is logged."""
    link.close()
    for event in link.take_events():
        recorder.record(topics.LINK_EVENTS, event)


def _tell(onboard: Onboard, loaded: Loaded) -> None:
    """Say which parameters were loaded, or why none were; a damaged file on stderr too."""
    if loaded.text:
        severity = Severity.WARNING if loaded.damaged else Severity.INFO
        onboard.view.tell(severity, "parameters", loaded.text)
    if loaded.damaged:
        print(f"wingbeat: {loaded.text}", file=sys.stderr)


def script(chosen: argparse.Namespace) -> tuple[Command, ...]:
    """What is commanded at fixed ticks: the start, and the faults that are inputs of the flight."""
    return (scripted_start() if chosen.start else ()) + fault_commands(chosen.fault)


def _fly(address: str, onboard: Onboard, link: GroundLink, account: Account) -> tuple[Flown, str]:
    """Fly; returns how far, and why it ended."""
    pin_to_core()
    flown = Flown()
    try:
        board = HilBoard(address)
        told = ToldBoard(board, onboard.view, account)
        try:
            onboard.fly(told, link)
        finally:
            flown = told.flown
            told.tell_events()
            board.close()
        return flown, board.ended
    except BoardSilent as silence:
        raise BadInput(str(silence)) from None
    except KeyboardInterrupt:
        return flown, STOPPED


def note_inputs(recorder: Recorder, vehicle: FlightVehicle, mission: Mission) -> None:
    """Store what the flight begins with: vehicle file, mission, parameters, version."""
    recorder.note("wingbeat.avionics", {"version": version("wingbeat"), "vehicle": vehicle.name})
    recorder.attach(FLIGHT_VEHICLE, "application/toml", vehicle.file.text.encode())
    items = [item._asdict() | {"kind": item.kind.name} for item in mission]
    recorder.attach("mission.json", "application/json", json.dumps(items, indent=1).encode())
    table = parameters.parameter_table(vehicle.gains)
    recorder.note(PARAMETERS, {name: repr(parameters.get(vehicle.gains, p)) for name, p in table.items()})
