"""A body is found among markers, with the attitude that it had; a capture of markers goes on the onboard clock."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from logs.importing.rigid_body import find_rigid_body, quaternions
from wingbeat.rotation_arrays import euler_from_quaternions, quaternions_from_euler

Array = NDArray[np.float64]
FUSELAGE = np.array([(0.15, 0.0, -0.02), (-0.2, 0.0, 0.0), (0.0, 0.06, 0.0), (0.0, -0.06, 0.01), (0.05, 0.0, 0.04)])
TIME = np.arange(0.0, 8.0, 0.005)


def rotations(quaternion: Array) -> Array:
    """Matrices (N, 3, 3) of quaternions (N, 4), w first."""
    w, v = quaternion[:, 0], quaternion[:, 1:]
    cross = np.zeros((len(w), 3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        cross[:, k, j], cross[:, j, k] = v[:, i], -v[:, i]
    return np.eye(3) + 2.0 * w[:, None, None] * cross + 2.0 * cross @ cross


def turning() -> Array:
    """Quaternions of a bird that is level at first, circles more than once, banks and pitches."""
    ramp = np.minimum(TIME, 1.0)
    angles = (0.5 * ramp * np.sin(1.3 * TIME), 0.4 * ramp * np.sin(2.1 * TIME), 1.5 * ramp * TIME)
    return np.stack(quaternions_from_euler(*angles), axis=1)


def captured(seed: int = 0) -> Array:
    """Fuselage, then a marker at either wing's tip, flapping at 5 Hz, with 0.3 mm of noise, (7, N, 3)."""
    flap = 0.6 * np.sin(2.0 * np.pi * 5.0 * TIME)
    tips = [np.stack([0.0 * TIME, side * 0.5 * np.cos(flap), -0.5 * np.sin(flap)], axis=1) for side in (1, -1)]
    own = np.concatenate([np.broadcast_to(FUSELAGE[:, None], (5, len(TIME), 3)), tips])
    place = np.stack([2.0 * np.cos(TIME), 2.0 * np.sin(TIME), -1.5 - 0.1 * TIME], axis=1)
    markers = np.einsum("nij,mnj->mni", rotations(turning()), own) + place
    noisy: Array = markers + np.random.default_rng(seed).normal(0.0, 3e-4, markers.shape)
    return noisy


def angle_between(one: Array, other: Array) -> Array:
    """rad; of the rotation from one quaternion to the other."""
    return 2.0 * np.arccos(np.minimum(np.abs((one * other).sum(axis=1)), 1.0))


def test_it_is_the_fuselage_not_the_wings_and_its_attitude_is_the_birds() -> None:
    found = find_rigid_body(captured())
    assert found is not None and found.markers == (0, 1, 2, 3, 4)
    assert np.max(angle_between(found.quaternion, turning())) < 0.015
    middle = np.einsum("nij,j->ni", rotations(turning()), FUSELAGE.mean(axis=0))
    expected = middle + np.stack([2.0 * np.cos(TIME), 2.0 * np.sin(TIME), -1.5 - 0.1 * TIME], axis=1)
    assert np.max(np.abs(found.position - expected)) < 1.5e-3
    steps = (found.quaternion[1:] * found.quaternion[:-1]).sum(axis=1)
    assert np.all(steps > 0.99), "no frame has the other sign"


def test_a_marker_that_is_hidden_costs_no_frame_while_three_are_seen() -> None:
    markers = captured()
    markers[0, 300:600] = np.nan
    markers[3, 500:800] = np.nan
    markers[:3, 1000:1010] = np.nan
    found = find_rigid_body(markers)
    assert found is not None and len(found.markers) == 5
    lost = np.isnan(found.quaternion).any(axis=1)
    assert np.flatnonzero(lost).tolist() == list(range(1000, 1010))
    assert np.max(angle_between(found.quaternion, turning())[~lost]) < 0.02


@pytest.mark.parametrize("chosen", [[0, 1], [0, 5, 6], [5, 6]])
def test_too_few_markers_are_no_body(chosen: list[int]) -> None:
    assert find_rigid_body(captured()[chosen]) is None


def test_markers_in_one_line_tell_no_attitude() -> None:
    line = np.array([(-0.1, 0.0, 0.0), (0.0, 0.0, 0.0), (0.25, 0.0, 0.0)])
    assert find_rigid_body(np.broadcast_to(line[:, None], (3, 100, 3)).copy()) is None


def test_quaternions_of_rotations_about_every_axis_by_up_to_a_whole_turn() -> None:
    source = np.random.default_rng(1)
    quaternion = source.normal(size=(500, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    assert np.max(angle_between(quaternions(rotations(quaternion)), quaternion)) < 1e-6
    half_turns = np.array([(0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)])
    assert np.abs(quaternions(rotations(half_turns))) == pytest.approx(half_turns, abs=1e-12)
    assert np.stack(euler_from_quaternions(*quaternions(rotations(turning())).T)) == pytest.approx(
        np.stack(euler_from_quaternions(*turning().T)), abs=1e-9
    )


def test_among_many_markers_those_seen_most_are_looked_at() -> None:
    """GIVEN a body and thousands of markers that are seen now and then THEN it is found."""
    source = np.random.default_rng(2)
    seldom = np.full((3000, 60, 3), np.nan)
    seldom[:, :15] = source.uniform(-1.0, 1.0, (3000, 15, 3))
    body = np.array([[0.1, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.0, 0.05, 0.0]])[:, None] + np.zeros((3, 60, 3))
    found = find_rigid_body(np.concatenate([seldom[:2000], body, seldom[2000:]]))
    assert found is not None and found.markers == (2000, 2001, 2002)
