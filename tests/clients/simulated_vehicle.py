"""A vehicle for ground stations of others: ``wingbeat sim`` and ``wingbeat avionics``, as a person starts them.

What a station does, it does on the wall clock; the vehicle flies `SPEED` times as fast. The launcher waits until the
vehicle has been armed for 5 s, so that nothing hurries whoever reads 300 parameters first.
"""

from __future__ import annotations

import itertools
import math
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from _pytest.mark import ParameterSet
from ground_links import TRANSPORTS, Addresses
from ports import free_port

from avionics import parameters
from avionics.link.dialect import mavlink
from avionics.messages import Mode
from avionics.vehicles import load_vehicle
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.plant import Plant, physics_compiled
from sim_bridge.vehicles import load_vehicle as load_world

SPEED = 4.0
"""-; times real time. A vehicle whose host is slower flies slower, it does not skip"""
VEHICLE = "robo_raven_ii_d"
PATIENCE = 60.0
"""s; of wall clock, until a step of a flight counts as failed"""
HURRY = 5.0
"""s; of wall clock, from the beginning of the connection to the last parameter"""
ALTITUDE = 12.0
"""m; of the plan"""


class Profile(NamedTuple):
    """What a ground station sees of an identity."""

    words: tuple[str, ...]
    """of the command line"""
    heartbeat: tuple[int, int]
    """MAV_TYPE and MAV_AUTOPILOT"""
    first_item: int
    """-; 1 where item 0 of a mission is home"""
    names: Mapping[Mode, str]
    """of modes, as MAVProxy says them"""


