"""Frames for viewers: z up, in agreement with the flight's own, and readable for everybody."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from recorded import EPOCH_NS
from scipy.spatial.transform import Rotation

from logs.poses import Frames, Pose, Posed, enu_from_flu, enu_from_ned, tail_in_body, wing_in_body

HINGE, TAIL = (0.1, 0.02, 0.03), (-0.4, 0.0, 0.0)
Vector = NDArray[np.float64]
angles = st.floats(-1.2, 1.2)
unit_quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple(part / math.hypot(*q) for part in q))
)


def rotate(quaternion: Any, vector: Any) -> Vector:
    """``vector`` turned by a quaternion (w, x, y, z)."""
    return np.asarray(Rotation.from_quat(quaternion, scalar_first=True).apply(vector))


def shown(pose: Pose, prefix: str = "", epoch_ns: int = EPOCH_NS) -> FrameTransforms:
    return FrameTransforms.FromString(Posed(pose.time_us, Frames(HINGE, TAIL, epoch_ns, prefix), pose).body)


@given(quaternion=unit_quaternions, vector=st.tuples(*[st.floats(-10.0, 10.0)] * 3))
def test_the_body_points_the_same_way_in_both_worlds(quaternion: Any, vector: Any) -> None:
    flu = (vector[0], -vector[1], -vector[2])
    assert rotate(enu_from_flu(quaternion), flu) == pytest.approx(enu_from_ned(rotate(quaternion, vector)), abs=1e-9)


def test_level_flight_to_the_north() -> None:
    assert rotate(enu_from_flu((1.0, 0.0, 0.0, 0.0)), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert rotate(enu_from_flu((1.0, 0.0, 0.0, 0.0)), (0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, 1.0))


@given(flap=angles, twist=angles)
def test_wings_flap_up_and_twist_leading_edge_up_as_mirror_images(flap: float, twist: float) -> None:
    left, right = wing_in_body(flap, twist, 1), wing_in_body(flap, twist, -1)
    assert rotate(left, (0.0, 1.0, 0.0)) == pytest.approx((0.0, math.cos(flap), math.sin(flap)), abs=1e-12)
    for point in ((0.3, 0.0, 0.0), (-0.1, 0.7, 0.0)):
        mirrored = (point[0], -point[1], point[2])
        assert rotate(right, mirrored) == pytest.approx(rotate(left, point) * (1.0, -1.0, 1.0), abs=1e-12)
    leading = rotate(wing_in_body(0.0, twist, 1), (1.0, 0.0, 0.0))
    assert leading[2] == pytest.approx(math.sin(0.5 * twist))


def test_a_tail_that_pitches_up_and_yaws_right_has_its_trailing_edge_up_and_right() -> None:
    assert rotate(tail_in_body(0.3, 0.0), (-1.0, 0.0, 0.0)) == pytest.approx((-math.cos(0.3), 0.0, math.sin(0.3)))
    assert rotate(tail_in_body(0.0, 0.3), (-1.0, 0.0, 0.0)) == pytest.approx((-math.cos(0.3), -math.sin(0.3), 0.0))


@given(elevator=angles, rudder=angles)
def test_the_tail_turns_rudder_first(elevator: float, rudder: float) -> None:
    expected = Rotation.from_euler("ZY", [rudder, elevator]).as_matrix()
    found = Rotation.from_quat(tail_in_body(elevator, rudder), scalar_first=True).as_matrix()
    assert found == pytest.approx(expected, abs=1e-12)


def test_frames_hang_together() -> None:
    pose = Pose(2_000_000, (10.0, 20.0, -30.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.4))
    frames = shown(pose, "estimated/").transforms
    assert [(frame.parent_frame_id, frame.child_frame_id) for frame in frames] == [
        ("world", "estimated/body"),
        ("estimated/body", "estimated/left_wing"),
        ("estimated/body", "estimated/right_wing"),
        ("estimated/body", "estimated/tail"),
    ]
    body = frames[0].translation
    assert (body.x, body.y, body.z) == (20.0, 10.0, 30.0)
    assert frames[1].translation.y == -frames[2].translation.y == 0.02
    assert all(frame.timestamp.ToNanoseconds() == EPOCH_NS + 2_000_000_000 for frame in frames)


@given(
    time_us=st.integers(0, 2**40),
    epoch_ns=st.sampled_from([0, EPOCH_NS, 2**35 * 10**9 - 2**51]),
    place=st.tuples(*[st.floats(allow_nan=False)] * 3),
    quaternion=unit_quaternions,
    others=st.tuples(*[angles] * 6),
)
def test_a_packed_pose_is_what_protobuf_makes_of_it(
    time_us: int, epoch_ns: int, place: Any, quaternion: Any, others: tuple[float, ...]
) -> None:
    pose = Pose(time_us, place, quaternion, others[:2], others[2:4], *others[4:])  # type: ignore[arg-type]
    built = FrameTransforms()
    for parent, child, translation, turned in (
        ("world", "body", enu_from_ned(place), enu_from_flu(quaternion)),
        ("body", "left_wing", HINGE, wing_in_body(others[0], others[2], 1)),
        ("body", "right_wing", (HINGE[0], -HINGE[1], HINGE[2]), wing_in_body(others[1], others[3], -1)),
        ("body", "tail", TAIL, tail_in_body(others[4], others[5])),
    ):
        frame = built.transforms.add(parent_frame_id=parent, child_frame_id=child)
        frame.timestamp.FromNanoseconds(epoch_ns + 1000 * time_us)
        frame.translation.x, frame.translation.y, frame.translation.z = translation
        frame.rotation.w, frame.rotation.x, frame.rotation.y, frame.rotation.z = turned
    found = shown(pose, epoch_ns=epoch_ns)
    assert found.SerializeToString(deterministic=True) == built.SerializeToString(deterministic=True)


def test_a_pose_without_numbers_cannot_be_shown_and_an_unknown_angle_can() -> None:
    pose = Pose(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert pose.can_be_shown() and pose._replace(elevator=math.nan).can_be_shown()
    for bad in (
        {"position_ned": (0.0, math.nan, 0.0)},
        {"quaternion": (math.inf, 0.0, 0.0, 0.0)},
        {"flap": (0.0, math.inf)},
        {"rudder": -math.inf},
    ):
        assert not pose._replace(**bad).can_be_shown()
