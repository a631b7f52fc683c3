"""Angles and quaternions against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from logs.rotations import angles_of, quaternion_of

angles = st.floats(-1.4, 1.4)


@given(roll=angles, pitch=angles, yaw=st.floats(-3.1, 3.1))
def test_angles_and_quaternions_are_each_others_inverse(roll: float, pitch: float, yaw: float) -> None:
    quaternion = np.array(quaternion_of(*(np.array([angle]) for angle in (roll, pitch, yaw))))
    wanted = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert Rotation.from_quat(quaternion[:, 0], scalar_first=True).as_matrix() == pytest.approx(wanted, abs=1e-9)
    assert [float(angle[0]) for angle in angles_of(*quaternion)] == pytest.approx([roll, pitch, yaw], abs=1e-6)
