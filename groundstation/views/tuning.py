"""Report of designed gains, margins and comparison flights."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from avionics.vehicles import FlightVehicle
from groundstation.views import tables, wording
from sim_bridge.flight.tuning.autopilots import AxisLoop, Firmware
from sim_bridge.flight.tuning.cascade import PARTS, Design, Loop
from sim_bridge.flight.tuning.proof import Comparison, FlightQuality, Proof
from sim_bridge.tuning.margins import LIMITS

SHORT = {"throttle_error": "P", "throttle_integral": "I", "proportional": "P", "integral": "I", "damping": "D"}
DESIGNED_FOR = "airspeed"
"""a loop's key that is not a gain: the design airspeed (m/s)"""


def design_heading(vehicle: FlightVehicle, design: Design) -> Text:
    """Return vehicle and model of the design."""
    model = design.model
    about = f"on {model.origin}, flapping at {model.frequency:.2f} Hz"
    return Text.assemble((vehicle.title, "bold"), "\n", about)


def design_table(design: Design) -> RenderableType:
    """Show two rows per loop, before and after: margins, bandwidth, gains."""
    numbers = (("gain margin", "right"), ("phase margin", "right"), ("crossover", "right"), ("bandwidth", "right"))
    table = tables.plain_table(("", tables.GROUP), ("", ""), *numbers, ("gains", tables.SENTENCES))
    for before, after in zip(design.before, design.after, strict=True):
        table.add_row(Text(before.name, style="bold"), "before", *_loop_cells(before))
        table.add_row("", "after", *_loop_cells(after))
    notes = [Text(words, style="dim") for words in _notes(design)]
    return Group(Text(), table, *notes)


def _loop_cells(loop: Loop) -> tuple[str | Text, ...]:
    margins = loop.margins
    named = {key.split(".")[1]: value for key, value in loop.gains.items()}
    gains = "  ".join(f"{SHORT[name]} {value:.3g}" for name, value in named.items() if name != DESIGNED_FOR)
    if not margins.stable:
        return Text("unstable", style="red"), "", "", "", gains
    gain = _margin(f"{margins.gain_db:.1f} dB", margins.gain_db >= LIMITS.gain_margin_db, margins.gain_db)
    phase = _margin(wording.angle(margins.phase, ".0f"), margins.phase >= LIMITS.phase_margin, margins.phase)
    return gain, phase, f"{margins.crossover:.2f} rad/s", f"{loop.bandwidth:.2f} rad/s", gains


def axes_table(firmware: Firmware, loops: Sequence[AxisLoop]) -> RenderableType:
    """Show a row per axis of another autopilot: margins, bandwidth, gains, travel."""
    numbers = (("gain margin", "right"), ("phase margin", "right"), ("crossover", "right"), ("bandwidth", "right"))
    table = tables.plain_table(("", tables.GROUP), *numbers, ("gains", tables.SENTENCES))
    for loop in loops:
        margins = loop.margins
        gains = "  ".join(f"{name} {value:.3g}" for name, value in loop.gains.items())
        table.add_row(
            Text(loop.name, style="bold"),
            _margin(f"{margins.gain_db:.1f} dB", True, margins.gain_db),
            _margin(wording.angle(margins.phase, ".0f"), True, margins.phase),
            f"{margins.crossover:.2f} rad/s",
            f"{loop.bandwidth:.2f} rad/s",
            gains,
        )
    travels = ", ".join(f"{loop.name} {wording.angle(loop.travel, '.0f')}" for loop in loops)
    notes = [
        f"attitude loops of {firmware.title}, cut at the surface; not flown",
        f"surface at full output: {travels}",
    ]
    return Group(Text(), table, *(Text(words, style="dim") for words in notes))


def _margin(words: str, kept: bool, value: float) -> Text:
    if not math.isfinite(value):
        return Text("any")
    return Text(words if kept else f"{words} !", style="" if kept else "red")


