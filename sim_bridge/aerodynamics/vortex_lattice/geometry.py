"""Lifting surfaces divided into panels, with twist, taper, sweep, dihedral and camber.

Axes are right-handed, with the span from the left tip to the right and the chord from the leading edge back; a
panel's normal is chord times span, which is up on a wing that is not upside down, whether x points forward and z down
or x back and z up. The nodes of a surface are (rows + 1) by (columns + 1): rows along the chord, columns along the
span. All surfaces of a lattice lie in one table, one after another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.sections import FLAT, MeanLine
from sim_bridge.vectors import Floats, Integers
from wingbeat.errors import InputError

SMALLEST_AREA = 1e-9
"""-; share of the surface's mean panel below which a panel counts as having none"""


class Section(NamedTuple):
    """A wing section; axes x back, y right, z up."""

    leading_edge: tuple[float, float, float]
    """m"""
    chord: float
    """m"""
    twist: float = 0.0
    """rad; about the leading edge, leading edge up"""
    mean_line: MeanLine = FLAT


class Surface(NamedTuple):
    """A lifting surface between sections, from the left tip to the right."""

    name: str
    sections: tuple[Section, ...]
    rows: int
    """panels along the chord"""
    columns: tuple[int, ...]
    """panels along the span between each section and the next"""
    chordwise: str = "uniform"
    """spacing: "uniform", or "cosine", denser at the edges; spanwise likewise"""
    spanwise: str = "uniform"


class Layout(NamedTuple):
    """Indices of the surfaces in the tables of nodes, panels and trailing edges; each (surfaces,)."""

    rows: Integers
    columns: Integers
    first_node: Integers
    first_panel: Integers
    first_edge: Integers
    """in a row of the wake's nodes"""
    first_strip: Integers
    """in a row of the wake's rings"""


class Lattice(NamedTuple):
    """Surfaces divided into panels."""

    names: tuple[str, ...]
    layout: Layout
    nodes: Floats
    """(3, nodes) m"""


def layout_of(shapes: Sequence[tuple[int, int]]) -> Layout:
    """Layout of surfaces with these numbers of rows and columns."""
    rows, columns = (np.array(column, dtype=np.int64) for column in zip(*shapes, strict=True))

    def before(counts: Integers) -> Integers:
        return np.concatenate(([0], np.cumsum(counts)[:-1])).astype(np.int64)

    return Layout(
        rows,
        columns,
        before((rows + 1) * (columns + 1)),
        before(rows * columns),
        before(columns + 1),
        before(columns),
    )


def panel_count(layout: Layout) -> int:
    """Number of panels of all surfaces."""
    return int(np.sum(layout.rows * layout.columns))


def spacing(kind: str, panels: int) -> Floats:
    """Positions (panels + 1,) from 0 to 1.

    Raises:
        InputError: no such spacing.
    """
    even = np.linspace(0.0, 1.0, panels + 1)
    if kind == "uniform":
        return even
    if kind == "cosine":
        return np.asarray(0.5 * (1.0 - np.cos(math.pi * even)))
    raise InputError(f'spacing "{kind}" is unknown; it is "uniform" or "cosine"')


def _chord_points(section: Section, places: Floats) -> Floats:
    """(places, 3) m; of the mean line."""
    along, up = places * section.chord, section.mean_line.height(places) * section.chord
    c, s = math.cos(section.twist), math.sin(section.twist)
    back, above = along * c + up * s, up * c - along * s
    return np.asarray(np.stack((back, np.zeros_like(back), above), axis=1) + np.array(section.leading_edge))


def surface_nodes(surface: Surface) -> Floats:
    """Nodes (rows + 1, columns + 1, 3) in m.

    Raises:
        InputError: fewer than two sections, panels that do not fit them, an unknown spacing, a chord below 0.
    """
    _check(surface)
    places = spacing(surface.chordwise, surface.rows)
    lines = [_chord_points(section, places) for section in surface.sections]
    pieces = [lines[0][:, None]]
    for one, other, columns in zip(lines[:-1], lines[1:], surface.columns, strict=True):
        share = spacing(surface.spanwise, columns)[1:, None]
        pieces.append(one[:, None] * (1.0 - share) + other[:, None] * share)
    return np.concatenate(pieces, axis=1)


def _check(surface: Surface) -> None:
    name, sections = surface.name, surface.sections
    if len(sections) < 2 or len(surface.columns) != len(sections) - 1:
        raise InputError(f'surface "{name}" needs two sections or more, and the number of panels between each two')
    if surface.rows < 1 or min(surface.columns) < 1:
        raise InputError(f'surface "{name}" needs one panel or more along chord and span')
    for i, section in enumerate(sections):
        if not section.chord >= 0.0:
            raise InputError(f'surface "{name}", section {i}: chord = {section.chord:g} m must not be below 0')


def build_lattice(surfaces: Sequence[Surface]) -> Lattice:
    """Build the lattice of all surfaces.

    Raises:
        InputError: see `surface_nodes` and `check_areas`.
    """
    return lattice_of({surface.name: surface_nodes(surface) for surface in surfaces})


def lattice_of(grids: dict[str, Floats]) -> Lattice:
    """Build a lattice from nodes (rows + 1, columns + 1, 3) in m of each surface.

    Raises:
        InputError: see `check_areas`.
    """
    layout = layout_of([(grid.shape[0] - 1, grid.shape[1] - 1) for grid in grids.values()])
    lattice = Lattice(tuple(grids), layout, flat_nodes(list(grids.values())))
    check_areas(lattice)
    return lattice


def flat_nodes(grids: Sequence[Floats]) -> Floats:
    """Nodes (3, nodes) of grids (rows + 1, columns + 1, 3)."""
    return np.ascontiguousarray(np.concatenate([grid.reshape(-1, 3) for grid in grids]).T)


def grid_of(lattice: Lattice, nodes: Floats, surface: int) -> Floats:
    """Grid (rows + 1, columns + 1, 3) of one surface of ``nodes`` (3, nodes)."""
    layout = lattice.layout
    rows, columns = int(layout.rows[surface]) + 1, int(layout.columns[surface]) + 1
    first = int(layout.first_node[surface])
    return nodes[:, first : first + rows * columns].T.reshape(rows, columns, 3)


def panel_areas(grid: Floats) -> Floats:
    """Panel areas (rows, columns) in m^2; half the cross product of the diagonals."""
    one, other = grid[1:, 1:] - grid[:-1, :-1], grid[:-1, 1:] - grid[1:, :-1]
    return np.asarray(0.5 * np.linalg.norm(np.cross(one, other), axis=2))


def check_areas(lattice: Lattice) -> None:
    """Check for panels without area.

    Raises:
        InputError: a node that is no place, or a panel without area.
    """
    for i, name in enumerate(lattice.names):
        grid = grid_of(lattice, lattice.nodes, i)
        if not np.all(np.isfinite(grid)):
            row, column = np.argwhere(~np.isfinite(grid).all(axis=2))[0]
            raise InputError(f'surface "{name}": node {row}, {column} is no place: {grid[row, column].tolist()}')
        areas = panel_areas(grid)
        flat = np.argwhere(areas <= SMALLEST_AREA * max(float(areas.mean()), 1e-300))
        if len(flat):
            row, column = flat[0]
            corner = ", ".join(f"{x:.3g}" for x in grid[row, column])
            raise InputError(f'surface "{name}": panel {row}, {column} at ({corner}) m has no area')
