"""Identification inputs in a mission file, and their validation.

The validation also applies to inputs from the link.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from avionics.guidance import excitation as excitation_input
from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.missions.keys import Key, choice, number, numbers
from wingbeat.errors import InputError

DEGREES = Key("deg", 0.1, 45.0, math.radians)
SHARE = Key("-", 0.005, 0.5)
AMPLITUDES: dict[Channel, tuple[str, Key]] = {
    Channel.ELEVATOR: ("amplitude_deg", DEGREES),
    Channel.THROTTLE: ("amplitude", SHARE),
    Channel.RUDDER: ("amplitude_deg", DEGREES),
}
BESIDE = {"elevator_deg": Channel.ELEVATOR, "throttle": Channel.THROTTLE, "rudder_deg": Channel.RUDDER}
"""amplitudes of a multisine"""
PACING = {"settle": Key("s", 0.0, 30.0), "repeats": Key("-", 1, 100)}
BAND_HZ = Key("Hz", 0.01, 20.0)
PULSE = {"width": Key("s", 0.02, 10.0), **PACING}
SWEEP = {"start": BAND_HZ, "end": BAND_HZ, "duration": Key("s", 1.0, 300.0), **PACING}
MULTISINE = {"period": Key("s", 1.0, 300.0), "low": BAND_HZ, "high": BAND_HZ, **PACING}
SHAPES = {
    "doublet": Shape.DOUBLET,
    "3211": Shape.MULTISTEP_3211,
    "sweep": Shape.LINEAR_SWEEP,
    "log_sweep": Shape.LOGARITHMIC_SWEEP,
    "multisine": Shape.MULTISINE,
}
LOOPS = {"frozen": 0, "active": 1}
LEAST_HARMONICS = 2
"""minimum harmonics of a multisine on each channel: a single one is a sine"""
MOST_HARMONICS = 60
"""maximum harmonics of a multisine on all channels, because each costs a sine per tick"""


def read_excitation(table: Mapping[str, Any]) -> Excitation:
    """Read the identification input of an ``[[item]]``.

    Raises:
        InputError: the text names the key and its range.
    """
    shape = choice(table, "shape", SHAPES)
    loops = choice({"loops": "frozen", **table}, "loops", LOOPS)
    read = _multisine if shape == Shape.MULTISINE else _single
    requested = read(table, shape)._replace(loops=loops)
    refusal = check_excitation(requested)
    if refusal:
        raise InputError(refusal)
    return requested


def _single(table: Mapping[str, Any], shape: Shape) -> Excitation:
    channel = choice(table, "channel", {channel.name.lower(): channel for channel in Channel})
    name, key = AMPLITUDES[channel]
    keys = SWEEP if shape in excitation_input.SWEEPS else PULSE
    entries = numbers(table, {name: key, **keys}, ("kind", "channel", "shape", "loops"))
    width = entries["duration"] if "duration" in entries else entries["width"]
    band = (entries.get("start", 0.0), entries.get("end", 0.0))
    return Excitation(channel, shape, entries[name], width, entries["settle"], _repeats(entries), *band)


def _multisine(table: Mapping[str, Any], shape: Shape) -> Excitation:
    entries = numbers(table, MULTISINE, ("kind", "shape", "loops", *BESIDE))
    amplitudes = {
        channel: number(table, name, AMPLITUDES[channel][1]) for name, channel in BESIDE.items() if name in table
    }
    if not amplitudes:
        raise InputError(f"a multisine needs {', '.join(BESIDE)}, one or more of them")
    requested = Excitation(
        Channel.ELEVATOR, shape, 0.0, entries["period"], entries["settle"], _repeats(entries),
        entries["low"], entries["high"],
    )  # fmt: skip
    return on_channels(requested, amplitudes)


def on_channels(requested: Excitation, amplitudes: Mapping[Channel, float]) -> Excitation:
    """Return ``requested`` with these amplitudes (rad, -, rad).

    The channel of the input is the first one used.
    """
    own = min((channel for channel, amplitude in amplitudes.items() if amplitude), default=requested.channel)
    elevator, throttle, rudder = (0.0 if c == own else amplitudes.get(c, 0.0) for c in Channel)
    return requested._replace(
        channel=own, amplitude=amplitudes.get(own, 0.0), other_amplitudes=(elevator, throttle, rudder)
    )


def _repeats(entries: Mapping[str, float]) -> int:
    if entries["repeats"] != int(entries["repeats"]):
        raise InputError(f"repeats must be a whole number, not {entries['repeats']:g}")
    return int(entries["repeats"])


def check_excitation(requested: Excitation | None) -> str:
    """Return why an identification input is rejected; empty if accepted.

    For an accepted input the phases are computed and cached.
    """
    if requested is None:
        return "EXCITE without an excitation"
    for word, value, key in _numbers_of(requested):
        if not key.low * (1.0 - 1e-6) <= value <= key.high * (1.0 + 1e-6):
            return f"{word} = {value:g} is outside {key.low:g} to {key.high:g} {key.unit}".removesuffix(" -")
    refusal = _amplitude_refusal(requested) or (
        _multisine_refusal(requested) if requested.shape == Shape.MULTISINE else ""
    )
    if not refusal:
        excitation_input.spectrum(requested)
    return refusal


def _numbers_of(requested: Excitation) -> list[tuple[str, float, Key]]:
    """Return name, value and range of the numbers that the shape uses."""
    entries = [
        ("settle", requested.settle, PACING["settle"]),
        ("repeats", float(requested.repeats), PACING["repeats"]),
    ]
    if requested.shape in excitation_input.SEGMENTS:
        return [("width", requested.width, PULSE["width"]), *entries]
    words = ("duration", "start", "end") if requested.shape in excitation_input.SWEEPS else ("period", "low", "high")
    keys = SWEEP | MULTISINE
    values = (requested.width, requested.low, requested.high)
    return [*((word, value, keys[word]) for word, value in zip(words, values, strict=True)), *entries]


def _amplitude_refusal(requested: Excitation) -> str:
    if any(requested.other_amplitudes) and requested.shape != Shape.MULTISINE:
        return "only a multisine is flown on several channels at once"
    for channel, amplitude in zip(Channel, requested.amplitudes(), strict=True):
        name, key = AMPLITUDES[channel]
        low, high = key.si(key.low), key.si(key.high)
        unused = channel != requested.channel and amplitude == 0.0
        if not unused and not low * (1.0 - 1e-6) <= amplitude <= high * (1.0 + 1e-6):
            outside = f"{channel.name.lower()}: {name} is outside {key.low:g} to {key.high:g} {key.unit}"
            return outside.removesuffix(" -")
    return ""


def _multisine_refusal(requested: Excitation) -> str:
    first, last = excitation_input.harmonics(requested)
    channels = sum(amplitude != 0.0 for amplitude in requested.amplitudes())
    count = last - first + 1
    if not channels * LEAST_HARMONICS <= count <= MOST_HARMONICS:
        return (
            f"a band from {requested.low:g} to {requested.high:g} Hz holds {max(count, 0)} harmonics"
            f" of {requested.width:g} s;"
            f" {channels * LEAST_HARMONICS} to {MOST_HARMONICS} are flown"
        )
    return ""
