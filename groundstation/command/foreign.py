"""``wingbeat sim --px4`` and ``--ardupilot``: other autopilots on the simulator."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import NamedTuple

from avionics.vehicles import load_vehicle
from groundstation.command import options
from sim_bridge.bridge.foreign import ardupilot, launch, px4
from sim_bridge.bridge.foreign.flight import Rig
from sim_bridge.bridge.foreign.launch import Launch
from sim_bridge.bridge.foreign.outputs import Channels, Pulses, parse_channels, parse_pulses
from sim_bridge.bridge.foreign.world import AutopilotSilent, Interface, NextStage
from sim_bridge.flight.world import Scenario
from sim_bridge.sensors.frame import TICK_RATE
from wingbeat.errors import InputError

REST_TIME = 20.0
"""s; on the ground before the simulation ends: time for an autopilot to detect the landing and disarm"""
HOST = "127.0.0.1"

SETUP = """
flying PX4 (--px4) or ArduPlane (--ardupilot), step by step in docs/sitl.md:
  1  wingbeat sim --ardupilot --launch throw --write-parameters raven.parm    (--px4: raven.px4.sh)
  2  start the two programs that it prints, then a ground station on ArduPlane's or PX4's own link
  3  wait for its position estimate; mode TAKEOFF, arm; afterwards LOITER, or AUTO with a mission
Throttle is flapping; the aileron is the roll command of the vehicle's own tail mixer: a plane's roll loop banks
it by the rudder (--channels aileron=0 leaves it out). PX4's airframe 1030 without the file needs --channels
aileron=7,elevator=8,throttle=5,rudder=3. An autopilot that starts over finds a new vehicle in the hand, and a new
recording. What a person has to set: altitude of the takeoff (TKOFF_ALT; MIS_TAKEOFF_ALT), failsafes, the mission.
"""


LAUNCHES = {
    Launch.THROTTLE: "the vehicle is thrown when it is armed with the throttle of level flight for half a second",
    Launch.THROW: f"launch by throw: {launch.ARMED_TIME:g} s after arming, for the autopilot's launch detection",
}


class Foreign(NamedTuple):
    """Options of foreign autopilots."""

    of_px4: bool
    """PX4, else ArduPilot"""
    interface: Interface
    rig: Rig
    pulses: Pulses

    @property
    def rate(self) -> float:
        """Hz; of the sensors' ticks."""
        return px4.IMU_RATE if self.of_px4 else TICK_RATE

    @property
    def description(self) -> dict[str, str]:
        """Description for the recording: autopilot, kind of launch and outputs."""
        outputs = {"channels": str(self.rig.channels), "launch": self.rig.launch.value}
        if self.of_px4:
            return {"autopilot": "PX4", **outputs}
        return {"autopilot": "ArduPilot", **outputs, "pwm": f"{self.pulses.low:g}:{self.pulses.high:g}"}


def add_foreign(parser: argparse.ArgumentParser) -> None:
    """Add ``--px4``, ``--ardupilot`` and the wiring of their outputs."""
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument("--px4", action="store_true", help=f"serve PX4's simulator interface: TCP {px4.PORT}")
    kinds.add_argument(
        "--ardupilot", action="store_true", help=f"serve ArduPilot's JSON interface: UDP {ardupilot.PORT}"
    )
    parser.add_argument(
        "--instance",
        type=int,
        default=0,
        metavar="N",
        help="instance N of PX4 (port + N) or ArduPilot (port + 10 N) (default: 0)",
    )
    parser.add_argument(
        "--channels",
        metavar="NAME=N,...",
        help=f"outputs of PX4 or ArduPilot, -N reversed, 0 none (default: {Channels()})",
    )
    parser.add_argument("--pwm", metavar="LOW:HIGH", help="limits of ArduPilot's pulses in us (default: 1100:1900)")
    parser.add_argument(
        "--launch",
        choices=[one.value for one in Launch],
        help=f"throttle: launch after {launch.Gains(0.0).time:g} s with the throttle of level flight (default);"
        f" throw: launch {launch.ARMED_TIME:g} s after arming, for its own launch detection",
    )
    parser.add_argument(
        "--write-parameters",
        type=Path,
        metavar="FILE",
        help="write the parameters with which ArduPlane or PX4 flies the vehicle to a new file, and exit",
    )
    parser.epilog = f"{parser.epilog or ''}\n{SETUP}"


