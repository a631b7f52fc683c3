"""Rotation matrices, quaternions and Euler angles against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wingbeat.quaternions import dcm_from_quaternion, frd_from_ned, quaternion_from_euler
from wingbeat.rotation_arrays import dcms_from_quaternions, euler_from_quaternions, quaternions_from_euler
from wingbeat.rotations import (
    Matrix,
    cross,
    dcm_from_rotation_vector,
    euler_from_dcm,
    multiply,
    norm,
    orthonormalize,
    quaternion_from_dcm,
    rotate,
    rotate_back,
)

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
angles = st.floats(-1.4, 1.4)


@given(roll=angles, pitch=angles, yaw=st.floats(-3.1, 3.1))
def test_euler_angles_and_quaternions_are_inverses(roll: float, pitch: float, yaw: float) -> None:
    quaternion = np.array(quaternions_from_euler(*(np.array([angle]) for angle in (roll, pitch, yaw))))
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert Rotation.from_quat(quaternion[:, 0], scalar_first=True).as_matrix() == pytest.approx(expected, abs=1e-9)
    assert [float(angle[0]) for angle in euler_from_quaternions(*quaternion)] == pytest.approx(
        [roll, pitch, yaw], abs=1e-6
    )
    assert quaternion_from_euler(roll, pitch, yaw) == pytest.approx(quaternion[:, 0])
    assert euler_from_dcm(dcm_from_quaternion(quaternion_from_euler(roll, pitch, yaw))) == pytest.approx(
        [roll, pitch, yaw], abs=1e-9
    )


@given(v=vectors)
def test_rotation_is_orthonormal_and_keeps_its_axis(v: tuple[float, float, float]) -> None:
    r = dcm_from_rotation_vector(*v)
    assert np.array(multiply(r, _transposed(r))) == pytest.approx(np.eye(3).ravel(), abs=1e-12)
    assert rotate(r, v) == pytest.approx(v, abs=1e-9)


@given(v=vectors, w=vectors)
def test_rotations_compose_and_come_back(v: tuple[float, float, float], w: tuple[float, float, float]) -> None:
    r = multiply(dcm_from_rotation_vector(*v), dcm_from_rotation_vector(*w))
    assert rotate_back(r, rotate(r, v)) == pytest.approx(v, abs=1e-9)
    assert rotate(r, v) == pytest.approx(
        rotate(dcm_from_rotation_vector(*v), rotate(dcm_from_rotation_vector(*w), v)), abs=1e-9
    )
    assert np.array(dcm_from_quaternion(quaternion_from_dcm(r))) == pytest.approx(np.array(r), abs=1e-9)
    quaternion = np.array([quaternion_from_dcm(r)])
    assert dcms_from_quaternions(quaternion)[0].ravel() == pytest.approx(np.array(r), abs=1e-9)
    assert frd_from_ned(quaternion_from_dcm(r), v) == pytest.approx(rotate_back(r, v), abs=1e-9)
    assert norm(cross(v, v)) == 0.0


@given(v=vectors, stretch=st.floats(0.99, 1.01))
def test_orthonormalize_removes_a_scale(v: tuple[float, float, float], stretch: float) -> None:
    r = dcm_from_rotation_vector(*v)
    stretched = tuple(stretch * value for value in r)
    assert orthonormalize(stretched) == pytest.approx(r, abs=1e-9)  # type: ignore[arg-type]


def test_frd_from_ned_normalizes_the_quaternion() -> None:
    q = quaternion_from_euler(0.3, -0.2, 1.0)
    doubled = (2 * q[0], 2 * q[1], 2 * q[2], 2 * q[3])
    assert frd_from_ned(doubled, (0.2, 0.1, 0.4)) == pytest.approx(frd_from_ned(q, (0.2, 0.1, 0.4)))


def _transposed(r: Matrix) -> Matrix:
    return (r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8])
