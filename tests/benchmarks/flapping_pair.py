"""A flapping pair of flat wings as PteraSoftware wants it: geometry axes aft, right and up, angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import pterasoftware as ps


class Section(NamedTuple):
    """A cross-section of the right wing."""

    span: float
    """m; from the root"""
    leading: float
    """m; the leading edge behind the root's"""
    chord: float
    """m"""


class Flapping(NamedTuple):
    """How the wings beat."""

    mean: float
    """rad"""
    amplitude: float
    """rad"""
    period: float
    """s"""
    shape: str | Callable[[float], float] = "sine"
    """of the phase in rad: from 0 back to 0 with an amplitude of 1"""


ROOT = 1e-3
"""m; of the wings from the middle plane, so that each turns by itself"""


def wing(sections: list[Section], flapping: Flapping, chordwise: int, mirrored: bool) -> ps.geometry.wing.Wing:
    """One of the pair, with one panel across from section to section."""
    before = [sections[0], *sections[:-1]]
    crossing = [
        ps.geometry.wing_cross_section.WingCrossSection(
            airfoil=ps.geometry.airfoil.Airfoil(name="naca0004"),
            num_spanwise_panels=None if one is sections[-1] else 1,
            chord=one.chord,
            Lp_Wcsp_Lpp=(one.leading - last.leading, one.span - last.span, 0.0),
            spanwise_spacing=None if one is sections[-1] else "uniform",
        )
        for last, one in zip(before, sections, strict=True)
    ]
    plane = {"symmetryNormal_G": (0.0, 1.0, 0.0), "symmetryPoint_G_Cg": (0.0, 0.0, 0.0)} if mirrored else {}
    return ps.geometry.wing.Wing(
        crossing, Ler_Gs_Cgs=(0.0, ROOT, 0.0), angles_Gs_to_Wn_ixyz=(math.degrees(flapping.mean), 0.0, 0.0),
        mirror_only=mirrored, num_chordwise_panels=chordwise, chordwise_spacing="uniform", **plane,
    )  # fmt: skip


def movement(
    sections: list[Section], flapping: Flapping, chordwise: int, weight: float = 0.0
) -> ps.movements.airplane_movement.AirplaneMovement:
    """The pair beating about its roots."""
    wings = [wing(sections, flapping, chordwise, mirrored) for mirrored in (False, True)]
    airplane = ps.geometry.airplane.Airplane(wings, weight=weight)
    still = ps.movements.wing_cross_section_movement.WingCrossSectionMovement
    beating = [
        ps.movements.wing_movement.WingMovement(
            one, [still(section) for section in one.wing_cross_sections],
            ampAngles_Gs_to_Wn_ixyz=(math.degrees(flapping.amplitude), 0.0, 0.0),
            periodAngles_Gs_to_Wn_ixyz=(flapping.period, 0.0, 0.0),
            spacingAngles_Gs_to_Wn_ixyz=(flapping.shape, "sine", "sine"),
        )
        for one in airplane.wings
    ]  # fmt: skip
    return ps.movements.airplane_movement.AirplaneMovement(airplane, beating)
