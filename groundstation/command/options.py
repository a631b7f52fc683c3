"""Common options and the parser with one-line errors."""

from __future__ import annotations

import argparse
import math
import re
import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from avionics.link.key_file import KeyFile
from avionics.link.urls import OPTIONS
from avionics.link.vehicle import DEFAULT_IDENTITY, PROFILES
from logs.names import recording_path as recording_path
from logs.names import vehicle_files as vehicle_files
from sim_bridge.environment.levels import LEVELS, LEVELS_TOLD
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean
from wingbeat.vehicle_file import name_by_path

if TYPE_CHECKING:
    from sim_bridge.flight.faults import Fault

HIDDEN = argparse.SUPPRESS
DEFAULT_VEHICLE = "robo_raven_ii_d"
DEFAULT_MISSION = "circuit"
NO_PARAMETERS = "none"
NO_KEY = "none"


NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|-inf$|-nan$", re.IGNORECASE)


class Parser(argparse.ArgumentParser):
    """Argument parser whose errors are one line, raised as `InputError`."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        # Before Python 3.14 argparse parses -1e9 as an option.
        self._negative_number_matcher = NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        """Raise the error of the command line."""
        raise InputError(f"{message}{self._guess(message)} (see {self.prog} --help)")

    def _guess(self, message: str) -> str:
        """Return a hint with the most similar choice or option."""
        if choice := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)$", message):
            return did_you_mean(choice[1], [name.strip("'") for name in choice[2].split(", ")])
        if unknown := re.match(r"unrecognized arguments: --([^\s=]+)", message):
            told = (one for one in self._actions if one.help != HIDDEN)
            names = [name[2:] for one in told for name in one.option_strings if name.startswith("--")]
            return did_you_mean(unknown[1], names).replace("'", "'--", 1)
        return ""


class VerbParser(Parser):
    """Parser of a verb, as of ``wingbeat log view``."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Reject unknown arguments here: the help of the verb lists its options, that of the subcommand does not."""
        found, others = super().parse_known_args(args, namespace)
        if others:
            self.error(f"unrecognized arguments: {' '.join(others)}")
        return found, others


