"""Generalized coordinates of a vehicle from marked bodies (Grauer et al. 2011, Eq. 1), with standard errors.

Eq. 8 gives every body a pose of its own; the joints between them are known. So all markers together, each where the
tree of bodies has it, are fitted by one position and attitude of the base and the joint angles (Gauss-Newton, started
at the poses of Eq. 8). A body with two markers, or one, takes part with what its joint leaves open, and the pitch of
the base is told by markers as far apart as nose and tail, not by three at the nose alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.motion_capture.kinematic_chain import marker_rates, product, skeleton, turned
from logs.identification.motion_capture.markers import LEAST_FRAMES, OUTLIER, MarkedBody, body_poses, jumps
from logs.identification.results import Array
from sim_bridge.mechanism import Mechanism
from sim_bridge.multibody.tree import Tree
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

ROUNDS = 12
"""of Gauss-Newton"""
SETTLED = 1e-9
"""m or rad; the last step of the fit"""
WORST_CONDITION = 1e8
"""-; of the normal equations, beyond which the markers seen do not tell all coordinates"""


class Coordinates(NamedTuple):
    """Position states of Eq. 1 in N frames; NaN where the markers seen do not tell them."""

    names: tuple[str, ...]
    """-; (c,), of the joint angles"""
    position_ned: Array
    """m; (N, 3), of the base's origin"""
    quaternion: Array
    """-; (N, 4), of r_ned_from_frd"""
    angles: Array
    """rad; (N, c)"""
    covariance: Array
    """m^2, m rad, rad^2; (N, 6 + c, 6 + c), of position and turn in the base's axes, and the angles"""
    noise: float
    """m; standard deviation of a marker along each axis"""
    unused: float
    """-; share of the samples seen that were left out as wrong"""


class _Cloud(NamedTuple):
    """All markers of all bodies."""

    bodies: tuple[int, ...]
    """-; numbers of the tree's bodies"""
    places: tuple[Array, ...]
    """m; (M_b, 3) of each, of its markers in the body's axes"""
    positions: Array
    """m; (N, M, 3), NaN where not seen"""


class _State(NamedTuple):
    """What the markers are to tell."""

    position: Array
    """m; (N, 3), NED, of the base's origin"""
    quaternion: Array
    """-; (N, 4), of r_ned_from_frd"""
    angles: Array
    """rad; (N, c)"""


