"""3D scene of the vehicle for Foxglove, Lichtblick and Rerun.

`SceneRecorder` stands between a flight and its recorder and adds `foxglove.FrameTransforms` at 50 Hz,
`foxglove.SceneUpdate` once a second and `foxglove.LocationFix` for every GPS fix. The time stamps inside these
messages are epoch time, because viewers match them with the log time.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import TracebackType
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message as Protobuf

from avionics import messages as m
from avionics import topics
from avionics.isolation import Guard
from logs.codecs import Stamped
from logs.poses import Frames, Pose, Posed, Vector, enu_from_ned
from logs.recorder import McapRecorder, TopicMessage
from sim_bridge import topics as truth_topics
from wingbeat.topic import Topic

TRANSFORMS = Topic("/view/transforms", FrameTransforms, 2000, 50.0, deterministic=False)
SCENE = Topic("/view/scene", SceneUpdate, 2001, 1.0, deterministic=False)
LOCATION = Topic("/view/location", LocationFix, 2002, 5.0, deterministic=False)
ESTIMATED_TRANSFORMS = Topic("/view/estimated/transforms", FrameTransforms, 2010, 50.0, deterministic=False)
ESTIMATED_SCENE = Topic("/view/estimated/scene", SceneUpdate, 2011, 1.0, deterministic=False)

TRANSFORM_PERIOD_US = 20_000
SCENE_PERIOD_US = 1_000_000
TRACK_POINTS = 300
"""Seconds of track in the scene."""


RAVEN = (1.0, 1.0, 1.0, 1.0, 1.0, 0.9375, 0.75, 0.4375, 0.0)
"""chords of Gerdes Eq. 1"""
ELLIPSE = (1.0, 0.99216, 0.96825, 0.92702, 0.86603, 0.78062, 0.66144, 0.48412, 0.0)
"""chords of an ellipse"""


class Shape(NamedTuple):
    """Outline of a vehicle in body axes FLU (x forward, y left, z up) from its center of mass."""

    semispan: float
    """m; wing hinge to tip"""
    chord: float
    """m; largest chord of a wing"""
    hinge: Vector
    """m; of the left wing's leading edge at its hinge"""
    nose: float
    """m; foremost point of the fuselage"""
    tail: Vector
    """m; hinge of the tail"""
    tail_span: float
    """m; tip to tip"""
    tail_chord: float
    """m"""
    fin_height: float
    """m; 0 for none"""
    body_radius: float = 0.04
    """m; largest radius of the fuselage"""
    chords: tuple[float, ...] = RAVEN
    """-; chord over the largest one at equal steps from the hinge to the tip"""


PLAIN_BIRD = Shape(0.5, 0.3, (0.1, 0.02, 0.0), 0.25, (-0.35, 0.0, 0.0), 0.25, 0.25, 0.0)
"""Outline of an unknown vehicle."""
FLOWN: Mapping[str, Shape] = {
    "arizona_100cm": Shape(
        0.5, 0.2, (0.08, 0.02, 0.03), 0.15, (-0.3567, 0.0, 0.0), 0.1732, 0.1732, 0.0775, 0.05, ELLIPSE
    ),
    "robo_raven_ii_d": Shape(0.762, 0.432, (0.15, 0.03, 0.04), 0.15, (-0.3588, 0.0, 0.0), 0.2449, 0.2449, 0.1, 0.05),
    "ulg_ornithopter": Shape(
        0.7, 0.3235, (0.131, 0.0, -0.015), 0.21, (-0.4839, 0.0, 0.0), 0.2646, 0.2646, 0.1183, 0.07, ELLIPSE
    ),
}
"""Outlines, to 0.1 mm, of the vehicles that the flight computer has by name. `outline.shape_of` computes them from
the vehicle files but loads the compiler of the physics, which the flight computer avoids.
"""


# --- messages for viewers -------------------------------------------------------------------------------


