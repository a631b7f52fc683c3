"""``wingbeat fly``: simulator and flight computer processes, view, report."""

from __future__ import annotations

import argparse
import math
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from avionics.board.cores import idle_pair
from avionics.board.parameter_file import ParameterFile, storage_name
from avionics.isolation import Isolation
from avionics.link.key_file import load_signing
from avionics.link.transport import open_transport
from avionics.link.vehicle import load_identity
from avionics.missions.files import load_flight_plan
from avionics.vehicles import load_vehicle
from avionics.vehicles import vehicle_names as flown_names
from groundstation.command import options
from groundstation.command.children import Children, Failure
from groundstation.command.compiling import announced, compile_physics, load_physics
from groundstation.command.compiling_ahead import LATER, CompilationAhead
from groundstation.command.live import add_live, shown_live
from groundstation.command.recordings import put_right
from groundstation.command.sim import REAL_TIME, simulated
from groundstation.link import modes
from groundstation.link.answers import NoAnswer
from groundstation.link.connection import Connection, listen_locally
from groundstation.link.vehicle_state import VehicleState, new_events
from groundstation.views import flight_report
from groundstation.views.flight_view import FlightView, Header, event_line, progress_line
from groundstation.views.history import History, remember
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from logs.identification.findings import Finding
from logs.join import Kept, join
from logs.model_range import range_findings
from logs.names import files_of, reserved
from logs.new_files import check_new, locked_name
from logs.reader import Log, open_log
from logs.summary import FlightSummary, summarize
from sim_bridge.aerodynamics.models import is_compiled_separately
from sim_bridge.environment import dryden
from sim_bridge.environment.levels import LEVELS_TOLD
from sim_bridge.environment.wind import steady_wind
from sim_bridge.flight.faults import Fault, check_carried, divided, mission_faults
from sim_bridge.flight_mechanics.similarity import cruise_excesses
from sim_bridge.plant import physics_compiled
from sim_bridge.sensors.transmitter import load_script
from sim_bridge.topics import STATE
from sim_bridge.vehicles import vehicle_names
from sim_bridge.vibration.flight import vibration_factor
from wingbeat.errors import InputError

if TYPE_CHECKING:
    from logs.identification.report import Identification

EXAMPLES = (
    "wingbeat fly",
    "wingbeat fly --vehicle arizona_100cm --wind 2 --seed 7",
    "wingbeat fly --aerodynamics blade_element",
    "wingbeat fly --mission field.plan      # QGroundControl's; also .waypoints and our own .toml",
    "wingbeat fly --vehicle my_bird/        # a folder with world.toml and avionics.toml",
    "wingbeat fly --fault pitot_blocked@30 --fault gps_lost@40-50",
    "wingbeat fly --sticks by_hand.csv      # armed and flown by a scripted transmitter",
    "wingbeat fly --speed 1 --gcs udpout:127.0.0.1:14550",
    "wingbeat fly --speed 1 --live          # then open ws://127.0.0.1:8765 in Foxglove or Lichtblick",
)
JSON_KEYS = {
    "log": "path of the joined log",
    "vehicle": "name",
    "aerodynamics": "name of the model of the wings' air loads",
    "seed": "of sensor noise and gusts",
    "wind": "m/s; steady",
    "wind_from": "rad; where it comes from, clockwise from north",
    "sticks": "table by which a transmitter was moved; null: armed and switched to AUTO by a script",
    "faults": "what failed, as NAME@T or NAME@T-T2: those of the command line, then those of the mission",
    "findings": "list of {code, severity, subject, value, limit, text}: cruise outside the range of the model",
    "never_injected": "those of faults whose time lay after the flight's end",
    "turbulence": f"of the gusts: {LEVELS_TOLD}",
    "vibration": "factor of the vibration of the vehicle file, 0: none",
    "wall_time": "s; how long the flight took, starting included, reporting not",
    "speed": "times real time",
    "incomplete": "list of {path, damage}; recordings of the world or the flight computer that ended early",
    "flight": "what was flown, see logs/summary.py: SI and radians, null where unknown",
    "identified": "as of wingbeat identify --json, null where the flight gave nothing",
}
LINE_EVERY = 10.0
"""s; of flight time between two lines without a terminal"""
REFRESH = 0.1
"""s; between two screen updates"""
RECORDING_ENDED = "recording to "
"""prefix of a child's message that its recording ended before the flight"""
DURATION = 300.0
"""s; default time limit of a flight"""


