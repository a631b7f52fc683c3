"""Wings that move as recorded: the velocities of their sections (Grauer Eq. 9) and the loads that a model gives.

No dynamics: body and wings follow a prescribed or recorded motion. The right wing is meant wherever one wing is; the
left one is its mirror image.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Motion, Strips, blank_loads
from sim_bridge.vectors import Floats

RIGHT, LEFT = 1.0, -1.0
MIRROR = np.array([1.0, -1.0, 1.0])
"""of a vector in body axes"""


class Wing(NamedTuple):
    """The sections of one wing, from root to tip, leading edge straight along the hinge's spar."""

    span: Floats
    """(n,) m; from the hinge to the middle of each section"""
    chord: Floats
    """(n,) m"""
    width: Floats
    """(n,) m"""
    hinge: Floats
    """(3,) m; of the right wing, from the fuselage's centre of mass, body axes"""


class WingMotion(NamedTuple):
    """One stroke at N instants, the last one interval before the stroke repeats."""

    phase: Floats
    """(N,) -; of the stroke, 0 to 1"""
    frequency: float
    """Hz; of the stroke"""
    flap: Floats
    """(N,) rad; wing up positive"""
    flap_rate: Floats
    """(N,) rad/s"""
    twist: Floats
    """(N,) rad; of the tip, leading edge up, growing linearly from the hinge"""
    twist_rate: Floats
    """(N,) rad/s"""
    velocity: Floats
    """(N, 3) m/s; of the fuselage through the air, body axes"""
    omega: Floats
    """(N, 3) rad/s; of the fuselage, body axes"""


class Stroke(NamedTuple):
    """Flapping between two angles, each half a cosine of its own length."""

    frequency: float
    """Hz"""
    highest: float
    """rad; wing up positive"""
    lowest: float
    """rad"""
    down_from: float
    """-; phase at which the down-stroke begins"""
    down_to: float
    """-; phase at which it ends"""


class SectionVelocity(NamedTuple):
    """Of one point of each section through the air in the section's axes, each (N, n) m/s."""

    along: Floats
    """forward along the chord"""
    down: Floats
    """against the normal"""
    outward: Floats
    """towards the tip"""


SLOW_HAWK_STROKE = Stroke(frequency=5.91, highest=0.67, lowest=-0.39, down_from=0.24, down_to=0.78)
"""Grauer V.A: extrema, phases, frequency; its angle counts the wing down positive. The cosines are chosen."""


def elliptic_wing(semispan: float, root_chord: float, sections: int, hinge: Floats) -> Wing:
    """A wing whose chord falls as a quarter of an ellipse from root to tip."""
    edges = np.linspace(0.0, semispan, sections + 1)
    span = 0.5 * (edges[1:] + edges[:-1])
    return Wing(span, root_chord * np.sqrt(1.0 - (span / semispan) ** 2), np.diff(edges), hinge)


def flap_angles(stroke: Stroke, phase: Floats) -> tuple[Floats, Floats]:
    """Flap angle in rad and rate in rad/s (N,) at the ``phase`` (N,) of a stroke.

    Raises:
        BadInput: the down-stroke's phases do not lie in one stroke, the earlier first.
    """
    length = stroke.down_to - stroke.down_from
    if not 0.0 < length < 1.0:
        raise BadInput(f"a down-stroke from phase {stroke.down_from:g} to {stroke.down_to:g} is not part of a stroke")
    since = np.mod(phase - stroke.down_from, 1.0)
    falling = since < length
    share = np.where(falling, since / length, (since - length) / (1.0 - length))
    amplitude = np.where(falling, 1.0, -1.0) * 0.5 * (stroke.highest - stroke.lowest)
    share_rate = stroke.frequency / np.where(falling, length, 1.0 - length)
    middle = 0.5 * (stroke.highest + stroke.lowest)
    return middle + amplitude * np.cos(np.pi * share), -amplitude * np.pi * share_rate * np.sin(np.pi * share)


def steady_flight(stroke: Stroke, instants: int, airspeed: float, angle: float = 0.0) -> WingMotion:
    """A stroke without twist of an aircraft that flies straight, at an ``angle`` of attack in rad of the fuselage."""
    phase = np.arange(instants) / instants
    flap, rate = flap_angles(stroke, phase)
    velocity = np.tile([airspeed * math.cos(angle), 0.0, airspeed * math.sin(angle)], (instants, 1))
    still = np.zeros(instants)
    return WingMotion(phase, stroke.frequency, flap, rate, still, still, velocity, np.zeros((instants, 3)))


def section_axes(wing: Wing, motion: WingMotion, side: float = RIGHT) -> Floats:
    """Span, chord and normal of each section in body axes, (N, n, 3, 3): instant, section, axis, component."""
    sine, cosine = np.sin(motion.flap), np.cos(motion.flap)
    nothing = np.zeros_like(sine)
    span = np.stack([nothing, side * cosine, -sine], axis=-1)[:, None, :]
    lift = np.stack([nothing, -side * sine, -cosine], axis=-1)[:, None, :]
    forward = np.array([1.0, 0.0, 0.0])
    twist = motion.twist[:, None, None] * _eta(wing)[:, None]
    chord = np.cos(twist) * forward + np.sin(twist) * lift
    normal = np.cos(twist) * lift - np.sin(twist) * forward
    return np.stack([np.broadcast_to(span, chord.shape), chord, normal], axis=2)


