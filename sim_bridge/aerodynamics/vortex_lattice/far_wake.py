"""Induced drag in the Trefftz plane of a steady, straight wake.

Far behind, the wake is a row of endless filaments. A strip whose wake has the strength G and the width l across them
bears the drag ``rho G d . (v x l) / 2`` in their direction d, v what all of them induce in the middle of the strip
(Katz and Plotkin 2001, Eq. 8.146 for a plane wake; Munk 1921). Where the bound vortices lie is no part of it. On
strips of equal width it is what the legs bear near by; on others it leaves out what coarse panels miss of the leading
edge's suction. It is too small by the first order of the strips' width, as the near field's is.
"""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice
from sim_bridge.aerodynamics.vortex_lattice.influence import reflections
from sim_bridge.aerodynamics.vortex_lattice.steady import CORE, direction, edge_nodes, mean_chords, trailing_panels
from sim_bridge.vectors import Floats, Integers
from wingbeat.errors import InputError

ALONG = 1e-9
"""-; sine of the angle to a mirror plane up to which a wake runs along it"""


def far_drag(
    lattice: Lattice,
    strengths: Floats,
    along: Floats,
    density: float,
    symmetric: bool = False,
    ground: float | None = None,
) -> Floats:
    """Induced drag in N (S,) of the strips without mirror images: the force in the direction ``along``.

    Args:
        strengths: (N,) m^2/s; of the rings, see `SteadyFlow`.
        along: (3,); direction of the wake, of any length.
        density: kg/m^3.
        symmetric: whether the lattice is one half and has a mirror image in y = 0.
        ground: m; height z of a plane that no air crosses.

    Raises:
        InputError: ``along`` has no direction, or leads through a plane that mirrors.
    """
    way, images = direction(along), reflections(symmetric, ground)
    _check_mirrors(way, images)
    left, right = _edge_indices(lattice)
    flat = edge_nodes(lattice.layout, lattice.nodes)
    flat = flat - way[:, None] * (way @ flat)
    middle, width = 0.5 * (flat[:, left] + flat[:, right]), flat[:, right] - flat[:, left]
    shed = strengths[trailing_panels(lattice.layout)]
    filaments = np.zeros(flat.shape[1])
    np.add.at(filaments, right, shed)
    np.subtract.at(filaments, left, shed)
    cores = np.repeat(CORE * mean_chords(lattice), lattice.layout.columns + 1)
    wash = _induced(flat, filaments, cores, way, images, middle)
    return np.asarray(0.5 * density * shed * (way @ np.cross(wash, width, axis=0)))


def _check_mirrors(way: Floats, images: Floats) -> None:
    for image in images:
        if np.max(np.abs(image[:3] @ way - way)) > ALONG:
            told = ", ".join(f"{x:.3g}" for x in way)
            raise InputError(f"the wake along ({told}) leads through a plane that mirrors, not along it")


def _edge_indices(lattice: Lattice) -> tuple[Integers, Integers]:
    """(S,) each: nodes of the trailing edges left and right of each strip."""
    firsts, columns = lattice.layout.first_edge.tolist(), lattice.layout.columns.tolist()
    left = np.concatenate([np.arange(first, first + n) for first, n in zip(firsts, columns, strict=True)])
    return left, left + 1


def _induced(places: Floats, strengths: Floats, cores: Floats, way: Floats, images: Floats, points: Floats) -> Floats:
    """(3, P) m/s at ``points`` by endless filaments through ``places`` (3, E) along ``way``, and their images."""
    solved = np.zeros_like(points)
    for image in images:
        seen = image[:3] @ points + image[3][:, None]
        apart = seen[:, :, None] - places[:, None, :]
        share = strengths / (2.0 * math.pi) / ((apart * apart).sum(axis=0) + cores * cores)
        solved += image[:3].T @ np.cross(way, np.einsum("cpe,pe->cp", apart, share), axisa=0, axisb=0, axisc=0)
    return solved