class Scene:
    """Builder of the viewers' messages of one vehicle from its poses."""

    def __init__(self, shape: Shape, start_epoch_ns: int, name: str = "", alpha: float = 1.0) -> None:
        """Initialize the messages.

        Args:
            shape: outline of the vehicle.
            start_epoch_ns: ns since 1970 at the zero of the vehicle clock.
            name: prefix of the frame names, with a slash, so that a scene can have two vehicles.
            alpha: opacity, 0 to 1.
        """
        self.start_epoch_ns = start_epoch_ns
        prefix = f"{name}/" if name else ""
        self.frames = Frames(shape.hinge, shape.tail, start_epoch_ns, prefix)
        self._scene = SceneUpdate(entities=entities(shape, prefix, alpha))
        self._line = self._scene.entities[-1].lines[0]

    def update(self, pose: Pose) -> SceneUpdate:
        """Return the parts of the vehicle and its track so far; the next call reuses the message."""
        point = enu_from_ned(pose.position_ned)
        if len(self._line.points) == TRACK_POINTS:
            del self._line.points[0]
        self._line.points.add(x=point[0], y=point[1], z=point[2])
        for entity in self._scene.entities:
            _stamp(entity.timestamp, self.start_epoch_ns, pose.time_us)
        return self._scene


def _stamp(target: Any, start_epoch_ns: int, time_us: int) -> None:
    target.seconds, target.nanos = divmod(start_epoch_ns + time_us * 1000, 1_000_000_000)


def location(fix: m.GpsFix, start_epoch_ns: int, frame: str = "body") -> LocationFix:
    """Build the map message of a fix; known accuracies become a covariance in east, north, up."""
    east = fix.horizontal_accuracy * fix.horizontal_accuracy
    up = fix.vertical_accuracy * fix.vertical_accuracy
    known = math.isfinite(east + up)
    out = LocationFix(
        frame_id=frame,
        latitude=math.degrees(fix.latitude),
        longitude=math.degrees(fix.longitude),
        altitude=fix.altitude,
        position_covariance=(east, 0.0, 0.0, 0.0, east, 0.0, 0.0, 0.0, up) if known else (0.0,) * 9,
        position_covariance_type=LocationFix.DIAGONAL_KNOWN if known else LocationFix.UNKNOWN,
    )
    _stamp(out.timestamp, start_epoch_ns, fix.time_us)
    return out


def entities(shape: Shape, prefix: str, alpha: float) -> list[SceneEntity]:
    """Return fuselage, wings and tail, each fixed to its frame, and last the track in the world frame."""
    plates = outlines(shape)
    colors = ((0.85, 0.33, 0.1, alpha), (0.1, 0.45, 0.75, alpha), (0.9, 0.7, 0.1, alpha))
    surfaces = [_surface(f"{prefix}{name}", plates[name], color) for name, color in zip(plates, colors, strict=True)]
    parts = [_fuselage(shape, prefix, alpha), *surfaces]
    track = SceneEntity(frame_id="world", id=f"{prefix}track")
    line = track.lines.add(type=LinePrimitive.LINE_STRIP, thickness=2.0, scale_invariant=True)
    line.pose.orientation.w = 1.0
    _paint(line.color, (0.2, 0.7, 0.3, alpha))
    return [*parts, track]


def outlines(shape: Shape) -> dict[str, list[list[Vector]]]:
    """Return four-cornered plates of ``left_wing``, ``right_wing`` and ``tail``, in m in the frame of that name."""
    x, half, height = shape.tail_chord, shape.tail_span / 2.0, shape.fin_height
    tail = [(0.0, half, 0.0), (-x, half, 0.0), (-x, -half, 0.0), (0.0, -half, 0.0)]
    fin = [(0.0, 0.0, 0.0), (-x, 0.0, 0.0), (-x, 0.0, height), (-x / 2.0, 0.0, height)]
    return {
        "left_wing": _wing(shape, 1),
        "right_wing": _wing(shape, -1),
        "tail": [tail, fin] if height else [tail],
    }


