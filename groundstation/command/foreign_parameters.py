"""``wingbeat sim --write-parameters FILE``: parameters of PX4 or ArduPlane."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np

from avionics.mixing import flapping
from groundstation.command import options
from groundstation.command.compiling import load_physics
from groundstation.command.foreign import Foreign
from groundstation.views.progress import ProgressBar
from logs.new_files import check_new, write_text
from sim_bridge.bridge.foreign import mixer
from sim_bridge.bridge.foreign.launch import Launch, Push
from sim_bridge.bridge.foreign.parameters import (
    Performance,
    Subject,
    ardupilot_file,
    ardupilot_parameters,
    check_outputs,
    check_push,
    px4_file,
    px4_parameters,
)
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import check_memory, throttle_for
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError

OF_A_FLIGHT = (
    "listen", "duration", "speed", "seed", "wind", "wind_from", "turbulence", "fault", "sticks", "log", "core",
    "epoch_ns",
)  # fmt: skip
"""options without effect on a parameter file"""
AIRSPEED_STEP = 0.5
"""m/s; step of the search for the fastest level flight"""
CLIMB_STEP = 0.25
"""m/s; step of the search for the steepest climb"""


def check_options(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Reject options that belong to a flight.

    Raises:
        InputError: there is one, or no autopilot to write parameters for.
    """
    if not (chosen.px4 or chosen.ardupilot):
        raise InputError("--write-parameters is for --px4 and --ardupilot")
    for name in OF_A_FLIGHT:
        if getattr(chosen, name) != parser.get_default(name):
            option = name.replace("_", "-")
            raise InputError(f"--write-parameters writes a file without a flight: --{option} has no effect on it")


def write_parameters(chosen: argparse.Namespace, foreign: Foreign, world: SimulatedVehicle) -> None:
    """Write the file and print the next commands.

    Raises:
        InputError: the file exists or cannot be written, no level flight is found, or the vehicle has no gains.
    """
    path = Path(chosen.write_parameters)
    check_new(path)
    check_memory(world)
    rig = foreign.rig
    check_outputs(rig.channels, foreign.of_px4)
    push = None
    if rig.launch is Launch.THROW:
        push = push_of(world)
        check_push(push)
    subject = Subject(rig.vehicle, _performance(world, foreign), rig.channels, foreign.pulses, push)
    autopilot, parameters = (
        ("PX4", px4_parameters(subject)) if foreign.of_px4 else ("ArduPlane", ardupilot_parameters(subject))
    )
    command = shlex.join(["wingbeat", *_options(chosen, "--write-parameters", path.name)])
    title = f"{autopilot} on {rig.vehicle.title}: {command}"
    text = (px4_file if foreign.of_px4 else ardupilot_file)(f"{title}. {EXPLANATION}", parameters)
    write_text(path, text)
    print(f"{len(parameters)} parameters of {autopilot} for {rig.vehicle.title} written to {path}")
    print("start next:")
    for line in (_px4_commands if foreign.of_px4 else _ardupilot_commands)(chosen, path):
        print(f"  {line}")


EXPLANATION = (
    "Behind each value: its unit, and its source. section.key is of the flight vehicle file; trim is the"
    " stroke-averaged steady flight of wingbeat trim."
)


def push_of(world: SimulatedVehicle) -> Push:
    """Return the acceleration of the launcher."""
    return Push(world.launch.speed / world.launch.duration, world.launch.duration)


