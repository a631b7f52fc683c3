"""Flat plates on bodies of the tree: tails and fins, fixed or all-moving."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.surfaces import plate_pressure
from sim_bridge.compiled import inlined, inlined_internal, noalias
from sim_bridge.multibody.tree import Kinematics
from sim_bridge.vectors import Floats, Integers


class Plates(NamedTuple):
    """Arrays of p plates in the axes of the body that carries each."""

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
    """Return an empty set of plates."""
    nowhere = np.zeros((0, 3))
    return Plates(np.zeros(0, dtype=np.int64), nowhere, nowhere, nowhere, np.zeros(0), np.zeros(0))


@inlined_internal
def add_plates(k: Kinematics, plates: Plates, air: Floats, density: float, total: Floats) -> None:
    """Add the air loads of the plates to their bodies.

    Args:
        air: (6,) m/s, rad/s; velocity and angular velocity of the air at the base's origin, body axes.
        total: (6,) out; force N and moment N m of all plates about the base's origin.
    """
    for i in range(6):
        total[i] = 0.0
    for n in range(plates.body.shape[0]):
        b = plates.body[n]
        _add_plate(
            plates.place[n], plates.chord[n], plates.normal[n], plates.area[n], plates.lift_slope[n], air, density,
            k.r[b], k.p[b], k.velocity[b], k.force[b], total,
        )  # fmt: skip


@noalias
def _add_plate(
    place: Floats,
    chord: Floats,
    normal: Floats,
    area: float,
    lift_slope: float,
    air: Floats,
    density: float,
    r: Floats,
    p: Floats,
    v: Floats,
    force: Floats,
    total: Floats,
) -> None:
    """Load a body, which is turned by ``r``, placed at ``p`` and moves at ``v`` (6,), with what one plate bears."""
    (x, y, z), chord_frd, normal_frd = _turned(r, place), _turned(r, chord), _turned(r, normal)
    x, y, z = p[0] + x, p[1] + y, p[2] + z
    # Through the air the body turns at w0, ...
    w0, w1, w2 = v[0] - air[3], v[1] - air[4], v[2] - air[5]
    through = (v[3] - air[0] + w1 * z - w2 * y, v[4] - air[1] + w2 * x - w0 * z, v[5] - air[2] + w0 * y - w1 * x)
    push = area * plate_pressure(_inner(through, chord_frd), _inner(through, normal_frd), 0.0, lift_slope, density)
    fx, fy, fz = push * normal_frd[0], push * normal_frd[1], push * normal_frd[2]
    nx, ny, nz = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
    total[0], total[1], total[2] = total[0] + fx, total[1] + fy, total[2] + fz
    total[3], total[4], total[5] = total[3] + nx, total[4] + ny, total[5] + nz
    force[0], force[1], force[2] = force[0] - nx, force[1] - ny, force[2] - nz
    force[3], force[4], force[5] = force[3] - fx, force[4] - fy, force[5] - fz


@inlined
def _turned(r: Floats, v: Floats) -> tuple[float, float, float]:
    return (
        r[0, 0] * v[0] + r[0, 1] * v[1] + r[0, 2] * v[2],
        r[1, 0] * v[0] + r[1, 1] * v[1] + r[1, 2] * v[2],
        r[2, 0] * v[0] + r[2, 1] * v[1] + r[2, 2] * v[2],
    )


@inlined
def _inner(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