def _wing(shape: Shape, side: int) -> list[list[Vector]]:
    """Return the strips of a wing behind its straight leading edge."""
    count = len(shape.chords) - 1
    edge = [(side * shape.semispan * place / count, -shape.chord * chord) for place, chord in enumerate(shape.chords)]
    return [
        [(0.0, inner, 0.0), (behind, inner, 0.0), (behind_outer, outer, 0.0), (0.0, outer, 0.0)]
        for (inner, behind), (outer, behind_outer) in pairwise(edge)
    ]


def _fuselage(shape: Shape, prefix: str, alpha: float) -> SceneEntity:
    entity = SceneEntity(frame_id=f"{prefix}body", id=f"{prefix}fuselage", frame_locked=True)
    body = entity.spheres.add()
    body.pose.position.x = 0.5 * (shape.nose + shape.tail[0])
    body.pose.orientation.w = 1.0
    body.size.x, body.size.y, body.size.z = shape.nose - shape.tail[0], 1.6 * shape.body_radius, 2 * shape.body_radius
    _paint(body.color, (0.25, 0.25, 0.28, alpha))
    return entity


def _surface(frame: str, outlines: list[list[Vector]], color: tuple[float, float, float, float]) -> SceneEntity:
    """Return four-cornered plates with both faces."""
    entity = SceneEntity(frame_id=frame, id=frame, frame_locked=True)
    for a, b, c, d in outlines:
        triangles = entity.triangles.add()
        triangles.pose.orientation.w = 1.0
        for x, y, z in (a, b, c, a, c, d, c, b, a, d, c, a):
            triangles.points.add(x=x, y=y, z=z)
        _paint(triangles.color, color)
    return entity


def _paint(target: Any, color: tuple[float, float, float, float]) -> None:
    target.r, target.g, target.b, target.a = color


# --- during a flight ------------------------------------------------------------------------------------


class SceneRecorder:
    """Recorder that passes all messages to another recorder and adds the topics of viewers.

    It shows the truth if it is recorded (``/truth/state``, ``/truth/wing``), else, with ``estimated``, the estimates
    of the flight computer. Both have their own topics and frames and may be in one file. GPS fixes are always put on
    the map. Data that cannot be shown, such as an attitude of NaN, are omitted without an exception.
    """

    def __init__(
        self,
        inner: McapRecorder,
        shape: Shape | None,
        start_epoch_ns: int,
        estimated: bool = False,
        guard: Guard | None = None,
    ) -> None:
        """Initialize the topics.

        Without a ``shape`` only the map is added, for a recording beside one that shows the vehicle. ``guard``
        catches exceptions of the view so that the recording continues; without it they are raised.
        """
        self.inner = inner
        self._guard = guard
        self.scene = Scene(shape or PLAIN_BIRD, start_epoch_ns, *(("estimated", 0.4) if estimated else ("", 1.0)))
        self._topics = (ESTIMATED_TRANSFORMS, ESTIMATED_SCENE) if estimated else (TRANSFORMS, SCENE)
        self._pose_channel = (topics.ATTITUDE if estimated else truth_topics.STATE).channel
        self._latest: dict[int, Any] = {}
        kept = _ESTIMATED_TOPICS if estimated else _TRUTH_TOPICS
        self.watched: frozenset[int] = (kept if shape is not None else frozenset[int]()) | {_FIXES}
        self._located = "estimated/body" if estimated and shape is not None else "body"
        self._pose = _estimated_pose if estimated else _true_pose
        self._next_us = [0, 0]
        self.added: dict[str, int] = {}
        """number of added messages, by topic"""

    @property
    def failure(self) -> str:
        """Reason why recording has ended, one line; empty while it continues."""
        return self.inner.failure

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Record one message and the view at its time."""
        self.inner.record(topic, message)
        if topic.channel in self.watched:
            for seen in self.views_of(topic.channel, message):
                self.inner.record(*seen)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to the recording."""
        self.inner.attach(name, media_type, data)

    def note(self, name: str, values: dict[str, str]) -> None:
        """Record metadata."""
        self.inner.note(name, values)

    def close(self) -> None:
        """Finish the recording; further calls have no effect."""
        self.inner.close()

    def __enter__(self) -> SceneRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def views_of(self, channel: int, message: Any) -> Sequence[TopicMessage]:
        """Return the viewers' messages that follow from one message of a channel in `watched`."""
        if self._guard is None:
            return self._updates_of(channel, message)
        return self._guard.run(self._updates_of, channel, message) or ()

    def _updates_of(self, channel: int, message: Any) -> Sequence[TopicMessage]:
        """Return the view messages that follow from one message of an observed channel."""
        seen: Sequence[TopicMessage] = ()
        # A fault of the view must not stop the flight.
        with contextlib.suppress(ValueError, ArithmeticError, TypeError):
            if channel == _FIXES:
                seen = self._placed(message)
            else:
                self._latest[channel] = message
                if channel == self._pose_channel and message.time_us >= self._next_us[0]:
                    seen = self._shown(message.time_us)
        for topic, _ in seen:
            self.added[topic.name] = self.added.get(topic.name, 0) + 1
        return seen

    def _placed(self, fix: m.GpsFix) -> Sequence[TopicMessage]:
        if fix.fix_type < 2:
            return ()
        return ((LOCATION, _stamped(fix.time_us, location(fix, self.scene.start_epoch_ns, self._located))),)

    def _shown(self, time_us: int) -> Sequence[TopicMessage]:
        self._next_us[0] = time_us + TRANSFORM_PERIOD_US
        pose = self._pose(self._latest)
        if not pose.can_be_shown():
            return ()
        frames = self._topics[0], Posed(time_us, self.scene.frames, pose)
        if time_us < self._next_us[1]:
            return (frames,)
        self._next_us[1] = time_us + SCENE_PERIOD_US
        return frames, (self._topics[1], _stamped(time_us, self.scene.update(pose)))


