"""``wingbeat sim``: simulator only, waiting for a flight computer."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from avionics.board.cores import pin_to_core, run_before_others
from avionics.isolation import Isolation, fault_events
from groundstation.command import foreign, foreign_parameters, options
from groundstation.command.compiling import announced_air, compiling_text, load_physics
from groundstation.command.recordings import begin_recording, format_recording_paths, put_right
from logs.names import RECORDINGS, STICKS
from logs.new_files import numbered
from logs.outline import shape_of
from logs.recorder import IN_FLIGHT, McapRecorder, Writing
from logs.recording_notes import note_autopilot, note_scenario
from logs.scene import SceneRecorder
from sim_bridge import topics
from sim_bridge.bridge.foreign.launch import Launch
from sim_bridge.bridge.foreign.world import Stage
from sim_bridge.bridge.microcontroller import PTY, SerialPeer
from sim_bridge.bridge.server import DEFAULT_URL, BridgeServer, FlightComputerSilent
from sim_bridge.flight.faults import divided
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.mechanism import build_mechanism
from sim_bridge.plant import Plant, physics_compiled
from sim_bridge.sensors.transmitter import Script, load_script
from sim_bridge.vehicles import FOLDER, SimulatedVehicle, load_vehicle, with_model
from sim_bridge.vibration.flight import vibration_factor
from wingbeat.errors import InputError
from wingbeat.message import Severity
from wingbeat.topic import Publish, Topic
from wingbeat.vehicle_file import name_by_path

EXAMPLES = (
    "wingbeat sim",
    "wingbeat sim --vehicle arizona_100cm --listen tcp:0.0.0.0:4560 --speed 1 --wind 3",
    "wingbeat sim --aerodynamics quasi_steady",
    "wingbeat sim --listen pty",
    "wingbeat sim --fault pitot_blocked@30 --fault gps_lost@40-50",
    "wingbeat sim --px4 --speed 1",
    "wingbeat sim --ardupilot --launch throw --channels aileron=0",
    "wingbeat sim --ardupilot --launch throw --write-parameters raven.parm",
)
WAITING = "the vehicle is launched after 5 s armed, 8 s after boot at the earliest"
REAL_TIME = 1.0
"""-; speed factor up to which a flight with real-time priority leaves time for other programs"""
HURRIED = "; use --speed 1 when arming manually"
LISTEN = (
    f"tcp:HOST:PORT ({DEFAULT_URL}); unix:NAME on the same computer (Linux); serial:DEVICE,BAUD"
    " simulates a microcontroller without lockstep, pty does so on a new pseudo terminal"
)
WRITING = Writing(IN_FLIGHT, account=topics.RECORDER)
DURATION = 600.0
"""s; default time limit of a simulation"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Simulator only: waits for a flight computer on TCP and runs in lockstep over MAVLink."
    parser = options.build_parser("sim", summary, EXAMPLES)
    options.add_vehicle(parser)
    options.add_aerodynamics(parser)
    parser.add_argument("--listen", default=DEFAULT_URL, metavar="URL", help=LISTEN)
    options.add_world(parser, DURATION)
    options.add_faults(parser)
    options.add_sticks(parser)
    foreign.add_foreign(parser)
    parser.add_argument("--log", type=Path, metavar="FILE", help="a new file (default: recordings/VEHICLE-TIME.mcap)")
    parser.add_argument("--epoch-ns", type=int, metavar="NS", help=argparse.SUPPRESS)
    options.add_core(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Run the simulator of one flight.

    Raises:
        InputError: unknown vehicle, aerodynamic model or fault, bad table of sticks, port in use, existing log, a
            flight computer that does not connect or respond.
    """
    parser = build_parser()
    chosen = parser.parse_args(arguments)
    if chosen.write_parameters is not None:
        foreign_parameters.check_options(chosen, parser)
    vehicle = simulated(options.vehicle_files(chosen.vehicle)[0], chosen.aerodynamics)
    alone = chosen.epoch_ns is None
    if alone:
        for line in options.name_warnings(vehicle):
            print(line, file=sys.stderr)
    sticks = None if chosen.sticks is None else load_script(chosen.sticks)
    scenario = _scenario(chosen, vehicle)._replace(
        waits_for_arming=True, pilot=None if sticks is None else sticks.pilot()
    )
    remote = foreign.chosen_foreign(chosen, None if chosen.listen == DEFAULT_URL else chosen.listen)
    if remote is not None and chosen.write_parameters is not None:
        foreign_parameters.write_parameters(chosen, remote, vehicle)
        return 0
    if remote is not None:
        serve_foreign(remote, Flights(vehicle, scenario, sticks, chosen.log, remote))
        return 0
    with contextlib.ExitStack() as stack:
        server = _server(chosen.listen, None if math.isinf(chosen.speed) else chosen.speed)
        listening = server.address if isinstance(server, SerialPeer) else chosen.listen
        stack.callback(server.close)
        recorder = _recorder(chosen, vehicle)
        stack.callback(recorder.close)
        if alone:
            print(f"{vehicle.title}, waiting for a flight computer on {listening}", file=sys.stderr, flush=True)
        load_physics(vehicle)
        note_scenario(recorder, vehicle, scenario)
        if sticks is not None:
            recorder.attach(STICKS, "text/csv", sticks.text.encode())
        isolation = Isolation()
        scene = SceneRecorder(recorder, shape_of(vehicle), recorder.start_epoch_ns, guard=isolation.guard("scene"))
        outputs = {"recorder": scene.record, **({"terminal": print_events} if alone else {})}
        world = SimulatedWorld(vehicle, scenario, IsolatedOutputs(outputs, isolation))
        if alone:
            hurried = HURRIED if math.isinf(chosen.speed) and isinstance(server, BridgeServer) else ""
            print(f"{WAITING}{hurried}", file=sys.stderr, flush=True)
        if chosen.speed <= REAL_TIME:
            run_before_others()
        ended = _serve(server, world, chosen.core)
        if alone:
            _report_end(world, ended, format_recording_paths(recorder))
        elif recorder.failure:
            print(recorder.failure, file=sys.stderr)
    return 0


def _scenario(chosen: argparse.Namespace, vehicle: SimulatedVehicle) -> Scenario:
    """Build the scenario of the flight.

    Raises:
        InputError: a fault that comes after the end or enters the flight computer, or no vibration in the file.
    """
    options.check_times(chosen.fault, chosen.duration)
    faults, of_flight = divided(chosen.fault)
    if of_flight:
        raise InputError(
            f"fault {of_flight[0].name} affects the flight computer, not the simulator: use wingbeat fly"
        )
    return Scenario(
        chosen.seed,
        chosen.wind,
        chosen.wind_from,
        chosen.turbulence,
        chosen.duration,
        faults=faults,
        vibration=vibration_factor(vehicle, chosen.vibration),
    )


def _recorder(chosen: argparse.Namespace, vehicle: SimulatedVehicle) -> McapRecorder:
    """Create the world's log; without a flight computer beside it, repair interrupted recordings."""
    if chosen.epoch_ns is None and chosen.log is None:
        put_right(RECORDINGS)
    return begin_recording(chosen.log, f"{_recording_name(vehicle)}-world", WRITING, chosen.epoch_ns)


def _recording_name(vehicle: SimulatedVehicle) -> str:
    """Return the vehicle's name, or that of the folder of a user's vehicle, whose file may be a copy."""
    return vehicle.name if vehicle.path.resolve().parent == FOLDER else name_by_path(vehicle.path)


class Flights:
    """Factory of worlds in the launcher and recordings, one for each start of a foreign autopilot."""

    def __init__(
        self,
        vehicle: SimulatedVehicle,
        scenario: Scenario,
        sticks: Script | None,
        log: Path | None,
        autopilot: foreign.Foreign,
    ) -> None:
        """Prepare; the sensors run at the rate of the ``autopilot``.

        Raises:
            InputError: ``log`` exists.
        """
        if log is not None and log.exists():
            raise InputError(f"{log} exists already")
        self._vehicle, self._sticks, self._log, self._autopilot = vehicle, sticks, log, autopilot
        self._scenario = foreign.unhurried(scenario)
        self._recorder: McapRecorder | None = None

    def __call__(self) -> Stage:
        """Create the next world after the previous recording is closed."""
        self.close()
        log = None if self._log is None else next(path for path in numbered(self._log) if not path.exists())
        self._recorder = begin_recording(log, f"{_recording_name(self._vehicle)}-world", WRITING)
        foreign.report(f"recording in {self._recorder.path}")
        if self._autopilot.rig.launch is Launch.THROW:
            push, speed = foreign_parameters.push_of(self._vehicle), self._vehicle.launch.speed
            text = f"{push.acceleration:.3g} m/s^2 along body x for {push.duration:g} s, to {speed:g} m/s"
            foreign.report(f"throw: {text}")
        note_scenario(self._recorder, self._vehicle, self._scenario)
        note_autopilot(self._recorder, self._autopilot.rig.vehicle, self._autopilot.description)
        if self._sticks is not None:
            self._recorder.attach(STICKS, "text/csv", self._sticks.text.encode())
        isolation = Isolation()
        scene = SceneRecorder(
            self._recorder, shape_of(self._vehicle), self._recorder.start_epoch_ns, guard=isolation.guard("scene")
        )
        outputs = IsolatedOutputs({"recorder": scene.record, "terminal": print_events}, isolation)
        world = SimulatedWorld(self._vehicle, self._scenario, outputs, self._autopilot.rate)
        return Stage(world, IsolatedOutputs({"recorder": scene.record}, isolation))

    def compile(self) -> None:
        """Compile the physics, with an announcement if it takes time."""
        if not physics_compiled():
            foreign.report(compiling_text())
            Plant(self._vehicle).compile()

    def close(self) -> None:
        """Close the recording."""
        if self._recorder is not None:
            self._recorder.close()


def serve_foreign(remote: foreign.Foreign, flights: Flights) -> None:
    """Run PX4 or ArduPilot until a simulation is finished.

    Raises:
        InputError: the port is in use, no autopilot connects, or it stops responding.
    """
    with contextlib.ExitStack() as stack:
        service = foreign.Service(remote)
        stack.callback(service.close)
        stack.callback(flights.close)
        flights.compile()
        service.serve(flights)


class IsolatedOutputs:
    """Outputs of the world's messages; exceptions of an output are recorded as events, and the world continues."""

    def __init__(self, outputs: Mapping[str, Publish], isolation: Isolation) -> None:
        """Set the ``outputs`` by name; ``isolation`` may have guards of other outputs."""
        self._isolation = isolation
        # The recording continues after any number of faults.
        self._outputs = [
            (isolation.guard(name, backoff=0.0, vital=name == "recorder"), publish)
            for name, publish in outputs.items()
        ]

    def __call__(self, topic: Topic[Any], message: Any) -> None:
        """Pass a message to each output, after the fault events of the previous one."""
        self._isolation.advance(message.time_us * 1e-6)
        for fault in self._isolation.take_faults():
            for event in fault_events(fault, message.time_us):
                self._publish(topics.EVENTS, event)
        self._publish(topic, message)

    def _publish(self, topic: Topic[Any], message: Any) -> None:
        for guard, publish in self._outputs:
            guard.run(publish, topic, message)


def print_events(topic: Topic[Any], message: Any) -> None:
    """Print the world's events to stderr, without tracebacks."""
    if topic is topics.EVENTS and message.severity < Severity.DEBUG:
        print(f"{message.time_us * 1e-6:6.1f} s  {message.text}", file=sys.stderr, flush=True)


def _report_end(world: SimulatedWorld, ended: str, recorded: str) -> None:
    end = world.time_us * 1e-6
    never = "" if world.launched else ", not launched"
    print(f"ended after {end:.1f} s{never}: {ended}; recorded in {recorded}", file=sys.stderr)
    for name in options.missed(world.scenario.faults, end):
        print(f"fault {name} did not occur: the flight ended before", file=sys.stderr)


def _server(address: str, speed: float | None) -> BridgeServer | SerialPeer:
    """Create the server: lockstep over TCP, or free-running over a serial line."""
    if address == PTY or address.startswith("serial:"):
        return SerialPeer(address, speed)
    return BridgeServer(address, speed)


def _serve(server: BridgeServer | SerialPeer, world: SimulatedWorld, core: int | None) -> str:
    """Run one flight; return why it ended."""
    if isinstance(server, BridgeServer):
        pin_to_core(core)
        server.busy_poll = core is not None
    try:
        return server.serve(world).ended
    except FlightComputerSilent as silence:
        raise InputError(str(silence)) from None


def simulated(vehicle: str, model: str | None) -> SimulatedVehicle:
    """Return the vehicle of a name or file, with an aerodynamic model (default: that of its file).

    Raises:
        InputError: no such vehicle or model, no section of the model, or bodies that make no vehicle.
    """
    loaded = unbuilt(vehicle, model)
    with announced_air(loaded):
        build_mechanism(loaded)
    return loaded


def unbuilt(vehicle: str, model: str | None) -> SimulatedVehicle:
    """Return `simulated` without a check of the bodies, which may need the aerodynamic model's compiler.

    Raises:
        InputError: no such vehicle or model, or no section of the model.
    """
    loaded = load_vehicle(vehicle)
    return loaded if model is None else with_model(loaded, model)
