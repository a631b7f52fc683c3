"""Forces on a lattice: unsteady Joukowski form per leg, and pressures by Katz and Plotkin.

* Joukowski (Simpson, Palacios and Murua 2013, Eq. 8 and 9): a leg of net strength G and length l in air that meets it
  with the velocity V bears ``rho G V x l``, a panel besides ``rho dG/dt A`` along its normal: the air's apparent mass
  and the rest of what its unsteadiness does. It has the leading edge's suction in it.
* Pressures (Katz and Plotkin 2001, Eq. 13.145): ``rho (V . grad G + dG/dt)`` along the normal, with the velocity of
  wake and motion alone; normal to the panels, without suction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Layout
from sim_bridge.aerodynamics.vortex_lattice.legs import NONE, Legs, leg_strength
from sim_bridge.aerodynamics.vortex_lattice.panels import Panels
from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats


class Loads(NamedTuple):
    """Loads of every panel."""

    force: Floats
    """(3, N) N; of the air on the panel, by the Joukowski form"""
    moment: Floats
    """(3, N) N m; about the axes' origin"""
    power: Floats
    """(N,) W; what moving the panel through the air takes"""
    pressure: Floats
    """(N,) Pa; below less above, by Katz and Plotkin"""


class Flow(NamedTuple):
    """Velocities at legs and panels."""

    legs: Floats
    """(3, L) m/s; induced at the middle of each leg"""
    leg_motion: Floats
    """(3, L) m/s; of that point"""
    wake: Floats
    """(3, N) m/s; induced at the collocation points by the wake"""
    panel_motion: Floats
    """(3, N) m/s; of the collocation points"""
    shed: Floats
    """(S,) m^2/s; strength of the wake's newest row as the trailing edges' legs have it"""
    rates: Floats
    """(N,) m^2/s^2; of the strengths"""
    areas: Floats
    """(N,) m^2; that the rates act on, see `ring_areas`"""


def blank_loads_of(panels: int) -> Loads:
    """Allocate loads for `set_loads`."""
    return Loads(np.zeros((3, panels)), np.zeros((3, panels)), np.zeros(panels), np.zeros(panels))


@kernel
def set_loads(
    layout: Layout, legs: Legs, panels: Panels, strengths: Floats, flow: Flow, density: float, loads: Loads
) -> None:
    """Fill ``loads`` for rings of ``strengths`` (N,) m^2/s; density kg/m^3."""
    loads.force[:] = 0.0
    loads.moment[:] = 0.0
    loads.power[:] = 0.0
    for k in range(legs.start.shape[0]):
        _add_leg(legs, k, panels.rings, leg_strength(legs, k, strengths, flow.shed) * density, flow, loads)
    for n in range(strengths.shape[0]):
        push, place = density * flow.rates[n] * flow.areas[n], panels.collocation[:, n]
        normal, motion = panels.normal[:, n], flow.panel_motion[:, n]
        _add(loads, n, push * normal[0], push * normal[1], push * normal[2], place, motion)
    for s in range(layout.rows.shape[0]):
        _set_pressures(layout, s, panels, strengths, flow, density, loads.pressure)


@kernel
def _add_leg(legs: Legs, k: int, rings: Floats, push: float, flow: Flow, loads: Loads) -> None:
    a, b, place = rings[:, legs.start[k]], rings[:, legs.end[k]], flow.legs[:, k]
    v0 = place[0] - flow.leg_motion[0, k]
    v1 = place[1] - flow.leg_motion[1, k]
    v2 = place[2] - flow.leg_motion[2, k]
    l0, l1, l2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    one, other = legs.with_it[k], legs.against[k]
    push *= 0.5 if one != NONE and other != NONE else 1.0
    f0, f1, f2 = push * (v1 * l2 - v2 * l1), push * (v2 * l0 - v0 * l2), push * (v0 * l1 - v1 * l0)
    for n in (one, other):
        if n != NONE:
            _add_between(loads, n, f0, f1, f2, a, b, flow.leg_motion[:, k])


@kernel
def _add_between(loads: Loads, n: int, f0: float, f1: float, f2: float, a: Floats, b: Floats, motion: Floats) -> None:
    x, y, z = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    loads.force[0, n] += f0
    loads.force[1, n] += f1
    loads.force[2, n] += f2
    loads.moment[0, n] += y * f2 - z * f1
    loads.moment[1, n] += z * f0 - x * f2
    loads.moment[2, n] += x * f1 - y * f0
    loads.power[n] -= f0 * motion[0] + f1 * motion[1] + f2 * motion[2]


@kernel
def _add(loads: Loads, n: int, f0: float, f1: float, f2: float, place: Floats, motion: Floats) -> None:
    _add_between(loads, n, f0, f1, f2, place, place, motion)


@kernel
def _set_pressures(
    layout: Layout, s: int, panels: Panels, strengths: Floats, flow: Flow, density: float, out: Floats
) -> None:
    columns, rings = layout.columns[s], panels.rings
    for i in range(layout.rows[s]):
        for j in range(columns):
            n = layout.first_panel[s] + i * columns + j
            at = layout.first_node[s] + i * (columns + 1) + j
            here = strengths[n]
            ahead = strengths[n - columns] if i > 0 else 0.0
            left = strengths[n - 1] if j > 0 else 0.0
            right = strengths[n + 1] if j < columns - 1 else 0.0
            back, across, c2, s2 = 0.0, 0.0, 0.0, 0.0
            for c in range(3):
                v = flow.wake[c, n] - flow.panel_motion[c, n]
                front, rear = rings[c, at] + rings[c, at + 1], rings[c, at + columns + 1] + rings[c, at + columns + 2]
                chord = 0.5 * (rear - front)
                span = 0.5 * (
                    rings[c, at + 1] + rings[c, at + columns + 2] - rings[c, at] - rings[c, at + columns + 1]
                )
                back += v * chord
                across += v * span
                c2 += chord * chord
                s2 += span * span
            slope = back * (here - ahead) / c2 + across * 0.5 * (right - left) / s2
            out[n] = density * (slope + flow.rates[n])


@kernel
def ring_areas(layout: Layout, area: Floats, out: Floats) -> None:
    """Fill ``out`` (N,) m^2 with what each ring covers of panels of ``area`` (N,): from its front leg to the next.

    The last ring of a strip ends at the trailing edge: a vortex at a quarter of its panel stands for vorticity whose
    moment it has, so that what is ahead of the first leg and behind the trailing edge bears nothing.
    """
    for s in range(layout.rows.shape[0]):
        columns = layout.columns[s]
        for i in range(layout.rows[s]):
            for j in range(columns):
                n = layout.first_panel[s] + i * columns + j
                out[n] = 0.75 * area[n]
                if i < layout.rows[s] - 1:
                    out[n] += 0.25 * area[n + columns]


@kernel
def middles(legs: Legs, rings: Floats, out: Floats) -> None:
    """Fill ``out`` (3, L) with the mean over each leg's ends of ``rings`` (3, nodes): places or velocities."""
    for k in range(legs.start.shape[0]):
        for c in range(3):
            out[c, k] = 0.5 * (rings[c, legs.start[k]] + rings[c, legs.end[k]])
