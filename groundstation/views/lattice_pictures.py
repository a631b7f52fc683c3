"""Pictures of vortex lattice validation: wake and lift of Yeo's wing."""

from __future__ import annotations

import html
from collections.abc import Callable
from pathlib import Path

import numpy as np

from groundstation.views.wake_picture import wake_svg
from logs.identification.report.document import DASHED, MEASURED, MODEL, OTHER, Plot, Series
from logs.identification.report.svg import Size, drawn
from sim_bridge.validation.yeo import STEPS, measured_lift, modelled_lift, section
from sim_bridge.validation.yeo_lattice import STROKES, lattice_stroke, wake_course, wing
from wingbeat.errors import InputError

WAKE, LIFT = "lattice_wake.svg", "lattice_lift.svg"
SIZE, HEAD, EDGE = Size(820.0, 380.0), 54.0, 12.0
"""px; plot width and height, height of title and legend, margin"""
COLOURS = {MEASURED: "#4a525e", MODEL: "#d55e00", OTHER: "#0072b2"}
"""Okabe and Ito: distinguishable with color vision deficiency"""
STYLE = (
    'text{font:11px system-ui,-apple-system,"Segoe UI",Roboto,"Liberation Sans",sans-serif;fill:#5b6572}'
    ".name,.key{fill:#1c2128}.key{font-size:13px}.title{font-size:16px;font-weight:600;fill:#1c2128}"
    "path{fill:none;stroke-width:1.8;stroke-linejoin:round}.grid{stroke:#e7eaee;stroke-width:1}"
    ".zero{stroke:#5b6572;stroke-width:1}.dashed{stroke-dasharray:6 4}"
    + "".join(f".{role}{{stroke:{colour}}}" for role, colour in COLOURS.items())
)


def draw_lattice(folder: Path, progress: Callable[[float], None]) -> list[Path]:
    """Draw both figures into new files of ``folder``, created if missing; ``progress`` gets the fraction.

    Raises:
        InputError: one of the files exists, or cannot be written.
    """
    paths = [folder / WAKE, folder / LIFT]
    for path in paths:
        if path.exists():
            raise InputError(f"{path} exists: it is not overwritten")
    course = wake_course(STROKES * STEPS, progress)
    title = "Wake of a flapping wing after three strokes: free vortex lattice (Yeo 2011: 2.9 m/s, 3.3 Hz)"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths[0].write_text(wake_svg(wing(), course[-1], title), encoding="utf-8")
        paths[1].write_text(_framed(lift_plot()), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}") from error
    return paths


def lift_plot() -> Plot:
    """Plot lift of both wings over a stroke: measured, by strip theory, and by the lattice with and without stall."""
    phase, lattice = np.arange(STEPS) / STEPS, lattice_stroke("prescribed")
    return Plot(
        "Lift of a flapping wing over a stroke (Yeo 2011)",
        "time since the stroke began, in strokes",
        "-",
        "lift of both wings",
        "N",
        (
            Series("measured", phase, measured_lift(), MEASURED),
            Series("strip theory", phase, modelled_lift(section("fixed")), OTHER),
            Series("vortex lattice, attached", phase, lattice.attached, MODEL, DASHED),
            Series("vortex lattice with stall", phase, lattice.corrected, MODEL),
        ),
    )


def _framed(plot: Plot) -> str:
    """Return the plot as a complete file with title and legend."""
    width, height = SIZE.width + 2.0 * EDGE, SIZE.height + HEAD + EDGE
    inner = drawn(plot, SIZE).replace("<svg ", f'<svg x="{EDGE:g}" y="{HEAD:g}" width="{SIZE.width:g}" ', 1)
    inner = inner.replace("<svg ", f'<svg height="{SIZE.height:g}" ', 1)
    title = html.escape(plot.title)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}"'
        f' height="{height:g}"><style>{STYLE}</style><rect width="{width:g}" height="{height:g}" fill="#fff"/>'
        f'<text class="title" x="{EDGE + 4:g}" y="24">{title}</text>{_key(plot)}{inner}</svg>\n'
    )


def _key(plot: Plot) -> str:
    parts, x = [], EDGE + 4.0
    for one in plot.series:
        parts.append(f'<path class="{one.role} {one.style}" d="M{x:g} 43h24"/>')
        parts.append(f'<text class="key" x="{x + 30:g}" y="47">{html.escape(one.label)}</text>')
        x += 56.0 + 7.0 * len(one.label)
    return "".join(parts)
