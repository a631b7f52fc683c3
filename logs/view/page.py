"""The HTML page of a flight, without network access."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from logs.attached import simulated_vehicle
from logs.info import vehicle
from logs.outline import shape_of
from logs.pages.render import AXES, CONTROLS, UPLOT, UPLOT_STYLE, render, write_text
from logs.reader import Log
from logs.scene import PLAIN_BIRD, Shape, outlines
from logs.view.motion import Motion, motion_of
from logs.view.packing import Packer
from logs.view.panels import DEGREES, PANELS, TIME_STEP, WING_ANGLE, Series, bands
from logs.view.tables import Progress, Tables, read_tables, true_state
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError

FOLDER = Path(__file__).parent
SCRIPTS = ("decode.js", "scene.js", "plots.js", "page.js")
PLACE_STEP = 1e-3
"""m; of packed positions"""
READING, DRAWING = 0.7, 0.2
"""Shares of the work, for the progress."""


class Page(NamedTuple):
    """Properties of a written page."""

    path: Path
    bytes: int
    panels: list[str]
    """titles"""
    events: int
    missing: list[str]
    """missing data, as text"""


def write_page(log: Log, path: Path, progress: Progress = lambda done, note: None) -> Page:
    """Write a flight as a page to ``path``, which must not exist.

    Raises:
        InputError: the file exists or cannot be written, or a part of the log is damaged or has no data to show.
    """
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    tables = read_tables(log, lambda done, note: progress(READING * done, note))
    packer = Packer()
    progress(READING, "drawing")
    document = flight_document(log, tables, packer)
    progress(READING + DRAWING, "writing")
    size = write_text(path, filled(document, packer.text()))
    titles = [panel["title"] for panel in document["panels"]]
    return Page(path, size, titles, len(document["events"]), document["missing"])


def flight_document(log: Log, tables: Tables, packer: Packer) -> dict[str, Any]:
    """Return the data of a page besides the numbers in ``packer``; times in s since boot.

    Keys: ``vehicle``, ``file``, ``date`` (ISO, of the first message), ``start``, ``end``, ``damage`` and ``missing``
    (lines), ``events`` (``time``, ``severity``, ``source``, ``text``), ``modes`` and ``stages`` (start, end, label),
    ``panels`` (see `Series.panel`), ``motion`` (see `_motion`), ``shape`` (see `_drawn`).

    Raises:
        InputError: a part of the log is damaged, or it has no data to show.
    """
    if not tables:
        raise InputError(f"{log.path} has no topics for a page, such as /attitude/ahrs")
    start, end = (log.start_ns - log.boot_ns) * 1e-9, (log.end_ns - log.boot_ns) * 1e-9
    motion = motion_of(tables)
    shape, known = shape_in(log)
    panels = _panels(Series(tables, packer), motion, drawn := _motion(motion, packer))
    modes = bands(tables, "mode", end)
    return {
        "vehicle": vehicle(log) or "unknown vehicle",
        "file": log.path.name,
        "date": datetime.fromtimestamp(log.start_ns * 1e-9, UTC).isoformat(timespec="seconds"),
        "start": start,
        "end": max(end, start + 1e-3),
        "damage": list(log.damage),
        "missing": _missing(tables, motion, panels, bool(modes), known),
        "events": _events(log),
        "modes": modes,
        "stages": bands(tables, "stage", end),
        "panels": panels,
        "motion": drawn,
        "shape": _drawn(shape),
    }


def filled(document: dict[str, Any], numbers: str) -> str:
    """Return the HTML of the page."""
    title = f"{document['vehicle']} – {document['file']}"
    scripts, styles = (
        [AXES, UPLOT, *(FOLDER / name for name in SCRIPTS)],
        [UPLOT_STYLE, CONTROLS, FOLDER / "page.css"],
    )
    return render("flight.html", styles, scripts, (FOLDER,), title=title, flight=document, numbers=numbers)


def _panels(series: Series, motion: Motion, drawn: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the panels with the wing angles of the drawn vehicle, which are packed once."""
    panels = series.panels()
    for panel in panels:
        if panel["title"] == WING_ANGLE and motion.wings is not None:
            packed = drawn["wings"]
            panel["lines"] = [
                {"name": side, "style": side, "time": packed["time"], "low": _turned(flap), "high": None}
                for side, flap in zip(("left", "right"), packed["flap"], strict=True)
            ]
    return [panel for panel in panels if panel["lines"]]


def _turned(packed: dict[str, float]) -> dict[str, float]:
    """Return a packed column of rad scaled to degrees."""
    return packed | {"step": packed["step"] * DEGREES, "middle": packed["middle"] * DEGREES}


def _motion(motion: Motion, packer: Packer) -> dict[str, Any]:
    """Keys: ``body`` (``time``, ``place``, ``quaternion``, ``tail``), ``wings`` (``time``, ``flap``, ``twist``),
    ``estimated`` (``time``, ``place``); each None where it is not known.
    """
    body, wings, track = motion.body, motion.wings, motion.estimated
    return {
        "body": body
        and {
            "time": packer.add(body.time, TIME_STEP),
            "place": [packer.add(row, PLACE_STEP) for row in body.place],
            "quaternion": [packer.add(row) for row in body.quaternion],
            "tail": [packer.add(row) for row in body.tail],
        },
        "wings": wings
        and {
            "time": packer.add(wings.time, TIME_STEP),
            "flap": [packer.add(row) for row in wings.flap],
            "twist": [packer.add(row) for row in wings.twist],
        },
        "estimated": track
        and {"time": packer.add(track[0], TIME_STEP), "place": [packer.add(row, PLACE_STEP) for row in track[1]]},
    }


def shape_in(log: Log) -> tuple[Shape, bool]:
    """Return the outline of the simulated vehicle, else of a vehicle of that name, and whether it is known."""
    for load in (simulated_vehicle, lambda log: load_vehicle(vehicle(log) or "")):
        # A vehicle file of another version, or an unknown name, must not prevent the display of a flight.
        with contextlib.suppress(InputError):
            found = load(log)
            if found is not None:
                return shape_of(found), True
    return PLAIN_BIRD, False


def _drawn(shape: Shape) -> dict[str, Any]:
    """Keys: ``semispan``, ``body`` (radius), ``nose``, ``tail``, ``hinge`` (m; left), and ``plates`` by frame."""
    return {
        "semispan": shape.semispan,
        "body": shape.body_radius,
        "nose": shape.nose,
        "tail": shape.tail,
        "hinge": shape.hinge,
        "plates": outlines(shape),
    }


def _events(log: Log) -> list[dict[str, Any]]:
    return [
        {"time": time_us * 1e-6, "severity": int(severity), "source": source, "text": text}
        for time_us, severity, source, text in log.events()
    ]


def _missing(tables: Tables, motion: Motion, panels: list[dict[str, Any]], modes: bool, known: bool) -> list[str]:
    """Return the data missing in the log, as text."""
    shown = {panel["title"] for panel in panels}
    out = ["truth"] if true_state(tables) is None else []
    out += motion.missing
    out += [panel.title.lower() for panel in PANELS if panel.title not in shown and panel.title != WING_ANGLE]
    out += [] if modes else ["modes"]
    out += [] if known or motion.body is None else ["the vehicle's shape (a generic vehicle is drawn)"]
    return list(dict.fromkeys(out))
