"""Loads of wings whose joints follow a prescribed stroke, by any aerodynamic model of the protocol.

The stroke plane passes through the hinges, raised at its rear so that it makes ``stroke_plane`` with the body's x-y
plane: 0 is an insect's hovering stroke (wings sweep fore and aft), pi/2 a bird's (wings flap up and down). Right wing
first in words, the left one is its mirror image:

* *stroke angle*: the span turns in the plane, positive towards the end of the upstroke (aft or up);
* *deviation*: the span leaves the plane, positive forward and up;
* *feathering*: the chord turns about the span. At 0 it stands across the plane, leading edge forward or up; positive
  raises the leading edge (bird) or tips it aft (insect). *Twist* is added to it, linearly from root to tip.

Accelerations are those of Han et al. 2017, Eq. B.7: rates of the velocity's components in section axes, which turn.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    INERTIA,
    MASS,
    NOSE_UP,
    OUTWARD,
    UPWARD,
    AerodynamicModel,
    Motion,
    SectionLoads,
    Strips,
    blank_loads,
)
from sim_bridge.vectors import Floats

APPARENT, FUSELAGE = "apparent_mass", "fuselage"
"""parts that the runner adds to those of the model"""
SIDES = (-1.0, 1.0)
"""of y: left wing, right wing"""


class Harmonics(NamedTuple):
    """A Fourier series in the phase of the stroke."""

    mean: float = 0.0
    """rad"""
    cosine: tuple[float, ...] = ()
    """rad; of the first, second ... harmonic"""
    sine: tuple[float, ...] = ()
    """rad; likewise"""


class PrescribedStroke(NamedTuple):
    """How the wings' joints move; both wings alike."""

    frequency: float
    """Hz"""
    stroke_plane: float
    """rad; against the body's x-y plane"""
    stroke: Harmonics
    deviation: Harmonics = Harmonics()
    feathering: Harmonics = Harmonics()
    twist: Harmonics = Harmonics()
    axis: float = 0.25
    """-; of feathering, in chords behind the leading edge"""
    hinge: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m; of the right wing, body axes"""


class StrokeKinematics(NamedTuple):
    """The motion at equal steps of a stroke."""

    period: float
    """s"""
    motions: tuple[Motion, ...]
    normal_acceleration: Floats
    """(phases, n) m/s^2; of mid-chord through the air, rate of its component along the normal (up)"""
    pitch_acceleration: Floats
    """(phases, n) rad/s^2; rate of the pitch rate"""


class StrokeLoads(NamedTuple):
    """Loads over a stroke, part by part: those of the model, then `APPARENT`, then `FUSELAGE` if the model has it."""

    parts: tuple[str, ...]
    sections: Floats
    """(phases, parts, 4, n) N, N m; section axes, as `sim_bridge.aerodynamics.protocol` orders them"""
    force: Floats
    """(phases, parts, 3) N; body axes (FRD)"""
    moment: Floats
    """(phases, parts, 3) N m; about the body's origin"""


class LiftThrust(NamedTuple):
    """Vertical and forward force, part by part."""

    lift: Floats
    """N; up"""
    thrust: Floats
    """N; forward, horizontal"""


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
    """(phases, strips) rad/s^2; pitch acceleration by the joints"""


def series(harmonics: Harmonics, phases: Floats, frequency: float) -> Floats:
    """(3, phases): angle rad, rate rad/s and acceleration rad/s^2 at ``phases`` (0 to 1) of a stroke."""
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
    """First and second derivative of a vector that turns with ``omega``."""
    rate = np.cross(omega, vector)
    return rate, np.cross(omega_rate, vector) + np.cross(omega, rate)


def _wing(motion: PrescribedStroke, phases: Floats, eta: Floats) -> _Wing:
    """The right wing's directions and their derivatives."""
    phi, psi, theta, twist = (
        series(h, phases, motion.frequency)[:, :, None]
        for h in (motion.stroke, motion.deviation, motion.feathering, motion.twist)
    )
    c, s = math.cos(motion.stroke_plane), math.sin(motion.stroke_plane)
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
    """What the strips of one wing do: (phases, strips), vectors with a last axis of 3."""

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


def _columns(motion: PrescribedStroke, wing: _Wing, hinge: Floats, rows: Strips, body: Floats) -> _Columns:
    behind, reach = ((0.5 - motion.axis) * rows.chord)[:, None], rows.span[:, None]
    place = hinge + reach * wing.span[:, None] - behind * wing.chord
    moving = reach * wing.span_rate[:, None] - behind * wing.chord_rate
    speeding = reach * wing.span_acceleration[:, None] - behind * wing.chord_acceleration
    velocity = body[:3] + np.cross(body[3:], place) + moving
    acceleration = np.cross(body[3:], moving) + speeding
    span = np.broadcast_to(wing.span[:, None], wing.chord.shape)
    tumbling = np.cross(body[3:], wing.chord)
    turning = _dot(np.cross(body[3:], wing.chord_rate), wing.normal) + _dot(tumbling, wing.normal_rate)
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


