"""3D scene of a lattice and its wake for viewers.

`write_wake` makes a recording of one `foxglove.SceneUpdate` a step: wing and wake as triangles, the wake coloured by
the strength of its rings, and its rows' edges as lines. `foxglove.FrameTransforms` carry the frame ``wing`` along
with the foremost point of the lattice, to be followed. The lattice's axes (x back, y right, z up) are the viewer's
``world``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message as Protobuf

from logs.codecs import Stamped
from logs.recorder import McapRecorder
from logs.scene import TRANSFORMS
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, grid_of
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Snapshot
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.topic import Topic

WAKE = Topic("/view/wake", SceneUpdate, 2020, 82.5, deterministic=False)
WING, EDGE, RISING, FALLING, NOTHING = (
    (0.22, 0.24, 0.28, 1.0),
    (0.35, 0.38, 0.43, 0.6),
    (0.84, 0.37, 0.0, 0.85),
    (0.0, 0.45, 0.7, 0.85),
    (0.9, 0.9, 0.88, 0.85),
)
"""red, green, blue, opacity, 0 to 1; of the rings of the wake: largest strength of either sign, and zero strength"""
THINNED = 2
"""rows of the wake that are drawn as one"""
MIRROR = (1.0, -1.0, 1.0)

Colour = tuple[float, float, float, float]


def write_wake(path: Path, lattice: Lattice, course: Sequence[Snapshot], start_epoch_ns: int | None = None) -> None:
    """Write the ``course`` of the lattice's first surface and its mirror image in y = 0 into a new file.

    Args:
        path: of the new file; its folder is created if missing.
        lattice: lattice whose nodes the course contains.
        course: time history of the nodes.
        start_epoch_ns: ns since 1970 at time 0 (default: now).

    Raises:
        InputError: the file exists, cannot be created, or the disk is full.
    """
    limit = max((float(np.abs(at.wake_strengths).max(initial=0.0)) for at in course), default=0.0) or 1.0
    with McapRecorder(path, start_epoch_ns=start_epoch_ns) as recorder:
        for at in course:
            stamp = recorder.start_epoch_ns + round(at.time * 1e9)
            time_us = round(at.time * 1e6)
            for topic, message in ((TRANSFORMS, _frame(at, stamp)), (WAKE, _scene(lattice, at, limit, stamp))):
                recorder.record(topic, Stamped(time_us, message.SerializeToString(deterministic=True)))
    if recorder.failure:
        raise InputError(f"{path}: {recorder.failure}")


def _frame(at: Snapshot, stamp: int) -> Protobuf:
    found = FrameTransforms()
    frame = found.transforms.add(parent_frame_id="world", child_frame_id="wing")
    frame.translation.x, frame.rotation.w = float(at.nodes[0].min()), 1.0
    _stamp(frame.timestamp, stamp)
    return found


def _scene(lattice: Lattice, at: Snapshot, limit: float, stamp: int) -> Protobuf:
    grid = grid_of(lattice, at.nodes, 0)
    wings = [_grid_entity(f"{side}_wing", one, [], stamp) for side, one in _sides(grid)]
    if not len(at.wake_strengths):
        return SceneUpdate(entities=wings)
    rows = np.arange(0, len(at.wake_strengths), THINNED)
    nodes = at.wake_nodes[:, [*rows.tolist(), len(at.wake_strengths)]].transpose(1, 2, 0)
    colours = [_colour(float(share)) for share in (at.wake_strengths[rows] / limit).ravel()]
    wakes = [_grid_entity(f"{side}_wake", one, colours, stamp) for side, one in _sides(nodes)]
    return SceneUpdate(entities=[*wings, *wakes])


def _sides(nodes: Floats) -> Iterator[tuple[str, Floats]]:
    yield "right", nodes
    yield "left", np.asarray(nodes * MIRROR)


def _grid_entity(name: str, nodes: Floats, colours: list[Colour], stamp: int) -> SceneEntity:
    """Nodes (rows + 1, columns + 1, 3) as plates, one of ``colours`` each, and the lines along its rows.

    Without colours it is a wing.
    """
    entity = SceneEntity(frame_id="world", id=name)
    _stamp(entity.timestamp, stamp)
    plates = entity.triangles.add()
    plates.pose.orientation.w = 1.0
    _paint(plates.color, WING)
    ring = 0
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            _add_plate(plates, nodes[[i, i, i + 1, i + 1], [j, j + 1, j + 1, j]], colours[ring] if colours else None)
            ring += 1
    for row in nodes:
        _add_line(entity, row)
    return entity


def _add_plate(plates: Any, corners: Floats, colour: Colour | None) -> None:
    """Four ``corners`` (4, 3) with both faces."""
    first = len(plates.points)
    for x, y, z in corners.tolist():
        plates.points.add(x=x, y=y, z=z)
        if colour is not None:
            _paint(plates.colors.add(), colour)
    plates.indices.extend(first + k for k in (0, 1, 2, 0, 2, 3, 2, 1, 0, 3, 2, 0))


def _add_line(entity: SceneEntity, points: Floats) -> None:
    line = entity.lines.add(type=LinePrimitive.LINE_STRIP, thickness=1.0, scale_invariant=True)
    line.pose.orientation.w = 1.0
    _paint(line.color, EDGE)
    for x, y, z in points.tolist():
        line.points.add(x=x, y=y, z=z)


def _colour(share: float) -> Colour:
    """Of a ring's strength as a share of the strongest, -1 to 1."""
    end, much = (RISING if share > 0.0 else FALLING), abs(share)
    red, green, blue, opacity = (a + much * (b - a) for a, b in zip(NOTHING, end, strict=True))
    return red, green, blue, opacity


def _paint(target: Any, colour: Colour) -> None:
    target.r, target.g, target.b, target.a = colour


def _stamp(target: Any, stamp: int) -> None:
    target.seconds, target.nanos = divmod(stamp, 1_000_000_000)