class Plan(NamedTuple):
    """Validated flight that is ready to start."""

    vehicle: str
    """-; name or path, as given"""
    name: str
    """-; as in its file"""
    title: str
    """-; display name"""
    aerodynamics: str
    """-; aerodynamic model of the wings"""
    notes: tuple[str, ...]
    """items of the mission file that are not flown, and warnings"""
    faults: tuple[Fault, ...]
    """of the command line, then of the mission"""
    findings: tuple[Finding, ...]
    """what is outside the range of the aerodynamic model at cruise"""
    vibration: float
    """-; factor of the vibration of the vehicle file"""
    log: Path = Path()
    """joined log, after its name is locked"""

    @property
    def parts(self) -> tuple[Path, Path]:
        """Recordings of world and flight computer."""
        _, world, computer = files_of(self.log)
        return world, computer


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Fly a modeled ornithopter: two processes in lockstep over MAVLink, recorded and identified."
    parser = options.build_parser("fly", summary, EXAMPLES, JSON_KEYS)
    options.add_vehicle(parser)
    options.add_aerodynamics(parser)
    options.add_mission(parser)
    options.add_world(parser, DURATION)
    options.add_faults(parser)
    options.add_sticks(parser)
    parser.add_argument("--log", type=Path, metavar="FILE", help="a new file (default: recordings/VEHICLE-TIME.mcap)")
    options.add_gcs(parser)
    add_live(parser)
    options.add_identity(parser)
    options.add_signing_key(parser, options.NO_KEY)
    options.add_parameters(parser, options.NO_PARAMETERS)
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Fly, join the recordings, and report the flight and the identified values.

    Raises:
        InputError: unknown vehicle or aerodynamic model, malformed mission, port in use, existing log, no live view.
        NoAnswer: the world or the flight computer failed; the recordings are kept.
    """
    chosen = build_parser().parse_args(arguments)
    plan = check(chosen)
    with _name(chosen.log, plan) as log:
        return _run(chosen, plan._replace(log=log))


@contextmanager
def _name(log: Path | None, plan: Plan) -> Iterator[Path]:
    """Yield the name of the joined log, locked until the log is complete.

    Raises:
        InputError: another program has locked it or left files, or its folder cannot be written to.
    """
    if log is None:
        with reserved(plan.name) as path:
            yield path
        return
    with locked_name(log) as ours:
        if not ours:
            raise InputError(f"{log} is in use: another flight is being recorded there")
        _check_log(log)  # again: who held the name before may have left files of it
        yield log


def _run(chosen: argparse.Namespace, plan: Plan) -> int:
    """Fly, join the recordings, and report the flight and the identified values."""
    console = open_console(quiet=chosen.json)
    for note in plan.notes:
        print(note, file=sys.stderr)
    if chosen.log is None:
        put_right(plan.log.parent)
    faults: dict[str, str] = {}
    try:
        with shown_live(chosen.live, plan.parts) as live, _prepared(plan, chosen.json) as ahead:
            began = time.monotonic()
            _fly(plan, chosen, console, faults, ahead)
        if live is not None and live.traceback:
            faults["live view"] = live.traceback
    except KeyboardInterrupt:
        _keep(plan, faults)
        raise
    _report(plan, chosen, console, time.monotonic() - began, faults)
    return 0


def check(chosen: argparse.Namespace) -> Plan:
    """Check the command line before anything is started.

    Raises:
        InputError: see `run`.
    """
    world, computer = options.vehicle_files(chosen.vehicle)
    _check_flyable(computer)
    vehicle = load_vehicle(computer)
    body = simulated(world, chosen.aerodynamics)
    steady_wind(chosen.wind, chosen.wind_from)
    dryden.turbulence(chosen.turbulence, 1.0, chosen.seed)
    notes = (*options.name_warnings(body, vehicle.file), *load_flight_plan(chosen.mission).notes)
    if chosen.parameters not in (None, options.NO_PARAMETERS):
        ParameterFile(Path(chosen.parameters), vehicle).check_owner()
    if chosen.sticks is not None:
        load_script(chosen.sticks)
    load_identity(chosen.identity)
    load_signing(options.key_file(chosen.signing_key, None))
    for url in chosen.gcs:
        open_transport(url).close()  # a port in use is told before anything is recorded
    if chosen.log is not None:
        _check_log(chosen.log)
    faults = (*chosen.fault, *mission_faults(chosen.mission))
    options.check_times(faults, chosen.duration)
    check_carried(faults, body.sections)
    vibration = vibration_factor(body, chosen.vibration)
    name = storage_name(vehicle)  # two vehicles of one name leave recordings that can be told apart
    findings = tuple(range_findings(cruise_excesses(body)))
    notes = (*notes, *(f"warning: {one.text}" for one in findings))
    return Plan(chosen.vehicle, name, vehicle.title, body.aerodynamics.model, notes, faults, findings, vibration)


def _check_log(log: Path) -> None:
    """Check that no file of that name exists, and that it can be written.

    Raises:
        InputError: it exists or cannot be written.
    """
    for path in files_of(log):
        check_new(path, made=True)


def _check_flyable(name: str) -> None:
    """Reject a simulated vehicle without a flight computer configuration.

    Raises:
        InputError: there is no flight computer configuration.
    """
    if name in vehicle_names() and name not in flown_names():
        raise InputError(
            f"{name} has no flight-computer file: it can be trimmed and linearized, not flown; "
            f"{' and '.join(flown_names())} can"
        )


@contextmanager
def _prepared(plan: Plan, quiet: bool) -> Iterator[Callable[[], None]]:
    """Compile the physics before the timeouts of the flight start; yield how to wait for what is compiled during it.

    A second process then compiles for the identification while the flight lasts.
    """
    vehicle = simulated(options.vehicle_files(plan.vehicle)[0], plan.aerodynamics)
    if physics_compiled():
        if is_compiled_separately(vehicle.aerodynamics.model):
            load_physics(vehicle, quiet)
        yield lambda: None
        return
    with CompilationAhead(vehicle, tuple(LATER)) as ahead:
        compile_physics(ahead, quiet)
        yield ahead.wait


def _fly(
    plan: Plan, chosen: argparse.Namespace, console: Console, faults: dict[str, str], compiled: Callable[[], None]
) -> None:
    """Fly; exceptions of the view are added to ``faults`` with their traceback.

    ``compiled`` waits for the kernels that the identification needs.

    Raises:
        InputError: invalid input of one of the two processes. NoAnswer: one of them failed.
    """
    connection = listen_locally()
    identity = load_identity(_identity(chosen))
    connection.know_modes({entry.custom_mode: entry.name for entry in identity.modes})
    try:
        with Children() as children:
            _start(children, plan, chosen, connection.url)
            loading = threading.Thread(target=_load_identification, args=(compiled,), daemon=True)
            loading.start()
            isolation = Isolation()
            if console.is_terminal and not chosen.json:
                isolation.guard("view").run(_watch_picture, children, connection, plan, console)
            else:
                isolation.guard("view").run(_watch_lines, children, connection, console)
            for fault in isolation.take_faults():
                faults[fault.service] = fault.record()
                text = f"wingbeat: no {fault.service} for the rest of the flight: {fault.error}"
                isolation.guard("terminal").run(print, text, file=sys.stderr)
            while children.running():
                time.sleep(REFRESH)
            failure, said = children.failure(), children.last_words()
        if failure is None:
            with console.status("compiling for the identification") if console.is_terminal else nullcontext():
                loading.join()
        if failure is not None:
            raise _failed(failure, plan)
        for line in said:
            if line.startswith(RECORDING_ENDED):
                print(f"wingbeat: {line}", file=sys.stderr)
    finally:
        connection.close()


def _start(children: Children, plan: Plan, chosen: argparse.Namespace, observer: str) -> None:
    simulated, flown = options.vehicle_files(plan.vehicle)
    cores = idle_pair() if math.isinf(chosen.speed) else None
    own = [[], []] if cores is None else [["--core", str(core)] for core in cores]
    epoch = ["--epoch-ns", str(time.time_ns())]
    bridge = _bridge_address()
    speed = "max" if math.isinf(chosen.speed) else repr(chosen.speed)
    world = ["--vehicle", simulated, *epoch, "--listen", bridge, "--speed", speed, "--seed", str(chosen.seed)]
    world += ["--duration", repr(chosen.duration), "--wind", repr(chosen.wind)]
    world += ["--turbulence", chosen.turbulence, "--vibration", repr(plan.vibration)]
    world += ["--wind-from", repr(math.degrees(chosen.wind_from)), "--log", str(plan.parts[0])]
    world += ["--aerodynamics", plan.aerodynamics]
    world += [] if chosen.sticks is None else ["--sticks", chosen.sticks]
    in_world, in_flight = (options.fault_words(some) for some in divided(plan.faults))
    children.start("the world", ["sim", *world, *own[0], *in_world])
    links = ["--identity", _identity(chosen), *(word for url in chosen.gcs for word in ("--gcs", url))]
    ours = ["--gcs", observer.replace("udpin", "udpout")]
    flight = ["--board", f"hil:{bridge}", "--mission", chosen.mission, "--log", str(plan.parts[1])]
    flight += ["--start"] if chosen.sticks is None else []
    flight += ["--real-time"] if chosen.speed <= REAL_TIME else []
    flight += ["--signing-key", chosen.signing_key or options.NO_KEY]
    flight += ["--parameters", chosen.parameters or options.NO_PARAMETERS]
    children.start(
        "the flight computer", ["avionics", "--vehicle", flown, *epoch, *own[1], *flight, *ours, *links, *in_flight]
    )


def _identity(chosen: argparse.Namespace) -> str:
    """Return the MAVLink profile of the flight; the default counts items as the flight computer's events do."""
    return str(chosen.identity) if chosen.gcs else "generic"