def joint_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joint angles of a mechanism: its coordinates without the twists of the wings."""
    return mechanism.layout.coordinates[: int(mechanism.tree.coordinate.max()) + 1]


def fit_coordinates(
    mechanism: Mechanism, marked: dict[str, tuple[int, Array]], positions: dict[str, Array]
) -> Coordinates:
    """Coordinates of ``mechanism`` in N frames.

    Args:
        mechanism: of the vehicle.
        marked: by a body's name its index in the tree and the places (m, 3) m of its markers in its axes.
        positions: by a body's name (m, N, 3) m in NED, NaN where a marker was not seen.

    Raises:
        InputError: the base has no three markers that tell its pose, a joint is beyond every marked body, or the
            frames are too few.
    """
    tree, names = mechanism.tree, joint_names(mechanism)
    cloud = _cloud(marked, positions)
    base = next((name for name, (index, _) in marked.items() if index == 0), None)
    if base is None:
        raise InputError("the base has no markers: its position and attitude start the fit")
    poses = body_poses(MarkedBody(base, marked[base][1]), positions[base])
    known = np.isfinite(poses.position[:, 0])
    start = _State(
        _filled(poses.position, known), _unit(_filled(poses.quaternion, known)), np.zeros((len(known), len(names)))
    )
    state, off, normal = _gauss_newton(tree, cloud, start)
    told, seen = _told(normal), np.isfinite(cloud.positions).all(axis=2)
    if told.sum() < LEAST_FRAMES:
        raise InputError(
            f"fewer than {LEAST_FRAMES} frames whose markers tell {', '.join(names)} and the base's pose"
        )
    scale = float(np.nanmedian(np.abs(off[told]))) / 0.6745
    wrong = np.linalg.norm(np.where(np.isfinite(off), off, 0.0), axis=2) > OUTLIER * scale
    if wrong.any():
        cloud = cloud._replace(positions=np.where(wrong[:, :, None], np.nan, cloud.positions))
        state, off, normal = _gauss_newton(tree, cloud, state)
        told = _told(normal)
    return _coordinates(names, state, off, normal, told, 1.0 - float(np.isfinite(off[..., 0]).sum() / seen.sum()))


def body_coordinates(body: MarkedBody, positions: Array) -> Coordinates:
    """Coordinates of one rigid body without joints, from ``positions`` (m, N, 3) m of its markers in NED.

    Raises:
        InputError: as of `body_poses`.
    """
    poses = body_poses(body, positions)
    own = np.tile(np.eye(6), (len(poses.position), 1, 1))
    own[:, :3, :3] = dcms_from_quaternions(poses.quaternion).swapaxes(1, 2)
    covariance = own @ poses.covariance @ own.swapaxes(1, 2)
    seen = np.isfinite(positions).all(axis=2)
    angles = np.zeros((len(poses.position), 0))
    unused = 1.0 - float(poses.used.sum() / seen.sum())
    return Coordinates((), poses.position, poses.quaternion, angles, covariance, poses.noise, unused)


def _coordinates(
    names: tuple[str, ...], state: _State, off: Array, normal: Array, told: NDArray[np.bool_], unused: float
) -> Coordinates:
    left = off[told]
    freedom = np.isfinite(left).sum() - told.sum() * normal.shape[1]
    if freedom <= 0:
        raise InputError("the markers just tell the coordinates: one more marker is needed to tell their noise")
    noise = float(np.sqrt(np.nansum(np.square(left)) / freedom))
    covariance = np.full(normal.shape, np.nan)
    covariance[told] = np.linalg.inv(normal[told]) * noise**2
    for values in state:
        values[~told] = np.nan
    return Coordinates(names, *state, covariance, noise, unused)


def _cloud(marked: dict[str, tuple[int, Array]], positions: dict[str, Array]) -> _Cloud:
    for name, (_, places) in marked.items():
        if name not in positions or positions[name].shape[::2] != places.shape:
            raise InputError(f"{name}: positions of {len(places)} markers are needed, (markers, frames, 3)")
    clean = [np.where(jumps(positions[name])[:, :, None], np.nan, positions[name]) for name in marked]
    bodies = tuple(index for index, _ in marked.values())
    return _Cloud(bodies, tuple(places for _, places in marked.values()), np.concatenate(clean).swapaxes(0, 1))


def _filled(values: Array, known: NDArray[np.bool_]) -> Array:
    """Rows that are not known, linearly between those that are."""
    at = np.arange(len(values))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in values.T])


def _unit(quaternion: Array) -> Array:
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))


def _told(normal: Array) -> NDArray[np.bool_]:
    """Frames whose normal equations are regular; columns count in their own measure, m or rad."""
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
    values = np.linalg.eigvalsh(normal / (size[:, :, None] * size[:, None, :]))
    return np.asarray(values[:, 0] * WORST_CONDITION > values[:, -1])


def _gauss_newton(tree: Tree, cloud: _Cloud, state: _State) -> tuple[_State, Array, Array]:
    """State after the fit, how far each marker (N, M, 3) is off in the base's axes, normal equations (N, p, p)."""
    for _ in range(ROUNDS):
        off, rates = _residuals(tree, cloud, state)
        normal = np.einsum("nmik,nmil->nkl", rates, rates)
        slope = np.einsum("nmik,nmi->nk", rates, np.where(np.isfinite(off), off, 0.0))
        told = _told(normal)
        step = np.zeros(slope.shape)
        step[told] = np.linalg.solve(normal[told], slope[told][:, :, None])[:, :, 0]
        state = _moved(state, step)
        if np.max(np.abs(step), initial=0.0) < SETTLED:
            break
    off, rates = _residuals(tree, cloud, state)
    return state, off, np.einsum("nmik,nmil->nkl", rates, rates)


def _residuals(tree: Tree, cloud: _Cloud, state: _State) -> tuple[Array, Array]:
    bones, columns = skeleton(tree, state.angles), state.angles.shape[1]
    parts = [marker_rates(tree, bones, b, p, columns) for b, p in zip(cloud.bodies, cloud.places, strict=True)]
    at, rates = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    own = np.einsum(
        "nji,nmj->nmi", dcms_from_quaternions(state.quaternion), cloud.positions - state.position[:, None]
    )
    return own - at, rates * np.isfinite(own[..., :1, None])


def _moved(state: _State, step: Array) -> _State:
    shift = np.einsum("nij,nj->ni", dcms_from_quaternions(state.quaternion), step[:, :3])
    quaternion = _unit(product(state.quaternion, turned(step[:, 3:6])))
    return _State(state.position + shift, quaternion, state.angles + step[:, 6:])
