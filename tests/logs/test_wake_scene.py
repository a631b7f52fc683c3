"""A wake for viewers, read back: every step, wing and wake on both sides where they are, colours by strength."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from logs.scene import TRANSFORMS
from logs.wake_scene import THINNED, WAKE, write_wake
from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, Scheme, Snapshot, run
from wingbeat.errors import InputError

EPOCH_NS, STEPS, DT = 1_700_000_000_000_000_000, 6, 0.1
LATTICE = build_lattice([Surface("wing", (Section((0.0, 0.1, 0.0), 0.3), Section((0.0, 1.0, 0.0), 0.2)), 2, (3,))])


def glide() -> list[Snapshot]:
    seen: list[Snapshot] = []
    way = np.array([[-1.0], [0.0], [-0.1]])
    run(LATTICE, lambda t: LATTICE.nodes + t * way, Scheme(DT, STEPS, "free"), Air(1.2, True), watch=seen.append)
    return seen


def read(path: Path, topic: str) -> list[tuple[int, Any]]:
    with path.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[topic])
        return [(message.log_time, decoded) for _, _, message, decoded in messages]


def points(entity: Any) -> Any:
    return np.array([(p.x, p.y, p.z) for p in entity.triangles[0].points])


def test_the_wake_is_read_back_step_by_step(tmp_path: Path) -> None:
    course, path = glide(), tmp_path / "wake.mcap"
    write_wake(path, LATTICE, course, EPOCH_NS)
    scenes, frames = read(path, WAKE.name), read(path, TRANSFORMS.name)
    assert [time - EPOCH_NS for time, _ in scenes] == [round(at.time * 1e9) for at in course]
    for at, (_, frame) in zip(course, frames, strict=True):
        assert frame.transforms[0].translation.x == pytest.approx(at.nodes[0].min())
        assert (frame.transforms[0].parent_frame_id, frame.transforms[0].child_frame_id) == ("world", "wing")
    assert [len(scene.entities) for _, scene in scenes] == [2] + [4] * (STEPS - 1)


def test_wing_and_wake_stand_on_both_sides_where_they_are(tmp_path: Path) -> None:
    course, path = glide(), tmp_path / "new" / "wake.mcap"
    write_wake(path, LATTICE, course, EPOCH_NS)
    last = {entity.id: entity for entity in read(path, WAKE.name)[-1][1].entities}
    assert set(last) == {"right_wing", "left_wing", "right_wake", "left_wake"}
    assert {entity.frame_id for entity in last.values()} == {"world"}
    wing, wake, at = points(last["right_wing"]), points(last["right_wake"]), course[-1]
    assert wing.max(axis=0) == pytest.approx(at.nodes.max(axis=1)) and len(wing) == 4 * 6
    assert wake[:, 0].max() == pytest.approx(at.wake_nodes[0].max())
    assert len(wake) == 4 * 3 * -(-(STEPS - 1) // THINNED)
    assert points(last["left_wake"]) == pytest.approx(wake * (1.0, -1.0, 1.0))
    assert last["right_wake"].timestamp.nanos == (EPOCH_NS + round(at.time * 1e9)) % 1_000_000_000


def test_triangles_are_whole_and_coloured_by_strength(tmp_path: Path) -> None:
    course, path = glide(), tmp_path / "wake.mcap"
    write_wake(path, LATTICE, course, EPOCH_NS)
    (wake,) = next(e for e in read(path, WAKE.name)[-1][1].entities if e.id == "right_wake").triangles
    assert len(wake.colors) == len(wake.points) and len(wake.indices) == 3 * len(wake.points)
    assert max(wake.indices) == len(wake.points) - 1
    blue = np.array([colour.b for colour in wake.colors]).reshape(-1, 4)[:, 0]
    red = np.array([colour.r for colour in wake.colors]).reshape(-1, 4)[:, 0]
    strengths = course[-1].wake_strengths[::THINNED].ravel()
    fading = np.where(strengths > 0.0, blue, red)
    assert np.array_equal(np.argsort(fading), np.argsort(-np.abs(strengths)))


def test_a_recording_that_exists_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "wake.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"wake\.mcap"):
        write_wake(path, LATTICE, glide(), EPOCH_NS)
    assert path.read_bytes() == b"mine"