def _performance(world: SimulatedVehicle, foreign: Foreign) -> Performance:
    """Compute level flight, largest airspeed and climb rate from the trim.

    Raises:
        InputError: there is no level flight at the cruise airspeed.
    """
    load_physics(world)
    gains = foreign.rig.vehicle.gains
    cruise = world.cruise.airspeed
    with ProgressBar("searching") as bar:

        def steady(airspeed: float, climb_rate: float) -> Orbit:
            bar.show(0, 0, f"steady flight at {airspeed:.3g} m/s climbing {climb_rate:.2g} m/s")
            return trim(world, airspeed, climb_rate)

        def is_within(airspeed: float, climb_rate: float) -> bool:
            try:
                orbit = steady(airspeed, climb_rate)
            except InputError:
                return False
            throttle = trim_throttle(gains.flapping, world, orbit)
            return throttle <= gains.altitude.throttle_max and orbit.means.pitch <= gains.altitude.pitch_max

        level = steady(cruise, 0.0)
        airspeed = _largest(cruise, gains.excitation.airspeed_max, AIRSPEED_STEP, lambda value: is_within(value, 0.0))
        climb_rate = _largest(0.0, gains.altitude.climb_max, CLIMB_STEP, lambda value: is_within(cruise, value))
    if climb_rate <= 0.0:
        raise InputError(f"{world.name}: no climb at {cruise:g} m/s, no parameters of its energy loops")
    elevator = mixer.elevator_output(mixer.gains_of(foreign.rig.vehicle), level.inputs.elevator)
    throttle = round(trim_throttle(gains.flapping, world, level), 3)
    return Performance(cruise, airspeed, climb_rate, throttle, level.means.pitch, round(elevator, 3))


def trim_throttle(gains: flapping.Gains, world: SimulatedVehicle, orbit: Orbit) -> float:
    """Return the throttle at which the flight vehicle's mixer commands the stroke of a trim.

    Above 1 if its largest stroke is too small.
    """
    if world.drive.kind == "crank":
        return throttle_for(orbit.inputs.frequency, world)
    if world.drive.kind == "linkage":
        return orbit.inputs.throttle
    if orbit.inputs.amplitude > gains.amplitude_points[-1]:
        return math.inf
    return float(np.interp(orbit.inputs.amplitude, gains.amplitude_points, gains.throttle_points))


def _largest(start: float, limit: float, step: float, is_within: Callable[[float], bool]) -> float:
    """Return the largest value in steps from ``start`` to ``limit`` before the first that is not within."""
    value = start
    while value < limit and is_within(min(value + step, limit)):
        value = min(value + step, limit)
    return value


def _options(chosen: argparse.Namespace, *more: str) -> list[str]:
    """Return the command line of the simulation for the file."""
    words = ["sim", "--px4" if chosen.px4 else "--ardupilot"]
    if chosen.vehicle != options.DEFAULT_VEHICLE:
        words += ["--vehicle", chosen.vehicle]
    for name in ("aerodynamics", "launch", "channels", "pwm"):
        value = getattr(chosen, name)
        if value is not None:
            words += [f"--{name}={value}"]
    if chosen.instance:
        words += ["--instance", str(chosen.instance)]
    return [*words, *more]


def _ardupilot_commands(chosen: argparse.Namespace, path: Path) -> list[str]:
    path = path.resolve()
    home = COLLEGE_PARK
    place = f"{math.degrees(home.latitude):.6g},{math.degrees(home.longitude):.6g},{home.altitude:g},0"
    instance = f" -I {chosen.instance}" if chosen.instance else ""
    return [
        shlex.join(["wingbeat", *_options(chosen)]),
        f"arduplane --model JSON:127.0.0.1 --home {place} --defaults {shlex.quote(str(path))}{instance}",
        "or: sim_vehicle.py -v ArduPlane --model JSON:127.0.0.1"
        f" -l {place} --add-param-file={shlex.quote(str(path))}{instance}",
    ]


def _px4_commands(chosen: argparse.Namespace, path: Path) -> list[str]:
    instance = f" -i {chosen.instance}" if chosen.instance else ""
    return [
        shlex.join(["wingbeat", *_options(chosen)]),
        f". {shlex.quote(str(path.resolve()))}    # in the shell that starts PX4",
        "PX4_SYS_AUTOSTART=1030 PX4_SIM_MODEL=gazebo-classic_plane build/px4_sitl_default/bin/px4" + instance,
    ]
