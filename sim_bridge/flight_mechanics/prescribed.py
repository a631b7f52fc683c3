"""Prescribed wing motion: Fourier series over a stroke, or samples of one.

The stroke plane passes through the hinges, raised at its rear so that it makes ``stroke_plane`` with the body's x-y
plane: 0 is an insect's hovering stroke (wings sweep fore and aft), pi/2 a bird's (wings flap up and down). Right wing
first in words, the left one is its mirror image:

* *stroke angle*: the span turns in the plane, positive towards the end of the upstroke (aft or up);
* *deviation*: the span leaves the plane, positive forward and up;
* *feathering*: the chord turns about the span. At 0 it stands across the plane, leading edge forward or up; positive
  raises the leading edge (bird) or tips it aft (insect). *Twist* is added to it, linearly from root to tip.

A recorded wing is a bird's that flaps and twists about its leading edge. Accelerations are those of Han et al. 2017,
Eq. B.7: rates of the components in section axes, which turn; velocities those of Grauer et al. 2011, Eq. 9.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import Motion, Strips
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

LEFT, RIGHT = -1.0, 1.0
SIDES = (LEFT, RIGHT)
"""of y"""
MIDDLE = 0.5
"""chords behind the leading edge; reference point of the protocol's velocities"""


class Harmonics(NamedTuple):
    """Fourier series in the phase of the stroke."""

    mean: float = 0.0
    """rad"""
    cosine: tuple[float, ...] = ()
    """rad; of the first, second ... harmonic"""
    sine: tuple[float, ...] = ()
    """rad; likewise"""


class PrescribedStroke(NamedTuple):
    """Joint motion of the wings; both wings are alike."""

    frequency: float
    """Hz"""
    stroke_plane: float
    """rad; relative to the body's x-y plane"""
    stroke: Harmonics
    deviation: Harmonics = Harmonics()
    feathering: Harmonics = Harmonics()
    twist: Harmonics = Harmonics()
    axis: float = 0.25
    """-; feathering axis, in chords behind the leading edge"""
    hinge: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m; of the right wing, body axes"""


class JointAngles(NamedTuple):
    """Sampled joint motion of a wing: each (3, N), angle in rad, its rate and acceleration."""

    stroke: Floats
    deviation: Floats
    feathering: Floats
    twist: Floats
    """of the tip"""


class WingMount(NamedTuple):
    """Attachment of the wings, see `PrescribedStroke`."""

    stroke_plane: float
    """rad; relative to the body's x-y plane"""
    axis: float = 0.25
    """-; feathering axis, in chords behind the leading edge"""
    hinge: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m; of the right wing, body axes"""


class StrokeKinematics(NamedTuple):
    """Motion at equal steps of a stroke."""

    period: float
    """s"""
    motions: tuple[Motion, ...]
    normal_acceleration: Floats
    """(phases, n) m/s^2; of mid-chord relative to the air: derivative of the velocity component along the normal
    (up)
    """
    pitch_acceleration: Floats
    """(phases, n) rad/s^2; derivative of the pitch rate"""


class Wing(NamedTuple):
    """Sections of one wing, from root to tip, with a straight leading edge along the hinge's spar."""

    span: Floats
    """(n,) m; from the hinge to the center of each section"""
    chord: Floats
    """(n,) m"""
    width: Floats
    """(n,) m"""
    hinge: Floats
    """(3,) m; of the right wing, from the fuselage's center of mass, body axes"""


class WingMotion(NamedTuple):
    """One stroke at N instants, the last one interval before the end of the period."""

    phase: Floats
    """(N,) -; of the stroke, 0 to 1"""
    frequency: float
    """Hz; of the stroke"""
    flap: Floats
    """(N,) rad; wing up positive"""
    flap_rate: Floats
    """(N,) rad/s"""
    twist: Floats
    """(N,) rad; of the tip, leading edge up, linear from the hinge"""
    twist_rate: Floats
    """(N,) rad/s"""
    velocity: Floats
    """(N, 3) m/s; of the fuselage relative to the air, body axes"""
    omega: Floats
    """(N, 3) rad/s; of the fuselage, body axes"""


class Stroke(NamedTuple):
    """Flapping between two angles; each half stroke is half a cosine of its own duration."""

    frequency: float
    """Hz"""
    highest: float
    """rad; wing up positive"""
    lowest: float
    """rad"""
    down_from: float
    """-; phase at the start of the downstroke"""
    down_to: float
    """-; phase at the end of the downstroke"""


class SectionVelocity(NamedTuple):
    """Velocity of one point of each section relative to the air in section axes, each (N, n) m/s."""

    along: Floats
    """forward along the chord"""
    down: Floats
    """against the normal"""
    outward: Floats
    """towards the tip"""