def build_parser(
    name: str, summary: str, examples: Sequence[str], json_keys: Mapping[str, str] | None = None
) -> Parser:
    """Build the parser of a subcommand from its summary, examples, and the keys of its JSON document."""
    parts = ["examples:" if len(examples) > 1 else "example:", *(f"  {example}" for example in examples)]
    if json_keys:
        parts += ["", "keys of --json:", *_key_lines(json_keys)]
    return Parser(
        prog=f"wingbeat {name}",
        description=summary,
        epilog="\n".join(parts),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


KEY_COLUMN = 20
"""characters; a longer key has its own line, like an option in argparse's help"""


def _key_lines(keys: Mapping[str, str]) -> list[str]:
    """Format keys and their meaning in two columns that fit the terminal."""
    indent = " " * (4 + min(max(len(key) for key in keys), KEY_COLUMN))
    width = max(shutil.get_terminal_size().columns - 2, len(indent) + KEY_COLUMN)
    lines = []
    for key, text in keys.items():
        first, *rest = textwrap.wrap(
            text, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
        )
        name = f"  {key}"
        lines += [name, first] if len(key) > KEY_COLUMN else [name.ljust(len(indent)) + first.lstrip()]
        lines += rest
    return lines


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def add_vehicle(parser: argparse.ArgumentParser) -> None:
    """Add ``--vehicle``."""
    parser.add_argument(
        "--vehicle",
        default=DEFAULT_VEHICLE,
        metavar="V|PATH",
        help=f"name, file or folder of a vehicle (default: {DEFAULT_VEHICLE})",
    )


class NamedFile(Protocol):
    """Common properties of a vehicle and its file."""

    @property
    def name(self) -> str:
        """Name in the file."""

    @property
    def path(self) -> Path:
        """The file."""


def name_warnings(*files: NamedFile) -> list[str]:
    """Return a line for each user vehicle file that still has the name of its original."""
    from avionics import vehicles as flight
    from sim_bridge import vehicles as world

    supplied = {*flight.vehicle_names(), *world.vehicle_names()}
    folders = {flight.FOLDER, world.FOLDER}
    return [
        f'{file.path}: name = "{file.name}" is that of another vehicle; change it to "{name_by_path(file.path)}"'
        for file in files
        if file.name in supplied and file.path.resolve().parent not in folders
    ]


def add_aerodynamics(parser: argparse.ArgumentParser) -> None:
    """Add ``--aerodynamics``."""
    parser.add_argument(
        "--aerodynamics",
        metavar="MODEL",
        help="aerodynamic model of the wings with a section in the vehicle file (default: that of the file)",
    )


def add_mission(parser: argparse.ArgumentParser) -> None:
    """Add ``--mission``."""
    parser.add_argument(
        "--mission",
        default=DEFAULT_MISSION,
        metavar="FILE",
        help=f"name or file of a mission: .toml, .plan, .waypoints (default: {DEFAULT_MISSION})",
    )


def add_parameters(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--parameters``; ``default`` describes the file that is used without it."""
    parser.add_argument(
        "--parameters",
        metavar="FILE|none",
        help=f"file of changed parameters and calibrations (default: {default}); none: not stored",
    )


SIZES = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9}
LEAST_LOG = 10**6
"""bytes; least size limit: a smaller file would contain less than a few seconds of flight"""


def log_size(text: str) -> int:
    """Parse a size such as 500M to bytes.

    Raises:
        argparse.ArgumentTypeError: invalid or too small.
    """
    match = re.fullmatch(r"(\d+(?:\.\d*)?)([kMG]?)", text)
    size = round(float(match[1]) * SIZES[match[2]]) if match else 0
    if size < LEAST_LOG:
        raise argparse.ArgumentTypeError(f"{text!r} is not a file size of at least 1M, such as 500M or 2G")
    return size


def add_core(parser: argparse.ArgumentParser) -> None:
    """Add ``--core``: a process of a lockstep pair on a core of its own, where it polls without sleeping."""
    parser.add_argument("--core", type=int, metavar="N", help=argparse.SUPPRESS)


def add_log_size(parser: argparse.ArgumentParser) -> None:
    """Add ``--log-size``."""
    parser.add_argument(
        "--log-size",
        type=log_size,
        default=0,
        metavar="SIZE",
        help="start a new file (-2, -3 ...) at this size, such as 500M (default: no limit)",
    )


def add_gcs(parser: argparse.ArgumentParser) -> None:
    """Add ``--gcs`` (repeatable)."""
    parser.add_argument(
        "--gcs",
        action="append",
        default=[],
        metavar="URL",
        help=f"link for a ground station (repeatable). Options follow a ?, joined by &: {OPTIONS}",
    )


def add_identity(parser: argparse.ArgumentParser) -> None:
    """Add ``--identity``."""
    parser.add_argument(
        "--identity",
        default=DEFAULT_IDENTITY,
        metavar="P",
        help=f"autopilot type reported to ground stations: {', '.join(PROFILES)} (default: {DEFAULT_IDENTITY})",
    )


def add_signing_key(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--signing-key``; ``default`` describes the file that is used without it."""
    parser.add_argument(
        "--signing-key",
        metavar="FILE|none",
        help=f"file with the MAVLink signing key: 64 hexadecimal digits, or 'passphrase' and a text ({default})",
    )


def key_file(chosen: str | None, default: Path | None) -> KeyFile | None:
    """Return the file of ``--signing-key``, or ``default`` if it was not given, None for none.

    Raises:
        InputError: the given file does not exist.
    """
    if chosen is None:
        return None if default is None else KeyFile(default)
    if chosen == NO_KEY:
        return None
    if not Path(chosen).exists():
        raise InputError(f"signing key {chosen}: there is no such file")
    return KeyFile(Path(chosen))


def add_world(parser: argparse.ArgumentParser, duration: float) -> None:
    """Add the options of the world: duration, speed, seed, wind, gusts."""
    parser.add_argument(
        "--duration", type=positive, default=duration, metavar="S", help=f"maximum duration (default: {duration:g})"
    )
    parser.add_argument(
        "--speed", type=speed, default=math.inf, metavar="X|max", help="multiple of real time (default: max)"
    )
    parser.add_argument(
        "--seed", type=seed, default=1, metavar="N", help="random seed for sensor noise and wind (default: 1)"
    )
    parser.add_argument("--wind", type=not_negative, default=0.0, metavar="M/S", help="steady wind (default: 0)")
    parser.add_argument(
        "--wind-from",
        type=direction,
        default=0.0,
        metavar="DEG",
        help="direction from which the wind comes, 0 is north (default: 0); launch is into the wind",
    )
    gusts = f"Dryden gusts: {LEVELS_TOLD} (default: none)"
    parser.add_argument("--turbulence", type=level, default="none", metavar="LEVEL", help=gusts)
    parser.add_argument(
        "--vibration",
        type=vibration,
        metavar="none|vehicle|FACTOR",
        help="vibration of the airframe: none, of the vehicle file, or a multiple of it (default: vehicle)",
    )


def add_faults(parser: argparse.ArgumentParser) -> None:
    """Add ``--fault`` (repeatable)."""
    from sim_bridge.flight.faults import FAULTS  # brings the world, which a reader of a log need not wait for

    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        type=fault,
        metavar="NAME@T[-T2]",
        help=f"fault from T to T2 seconds since boot (repeatable). NAME: {', '.join(FAULTS)}",
    )


def add_sticks(parser: argparse.ArgumentParser) -> None:
    """Add ``--sticks``."""
    from sim_bridge.sensors.receiver import Sticks
    from sim_bridge.sensors.transmitter import MODES

    columns = ", ".join(Sticks._fields)
    modes = ", ".join(f"{position} or {name}" for position, name in enumerate(MODES))
    parser.add_argument(
        "--sticks",
        metavar="FILE",
        help=f"a transmitter moved by a table of comma-separated values: time (s since boot) and any of {columns};"
        f" mode is {modes}; arm takes throttle 0, and the arm switch moved from 0 to 1",
    )


def fault(text: str) -> Fault:
    """Parse a fault for argparse."""
    from sim_bridge.flight.faults import parse_fault

    try:
        return parse_fault(text)
    except InputError as reason:
        raise argparse.ArgumentTypeError(str(reason)) from None


def check_times(faults: Iterable[Fault], duration: float) -> None:
    """Reject a fault after the end of a flight of ``duration`` s.

    Raises:
        InputError: there is one.
    """
    for one in faults:
        if one.at >= duration:
            raise InputError(
                f"fault {fault_name(one)}: the flight ends at {duration:g} s at the latest (--duration), before it"
            )


def missed(faults: Iterable[Fault], end: float) -> tuple[str, ...]:
    """Return the faults, as given, with a time after the ``end`` (s since boot) of the flight."""
    return tuple(fault_name(one) for one in faults if one.at > end)


def fault_name(one: Fault) -> str:
    """Return a fault in command-line notation."""
    return f"{one.name}@{one.at:g}" + (f"-{one.until:g}" if math.isfinite(one.until) else "")


def fault_words(faults: Iterable[Fault]) -> list[str]:
    """Return the command-line arguments that pass ``faults`` to another process."""
    from logs.recording_notes import exact_fault

    return [word for one in faults for word in ("--fault", exact_fault(one))]


def positive(text: str) -> float:
    """Parse a number above zero for argparse."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def number(text: str) -> float:
    """Parse a finite number for argparse."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number")
    return value


