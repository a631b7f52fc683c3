"""Pictures of vortex lattice validation: wake (SVG) and lift (page) of Yeo's wing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from groundstation.views.wake_picture import wake_svg
from logs.pages.document import DASHED, MEASURED, MODEL, OTHER, Chapter, Plot, Series
from logs.pages.render import write_page
from sim_bridge.validation.yeo import STEPS, measured_lift, modelled_lift, section
from sim_bridge.validation.yeo_lattice import STROKES, lattice_stroke, wake_course, wing
from wingbeat.errors import InputError

WAKE, LIFT = "lattice_wake.svg", "lattice_lift.html"


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
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}") from error
    plot = lift_plot()
    write_page(paths[1], plot.title, (), (Chapter("Lift", plots=(plot._replace(title=""),)),))
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