SLOW_HAWK_STROKE = Stroke(frequency=5.91, highest=0.67, lowest=-0.39, down_from=0.24, down_to=0.78)
"""Grauer V.A: extrema, phases, frequency; its flap angle is positive wing down. The cosines are chosen."""


def elliptic_wing(semispan: float, root_chord: float, sections: int, hinge: Floats) -> Wing:
    """Return a wing with a quarter-elliptic chord from root to tip."""
    edges = np.linspace(0.0, semispan, sections + 1)
    span = 0.5 * (edges[1:] + edges[:-1])
    return Wing(span, root_chord * np.sqrt(1.0 - (span / semispan) ** 2), np.diff(edges), hinge)


def flap_angles(stroke: Stroke, phase: Floats) -> tuple[Floats, Floats]:
    """Return flap angle in rad and rate in rad/s (N,) at the ``phase`` (N,) of a stroke.

    Raises:
        InputError: the phases of the downstroke are not increasing within one stroke.
    """
    length = stroke.down_to - stroke.down_from
    if not 0.0 < length < 1.0:
        raise InputError(
            f"a down-stroke from phase {stroke.down_from:g} to {stroke.down_to:g} is not part of a stroke"
        )
    since = np.mod(phase - stroke.down_from, 1.0)
    falling = since < length
    share = np.where(falling, since / length, (since - length) / (1.0 - length))
    amplitude = np.where(falling, 1.0, -1.0) * 0.5 * (stroke.highest - stroke.lowest)
    share_rate = stroke.frequency / np.where(falling, length, 1.0 - length)
    middle = 0.5 * (stroke.highest + stroke.lowest)
    return middle + amplitude * np.cos(np.pi * share), -amplitude * np.pi * share_rate * np.sin(np.pi * share)


def steady_flight(stroke: Stroke, instants: int, airspeed: float, angle: float = 0.0) -> WingMotion:
    """Return a stroke without twist in straight flight at an ``angle`` of attack in rad of the fuselage."""
    phase = np.arange(instants) / instants
    flap, rate = flap_angles(stroke, phase)
    velocity = np.tile([airspeed * math.cos(angle), 0.0, airspeed * math.sin(angle)], (instants, 1))
    still = np.zeros(instants)
    return WingMotion(phase, stroke.frequency, flap, rate, still, still, velocity, np.zeros((instants, 3)))


class _Joints(NamedTuple):
    """Joint motion of both wings: each (3, N), angle in rad, its rate and acceleration."""

    stroke_plane: float
    """rad"""
    stroke: Floats
    deviation: Floats
    feathering: Floats
    twist: Floats
    """of the tip"""


class _Mount(NamedTuple):
    """Sections of one wing and their attachment."""

    span: Floats
    """(n,) m"""
    chord: Floats
    """(n,) m"""
    axis: float
    """-; axis of feathering and twist, in chords behind the leading edge"""
    hinge: Floats
    """(3,) m; body axes"""


class _Wing(NamedTuple):
    """The right wing in body axes: each (phases, 3) or (phases, strips, 3)."""

    span: Floats
    span_rate: Floats
    span_acceleration: Floats
    normal: Floats
    normal_rate: Floats
    chord: Floats
    chord_rate: Floats
    chord_acceleration: Floats
    turn: Floats
    """(phases, strips) rad/s^2; pitch acceleration from the joints"""


def series(harmonics: Harmonics, phases: Floats, frequency: float) -> Floats:
    """Evaluate (3, phases): angle rad, rate rad/s and acceleration rad/s^2 at ``phases`` (0 to 1) of a stroke."""
    found = np.zeros((3, len(phases)))
    found[0] = harmonics.mean
    for quarter, amplitudes in ((0.0, harmonics.cosine), (-0.25, harmonics.sine)):
        for order, amplitude in enumerate(amplitudes, start=1):
            omega, angle = 2.0 * math.pi * frequency * order, 2.0 * math.pi * (order * phases + quarter)
            found[0] += amplitude * np.cos(angle)
            found[1] -= amplitude * omega * np.sin(angle)
            found[2] -= amplitude * omega * omega * np.cos(angle)
    return found


def _turning(vector: Floats, omega: Floats, omega_rate: Floats) -> tuple[Floats, Floats]:
    """Return first and second derivative of a vector that rotates with ``omega``."""
    rate = np.cross(omega, vector)
    return rate, np.cross(omega_rate, vector) + np.cross(omega, rate)


