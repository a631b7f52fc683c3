"""Flat surfaces on bodies of the tree: tails and fins, fixed or all-moving."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.surfaces import plate_pressure
from sim_bridge.multibody.tree import Kinematics, add_wrench, point_velocity
from sim_bridge.vectors import Floats, Integers, inlined, laid_in


class Plates(NamedTuple):
    """p surfaces; axes are those of the body that carries each."""

    body: Integers
    """(p,)"""
    place: Floats
    """(p, 3) m; of the aerodynamic centre, from the body's joint"""
    chord: Floats
    """(p, 3); unit vector forward"""
    normal: Floats
    """(p, 3); unit vector"""
    area: Floats
    """(p,) m^2"""
    lift_slope: Floats
    """(p,) 1/rad"""


def no_plates() -> Plates:
    """Where there is nothing for the air to act on."""
    nowhere = np.zeros((0, 3))
    return Plates(np.zeros(0, dtype=np.int64), nowhere, nowhere, nowhere, np.zeros(0), np.zeros(0))


@inlined
def _turned(r: Floats, v: Floats, out: Floats) -> None:
    for i in range(3):
        out[i] = r[i, 0] * v[0] + r[i, 1] * v[1] + r[i, 2] * v[2]


@laid_in
def add_plates(k: Kinematics, plates: Plates, air: Floats, density: float, work: Floats, total: Floats) -> None:
    """Let the air act on the plates.

    Args:
        air: (6,) m/s, rad/s; velocity and angular velocity of the air at the base's origin, body axes.
        work: (5, 3) scratch. total: (6,) out; force N and moment N m of all plates about the base's origin.
    """
    point, speed, chord, normal, force = work[0], work[1], work[2], work[3], work[4]
    total[:] = 0.0
    for n in range(plates.body.shape[0]):
        b = plates.body[n]
        _turned(k.r[b], plates.place[n], point)
        _turned(k.r[b], plates.chord[n], chord)
        _turned(k.r[b], plates.normal[n], normal)
        for i in range(3):
            point[i] += k.p[b, i]
        point_velocity(k, b, point, speed)
        along = across = 0.0
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            through = speed[i] - air[i] - (air[3 + i1] * point[i2] - air[3 + i2] * point[i1])
            along += through * chord[i]
            across += through * normal[i]
        push = plates.area[n] * plate_pressure(along, across, 0.0, plates.lift_slope[n], density)
        for i in range(3):
            force[i] = push * normal[i]
            total[i] += force[i]
        total[3] += point[1] * force[2] - point[2] * force[1]
        total[4] += point[2] * force[0] - point[0] * force[2]
        total[5] += point[0] * force[1] - point[1] * force[0]
        add_wrench(k, b, point, force)
