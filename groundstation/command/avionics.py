"""``wingbeat avionics``: the flight computer process."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics import topics
from avionics.board import boards
from avionics.board.board import BoardSilent, Surroundings
from avionics.board.cores import pin_to_core, run_before_others
from avionics.board.hil import HilBoard
from avionics.board.line_watch import Losses
from avionics.board.parameter_file import Loaded, ParameterFile, default_path, key_path, storage_name, unused_files
from avionics.board.razor import RazorBoard
from avionics.board.razor_protocol import Angles
from avionics.isolation import Isolation
from avionics.link.ground import Files, GroundLink
from avionics.link.key_file import load_signing
from avionics.link.vehicle import load_identity
from avionics.messages import Command
from avionics.missions.files import load_flight_plan
from avionics.missions.script import plan_commands, scripted_start
from avionics.recorder import Recorder
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import FlightVehicle, load_vehicle
from groundstation.command import options
from groundstation.command.bench import BoundedBoard, showing
from groundstation.command.console_status import Account, FlightOutcome, ReportingBoard, event_record
from groundstation.command.ending import WORDS
from groundstation.command.recordings import begin_recording, format_recording_paths, put_right
from groundstation.views.json_document import print_document
from logs.names import RECORDINGS
from logs.recorder import IN_FLIGHT, Writing
from logs.recording_notes import note_inputs
from logs.scene import FLOWN, PLAIN_BIRD, SceneRecorder
from sim_bridge.flight.faults import fault_commands
from wingbeat.errors import InputError
from wingbeat.message import Severity
from wingbeat.text import pluralize

ANGLES = ("roll", "pitch", "yaw")
WITHOUT_LOCKSTEP = ("hil:serial:", "razor:")
"""boards without lockstep, which share no core with a simulator"""
STOPPED = f"{WORDS}Ctrl-C"
EXAMPLES = (
    "wingbeat avionics --board hil:tcp:127.0.0.1:4560 --gcs udpin:0.0.0.0:14550",
    "wingbeat avionics --board hil:tcp:127.0.0.1:4560 --gcs serial:/dev/ttyUSB0,57600 --identity ardupilot",
    "wingbeat avionics --board hil:serial:/dev/ttyACM0,921600 --vehicle my_bird.toml",
    "wingbeat avionics --board razor:/dev/ttyUSB0",
    "wingbeat avionics --board razor:/dev/ttyUSB0,57600,ox --duration 10 --json",
)
LINE_EVERY = 10.0
"""s; of flight time between two status lines on a terminal, as of ``fly``"""
JSON_KEYS = {
    "vehicle": "name",
    "board": "address",
    "links": "list of addresses of links for ground stations",
    "log": "path of the recording",
    "frames": "sensor frames read",
    "time": "s; since boot, of the last sensor frame",
    "ended": "why it ended, one line",
    "attitude": "{roll, pitch, yaw, tilt_sigma, heading_sigma}; rad, of the flight computer at the end",
    "own_attitude": "{roll, pitch, yaw} that the board told last, rad, or null",
    "losses": "{lost, late, bad_bytes, dropped}; messages or frames, frames, bytes and writes, of a serial line",
    "events": "list of {time, severity, source, text}; s since boot",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Flight computer only: sensors and servos over a board, ground stations over MAVLink."
    parser = options.build_parser("avionics", summary, EXAMPLES, JSON_KEYS)
    options.add_vehicle(parser)
    parser.add_argument("--board", required=True, metavar="ADDRESS", help=board_help())
    parser.add_argument("--duration", type=options.positive, metavar="S", help="end after so many seconds of frames")
    options.add_mission(parser)
    options.add_gcs(parser)
    options.add_identity(parser)
    options.add_signing_key(parser, "in the user's state folder")
    parser.add_argument("--log", type=Path, metavar="FILE", help="a new file (default: recordings/VEHICLE-TIME.mcap)")
    options.add_log_size(parser)
    options.add_parameters(parser, "in the user's state folder")
    parser.add_argument("--start", action="store_true", help="arm and switch to AUTO 2 s after boot")
    parser.add_argument("--real-time", action="store_true", help="request real-time scheduling priority if permitted")
    options.add_json(parser)
    parser.add_argument("--fault", action="append", default=[], type=options.fault, help=argparse.SUPPRESS)
    parser.add_argument("--epoch-ns", type=int, metavar="NS", help=argparse.SUPPRESS)
    options.add_core(parser)
    return parser


class Outcome(NamedTuple):
    """Result of a flight."""

    flight: FlightOutcome
    """duration and number of sensor frames"""
    ended: str
    """reason of the end, one line"""
    silent: bool
    """whether the board stopped sending"""
    board_angles: Angles | None
    """last attitude reported by the board itself"""
    losses: Losses
    """losses on the line to the board"""


def board_help() -> str:
    """Return the forms of a board's address in one sentence."""
    return "board with sensors and servos: " + "; ".join(f"{kind.form} {kind.help}" for kind in boards.KINDS)


