"""Where the bodies of a vehicle's tree are for N sets of its joint angles, and how they move with each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.motion_capture.markers import skew
from logs.identification.results import Array
from sim_bridge.multibody.tree import Tree
from wingbeat.rotation_arrays import dcms_from_quaternions


class Skeleton(NamedTuple):
    """Bodies of a tree, N instants, in the base's axes from the base's origin."""

    rotation: Array
    """-; (b, N, 3, 3), r_frd_from_body"""
    place: Array
    """m; (b, N, 3), of the joints"""
    axis: Array
    """-; (b, N, 3), unit vectors of each joint's turn"""


def skeleton(tree: Tree, angles: Array) -> Skeleton:
    """Bodies of ``tree`` at ``angles`` (N, c) of its joints."""
    count, samples = len(tree.parent), len(angles)
    rotation = np.tile(np.eye(3), (count, samples, 1, 1))
    place, axis = np.zeros((count, samples, 3)), np.zeros((count, samples, 3))
    for b in range(1, count):
        up, c = int(tree.parent[b]), int(tree.coordinate[b])
        turned = turns(tree.axis[b], angles[:, c]) if c >= 0 else np.eye(3)
        rotation[b] = rotation[up] @ (tree.rotation[b] @ turned)
        place[b] = place[up] + rotation[up] @ tree.place[b]
        axis[b] = rotation[b] @ tree.axis[b]
    return Skeleton(rotation, place, axis)


def turns(axis: Array, angles: Array) -> Array:
    """Rotation matrices (N, 3, 3) of turns by ``angles`` (N,) about the unit vector ``axis`` (3,)."""
    half = 0.5 * angles[:, None]
    return dcms_from_quaternions(np.concatenate([np.cos(half), np.sin(half) * axis], axis=1))


def turned(vectors: Array) -> Array:
    """Quaternions (N, 4), w first, of rotation vectors (N, 3) in rad."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors], axis=1)


def product(first: Array, second: Array) -> Array:
    """Quaternion product (N, 4) of ``first`` and ``second`` (N, 4), w first."""
    (a, b, c, d), (w, x, y, z) = first.T, second.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )


def ways(tree: Tree, body: int) -> list[int]:
    """Bodies with a joint that turns on the way from the base to ``body``, itself included."""
    found: list[int] = []
    while body > 0:
        if tree.coordinate[body] >= 0:
            found.append(body)
        body = int(tree.parent[body])
    return found[::-1]


def marker_rates(tree: Tree, bones: Skeleton, body: int, places: Array, columns: int) -> tuple[Array, Array]:
    """Places (N, m, 3) of markers at ``places`` (m, 3) of ``body`` in the base's axes, and their derivatives.

    Derivatives (N, m, 3, 6 + ``columns``): with the base's position in its axes, a turn of it about its axes, and
    the joint angles.
    """
    at = bones.place[body][:, None] + np.einsum("nij,mj->nmi", bones.rotation[body], places)
    rates = np.zeros((*at.shape, 6 + columns))
    rates[..., :3] = np.eye(3)
    rates[..., 3:6] = -skew(at)
    for joint in ways(tree, body):
        arm = at - bones.place[joint][:, None]
        rates[..., 6 + int(tree.coordinate[joint])] = np.cross(bones.axis[joint][:, None], arm)
    return at, rates