def _wing(joints: _Joints, eta: Floats) -> _Wing:
    """Return the directions of the right wing and their derivatives."""
    phi, psi, theta, twist = (angles[:, :, None] for angles in joints[1:])
    c, s = math.cos(joints.stroke_plane), math.sin(joints.stroke_plane)
    right, back, across = np.array([0.0, 1.0, 0.0]), np.array([-c, 0.0, -s]), np.array([s, 0.0, -c])
    outward = np.cos(phi[0]) * right + np.sin(phi[0]) * back
    swept = np.cos(phi[0]) * back - np.sin(phi[0]) * right
    omega = -phi[1] * across + psi[1] * swept
    omega_rate = -phi[2] * across + psi[2] * swept - psi[1] * phi[1] * outward
    span = np.cos(psi[0]) * outward + np.sin(psi[0]) * across
    risen = np.cos(psi[0]) * across - np.sin(psi[0]) * outward
    span_rate, span_acceleration = _turning(span, omega, omega_rate)
    pitch = theta[:, :, None, :] + eta[:, None] * twist[:, :, None, :]
    omega_strip = omega[:, None] + pitch[1] * span[:, None]
    rate_strip = omega_rate[:, None] + pitch[2] * span[:, None] + pitch[1] * span_rate[:, None]
    chord = np.cos(pitch[0]) * risen[:, None] + np.sin(pitch[0]) * swept[:, None]
    normal = np.cos(pitch[0]) * swept[:, None] - np.sin(pitch[0]) * risen[:, None]
    chord_rate, chord_acceleration = _turning(chord, omega_strip, rate_strip)
    turn = np.sum(rate_strip * span[:, None], axis=2)
    normal_rate = np.cross(omega_strip, normal)
    return _Wing(span, span_rate, span_acceleration, normal, normal_rate, chord, chord_rate, chord_acceleration, turn)


def _mirrored(wing: _Wing, side: float) -> _Wing:
    flip = np.array([1.0, side, 1.0])
    return _Wing._make([*(vector * flip for vector in wing[:-1]), wing.turn])


class _Columns(NamedTuple):
    """Motion of the strips of one wing: (phases, strips), vectors with a last axis of 3."""

    along: Floats
    down: Floats
    outward: Floats
    pitch_rate: Floats
    plunge: Floats
    place: Floats
    axes: Floats
    """(phases, strips, 3 axes, 3)"""
    normal_acceleration: Floats
    pitch_acceleration: Floats


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.sum(a * b, axis=-1))


def _columns(wing: _Wing, mount: _Mount, body: Floats, at: float = MIDDLE) -> _Columns:
    """Compute the motion of the points ``at`` of a chord, with the ``body``'s velocity and angular rate (N, 6)."""
    behind, reach = ((at - mount.axis) * mount.chord)[:, None], mount.span[:, None]
    flight, omega = body[:, None, :3], body[:, None, 3:]
    place = mount.hinge + reach * wing.span[:, None] - behind * wing.chord
    moving = reach * wing.span_rate[:, None] - behind * wing.chord_rate
    speeding = reach * wing.span_acceleration[:, None] - behind * wing.chord_acceleration
    velocity = flight + np.cross(omega, place) + moving
    acceleration = np.cross(omega, moving) + speeding
    span = np.broadcast_to(wing.span[:, None], wing.chord.shape)
    tumbling = np.cross(omega, wing.chord)
    turning = _dot(np.cross(omega, wing.chord_rate), wing.normal) + _dot(tumbling, wing.normal_rate)
    return _Columns(
        _dot(velocity, wing.chord),
        -_dot(velocity, wing.normal),
        _dot(velocity, span),
        _dot(wing.chord_rate + tumbling, wing.normal),
        -_dot(reach * wing.span_rate[:, None], wing.normal),
        place,
        np.stack((span, wing.chord, wing.normal), axis=2),
        _dot(acceleration, wing.normal) + _dot(velocity, wing.normal_rate),
        wing.turn + turning,
    )


def _both(joints: _Joints, mount: _Mount, eta: Floats, body: Floats) -> _Columns:
    """Compute the motion of both wings, left first; ``mount`` is that of the right one."""
    right = _wing(joints, eta)
    sides = [
        _columns(_mirrored(right, side), mount._replace(hinge=mount.hinge * (1.0, side, 1.0)), body) for side in SIDES
    ]
    return _Columns(*[np.concatenate(pair, axis=1) for pair in zip(*sides, strict=True)])


def kinematics(motion: PrescribedStroke, strips: Strips, body: Floats, phases: int = 200) -> StrokeKinematics:
    """Compute the motion at ``phases`` equal steps of a stroke, from phase 0.

    ``body`` (6,) is the fuselage's steady velocity relative to the air in m/s and its angular velocity in rad/s, body
    axes. ``strips`` are those of two equal wings, left (0) and right (1).
    """
    at = np.arange(phases) / phases
    told = (motion.stroke, motion.deviation, motion.feathering, motion.twist)
    angles = JointAngles(*(series(harmonics, at, motion.frequency) for harmonics in told))
    mount = WingMount(motion.stroke_plane, motion.axis, motion.hinge)
    return joint_kinematics(angles, mount, strips, body, 1.0 / motion.frequency)