def _bridge_address() -> str:
    """Return an address for the lockstep of the two processes: a Unix socket takes half as long as TCP."""
    if sys.platform == "linux":
        return f"unix:wingbeat-{os.getpid()}-{time.monotonic_ns()}"
    return f"tcp:127.0.0.1:{_free_port()}"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _failed(failure: Failure, plan: Plan) -> Exception:
    kept = ", ".join(str(part) for part in plan.parts if part.exists())
    text = f"{failure.text}{f' (recorded so far: {kept})' if kept else ''}"
    return InputError(text) if failure.code == 2 else NoAnswer(text)


# --- watching -----------------------------------------------------------------------------------------------


class _Speed:
    """Speed factor of the flight relative to real time."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def note(self, state: VehicleState) -> str:
        """Return the text for the header."""
        if state.time is None or state.received_at is None:
            return "starting"
        if self._first is None:
            self._first = (state.received_at, state.time)
        elapsed = state.received_at - self._first[0]
        return f"{(state.time - self._first[1]) / elapsed:.1f} × real time" if elapsed > 0.5 else ""


def _watch_picture(children: Children, connection: Connection, plan: Plan, console: Console) -> None:
    history = History()
    speed = _Speed()
    with Live(console=console, auto_refresh=False) as live:
        while children.running():
            connection.listen(REFRESH)
            state = connection.state
            history = remember(history, state)
            top = Header(plan.title, modes.mode_name(state), speed.note(state))
            live.update(FlightView(top, state, history), refresh=True)


def _watch_lines(children: Children, connection: Connection, console: Console) -> None:
    said, due = 0, 0.0
    while children.running():
        connection.listen(REFRESH)
        state = connection.state
        for heard in new_events(state, said):
            console.print(event_line(heard), soft_wrap=True)
        said = state.text_count
        if state.time is not None and state.time >= due:
            line = progress_line(state, modes.mode_name(state))
            console.print(line, soft_wrap=True)
            due = (state.time // LINE_EVERY + 1.0) * LINE_EVERY


# --- afterwards ---------------------------------------------------------------------------------------------


def _keep(plan: Plan, faults: Mapping[str, str]) -> None:
    """Join the recordings of an interrupted flight, and report the path."""
    parts = [part for part in plan.parts if part.exists()]
    if parts:
        _report_kept(join(parts, plan.log, faults))
        with open_log(plan.log) as log:
            has_messages = any(topic.messages for topic in log.topics.values())
        text = "recorded so far" if has_messages else "before the first message of the flight"
        print(f"stopped; {text}: {plan.log}", file=sys.stderr)


def _joined(plan: Plan, faults: Mapping[str, str]) -> list[Kept]:
    """Join the recordings; return the parts that were damaged.

    Raises:
        InputError: they cannot be joined; the message has their paths.
    """
    try:
        return join(plan.parts, plan.log, faults)
    except InputError as reason:
        raise InputError(f"{reason} (recordings: {', '.join(map(str, plan.parts))})") from None


def _report_kept(kept: Sequence[Kept]) -> None:
    """Report the recordings that ended before the flight; the summary covers only their content."""
    for part in kept:
        print(f"wingbeat: a recording ended early: {part.path}: {part.damage}", file=sys.stderr)


def _load_identification(compiled: Callable[[], None]) -> None:
    """Import what the report needs while the flight lasts; this takes two seconds of processor time."""
    compiled()  # or this process would compile the same
    with suppress(ImportError):  # the report raises it again, and prints it
        import control  # noqa: F401 (of the eigensystem realization)

        from groundstation.command import identify  # noqa: F401


def _identified(log: Log) -> Identification | str:
    """Identify from the log, or return why that is not possible, as for a flight without an excitation."""
    from groundstation.command import identify  # see _load_identification

    try:
        return identify.identified(log, wings=False)  # whose coefficients take as long as all the rest
    except InputError as reason:
        return str(reason)


class _FlightResult(NamedTuple):
    """Results from the joined log."""

    summary: FlightSummary
    identified: Identification | str
    """estimates, or why there are none"""
    speed: float
    """-; speed factor relative to real time"""
    end: float
    """s; since boot, of the world's last step"""