def kinematics(motion: PrescribedStroke, strips: Strips, body: Floats, phases: int = 200) -> StrokeKinematics:
    """The motion at ``phases`` equal steps of a stroke, from phase 0.

    ``body`` (6,) is the fuselage's steady velocity through the air in m/s and its angular velocity in rad/s, body
    axes. ``strips`` are of two wings, left (0) and right (1).
    """
    at = np.arange(phases) / phases
    wings = []
    for index, side in enumerate(SIDES):
        rows = Strips(*[column[strips.wing == index] for column in strips])
        hinge = np.array(motion.hinge) * (1.0, side, 1.0)
        wings.append(_columns(motion, _mirrored(_wing(motion, at, rows.eta), side), hinge, rows, body))
    whole = _Columns(*[np.concatenate(pair, axis=1) for pair in zip(*wings, strict=True)])
    flap = series(motion.stroke, at, motion.frequency)[:2]
    return StrokeKinematics(
        1.0 / motion.frequency,
        tuple(_motion(whole, i, np.tile(flap[:, i], (2, 1)), body) for i in range(phases)),
        whole.normal_acceleration,
        whole.pitch_acceleration,
    )


def _motion(whole: _Columns, i: int, wings: Floats, body: Floats) -> Motion:
    columns = [np.ascontiguousarray(column[i]) for column in whole[:5]]
    place, axes = np.ascontiguousarray(whole.place[i].T), np.ascontiguousarray(whole.axes[i].transpose(1, 2, 0))
    return Motion._make([*columns, place, axes, wings, np.asarray(body, dtype=np.float64)])


def stroke_loads(
    model: AerodynamicModel,
    parameters: Any,
    strips: Strips,
    stroke: StrokeKinematics,
    density: float,
    strokes: int = 3,
) -> StrokeLoads:
    """Loads at each phase of the last of ``strokes`` strokes (for a model with memory; others need one).

    The memory's smooth share is carried from phase to phase by Heun's rule. ``density`` in kg/m^3.
    """
    motions, count = stroke.motions, len(stroke.motions)
    state, dt = model.initial(parameters, strips), stroke.period / count
    now, then = (blank_loads(len(model.parts), strips, len(state)) for _ in range(2))
    names = (*model.parts, APPARENT, *([FUSELAGE] if model.whole_aircraft else []))
    n = strips.chord.shape[0]
    found = StrokeLoads(
        names, np.zeros((count, len(names), 4, n)), np.zeros((count, len(names), 3)), np.zeros((count, len(names), 3))
    )
    last = (strokes if len(state) else 1) * count
    for step in range(last):
        i, following = step % count, motions[(step + 1) % count]
        model.loads(parameters, strips, motions[i], density, state, now)
        if step >= last - count:
            _record(found, i, now, motions[i], stroke)
        if len(state):
            model.loads(parameters, strips, following, density, state + dt * now.rates, then)
            state = state + 0.5 * dt * (now.rates + then.rates)
            model.advance(parameters, strips, following, density, state, dt)
    return found


def _record(found: StrokeLoads, i: int, out: SectionLoads, motion: Motion, stroke: StrokeKinematics) -> None:
    own = out.parts.shape[0]
    found.sections[i, :own] = out.parts
    found.sections[i, own, UPWARD] = -out.apparent[MASS] * stroke.normal_acceleration[i]
    found.sections[i, own, NOSE_UP] = -out.apparent[INERTIA] * stroke.pitch_acceleration[i]
    span, chord, normal = motion.axes
    sections = found.sections[i]
    force = sections[:, None, FORWARD] * chord + sections[:, None, UPWARD] * normal
    force = force + sections[:, None, OUTWARD] * span
    couple = sections[:, None, NOSE_UP] * np.cross(chord, normal, axis=0)
    found.force[i] = np.sum(force, axis=2)
    found.moment[i] = np.sum(np.cross(motion.place, force, axisa=0, axisb=1, axisc=1) + couple, axis=2)
    if found.parts[-1] == FUSELAGE:
        found.force[i, -1], found.moment[i, -1] = out.body[:3], out.body[3:]


def lift_and_thrust(force: Floats, pitch: float = 0.0) -> LiftThrust:
    """Vertical and forward components of forces (..., 3) in body axes, wings level at ``pitch`` rad."""
    c, s = math.cos(pitch), math.sin(pitch)
    return LiftThrust(-c * force[..., 2] + s * force[..., 0], c * force[..., 0] + s * force[..., 2])


def mean_lift_and_thrust(loads: StrokeLoads, pitch: float = 0.0) -> LiftThrust:
    """Means over the stroke, each (parts,)."""
    return lift_and_thrust(np.mean(loads.force, axis=0), pitch)
