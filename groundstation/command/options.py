"""What the subcommands share: the parser that answers in one line, and common options."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import NoReturn

from avionics.quantities import BadInput


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line, raised as `BadInput`."""

    def error(self, message: str) -> NoReturn:
        """Refuse the command line."""
        raise BadInput(f"{message} (see {self.prog} --help)")


def build_parser(
    name: str, summary: str, examples: Sequence[str], json_keys: Mapping[str, str] | None = None
) -> Parser:
    """A subcommand's parser: its summary, its examples, and the keys of its JSON document."""
    parts = ["examples:" if len(examples) > 1 else "example:", *(f"  {example}" for example in examples)]
    if json_keys:
        width = max(len(key) for key in json_keys)
        parts += ["", "keys of --json:", *(f"  {key:<{width}}  {text}" for key, text in json_keys.items())]
    return Parser(
        prog=f"wingbeat {name}",
        description=summary,
        epilog="\n".join(parts),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Offer ``--json``."""
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def positive(text: str) -> float:
    """A number above zero, for argparse."""
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def not_negative(text: str) -> float:
    """A number of zero or more, for argparse."""
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value


def seed(text: str) -> int:
    """A whole number of zero or more, for argparse."""
    if not (text.isascii() and text.isdigit()) or int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 0")
    return int(text)


def speed(text: str) -> float:
    """A factor of real time, or ``max`` (infinite), for argparse."""
    return math.inf if text == "max" else positive(text)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number")
    return value