def _read(path: Path, wall_time: float) -> _FlightResult:
    with open_log(path) as log:
        return _FlightResult(summarize(log), _identified(log), log.duration / wall_time, _end(log))


def _end(log: Log) -> float:
    """Return the time (s since boot) of the world's last step; 0 without one."""
    state = log.topics.get(STATE.name)
    return float(log.columns(STATE).time[-1]) if state is not None and state.messages else 0.0


def _report(
    plan: Plan, chosen: argparse.Namespace, console: Console, wall_time: float, faults: Mapping[str, str]
) -> None:
    with console.status("joining the recordings, identifying") if console.is_terminal else nullcontext():
        kept = _joined(plan, faults)
        with announced(chosen.json):
            summary, results, speed, end = _read(plan.log, wall_time)
    missed = options.missed(plan.faults, end)
    _report_kept(kept)
    if chosen.json:
        end_of_flight = {"wall_time": wall_time, "speed": speed, "never_injected": missed}
        print_document(_entries(plan, chosen) | end_of_flight | _outcome(kept, summary, results))
        return
    console.print()
    console.print(flight_report.log_line(plan.log))
    for name in missed:
        console.print(flight_report.missed_line(name, end))
    for part in closing_parts(plan.log, summary, results):
        console.print(part, soft_wrap=True)