def section_velocity(wing: Wing, motion: WingMotion, aft: float, side: float = RIGHT) -> SectionVelocity:
    """Velocity of the point ``aft`` of a chord behind each section's leading edge, Grauer Eq. 9."""
    axes = section_axes(wing, motion, side)
    arm, _ = _points(wing, axes, aft, side)
    turning = -side * motion.flap_rate[:, None, None] * np.array([1.0, 0.0, 0.0])
    turning = turning + side * (motion.twist_rate[:, None] * _eta(wing))[..., None] * axes[:, :, 0]
    hinge = wing.hinge if side == RIGHT else wing.hinge * MIRROR
    omega = motion.omega[:, None, :]
    velocity = motion.velocity[:, None, :] + np.cross(omega, hinge) + np.cross(omega + turning, arm)
    along = np.einsum("ijk,ijk->ij", velocity, axes[:, :, 1])
    down = -np.einsum("ijk,ijk->ij", velocity, axes[:, :, 2])
    return SectionVelocity(along, down, np.einsum("ijk,ijk->ij", velocity, axes[:, :, 0]))


def strips_of(wing: Wing) -> Strips:
    """Both wings as the protocol's strips, left wing first."""
    which = np.repeat([0.0, 1.0], len(wing.span))
    span, eta, chord, width = (np.tile(column, 2) for column in (wing.span, _eta(wing), wing.chord, wing.width))
    return Strips(span, eta, chord, width, which)


def protocol_motions(wing: Wing, motion: WingMotion) -> list[Motion]:
    """The protocol's motion of both wings at each instant."""
    sides = [_one_side(wing, motion, side) for side in (LEFT, RIGHT)]
    joined = [np.concatenate(pair, axis=1) for pair in zip(*sides, strict=True)]
    along, down, outward, pitch_rate, plunge, place, axes = joined
    return [
        Motion(
            along[i],
            down[i],
            outward[i],
            pitch_rate[i],
            plunge[i],
            np.ascontiguousarray(place[i].T),
            np.ascontiguousarray(axes[i].transpose(1, 2, 0)),
            np.tile([motion.flap[i], motion.flap_rate[i]], (2, 1)),
            np.concatenate((motion.velocity[i], motion.omega[i])),
        )
        for i in range(len(motion.phase))
    ]


def prescribed_loads(
    model: AerodynamicModel, settings: Any, wing: Wing, motion: WingMotion, density: float = 1.225
) -> Floats:
    """Force and moment (N, 6) in N, N m of both wings on the fuselage, body axes, moment about its centre of mass.

    Without the forces of apparent mass, which need the wings' acceleration, and with a model's state at rest.
    """
    strips = strips_of(wing)
    parameters = model.build(settings, strips)
    state = model.initial(parameters, strips)
    total = np.zeros((len(motion.phase), 6))
    out = blank_loads(len(model.parts), strips, len(state))
    for i, instant in enumerate(protocol_motions(wing, motion)):
        model.loads(parameters, strips, instant, density, state, out)
        total[i] = out.body + body_loads(instant, out.parts.sum(axis=0))
    return total


def body_loads(motion: Motion, sections: Floats) -> Floats:
    """Force and moment (6,) about the body's origin of section loads (4, n) in the protocol's components."""
    span, chord, normal = motion.axes
    force = chord * sections[0] + normal * sections[1] + span * sections[2]
    # Nose up turns about the axis to the right, which is towards the tip on the right wing alone.
    right = np.where(span[1] >= 0.0, 1.0, -1.0)
    moment = np.cross(motion.place, force, axis=0) + span * (right * sections[3])
    return np.asarray(np.concatenate((force.sum(axis=1), moment.sum(axis=1))), dtype=np.float64)


def _one_side(wing: Wing, motion: WingMotion, side: float) -> tuple[Floats, ...]:
    """Along, down, outward, pitch rate, plunge (N, n), place (N, n, 3), axes (N, n, 3, 3) of one wing."""
    axes = section_axes(wing, motion, side)
    half = section_velocity(wing, motion, 0.5, side)
    place = _points(wing, axes, 0.5, side)[1]
    turn = side * np.einsum("ik,ijk->ij", motion.omega, axes[:, :, 0]) + motion.twist_rate[:, None] * _eta(wing)
    plunge = -motion.flap_rate[:, None] * wing.span * np.cos(motion.twist[:, None] * _eta(wing))
    return half.along, half.down, half.outward, turn, plunge, place, axes


def _points(wing: Wing, axes: Floats, aft: float, side: float) -> tuple[Floats, Floats]:
    """Points ``aft`` of a chord behind the leading edge (N, n, 3) from the hinge and from the body's origin."""
    arm = wing.span[:, None] * axes[:, :, 0] - aft * wing.chord[:, None] * axes[:, :, 1]
    return arm, arm + (wing.hinge if side == RIGHT else wing.hinge * MIRROR)


def _eta(wing: Wing) -> Floats:
    return np.asarray(wing.span / (wing.span[-1] + 0.5 * wing.width[-1]), dtype=np.float64)