def _stamped(time_us: int, body: Protobuf) -> Stamped:
    return Stamped(time_us, body.SerializeToString(deterministic=True))


_FIXES = topics.GPS.channel
_TRUTH_TOPICS = frozenset({truth_topics.STATE.channel, truth_topics.WING.channel})
_ESTIMATED_TOPICS = frozenset(
    topic.channel for topic in (topics.ATTITUDE, topics.POSITION, topics.ALTITUDE, topics.WING, topics.ACTUATORS)
)


def _true_pose(latest: dict[int, Any]) -> Pose:
    state = latest[truth_topics.STATE.channel]
    wing = latest.get(truth_topics.WING.channel)
    place = (state.north, state.east, state.down)
    quaternion = (state.quaternion_w, state.quaternion_x, state.quaternion_y, state.quaternion_z)
    if wing is None:
        return Pose(state.time_us, place, quaternion)
    flap, twist = (wing.angle_left, wing.angle_right), (wing.twist_left, wing.twist_right)
    return Pose(state.time_us, place, quaternion, flap, twist, wing.elevator, wing.rudder)


def _estimated_pose(latest: dict[int, Any]) -> Pose:
    """Return the estimated pose; unknown position, altitude, wings and tail are zero, and NaN counts as unknown."""
    attitude = latest[topics.ATTITUDE.channel]
    position, altitude = latest.get(topics.POSITION.channel), latest.get(topics.ALTITUDE.channel)
    wing, actuators = latest.get(topics.WING.channel), latest.get(topics.ACTUATORS.channel)
    place = (
        position.north if position else 0.0,
        position.east if position else 0.0,
        -altitude.altitude if altitude else 0.0,
    )
    north, east, down = (part if math.isfinite(part) else 0.0 for part in place)
    return Pose(
        attitude.time_us,
        (north, east, down),
        (attitude.quaternion_w, attitude.quaternion_x, attitude.quaternion_y, attitude.quaternion_z),
        (wing.angle_left, wing.angle_right) if wing else (0.0, 0.0),
        elevator=actuators.elevator if actuators else 0.0,
        rudder=actuators.rudder if actuators else 0.0,
    )