def closing_parts(log: Path, summary: FlightSummary, results: Identification | str) -> tuple[RenderableType, ...]:
    """Return the parts of the closing text of a flight: metrics, identified numbers, next commands."""
    identified: RenderableType
    if isinstance(results, str):
        identified = Text(f"not identified: {results}", style="dim")
    else:
        from groundstation.views.identification import identification_summary

        identified = identification_summary(results)
    return flight_report.flight_metrics_table(summary), Text(), identified, Text(), flight_report.next_lines(log)


def _entries(plan: Plan, chosen: argparse.Namespace) -> dict[str, object]:
    """Return the inputs of the flight for the JSON document."""
    return {
        "log": str(plan.log),
        "vehicle": chosen.vehicle,
        "aerodynamics": plan.aerodynamics,
        "seed": chosen.seed,
        "wind": chosen.wind,
        "wind_from": chosen.wind_from,
        "sticks": chosen.sticks,
        "faults": options.fault_words(plan.faults)[1::2],
        "turbulence": chosen.turbulence,
        "vibration": plan.vibration,
        "findings": [one.document() for one in plan.findings],
    }


def _outcome(kept: Sequence[Kept], summary: FlightSummary | None, results: Identification | str) -> dict[str, object]:
    """Return the results of the flight for the JSON document."""
    from logs.identification.report import document

    return {
        "incomplete": [{"path": str(part.path), "damage": part.damage} for part in kept],
        "flight": summary,
        "identified": None if isinstance(results, str) else document(results),
    }
