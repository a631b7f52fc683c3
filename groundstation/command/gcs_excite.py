"""``wingbeat gcs URL excite``: identification inputs."""

from __future__ import annotations

import argparse
import math
from typing import Any

from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.link.excitation_codec import encode_excitation
from avionics.link.wire_item import WireItem
from avionics.missions.excitations import check_excitation, on_channels
from groundstation.command import options
from groundstation.command.gcs_session import Session, Verb, VerbParser
from groundstation.link.commands import CommandExchange
from groundstation.link.exchange import Target
from wingbeat.errors import InputError

STEPS = {"doublet": Shape.DOUBLET, "3211": Shape.MULTISTEP_3211}
SWEEPS = {"sweep": Shape.LINEAR_SWEEP, "log_sweep": Shape.LOGARITHMIC_SWEEP}
CHANNELS = {channel.name.lower(): channel for channel in Channel}


JSON_KEYS = {"excite": "done, mode, armed"}


def add_verbs(verbs: Any) -> None:
    """Add the input shapes and their parameters."""
    parser = verbs.add_parser("excite", help="fly an identification input")
    shapes = parser.add_subparsers(dest="shape", required=True, metavar="SHAPE", parser_class=VerbParser)
    for word in STEPS:
        steps = shapes.add_parser(word, help="steps of one width")
        _add_single(steps)
        steps.add_argument("--width", type=options.positive, required=True, metavar="S", help="of one step")
        _add_pacing(steps)
    for word in SWEEPS:
        sweep = shapes.add_parser(word, help="a sine whose frequency runs from one end to the other")
        _add_single(sweep)
        sweep.add_argument("--start", type=options.positive, required=True, metavar="HZ", help="where it begins")
        sweep.add_argument("--end", type=options.positive, required=True, metavar="HZ", help="where it ends")
        sweep.add_argument("--duration", type=options.positive, required=True, metavar="S", help="of the sweep")
        _add_pacing(sweep)
    multisine = shapes.add_parser("multisine", help="orthogonal sums of sines, on several channels at once")
    for name, unit in (("--elevator", "DEG"), ("--throttle", "SHARE"), ("--rudder", "DEG")):
        multisine.add_argument(name, type=options.positive, default=0.0, metavar=unit, help="greatest excursion")
    multisine.add_argument("--period", type=options.positive, required=True, metavar="S", help="of the lowest sine")
    multisine.add_argument("--low", type=options.positive, required=True, metavar="HZ", help="of the band")
    multisine.add_argument("--high", type=options.positive, required=True, metavar="HZ", help="of the band")
    _add_pacing(multisine)


def _add_single(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("channel", choices=tuple(CHANNELS), metavar="CHANNEL", help=", ".join(CHANNELS))
    parser.add_argument(
        "--amplitude", type=options.positive, required=True, metavar="A", help="deg, or fraction of throttle"
    )


def _add_pacing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--settle", type=options.not_negative, default=1.0, metavar="S", help="pause before and after (default: 1)"
    )
    parser.add_argument("--repeats", type=int, default=1, metavar="N", help="number of repetitions (default: 1)")
    parser.add_argument(
        "--loops", choices=("frozen", "active"), default="frozen", help="loops during the input: frozen or active"
    )


def prepare(chosen: argparse.Namespace) -> None:
    """Check the input before the vehicle is contacted.

    Raises:
        InputError: invalid input.
    """
    if chosen.verb == "excite":
        chosen.requested = excitation_of(chosen)


def excitation_of(chosen: argparse.Namespace) -> Excitation:
    """Build the input from the command line.

    Raises:
        InputError: invalid input; the message has the reason.
    """
    requested = _multisine(chosen) if chosen.shape == "multisine" else _single(chosen)
    requested = requested._replace(loops=int(chosen.loops == "active"))
    refusal = check_excitation(requested)
    if refusal:
        raise InputError(refusal)
    return requested


def _single(chosen: argparse.Namespace) -> Excitation:
    channel = CHANNELS[chosen.channel]
    amplitude = chosen.amplitude if channel == Channel.THROTTLE else math.radians(chosen.amplitude)
    if chosen.shape in STEPS:
        return Excitation(channel, STEPS[chosen.shape], amplitude, chosen.width, chosen.settle, chosen.repeats)
    shape, band = SWEEPS[chosen.shape], (chosen.start, chosen.end)
    return Excitation(channel, shape, amplitude, chosen.duration, chosen.settle, chosen.repeats, *band)


def _multisine(chosen: argparse.Namespace) -> Excitation:
    requested = Excitation(
        Channel.ELEVATOR, Shape.MULTISINE, 0.0, chosen.period, chosen.settle, chosen.repeats, chosen.low, chosen.high
    )
    elevator, rudder = math.radians(chosen.elevator), math.radians(chosen.rudder)
    return on_channels(requested, dict(zip(Channel, (elevator, chosen.throttle, rudder), strict=True)))


def request(target: Target, requested: Excitation) -> CommandExchange:
    """Build the command that requests the input."""
    item: WireItem = encode_excitation(requested)
    return CommandExchange(target, item.command, (*item.params, item.x, item.y, item.z))


def run(session: Session) -> None:
    """Request the input."""
    session.run_exchange(request(session.target, session.chosen.requested), f"excite {session.chosen.shape}")
    session.done(f"excite {session.chosen.shape} accepted")


VERBS: dict[str, Verb] = {"excite": run}