def run(arguments: Sequence[str]) -> int:
    """Fly until the simulation ends or the board disconnects, with the vehicle's events on stderr.

    Raises:
        InputError: unknown vehicle, malformed mission, port in use, existing log, no board at the address, a board
            that stopped sending.
    """
    chosen = build_parser().parse_args(arguments)
    identity = load_identity(chosen.identity)
    boards.check_address(chosen.board)
    vehicle = load_vehicle(options.vehicle_files(chosen.vehicle)[1])
    plan = load_flight_plan(chosen.mission)
    kept = _parameters(chosen, vehicle)
    loaded = Loaded(vehicle, "", False) if kept is None else kept.load()
    vehicle = loaded.vehicle
    signing = load_signing(options.key_file(chosen.signing_key, key_path(vehicle)))
    # Beside a simulator that shares the time of the recordings, `wingbeat fly` prints the status.
    account = Account(quiet=chosen.json or chosen.epoch_ns is not None)
    if chosen.epoch_ns is None:  # otherwise `wingbeat fly` has warned, and the import of all vehicles takes 0.2 s
        for line in (*options.name_warnings(vehicle.file), *unused_files(vehicle)):
            account.report(line)
    if chosen.log is None:
        put_right(RECORDINGS)
    writing = Writing(IN_FLIGHT, chosen.log_size, topics.RECORDER)
    if chosen.real_time:
        # Before the recorder's thread starts: a thread that is preempted while it holds the interpreter lock delays
        # the
        # flight.
        run_before_others()
    with contextlib.ExitStack() as stack:
        recorder = begin_recording(chosen.log, storage_name(vehicle), writing, chosen.epoch_ns)
        path = recorder.path
        stack.callback(recorder.close)
        note_inputs(recorder, vehicle, plan.mission)
        commands = (*plan_commands(plan), *script(chosen))
        # A simulator that records beside it shows the true motion of the vehicle.
        shape = None if chosen.epoch_ns is not None else FLOWN.get(vehicle.name, PLAIN_BIRD)
        isolation = Isolation()
        scene = isolation.guard("scene")
        seen = SceneRecorder(recorder, shape, recorder.start_epoch_ns, estimated=True, guard=scene)
        onboard = FlightComputer(vehicle, plan.mission, seen, commands, isolation=isolation)
        if kept is not None:
            onboard.keep_parameters(kept)
        _report(onboard, loaded)
        link = GroundLink(chosen.gcs, onboard.view, identity, files=Files(kept, signing, path.parent))
        stack.callback(_close, link, recorder)
        for line in opening(chosen, vehicle, len(plan.mission), path):
            account.report(line)
        outcome = _fly(chosen, onboard, link, account, isolation)
    if chosen.json and (outcome.flight.frames or not outcome.silent):
        print_document(_document(chosen, onboard, path, outcome))
    return _over(outcome, account, format_recording_paths(recorder))


def _parameters(chosen: argparse.Namespace, vehicle: FlightVehicle) -> ParameterFile | None:
    """Return the file of the parameters that the ground station sets; None for no file."""
    if chosen.parameters == options.NO_PARAMETERS:
        return None
    return ParameterFile(Path(chosen.parameters or default_path(vehicle)), vehicle)


def _over(outcome: Outcome, account: Account, paths: str) -> int:
    """Report how the flight ended.

    Raises:
        InputError: the board stopped sending.
        KeyboardInterrupt: a signal ended it.
    """
    if outcome.silent:
        raise InputError(outcome.ended)
    account.report(f"ended after {outcome.flight.time:.1f} s: {outcome.ended}; recorded in {paths}")
    if outcome.ended.startswith(WORDS):
        raise KeyboardInterrupt
    return 0