def joint_kinematics(
    angles: JointAngles, mounting: WingMount, strips: Strips, body: Floats, period: float
) -> StrokeKinematics:
    """Compute the motion at N equal steps of ``period`` s; ``body`` and ``strips`` as in `kinematics`."""
    joints = _Joints(mounting.stroke_plane, *angles)
    rows = Strips(*[column[strips.wing == 1] for column in strips])
    mount = _Mount(rows.span, rows.chord, mounting.axis, np.array(mounting.hinge))
    flown = np.tile(np.asarray(body, dtype=np.float64), (angles.stroke.shape[1], 1))
    whole = _both(joints, mount, rows.eta, flown)
    return StrokeKinematics(
        period,
        tuple(_motions(whole, joints.stroke[:2], flown)),
        whole.normal_acceleration,
        whole.pitch_acceleration,
    )


def wing_points(motion: PrescribedStroke, phases: Floats, span: Floats, behind: Floats) -> Floats:
    """Return (N, n, 3) m; points of the right wing in body axes at ``phases`` (N,) of a stroke, in strokes.

    Each point is ``span`` (n,) m from the hinge and ``behind`` (n,) m behind the feathering axis, both in the wing.
    The outermost point is the tip for the twist.
    """
    told = (motion.stroke, motion.deviation, motion.feathering, motion.twist)
    joints = _Joints(motion.stroke_plane, *(series(harmonics, phases, motion.frequency) for harmonics in told))
    wing = _wing(joints, np.asarray(span / span.max()))
    return np.asarray(np.array(motion.hinge) + span[:, None] * wing.span[:, None] - behind[:, None] * wing.chord)


def protocol_motions(wing: Wing, motion: WingMotion) -> list[Motion]:
    """Convert to the protocol's motion of both wings at each instant."""
    joints = _recorded(motion)
    body = np.concatenate((motion.velocity, motion.omega), axis=1)
    return _motions(_both(joints, _mount(wing), _eta(wing), body), joints.stroke[:2], body)


def section_velocity(wing: Wing, motion: WingMotion, aft: float, side: float = RIGHT) -> SectionVelocity:
    """Compute the velocity of the point ``aft`` of a chord behind each leading edge, Grauer Eq. 9."""
    body = np.concatenate((motion.velocity, motion.omega), axis=1)
    mount = _mount(wing)._replace(hinge=wing.hinge * (1.0, side, 1.0))
    found = _columns(_mirrored(_wing(_recorded(motion), _eta(wing)), side), mount, body, aft)
    return SectionVelocity(found.along, found.down, found.outward)


def strips_of(wing: Wing) -> Strips:
    """Convert both wings to the protocol's strips, left wing first."""
    which = np.repeat([0.0, 1.0], len(wing.span))
    span, eta, chord, width = (np.tile(column, 2) for column in (wing.span, _eta(wing), wing.chord, wing.width))
    return Strips(span, eta, chord, width, which)


def _recorded(motion: WingMotion) -> _Joints:
    """Return the recorded joint motion; accelerations are not recorded and omitted."""
    still = np.zeros((3, len(motion.phase)))
    flap, twist = (
        np.stack((angle, rate, still[0]))
        for angle, rate in ((motion.flap, motion.flap_rate), (motion.twist, motion.twist_rate))
    )
    return _Joints(math.pi / 2, flap, still, still, twist)


def _mount(wing: Wing) -> _Mount:
    return _Mount(wing.span, wing.chord, 0.0, wing.hinge)


def _eta(wing: Wing) -> Floats:
    return np.asarray(wing.span / (wing.span[-1] + 0.5 * wing.width[-1]), dtype=np.float64)


def _motions(whole: _Columns, flap: Floats, body: Floats) -> list[Motion]:
    """Return one motion per row: flap angle and rate (2, N), ``body`` (N, 6)."""
    return [_motion(whole, i, np.tile(flap[:, i], (2, 1)), body[i]) for i in range(len(body))]


def _motion(whole: _Columns, i: int, wings: Floats, body: Floats) -> Motion:
    columns = [np.ascontiguousarray(column[i]) for column in whole[:5]]
    place, axes = np.ascontiguousarray(whole.place[i].T), np.ascontiguousarray(whole.axes[i].transpose(1, 2, 0))
    ground = np.array([math.inf, 0.0, 0.0, 1.0])
    return Motion._make([*columns, place, axes, wings, body.copy(), np.zeros(2), np.zeros(2), ground])