def not_negative(text: str) -> float:
    """Parse a number of zero or more for argparse."""
    value = number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value


def direction(text: str) -> float:
    """Parse a bearing in degrees, 0 to 360, to rad for argparse."""
    value = number(text)
    if not 0.0 <= value <= 360.0:
        raise argparse.ArgumentTypeError(f"{text} is outside 0 to 360 degrees")
    return math.radians(value)


def level(text: str) -> str:
    """Parse a level of turbulence for argparse."""
    if text not in LEVELS:
        raise argparse.ArgumentTypeError(f'turbulence "{text}" is unknown; it is {LEVELS_TOLD}')
    return text


def recording_file(text: str) -> Path:
    """Parse the path of a recording, or ``latest``, for argparse."""
    try:
        return recording_path(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def vibration(text: str) -> float:
    """Parse a vibration: ``none`` (0), ``vehicle`` (1), or a factor from 0, for argparse."""
    named = {"none": 0.0, "vehicle": 1.0}
    try:
        return named[text] if text in named else not_negative(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{text!r} is none of none, vehicle or a factor from 0") from None


def seed(text: str) -> int:
    """Parse a nonnegative integer for argparse."""
    if not (text.isascii() and text.isdigit()) or int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 0")
    return int(text)


def speed(text: str) -> float:
    """Parse a speed factor, or ``max`` (infinite), for argparse."""
    return math.inf if text == "max" else positive(text)


def port(text: str) -> int:
    """Parse a TCP port, 0 for any free one, for argparse."""
    if not (text.isascii() and text.isdigit()) or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port (0 to 65535)")
    return int(text)