def chosen_foreign(chosen: argparse.Namespace, listen: str | None) -> Foreign | None:
    """Return the foreign autopilot of the command line; None for the Wingbeat flight computer.

    Raises:
        InputError: options of foreign autopilots without one, invalid options, or a vehicle without a flight computer
            file.
    """
    if not (chosen.px4 or chosen.ardupilot):
        if chosen.instance or chosen.channels or chosen.pwm or chosen.launch:
            raise InputError("--instance, --channels, --pwm and --launch are for --px4 and --ardupilot")
        return None
    if chosen.px4 and chosen.pwm:
        raise InputError("--pwm is for --ardupilot: PX4 sends shares of the travel")
    if not 0 <= chosen.instance <= 255:
        raise InputError(f"instance must be 0 to 255, not {chosen.instance}")
    channels = parse_channels(chosen.channels) if chosen.channels else Channels()
    pulses = parse_pulses(chosen.pwm) if chosen.pwm else Pulses()
    speed = None if math.isinf(chosen.speed) else chosen.speed
    interface = Interface(listen or default_url(chosen.px4, chosen.instance), speed)
    vehicle = load_vehicle(options.vehicle_files(chosen.vehicle)[1])
    rig = Rig(vehicle, channels, Launch(chosen.launch) if chosen.launch else Launch.THROTTLE)
    return Foreign(chosen.px4, interface, rig, pulses)


def default_url(of_px4: bool, instance: int) -> str:
    """Return the default simulator address of an instance of PX4 or ArduPilot."""
    if of_px4:
        return f"tcp:{HOST}:{px4.PORT + instance}"
    return f"udpin:{HOST}:{ardupilot.PORT + ardupilot.INSTANCE_PORTS * instance}"


def unhurried(scenario: Scenario) -> Scenario:
    """Return the scenario of a foreign autopilot: the launcher waits for it, and landing does not end it."""
    return scenario._replace(waits_for_arming=False, launch_time=math.inf, rest_time=REST_TIME)


class Service:
    """Open port for a foreign autopilot; `serve` runs the flights."""

    def __init__(self, foreign: Foreign) -> None:
        """Open the port.

        Raises:
            InputError: it is in use, or the address is not one for this autopilot.
        """
        self._foreign = foreign
        interface, rig = foreign.interface, foreign.rig
        self._server: px4.Px4Server | ardupilot.ArduPilotServer = (
            px4.Px4Server(interface, rig, report)
            if foreign.of_px4
            else ardupilot.ArduPilotServer(interface, rig, foreign.pulses, report)
        )

    def serve(self, next_stage: NextStage) -> None:
        """Report the wait for the autopilot, and fly until the simulation is finished or no autopilot reconnects.

        Raises:
            InputError: no autopilot connected, or one stopped responding.
        """
        self._announce()
        try:
            tally = self._server.serve(next_stage)
        except AutopilotSilent as silence:
            raise InputError(str(silence)) from None
        counts = (f"{name.replace('_', ' ')} {count}" for name, count in tally._asdict().items() if name != "ended")
        report(f"{tally.ended}: {', '.join(counts)}")

    def close(self) -> None:
        """Close the port."""
        self._server.close()

    def _announce(self) -> None:
        interface, rig = self._foreign.interface, self._foreign.rig
        who = "PX4's simulator_mavlink" if self._foreign.of_px4 else "ArduPilot's --model JSON"
        fast = "as fast as it answers; --speed 1 is real time"
        pace = fast if interface.speed is None else f"{interface.speed:g} times real time"
        report(f"{rig.vehicle.title}, waiting for {who} on {interface.url} ({pace})")
        report(f"outputs: {rig.channels}; parameters of the autopilot: --write-parameters FILE")
        report(LAUNCHES[rig.launch])


def report(text: str) -> None:
    """Print a line on the terminal."""
    print(text, file=sys.stderr, flush=True)