def opening(chosen: argparse.Namespace, vehicle: FlightVehicle, items: int, path: Path) -> list[str]:
    """Return the lines printed before the board responds: vehicle, mission and links."""
    links = [f"ground stations on {url}" for url in chosen.gcs] or ["no link for a ground station (--gcs)"]
    return [
        f"{vehicle.title}, mission {chosen.mission} of {pluralize(items, 'item')}",
        *links,
        f"recording to {path}",
        f"waiting for the board on {chosen.board}",
    ]


def _document(chosen: argparse.Namespace, onboard: FlightComputer, path: Path, outcome: Outcome) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`."""
    attitude = onboard.view.autopilot.memory.attitude
    return {
        "vehicle": chosen.vehicle,
        "board": chosen.board,
        "links": chosen.gcs,
        "log": str(path),
        "frames": outcome.flight.frames,
        "time": outcome.flight.time,
        "ended": outcome.ended,
        "attitude": {key: getattr(attitude, key) for key in (*ANGLES, "tilt_sigma", "heading_sigma")},
        "own_attitude": outcome.board_angles,
        "losses": outcome.losses,
        "events": [event_record(event) for event in onboard.view.events(0)],
    }


def _close(link: GroundLink, recorder: Recorder) -> None:
    """Close the ports and the recording; the link statistics are recorded last."""
    link.close()
    for event in link.take_events():
        recorder.record(topics.LINK_EVENTS, event)


def _report(onboard: FlightComputer, loaded: Loaded) -> None:
    """Report which parameters were loaded, or why none were; a damaged file on stderr too."""
    if loaded.text:
        severity = Severity.WARNING if loaded.damaged else Severity.INFO
        onboard.view.send_statustext(severity, "parameters", loaded.text)
    if loaded.damaged:
        print(f"wingbeat: {loaded.text}", file=sys.stderr)


def script(chosen: argparse.Namespace) -> tuple[Command, ...]:
    """Return the commands at fixed ticks: the start, and the faults that are inputs of the flight."""
    return (scripted_start() if chosen.start else ()) + fault_commands(chosen.fault)


def _fly(
    chosen: argparse.Namespace, onboard: FlightComputer, link: GroundLink, account: Account, isolation: Isolation
) -> Outcome:
    """Fly; return duration and reason of the end."""
    if not chosen.board.startswith(WITHOUT_LOCKSTEP):
        pin_to_core(chosen.core)

    def idle() -> None:
        onboard.idle()
        told.print_events()

    def report_text(severity: Severity, text: str) -> None:
        onboard.view.send_statustext(severity, "board", text)

    try:
        board = boards.open_board(chosen.board, Surroundings(report_text, idle))
    except BoardSilent as silence:
        raise InputError(str(silence)) from None
    if chosen.core is not None and isinstance(board, HilBoard):
        board.enable_busy_poll()
    # A Razor on the bench has its own display.
    shown = sys.stderr.isatty() and not isinstance(board, RazorBoard)
    every, guard = LINE_EVERY if shown else math.inf, isolation.guard("terminal")
    told = ReportingBoard(board, onboard.view, account, link.announced, every, guard)
    ended, silent = _run_flight(chosen, board, told, onboard, link, isolation)
    board.close()
    board_angles = board.angles if isinstance(board, RazorBoard) else None
    return Outcome(told.outcome, ended, silent, board_angles, board.losses)


def _run_flight(
    chosen: argparse.Namespace,
    board: HilBoard | RazorBoard,
    console: ReportingBoard,
    onboard: FlightComputer,
    link: GroundLink,
    isolation: Isolation,
) -> tuple[str, bool]:
    """Fly on an open board; return the reason of the end, and whether the board stopped sending."""
    with contextlib.ExitStack() as stack:
        stack.callback(console.print_events)
        show = None
        if isinstance(board, RazorBoard) and not chosen.json:
            show = showing(stack, chosen.board, board, console, onboard.view, isolation.guard("bench view"))
        bounded = BoundedBoard(console, chosen.duration, show)
        try:
            onboard.fly(bounded, link)
        except BoardSilent as silence:
            return str(silence), True
        except KeyboardInterrupt as stop:
            return str(stop) or STOPPED, False
        return bounded.ended or board.ended, False
