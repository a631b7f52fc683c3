"""What viewers are shown: frames with z up that agree with the flight's own, and scenes that belong to them."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from recorded import EPOCH_NS, flight

from avionics import topics
from avionics.vehicles import vehicle_names
from logs.outline import shape_of
from logs.poses import Pose, wing_in_body
from logs.recorder import McapRecorder
from logs.scene import ELLIPSE, FLOWN, RAVEN, TRACK_POINTS, Scene, SceneRecorder, Shape, entities, location, outlines
from sim_bridge import topics as truth_topics
from sim_bridge.vehicles import load_vehicle

SHAPE = Shape(0.5, 0.3, (0.1, 0.02, 0.03), 0.2, (-0.4, 0.0, 0.0), 0.3, 0.2, 0.1)
SHOWN = (truth_topics.STATE, truth_topics.WING, topics.ATTITUDE, topics.WING, topics.ALTITUDE)


def test_a_wing_has_the_area_of_its_planform() -> None:
    """A raven planform has 5/6 of its rectangle, an ellipse pi/4 (of the drawn strips, within 1 %)."""
    for chords, area in ((RAVEN, 5 / 6), (ELLIPSE, math.pi / 4)):
        strips = np.array(outlines(SHAPE._replace(chords=chords))["left_wing"])
        x, y = strips[..., 0], strips[..., 1]
        areas = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
        assert np.sum(areas) == pytest.approx(area * SHAPE.semispan * SHAPE.chord, rel=0.02)


def test_the_wings_of_the_scene_reach_from_the_hinge_to_the_tip() -> None:
    parts = {entity.id: entity for entity in entities(SHAPE, "", 1.0)}
    assert set(parts) == {"fuselage", "left_wing", "right_wing", "tail", "track"}
    points = [(p.x, p.y) for strip in parts["left_wing"].triangles for p in strip.points]
    assert max(y for _, y in points) == SHAPE.semispan and min(y for _, y in points) == 0.0
    assert (min(x for x, _ in points), max(x for x, _ in points)) == (-SHAPE.chord, 0.0)
    assert parts["fuselage"].spheres[0].size.z == pytest.approx(2 * SHAPE.body_radius)
    assert all(entity.frame_locked for name, entity in parts.items() if name != "track")
    assert len(parts["tail"].triangles) == 2
    assert len(entities(SHAPE._replace(fin_height=0.0), "", 1.0)[3].triangles) == 1


def test_the_track_grows_and_is_bounded() -> None:
    scene = Scene(SHAPE, EPOCH_NS)
    for n in range(TRACK_POINTS + 5):
        update = scene.update(Pose(n * 10**6, (n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
    track = update.entities[-1].lines[0].points
    assert (len(track), track[0].y, track[-1].y) == (TRACK_POINTS, 5.0, TRACK_POINTS + 4.0)


def recorded_views(tmp_path: Path, estimated: bool, shape: Shape | None = SHAPE) -> dict[str, list[Any]]:
    recorder = McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0)
    with SceneRecorder(recorder, shape, EPOCH_NS, estimated) as wrapped:
        wrapped.note("flight", {"vehicle": "x"})
        wrapped.attach("a", "b", b"c")
        for topic, message in flight(
            2.0, (truth_topics.STATE, truth_topics.WING, topics.ATTITUDE, topics.WING, topics.ALTITUDE)
        ):
            wrapped.record(topic, message)
        for topic, message in flight(1.0, (topics.GPS,)):
            wrapped.record(topic, message._replace(fix_type=3, latitude=0.5, longitude=-1.0))
            wrapped.record(topic, message._replace(fix_type=0))
    assert not recorder.refusal and not recorder.failure
    added = wrapped.added
    found: dict[str, list[Any]] = {}
    with (tmp_path / "a.mcap").open("rb") as file:
        for _, channel, raw, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((raw.log_time, decoded))
    assert added == {name: len(messages) for name, messages in found.items() if name.startswith("/view/")}
    return found


def test_the_truth_is_shown_at_50_hz_and_the_scene_once_a_second(tmp_path: Path) -> None:
    found = recorded_views(tmp_path, estimated=False)
    times = [time for time, _ in found["/view/transforms"]]
    assert set(np.diff(times)) == {20_000_000}
    assert len(times) == 100 and len(found["/view/scene"]) == 2
    assert "/view/estimated/transforms" not in found
    for time, frames in found["/view/transforms"]:
        assert isinstance(frames.transforms[0].translation.x, float)
        assert frames.transforms[0].timestamp.ToNanoseconds() == time
    assert len(found["/view/location"]) == 5
    fix = found["/view/location"][0][1]
    assert (fix.latitude, fix.longitude) == (math.degrees(0.5), math.degrees(-1.0))


def test_the_wings_follow_the_recorded_angles(tmp_path: Path) -> None:
    found = recorded_views(tmp_path, estimated=False)
    wings = [message for topic, message in flight(2.0, SHOWN) if topic is truth_topics.WING]
    by_time = {EPOCH_NS + message.time_us * 1000: message for message in wings}
    for time, frames in found["/view/transforms"][1:]:
        wing = by_time[time - 5_000_000]  # the state of a tick comes before its wings
        rotation = frames.transforms[1].rotation
        expected = wing_in_body(wing.angle_left, wing.twist_left, 1)
        assert (rotation.w, rotation.x, rotation.y, rotation.z) == pytest.approx(expected)


def test_the_estimate_is_shown_beside_the_truth(tmp_path: Path) -> None:
    found = recorded_views(tmp_path, estimated=True)
    assert len(found["/view/estimated/transforms"]) == 100 and len(found["/view/estimated/scene"]) == 2
    assert "/view/transforms" not in found
    frames = found["/view/estimated/transforms"][0][1]
    assert frames.transforms[0].child_frame_id == "estimated/body"
    assert found["/view/location"][0][1].frame_id == "estimated/body"


def test_beside_a_recording_that_shows_the_bird_there_is_the_map_alone(tmp_path: Path) -> None:
    found = recorded_views(tmp_path, estimated=True, shape=None)
    assert [name for name in found if name.startswith("/view/")] == ["/view/location"]
    assert {fix.frame_id for _, fix in found["/view/location"]} == {"body"}


def test_what_cannot_be_shown_is_left_out_and_harms_nothing(tmp_path: Path) -> None:
    worst = {"time_us": 10_000_000, "fix_type": 3, "latitude": math.inf, "horizontal_accuracy": 1e300}
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS) as recorder:
        seen = SceneRecorder(recorder, SHAPE, EPOCH_NS, estimated=True)
        (_, attitude), (_, wing), (_, fix) = (
            flight(1.0, (topic,))[0] for topic in (topics.ATTITUDE, topics.WING, topics.GPS)
        )
        seen.record(topics.ATTITUDE, attitude._replace(quaternion_w=math.nan))
        seen.record(topics.WING, wing._replace(angle_left=math.inf))
        seen.record(topics.ATTITUDE, attitude._replace(time_us=5_000_000))
        assert not seen.added
        seen.record(topics.GPS, fix._replace(**worst))
        assert seen.added == {"/view/location": 1} and not recorder.refused
    shown = location(fix._replace(**worst), EPOCH_NS)
    assert shown.position_covariance_type == shown.UNKNOWN and not any(shown.position_covariance)


def test_the_outlines_that_a_flight_computer_knows_are_those_of_the_worlds_files() -> None:
    assert set(FLOWN) == set(vehicle_names())
    for name, shape in FLOWN.items():
        for known, true in zip(shape, shape_of(load_vehicle(name)), strict=True):
            assert known == pytest.approx(true, abs=5e-5)


def test_a_flight_computer_draws_a_bird_without_the_physics_compiler() -> None:
    script = "import sys, groundstation.command.avionics; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0


def test_accuracy_of_a_fix_is_a_covariance() -> None:
    (_, fix), *_ = flight(0.5, (topics.GPS,))
    shown = location(fix._replace(horizontal_accuracy=2.0, vertical_accuracy=3.0), EPOCH_NS)
    assert list(shown.position_covariance) == [4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 9.0]