GENERIC = Profile(
    ("--identity", "generic"),
    (mavlink.MAV_TYPE_FLAPPING_WING, mavlink.MAV_AUTOPILOT_GENERIC),
    0,
    {m: m.name for m in Mode},
)
ARDUPILOT = Profile(
    ("--identity", "ardupilot"),
    (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
    1,
    {
        Mode.MANUAL: "MANUAL",
        Mode.STABILIZED: "FBWA",
        Mode.ALTITUDE_HOLD: "FBWB",
        Mode.AUTO: "AUTO",
        Mode.RETURN: "RTL",
        Mode.LOITER: "LOITER",
        Mode.LAND: "AUTOLAND",
    },
)
PX4 = Profile(
    ("--identity", "px4"),
    (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4),
    0,
    {
        Mode.MANUAL: "MANUAL",
        Mode.STABILIZED: "STABILIZED",
        Mode.ALTITUDE_HOLD: "ALTCTL",
        Mode.AUTO: "MISSION",
        Mode.RETURN: "RTL",
        Mode.LOITER: "LOITER",
        Mode.LAND: "LAND",
    },
)
PROFILES = {"generic": GENERIC, "ardupilot": ARDUPILOT, "px4": PX4}
"""By name; those that are flown"""


def matrix(always: tuple[str, str], profiles: Sequence[str] = tuple(PROFILES)) -> list[ParameterSet]:
    """Every transport in each of ``profiles``; those but one are a long study."""
    pairs = [(transport, profile) for transport in TRANSPORTS for profile in profiles]
    return [pytest.param(*pair, marks=() if pair == always else pytest.mark.validate) for pair in pairs]


class PlanItem(NamedTuple):
    """A mission item on the wire, in the terms that the vehicle itself answers in; places in 1e-7 degrees."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


_NOTHING = (0.0, 0.0, 0.0, 0.0)
_NO_HEADING = (0.0, 0.0, 0.0, math.nan)
_ABOVE_HOME = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
X, Y = (round(math.degrees(angle) * 1e7) for angle in (COLLEGE_PARK.latitude, COLLEGE_PARK.longitude))


def plan(profile: Profile) -> list[PlanItem]:
    """A short flight northward, that ends with a return."""
    home = PlanItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, _NOTHING, X, Y, COLLEGE_PARK.altitude)
    flown = [
        PlanItem(_ABOVE_HOME, mavlink.MAV_CMD_NAV_TAKEOFF, _NO_HEADING, X + 4_000, Y + 1_000, ALTITUDE),
        PlanItem(_ABOVE_HOME, mavlink.MAV_CMD_NAV_WAYPOINT, _NO_HEADING, X + 13_000, Y, ALTITUDE),
        PlanItem(mavlink.MAV_FRAME_MISSION, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, _NOTHING, 0, 0, 0.0),
    ]
    return [home] * profile.first_item + flown


def fence() -> list[PlanItem]:
    """A quadrangle about home, far from where the plan leads."""
    corners = ((-1, -1), (-1, 1), (1, 1), (1, -1))
    of, command = (4.0, 0.0, 0.0, 0.0), mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    return [PlanItem(_ABOVE_HOME, command, of, X + 60_000 * n, Y + 60_000 * e, 0.0) for n, e in corners]


def rally() -> list[PlanItem]:
    """One point to return to."""
    return [PlanItem(_ABOVE_HOME, mavlink.MAV_CMD_NAV_RALLY_POINT, _NOTHING, X + 9_000, Y, 2 * ALTITUDE)]


def send_text(line: str) -> None:
    """Tell a measurement."""
    sys.stdout.write(line + "\n")


def assert_same(there: Sequence[PlanItem], target: Sequence[PlanItem], begin: int = 0) -> None:
    """Every number is the same from item ``begin`` on; home before it is where the vehicle has it.

    MAVProxy cuts the last digit of a place off.
    """
    assert [(item.frame, item.command) for item in there] == [(item.frame, item.command) for item in target]
    for one, other in zip(there[begin:], target[begin:], strict=True):
        assert (*one.params, one.z) == pytest.approx((*other.params, other.z), rel=1e-7, nan_ok=True)
        assert (one.x, one.y) == pytest.approx((other.x, other.y), rel=0.0, abs=1.0)


def parameter_values() -> dict[str, float]:
    """The vehicle's parameters as its file has them."""
    gains = load_vehicle(VEHICLE).gains
    table = parameters.parameter_table(gains)
    return {name: parameters.get(gains, entry) for name, entry in table.items()}


class Started:
    """A subcommand of ``wingbeat`` as a process, and what it says on stderr."""

    def __init__(self, words: Sequence[str]) -> None:
        self._words = words
        command = [sys.executable, "-m", "groundstation.command.main", *words]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def receive(self, text: str) -> None:
        """Wait until it says a line with ``text`` in it."""
        assert self._process.stderr is not None
        enable_busy_poll = threading.Timer(PATIENCE, self._process.kill)
        enable_busy_poll.start()
        said = list(itertools.takewhile(lambda line: text not in line, self._process.stderr))
        enable_busy_poll.cancel()
        if self._process.poll() is not None:
            pytest.fail(f"wingbeat {self._words[0]} never said {text!r}, but: {''.join(said)}")

    def end(self) -> str:
        """Ask it to close its recording; what it complained of if it had ended badly by itself."""
        failed = self._process.poll()
        if failed is None:
            self._process.send_signal(signal.SIGINT)
        said = self._process.communicate(timeout=PATIENCE)[1]
        return f"wingbeat {self._words[0]} ended with {failed}: {said}" if failed else ""


@contextmanager
def aircraft(link: Addresses, profile: Profile, folder: Path, speed: float = SPEED) -> Iterator[None]:
    """World and flight computer in lockstep, in the launcher's hand, its link open; ended when left.

    Fails:
        when one of them has ended badly.
    """
    if not physics_compiled():
        Plant(load_world(VEHICLE)).compile()  # before anybody's patience begins
    bridge = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    world = ["--listen", bridge, "--speed", repr(speed), "--log", str(folder / "world.mcap")]
    log = ["--log", str(folder / "avionics.mcap")]
    computer = ["--board", f"hil:{bridge}", *log, "--parameters", "none", "--signing-key", "none", *profile.words]
    started = [
        Started(["sim", "--vehicle", VEHICLE, *world]),
        Started(["avionics", "--vehicle", VEHICLE, *computer, "--gcs", link.vehicle]),
    ]
    try:
        started[1].receive("waiting for the board")
        yield
    finally:
        failures = [failure for one in started if (failure := one.end())]
    assert not failures, failures
