"""Spatial kinematics over a stroke (Grauer V.B, Fig. 8): what each section of a wing meets, and a picture of it.

The angle runs around the stroke, the radius from root to tip: phase 0 is wings level, a quarter wings up.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.prescribed import Wing, WingMotion, section_velocity
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

QUARTER_CHORD = 0.25
DENSITY, VISCOSITY = 1.225, 1.789e-5
"""kg/m^3, Pa s; air of the standard atmosphere at sea level"""
LABEL_BOX = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1.5}


class SpatialKinematics(NamedTuple):
    """Fields over span and stroke of one wing, at its quarter chords; each field (n, N): section, instant."""

    eta: Floats
    """(n,) -; span from the hinge over the semispan"""
    phase: Floats
    """(N,) -; of the stroke"""
    speed: Floats
    """m/s"""
    angle_of_attack: Floats
    """rad; Grauer Eq. 10"""
    reduced_frequency: Floats
    """-; Grauer Eq. 11 with the first power of the speed; infinite for a section at rest"""
    reynolds: Floats
    """-; Grauer Eq. 12"""


def spatial_kinematics(
    wing: Wing, motion: WingMotion, density: float = DENSITY, viscosity: float = VISCOSITY
) -> SpatialKinematics:
    """Compute speed, angle of attack, reduced frequency and Reynolds number of the right wing (Grauer Eq. 9 to 12).

    Args:
        wing: its sections.
        motion: prescribed or recorded.
        density: kg/m^3. viscosity: Pa s.
    """
    velocity = section_velocity(wing, motion, QUARTER_CHORD)
    speed = np.sqrt(sum(np.square(component) for component in velocity)).T
    chord = wing.chord[:, None]
    with np.errstate(divide="ignore"):
        frequency = np.pi * motion.frequency * chord / speed
    semispan = wing.span[-1] + 0.5 * wing.width[-1]
    return SpatialKinematics(
        wing.span / semispan,
        motion.phase,
        speed,
        np.arctan2(velocity.down, velocity.along).T,
        frequency,
        density * chord * speed / viscosity,
    )


def draw_spatial(kinematics: SpatialKinematics, path: Path, title: str) -> None:
    """Draw the four fields as polar plots into a PNG.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError(f"drawing needs matplotlib: {sys.executable} -m pip install matplotlib") from None
    figure = Figure(figsize=(10.5, 9.4), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=14)
    axes = figure.subplots(2, 2, subplot_kw={"projection": "polar"})
    fields = (
        (kinematics.speed, "speed", "m/s", "viridis"),
        (kinematics.angle_of_attack, "angle of attack", "rad", "RdBu_r"),
        (kinematics.reduced_frequency, "reduced frequency", "-", "viridis"),
        (kinematics.reynolds / 1000.0, "Reynolds number", "thousands", "viridis"),
    )
    for polar, (values, name, unit, colours) in zip(axes.flat, fields, strict=True):
        _draw_field(figure, polar, kinematics, (values, name, unit, colours))
    figure.savefig(path, dpi=110)


def _draw_field(figure: Any, polar: Any, kinematics: SpatialKinematics, field: tuple[Floats, str, str, str]) -> None:
    values, name, unit, colours = field
    shown = np.where(np.isfinite(values), values, np.nan)
    lowest, highest = float(np.nanmin(shown)), float(np.nanmax(shown))
    span = max(abs(lowest), abs(highest)) if colours == "RdBu_r" else None
    # Closed around the stroke, without a gap between the last instant and the first.
    phase = 2.0 * np.pi * np.append(kinematics.phase, kinematics.phase[0] + 1.0)
    closed = np.column_stack((shown, shown[:, 0]))
    drawn = polar.pcolormesh(
        phase,
        kinematics.eta,
        closed,
        cmap=colours,
        shading="gouraud",
        vmin=lowest if span is None else -span,
        vmax=highest if span is None else span,
    )
    polar.set_ylim(0.0, 1.0)
    polar.set_yticks([0.5, 1.0], ["0.5", "tip"], fontsize=9, bbox=LABEL_BOX)
    polar.set_xticks(np.arange(4) * np.pi / 2, ["0 T\nlevel", "1/4 T, wings up", "1/2 T\nlevel", "3/4 T, wings down"])
    polar.grid(color="0.6", linewidth=0.5)
    polar.set_title(f"{name}: {lowest:.3g} to {highest:.3g} {'' if unit == '-' else unit}".rstrip(), pad=14)
    figure.colorbar(drawn, ax=polar, shrink=0.75, pad=0.12, label=name if unit == "-" else f"{name} ({unit})")
