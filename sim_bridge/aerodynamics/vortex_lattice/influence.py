"""Velocities that straight vortex filaments induce (Biot and Savart), with a viscous core, and their mirror images.

A filament from a to b of strength G induces at p, with r1 = a - p, r2 = b - p and l = |b - a|

    G / 4 pi  (r1 x r2) (|r1| + |r2|) (|r1| |r2| - r1 . r2) / (|r1| |r2| (|r1 x r2|^2 + (core l)^2)),

which is Katz and Plotkin 2001, Eq. 2.72, times h^2 / (h^2 + core^2) of the distance h to the filament's line:
Scully's core. It has no branch and no singularity, so that the sum over many filaments runs on all lanes of the
processor. A reflection in a plane is ``p -> R p + t``: the image of all filaments induces R^T of what they induce at
that point.
"""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

FILAMENT = 8
"""rows of a table of filaments: start (3) m, end (3) m, strength over 4 pi in m^2/s, (core length)^2 in m^4"""
OVER_4_PI = 0.25 / math.pi
LEAST = 1e-60
"""m^6; keeps a filament at whose end the point lies from dividing by 0"""
IN_LINE = 1e-24
"""-; square of the angle in rad between both ends below which a filament is none: rounding leaves 1e-16"""


def reflections(symmetric: bool, ground: float | None) -> Floats:
    """(k, 4, 3) reflections, R above t: none, that in the plane y = 0, that in z = ``ground`` m, and in both.

    Raises:
        InputError: the ground's height is no number.
    """
    if ground is not None and not math.isfinite(ground):
        raise InputError(f"ground = {ground:g} m is no height")
    solved = [np.vstack((np.eye(3), np.zeros(3)))]
    if symmetric:
        solved += [_reflected(one, 1, 0.0) for one in solved]
    if ground is not None:
        solved += [_reflected(one, 2, ground) for one in solved]
    return np.array(solved)


def _reflected(one: Floats, axis: int, place: float) -> Floats:
    out = one.copy()
    out[:, axis] *= -1.0
    out[3, axis] += 2.0 * place
    return out


@kernel
def set_filament(table: Floats, k: int, start: Floats, end: Floats, strength: float, core: float) -> None:
    """Put a filament from ``start`` (3,) to ``end`` (3,) m into column ``k``: m^2/s, core radius m."""
    square = 0.0
    for i in range(3):
        table[i, k], table[3 + i, k] = start[i], end[i]
        square += (end[i] - start[i]) * (end[i] - start[i])
    table[6, k], table[7, k] = OVER_4_PI * strength, core * core * square


@kernel
def _sum(table: Floats, count: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    u = v = w = 0.0
    for k in range(count):
        ax, ay, az = table[0, k] - x, table[1, k] - y, table[2, k] - z
        bx, by, bz = table[3, k] - x, table[4, k] - y, table[5, k] - z
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        a, b = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
        both = a * b
        around = both * (cx * cx + cy * cy + cz * cz + table[7, k] + IN_LINE * both * both) + LEAST
        share = table[6, k] * (a + b) * (both - (ax * bx + ay * by + az * bz)) / around
        u += share * cx
        v += share * cy
        w += share * cz
    return u, v, w


@kernel
def induced(table: Floats, count: int, images: Floats, points: Floats, out: Floats) -> None:
    """Add to ``out`` (3, p) m/s what the first ``count`` filaments and their images induce at ``points`` (3, p)."""
    for n in range(points.shape[1]):
        x, y, z = points[0, n], points[1, n], points[2, n]
        for k in range(images.shape[0]):
            r = images[k]
            u, v, w = _sum(
                table,
                count,
                r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + r[3, 0],
                r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + r[3, 1],
                r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + r[3, 2],
            )
            out[0, n] += r[0, 0] * u + r[1, 0] * v + r[2, 0] * w
            out[1, n] += r[0, 1] * u + r[1, 1] * v + r[2, 1] * w
            out[2, n] += r[0, 2] * u + r[1, 2] * v + r[2, 2] * w


@kernel
def row_influence(a: Floats, b: Floats, core: float, p: Floats, n: Floats, out: Floats) -> None:
    """Add to ``out`` (c,) 1/m what filaments of unit strength, each from ``a`` to ``b``, induce along ``n`` at ``p``.

    ``a``, ``b`` (3, c) m; ``core`` m; ``p`` (3,) m; ``n`` (3,).
    """
    x, y, z, n0, n1, n2 = p[0], p[1], p[2], n[0], n[1], n[2]
    for k in range(out.shape[0]):
        ax, ay, az = a[0, k] - x, a[1, k] - y, a[2, k] - z
        bx, by, bz = b[0, k] - x, b[1, k] - y, b[2, k] - z
        lx, ly, lz = bx - ax, by - ay, bz - az
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        one, other = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
        both, inside = one * other, core * core * (lx * lx + ly * ly + lz * lz)
        around = both * (cx * cx + cy * cy + cz * cz + inside + IN_LINE * both * both) + LEAST
        share = OVER_4_PI * (one + other) * (both - (ax * bx + ay * by + az * bz)) / around
        out[k] += share * (n0 * cx + n1 * cy + n2 * cz)
