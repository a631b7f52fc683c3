"""Generalized coordinates of a vehicle from marked bodies (Grauer et al. 2011, Eq. 1), with standard errors.

Eq. 8 gives every body a pose; the joints between the bodies are known. So all markers, each at its position in the
kinematic chain, are fitted together by position and attitude of the base and the joint angles (Gauss-Newton from the
poses of Eq. 8). A body with two markers, or one, contributes what its joint leaves free, and the pitch of the base is
determined by markers as far apart as nose and tail.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from logs.identification.motion_capture.markers import MIN_FRAMES, OUTLIER, MarkedBody, body_poses, jumps, skew
from logs.identification.results import Array
from sim_bridge.mechanism import Mechanism
from sim_bridge.multibody.tree import Tree
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

ITERATIONS = 12
CONVERGED = 1e-9
"""m or rad; largest last step"""
MAX_CONDITION = 1e8
"""-; of the normal equations, above which the measured markers do not determine all coordinates"""


class Coordinates(NamedTuple):
    """Position states of Eq. 1 in N frames; NaN if the measured markers do not determine them."""

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
    """-; fraction of the measured samples that were rejected"""


class _Cloud(NamedTuple):
    """All markers of all bodies."""

    bodies: tuple[int, ...]
    """-; numbers of the tree's bodies"""
    places: tuple[Array, ...]
    """m; (M_b, 3) by body, of its markers in the body's axes"""
    positions: Array
    """m; (N, M, 3), NaN if not measured"""


class _State(NamedTuple):
    """Unknowns of the fit."""

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
        positions: by a body's name (m, N, 3) m in NED, NaN if not measured.

    Raises:
        InputError: the base has no three markers that determine its pose, a joint has no marked body after it, or
            the frames are too few.
    """
    tree, names = mechanism.tree, joint_names(mechanism)
    cloud = _cloud(marked, positions)
    base = next((name for name, (index, _) in marked.items() if index == 0), None)
    if base is None:
        raise InputError("the base has no markers: its position and attitude start the fit")
    poses = body_poses(MarkedBody(base, marked[base][1]), positions[base])
    known = np.isfinite(poses.position[:, 0])
    start = _State(
        _filled(poses.position, known),
        _normalized(_filled(poses.quaternion, known)),
        np.zeros((len(known), len(names))),
    )
    state, residuals, normal = _gauss_newton(tree, cloud, start)
    known, measured = _determined(normal), np.isfinite(cloud.positions).all(axis=2)
    if known.sum() < MIN_FRAMES:
        raise InputError(
            f"fewer than {MIN_FRAMES} frames whose markers determine {', '.join(names)} and the base's pose"
        )
    scale = float(np.nanmedian(np.abs(residuals[known]))) / 0.6745
    wrong = np.linalg.norm(np.where(np.isfinite(residuals), residuals, 0.0), axis=2) > OUTLIER * scale
    if wrong.any():
        cloud = cloud._replace(positions=np.where(wrong[:, :, None], np.nan, cloud.positions))
        state, residuals, normal = _gauss_newton(tree, cloud, state)
        known = _determined(normal)
    return _coordinates(
        names, state, residuals, normal, known, 1.0 - float(np.isfinite(residuals[..., 0]).sum() / measured.sum())
    )


def body_coordinates(body: MarkedBody, positions: Array) -> Coordinates:
    """Coordinates of one rigid body without joints, from ``positions`` (m, N, 3) m of its markers in NED.

    Raises:
        InputError: as of `body_poses`.
    """
    poses = body_poses(body, positions)
    rotation = np.tile(np.eye(6), (len(poses.position), 1, 1))
    rotation[:, :3, :3] = dcms_from_quaternions(poses.quaternion).swapaxes(1, 2)
    covariance = rotation @ poses.covariance @ rotation.swapaxes(1, 2)
    measured = np.isfinite(positions).all(axis=2)
    angles = np.zeros((len(poses.position), 0))
    unused = 1.0 - float(poses.used.sum() / measured.sum())
    return Coordinates((), poses.position, poses.quaternion, angles, covariance, poses.noise, unused)


def _coordinates(
    names: tuple[str, ...], state: _State, residuals: Array, normal: Array, known: NDArray[np.bool_], unused: float
) -> Coordinates:
    left = residuals[known]
    freedom = np.isfinite(left).sum() - known.sum() * normal.shape[1]
    if freedom <= 0:
        raise InputError("the markers just determine the coordinates: their noise takes one more marker")
    noise = float(np.sqrt(np.nansum(np.square(left)) / freedom))
    covariance = np.full(normal.shape, np.nan)
    covariance[known] = np.linalg.inv(normal[known]) * noise**2
    for values in state:
        values[~known] = np.nan
    return Coordinates(names, *state, covariance, noise, unused)


def _cloud(marked: dict[str, tuple[int, Array]], positions: dict[str, Array]) -> _Cloud:
    for name, (_, places) in marked.items():
        if name not in positions or positions[name].shape[::2] != places.shape:
            raise InputError(f"{name}: positions of {len(places)} markers are needed, (markers, frames, 3)")
    clean = [np.where(jumps(positions[name])[:, :, None], np.nan, positions[name]) for name in marked]
    bodies = tuple(index for index, _ in marked.values())
    return _Cloud(bodies, tuple(places for _, places in marked.values()), np.concatenate(clean).swapaxes(0, 1))


def _filled(values: Array, known: NDArray[np.bool_]) -> Array:
    """The table with unknown rows interpolated linearly."""
    at = np.arange(len(values))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in values.T])


def _normalized(quaternion: Array) -> Array:
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))


def _determined(normal: Array) -> NDArray[np.bool_]:
    """Frames whose normal equations are regular; columns are scaled to one size."""
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-12))
    values = np.linalg.eigvalsh(normal / (size[:, :, None] * size[:, None, :]))
    return np.asarray(values[:, 0] * MAX_CONDITION > values[:, -1])


def _gauss_newton(tree: Tree, cloud: _Cloud, state: _State) -> tuple[_State, Array, Array]:
    """State after the fit, residuals (N, M, 3) in the base's axes, normal equations (N, p, p)."""
    for _ in range(ITERATIONS):
        residuals, rates = _residuals(tree, cloud, state)
        normal = np.einsum("nmik,nmil->nkl", rates, rates)
        slope = np.einsum("nmik,nmi->nk", rates, np.where(np.isfinite(residuals), residuals, 0.0))
        known = _determined(normal)
        step = np.zeros(slope.shape)
        step[known] = np.linalg.solve(normal[known], slope[known][:, :, None])[:, :, 0]
        state = _moved(state, step)
        if np.max(np.abs(step), initial=0.0) < CONVERGED:
            break
    residuals, rates = _residuals(tree, cloud, state)
    return state, residuals, np.einsum("nmik,nmil->nkl", rates, rates)