def _notes(design: Design) -> list[str]:
    asked = f"at least {LIMITS.gain_margin_db:g} dB and {wording.angle(LIMITS.phase_margin, '.0f')}"
    notes = [f"every loop: {asked}, ! falls short; bandwidth: -3 dB from setpoint to response"]
    for before, after in zip(design.before, design.after, strict=True):
        for key, value in after.gains.items():
            if key.endswith(f".{DESIGNED_FOR}"):
                speeds = f"{before.gains[key]:.3g} m/s before, {value:.3g} m/s after"
                notes.append(f"gains of {after.name} are for {speeds}, and go with the dynamic pressure")
    missing = [part.name for part in PARTS if part.name not in {loop.name for loop in design.after}]
    if missing:
        notes.append(f"not designed, the model lacks their motion: {', '.join(missing)}")
    return notes


def proof_table(proof: Proof) -> RenderableType:
    """Show the same flight with the gains before and after."""
    table = tables.plain_table(("", ""), ("before", "right"), ("after", "right"), ("", tables.SENTENCES))
    before, after = (_flight_cells(flight) for flight in proof)
    for (label, one, note), (_, other, _) in zip(before, after, strict=True):
        table.add_row(label, one, other, Text(note, style="dim"))
    flight = proof.after
    title = f"flown in gusts, {flight.completed_legs} holds, {flight.airtime:.0f} s measured; RMS"
    return Group(Text(), Text(title, style="dim"), table)


def _flight_cells(flight: FlightQuality) -> list[tuple[str, str, str]]:
    degrees = {
        "heading": (flight.heading_rms, "course over ground against its setpoint"),
        "pitch": (flight.pitch_rms, "against its setpoint, as the loop sees it"),
        "rocking": (flight.roll_rms, "bank about its mean"),
    }
    rates = {"elevator": flight.elevator_rate, "rudder": flight.rudder_rate}
    rows = [("altitude", f"{flight.altitude_rms:.2f} m", "true altitude against its setpoint")]
    rows += [(name, wording.angle(value, ".1f"), note) for name, (value, note) in degrees.items()]
    rows += [
        (name, f"{wording.angle(value, '.0f')}/s", "rate of the command: effort") for name, value in rates.items()
    ]
    rows += [("throttle", f"{flight.throttle_rms:.3f}", "about its mean: effort")]
    rows += [("power", f"{flight.power:.1f} W", "mean")]
    return [*rows, ("ground", "touched" if flight.touched else "clear", "")]


def comparison_line(proof: Proof) -> Text:
    """Return one line on whether the new gains perform better."""
    before, after = proof
    if before.touched != after.touched:
        reason = f"it touched the ground with the gains {'after' if after.touched else 'before'}"
    elif before.completed_legs != after.completed_legs:
        reason = f"{after.completed_legs} of the holds completed, {before.completed_legs} before"
    else:
        reason = (
            f"errors {proof.error_ratio:.2f} times those before (geometric mean of altitude, heading, pitch, roll)"
        )
    words, style = {
        Comparison.BETTER: ("flies better", "green"),
        Comparison.SAME: ("flies the same", ""),
        Comparison.WORSE: ("flies worse", "red"),
    }[proof.comparison]
    return Text.assemble("\n", (words, style), f": {reason}")


def withheld_line(words: Sequence[str]) -> Text:
    """Return the line that no file was written because the flight got worse; ``words`` is the command line."""
    return Text(f"\nnothing was written: wingbeat tune {shlex.join(words)} --force writes gains that fly worse")


def written_line(written: Sequence[Path]) -> Text:
    """Return the line with the paths of the files."""
    return Text(f"\nwritten {' and '.join(str(path) for path in written)}")


def unwritten_line(words: Sequence[str], effect: str = "DIR writes a vehicle with these gains") -> Text:
    """Return the line that the gains were not stored, and the ``tune`` arguments ``words`` that store them."""
    return Text(f"\nnothing was written; wingbeat tune {shlex.join(words)} --out {effect}")
