"""``wingbeat``: subcommand selection; one line and an exit code per failure.

Exit codes: 0 done; 1 the vehicle refused or did not answer; 2 the input cannot be used; 130 stopped
with Ctrl-C, 143 with SIGTERM, 129 with SIGHUP.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Sequence
from typing import NamedTuple

from groundstation.command import ending
from groundstation.link.answers import LinkSilent, NoAnswer
from groundstation.views.printable import printable_streams
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

REFUSED = 1
BAD_INPUT = 2
# Before any import of NumPy. The matrices here are small: threads that share one spend more time on synchronization,
# and take it from the other processes of a flight or a campaign.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class Subcommand(NamedTuple):
    """Subcommand: a module with ``run(arguments: list[str]) -> int``, and a line of help."""

    module: str
    summary: str


FLIGHT_CODE = "avionics.autopilot"
"""module that is compiled if the flight code is"""
SUBCOMMANDS: dict[str, Subcommand] = {
    "fly": Subcommand(
        "groundstation.command.fly", "fly a modeled ornithopter: simulator, flight computer, view, log"
    ),
    "sim": Subcommand("groundstation.command.sim", "simulator only, waiting for a flight computer"),
    "avionics": Subcommand("groundstation.command.avionics", "flight computer only, on a board"),
    "gcs": Subcommand("groundstation.command.gcs", "monitor and command any MAVLink vehicle"),
    "log": Subcommand("groundstation.command.log", "inspect, view, export, import or repair a log"),
    "replay": Subcommand("groundstation.command.replay", "replay a recorded flight, or play it to a ground station"),
    "identify": Subcommand("groundstation.command.identify", "identify servo, power and short period from a log"),
    "trim": Subcommand("groundstation.command.trim", "find the steady flight at an airspeed and climb rate"),
    "linearize": Subcommand("groundstation.command.linearize", "modes, A and B of the motion about a steady flight"),
    "tunnel": Subcommand("groundstation.command.tunnel", "forces of recorded wing motion beside measured ones"),
    "tune": Subcommand("groundstation.command.tune", "gains of every loop: margins, file, flights before and after"),
    "new-bird": Subcommand(
        "groundstation.command.new_bird", "vehicle folder of a new ornithopter from eight numbers"
    ),
    "design": Subcommand("groundstation.command.design", "plan an identification input and the errors it will leave"),
    "campaign": Subcommand("groundstation.command.campaign", "many flights of a sweep and their statistics"),
    "validate": Subcommand("groundstation.command.validate", "every published figure beside ours"),
    "vehicles": Subcommand("groundstation.command.vehicles", "vehicles and the sources of their values"),
}


def overview() -> str:
    """Return the help of the command."""
    rows = "\n".join(f"  {name:<9} {subcommand.summary}" for name, subcommand in SUBCOMMANDS.items())
    return (
        "usage: wingbeat COMMAND [OPTIONS]\n\n"
        "Flight software, simulation and system identification for flapping-wing aircraft.\n\n"
        f"commands:\n{rows}\n\n"
        "examples:\n"
        "  wingbeat fly\n"
        "  wingbeat fly --speed 1 --gcs udpout:127.0.0.1:14550\n"
        "  wingbeat log info recordings/flight.mcap\n\n"
        "wingbeat COMMAND --help says more about each."
    )


def dispatch(arguments: Sequence[str]) -> int:
    """Run one subcommand and return its exit code.

    Raises:
        InputError: unknown subcommand or invalid input.
    """
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(overview())
        return 0
    if arguments[0] == "--version":
        print_version()
        return 0
    name = arguments[0]
    if name not in SUBCOMMANDS:
        raise InputError(
            f"unknown command {name!r}{did_you_mean(name, SUBCOMMANDS)}; commands: {', '.join(SUBCOMMANDS)}"
        )
    gc.disable()  # an import leaves next to no garbage, and looking for it takes a seventh of its time
    try:
        with ending.importing():
            module = importlib.import_module(SUBCOMMANDS[name].module)
    finally:
        gc.enable()
    code: int = module.run(list(arguments[1:]))
    return code


def print_version() -> None:
    """Print the version, and whether the flight code is compiled."""
    from importlib.metadata import version

    from wingbeat.docstrings import is_compiled

    print(f"wingbeat {version('wingbeat')}")
    print(f"flight code: {'compiled' if is_compiled(FLIGHT_CODE) else 'Python'}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the console script; expected failures print no traceback."""
    with ending.heeded() as ended, printable_streams():
        ending.follow_starter()
        try:
            code = _main(arguments)
        except OSError:  # the terminal went away, as it does with SIGHUP: nobody is there to be told
            code = BAD_INPUT
            if ended.code is None:
                raise
        return code if ended.code is None else ended.code


def _main(arguments: Sequence[str] | None) -> int:
    try:
        code = dispatch(sys.argv[1:] if arguments is None else arguments)
        sys.stdout.flush()
        return code
    except (InputError, LinkSilent) as error:
        return _report_error(error, BAD_INPUT)
    except NoAnswer as error:
        return _report_error(error, REFUSED)
    except KeyboardInterrupt:
        return ending.INTERRUPTED
    except SystemExit as leaving:  # argparse, after --help
        return int(leaving.code or 0)
    except BrokenPipeError:
        # The reader of the output closed it, as in `wingbeat log info FILE | head`, so no message is printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _report_error(_file_failure(error), BAD_INPUT)


def _file_failure(error: OSError) -> str:
    reason = error.strerror or str(error)
    return f"cannot read or write {error.filename}: {reason}" if error.filename else reason


def _report_error(error: object, code: int) -> int:
    line = " ".join(str(error).split())
    print(f"wingbeat: {line}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