def _residuals(tree: Tree, cloud: _Cloud, state: _State) -> tuple[Array, Array]:
    chain, columns = kinematic_chain(tree, state.angles), state.angles.shape[1]
    parts = [marker_rates(tree, chain, b, p, columns) for b, p in zip(cloud.bodies, cloud.places, strict=True)]
    at, rates = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    measured = np.einsum(
        "nji,nmj->nmi", dcms_from_quaternions(state.quaternion), cloud.positions - state.position[:, None]
    )
    return measured - at, rates * np.isfinite(measured[..., :1, None])


def _moved(state: _State, step: Array) -> _State:
    attitude = Rotation.from_quat(state.quaternion, scalar_first=True)
    quaternion = (attitude * Rotation.from_rotvec(step[:, 3:6])).as_quat(scalar_first=True)
    return _State(state.position + attitude.apply(step[:, :3]), quaternion, state.angles + step[:, 6:])


# --- kinematic chain ----------------------------------------------------------------------------------------


class KinematicChain(NamedTuple):
    """Bodies of a tree, N instants, in the base's axes from the base's origin."""

    rotation: Array
    """-; (b, N, 3, 3), r_frd_from_body"""
    position: Array
    """m; (b, N, 3), of the joints"""
    axis: Array
    """-; (b, N, 3), unit vectors of each joint's turn"""


def kinematic_chain(tree: Tree, angles: Array) -> KinematicChain:
    """Bodies of ``tree`` at ``angles`` (N, c) of its joints."""
    count, samples = len(tree.parent), len(angles)
    rotation = np.tile(np.eye(3), (count, samples, 1, 1))
    position, axis = np.zeros((count, samples, 3)), np.zeros((count, samples, 3))
    for b in range(1, count):
        up, c = int(tree.parent[b]), int(tree.coordinate[b])
        joint = Rotation.from_rotvec(angles[:, c, None] * tree.axis[b]).as_matrix() if c >= 0 else np.eye(3)
        rotation[b] = rotation[up] @ (tree.rotation[b] @ joint)
        position[b] = position[up] + rotation[up] @ tree.place[b]
        axis[b] = rotation[b] @ tree.axis[b]
    return KinematicChain(rotation, position, axis)


def movable_bodies(tree: Tree, body: int) -> list[int]:
    """Bodies with a movable joint from the base to ``body``, included."""
    bodies: list[int] = []
    while body > 0:
        if tree.coordinate[body] >= 0:
            bodies.append(body)
        body = int(tree.parent[body])
    return bodies[::-1]


def marker_rates(tree: Tree, chain: KinematicChain, body: int, places: Array, columns: int) -> tuple[Array, Array]:
    """Places (N, m, 3) of markers at ``places`` (m, 3) of ``body`` in the base's axes, and their derivatives.

    Derivatives (N, m, 3, 6 + ``columns``): by the base's position in its axes, a rotation of it about its axes, and
    the joint angles.
    """
    at = chain.position[body][:, None] + np.einsum("nij,mj->nmi", chain.rotation[body], places)
    rates = np.zeros((*at.shape, 6 + columns))
    rates[..., :3] = np.eye(3)
    rates[..., 3:6] = -skew(at)
    for joint in movable_bodies(tree, body):
        arm = at - chain.position[joint][:, None]
        rates[..., 6 + int(tree.coordinate[joint])] = np.cross(chain.axis[joint][:, None], arm)
    return at, rates
