"""Legs of a lattice's rings: each straight vortex segment once, with the rings on both sides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Layout
from sim_bridge.aerodynamics.vortex_lattice.influence import set_filament
from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats, Integers

NONE = -1
"""in the place of a panel: there is none"""


class Legs(NamedTuple):
    """L legs of all surfaces; each (L,). A leg runs to the right or back."""

    start: Integers
    """node"""
    end: Integers
    """node"""
    with_it: Integers
    """panel whose ring runs with the leg, `NONE` at an edge"""
    against: Integers
    """panel whose ring runs against it, `NONE` at an edge"""
    edge: Integers
    """strip of the wake whose newest ring begins here, `NONE` but at a trailing edge"""
    surface: Integers


def legs_of(layout: Layout) -> Legs:
    """Return all legs of a lattice."""
    solved: list[tuple[int, int, int, int, int, int]] = []
    for s in range(len(layout.rows)):
        solved += _across(layout, s) + _along(layout, s)
    return Legs(*(np.array(column, dtype=np.int64) for column in zip(*solved, strict=True)))


Row = tuple[int, int, int, int, int, int]


def _across(layout: Layout, s: int) -> list[Row]:
    rows, columns, node, panel, strip = _places(layout, s)
    out = []
    for i in range(rows + 1):
        for j in range(columns):
            at = node + i * (columns + 1) + j
            here = panel + i * columns + j if i < rows else NONE
            ahead = panel + (i - 1) * columns + j if i > 0 else NONE
            out.append((at, at + 1, here, ahead, strip + j if i == rows else NONE, s))
    return out


def _along(layout: Layout, s: int) -> list[Row]:
    rows, columns, node, panel, _ = _places(layout, s)
    out = []
    for i in range(rows):
        for j in range(columns + 1):
            at = node + i * (columns + 1) + j
            left = panel + i * columns + j - 1 if j > 0 else NONE
            right = panel + i * columns + j if j < columns else NONE
            out.append((at, at + columns + 1, left, right, NONE, s))
    return out


def _places(layout: Layout, s: int) -> tuple[int, int, int, int, int]:
    columns = (layout.rows, layout.columns, layout.first_node, layout.first_panel, layout.first_strip)
    return tuple(int(column[s]) for column in columns)  # type: ignore[return-value]


@kernel
def leg_strength(legs: Legs, k: int, strengths: Floats, shed: Floats) -> float:
    """Strength in m^2/s of leg ``k`` from rings' ``strengths`` (N,) and ``shed`` (S,) of the newest wake row."""
    solved = 0.0
    if legs.with_it[k] != NONE:
        solved += strengths[legs.with_it[k]]
    if legs.against[k] != NONE:
        solved -= strengths[legs.against[k]]
    if legs.edge[k] != NONE:
        solved += shed[legs.edge[k]]
    return float(solved)


@kernel
def set_bound_filaments(legs: Legs, rings: Floats, strengths: Floats, cores: Floats, table: Floats) -> int:
    """Put the bound rings of ``strengths`` (N,) m^2/s into ``table``; returns how many filaments they are.

    ``cores`` (surfaces,) in m. The wake's newest row is no part of it.
    """
    count = legs.start.shape[0]
    for k in range(count):
        solved = 0.0
        if legs.with_it[k] != NONE:
            solved += strengths[legs.with_it[k]]
        if legs.against[k] != NONE:
            solved -= strengths[legs.against[k]]
        start, end = rings[:, legs.start[k]], rings[:, legs.end[k]]
        set_filament(table, k, start, end, solved, cores[legs.surface[k]])
    return int(count)
