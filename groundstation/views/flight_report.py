"""Report of a flight: log, metrics, identified values."""

from __future__ import annotations

import math
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views import wording
from logs.names import LATEST, RECORDINGS
from logs.summary import AltitudeHold, EstimateError, FlightSummary, Touchdown


def next_lines(log: Path) -> Text:
    """Return the next three commands of a flight recorded to ``log``."""
    file = LATEST if log.parent == RECORDINGS else str(log)
    commands = (
        f"wingbeat log view {file} --open",
        f"wingbeat identify {file} --report report.html",
        "wingbeat gcs udpout:127.0.0.1:14550",
    )
    label = "next".ljust(12)
    beside = ("\n" + " " * 15 + "beside: wingbeat fly --speed 1 --gcs udpin:127.0.0.1:14550", "dim")
    return Text.assemble((label, "dim"), ("\n" + " " * 12).join(commands), beside)


def log_line(path: Path) -> Text:
    """Return the line with the path of the log."""
    return Text.assemble(("log".ljust(12), "dim"), str(path), (f"   {wording.size(path.stat().st_size)}", "dim"))


def missed_line(fault: str, end: float) -> Text:
    """Return the notice of a fault with a time after the ``end`` (s since boot) of the flight."""
    return Text.assemble(("fault".ljust(12), "dim"), f"{fault} did not occur: the flight ended at {end:.1f} s")


def flight_metrics_table(summary: FlightSummary) -> RenderableType:
    """Return the flight metrics as a table without missing data."""
    table = Table.grid(padding=(0, 3))
    table.add_column(style="dim", min_width=9)
    table.add_column()
    rows = [
        ("flight", _flight(summary)),
        ("hold", _level_cells(summary.hold)),
        ("drive", _drive(summary)),
        ("estimate", _estimate(summary.estimate)),
        ("touchdown", _touchdown(summary.touchdown)),
        ("landed", "" if summary.landed is None else f"at {summary.landed:.1f} s, detected by the flight computer"),
    ]
    for label, text in rows:
        if text:
            table.add_row(label, text)
    note = (
        "" if summary.against_truth else "errors relative to the estimate of the flight computer: no truth in the log"
    )
    return Group(table, Text(note, style="dim")) if note else table


def _flight(summary: FlightSummary) -> str:
    if summary.airtime is None:
        return "never left the ground"
    parts = [
        f"{summary.airtime:.1f} s in the air",
        "" if summary.distance is None else f"{summary.distance:.0f} m",
        "" if summary.highest is None else f"up to {summary.highest:.1f} m",
        "" if summary.airspeed is None else f"{summary.airspeed:.2f} m/s mean airspeed",
    ]
    return _joined(parts)


def _level_cells(level_flight: AltitudeHold | None) -> str:
    if level_flight is None:
        return ""
    return _joined(
        [
            f"altitude {level_flight.altitude_rms:.2f} m RMS",
            f"heading {math.degrees(level_flight.heading_rms):.1f}° RMS",
            f"over {level_flight.duration:.1f} s",
        ]
    )


def _drive(summary: FlightSummary) -> str:
    return _joined(
        [
            "" if summary.frequency is None else f"flapping at {summary.frequency:.2f} Hz",
            "" if summary.power is None else f"{summary.power:.1f} W mean",
            "" if summary.energy is None else f"{summary.energy:.0f} J used",
        ]
    )


def _estimate(error: EstimateError | None) -> str:
    if error is None:
        return ""
    angles = (math.degrees(error.roll), math.degrees(error.pitch), math.degrees(error.yaw))
    return _joined(
        [
            f"roll {angles[0]:.2f}°",
            f"pitch {angles[1]:.2f}°",
            f"yaw {angles[2]:.2f}°",
            f"altitude {error.altitude:.2f} m",
            f"{error.airspeed:.2f} m/s RMS",
        ],
        "  ",
    )


def _touchdown(touchdown: Touchdown | None) -> str:
    if touchdown is None:
        return ""
    return _joined(
        [
            f"at {touchdown.time:.1f} s",
            f"sink {touchdown.sink:.2f} m/s",
            f"speed {touchdown.speed:.1f} m/s",
            f"bank {wording.angle(touchdown.bank)}",
            f"pitch {wording.angle(touchdown.pitch)}",
        ]
    )


def _joined(parts: list[str], gap: str = "   ") -> str:
    return gap.join(part for part in parts if part)
