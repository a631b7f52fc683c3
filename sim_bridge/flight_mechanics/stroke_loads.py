"""Loads of prescribed strokes by any aerodynamic model of the protocol, section by section and on the body.

Neither tail nor fuselage: those of a model that has them in its loads apart, see `AerodynamicModel.with_fuselage`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import (
    INERTIA,
    MASS,
    NOSE_UP,
    UPWARD,
    AerodynamicModel,
    Motion,
    SectionLoads,
    Strips,
    blank_loads,
    strip_loads,
)
from sim_bridge.flight_mechanics.prescribed import StrokeKinematics, Wing, WingMotion, protocol_motions, strips_of
from sim_bridge.vectors import Floats

APPARENT = "apparent_mass"
"""contribution that is added here to those of the model"""


class StrokeLoads(NamedTuple):
    """Loads over a stroke by contribution: those of the model, then `APPARENT`."""

    parts: tuple[str, ...]
    sections: Floats
    """(phases, parts, 4, n) N, N m; section axes, in the order of `sim_bridge.aerodynamics.protocol`"""
    force: Floats
    """(phases, parts, 3) N; body axes (FRD), the model's fuselage forces included"""
    moment: Floats
    """(phases, parts, 3) N m; about the body's origin"""


class LiftThrust(NamedTuple):
    """Vertical and forward force by contribution."""

    lift: Floats
    """N; up"""
    thrust: Floats
    """N; forward, horizontal"""


def stroke_loads(
    model: AerodynamicModel,
    parameters: Any,
    strips: Strips,
    stroke: StrokeKinematics,
    density: float,
    strokes: int = 3,
) -> StrokeLoads:
    """Compute loads at each phase of the last of ``strokes`` strokes (for a model with memory; others need one).

    The continuous states of the memory are integrated by Heun's method. ``density`` in kg/m^3.
    """
    motions, count = stroke.motions, len(stroke.motions)
    state, dt = model.initial(parameters, strips), stroke.period / count
    now, then = (blank_loads(len(model.parts), strips, len(state)) for _ in range(2))
    names = (*model.parts, APPARENT)
    n = strips.chord.shape[0]
    result = StrokeLoads(
        names, np.zeros((count, len(names), 4, n)), np.zeros((count, len(names), 3)), np.zeros((count, len(names), 3))
    )
    last = (strokes if len(state) else 1) * count
    for step in range(last):
        i, following = step % count, motions[(step + 1) % count]
        model.loads(parameters, strips, motions[i], density, state, now)
        if step >= last - count:
            _record(result, i, now, motions[i], stroke)
        if len(state):
            model.loads(parameters, strips, following, density, state + dt * now.rates, then)
            state = state + 0.5 * dt * (now.rates + then.rates)
            model.advance(parameters, strips, following, density, state, dt)
    return result


def _record(result: StrokeLoads, i: int, out: SectionLoads, motion: Motion, stroke: StrokeKinematics) -> None:
    own = out.parts.shape[0]
    result.sections[i, :own] = out.parts
    result.sections[i, own, UPWARD] = -out.apparent[MASS] * stroke.normal_acceleration[i]
    result.sections[i, own, NOSE_UP] = -out.apparent[INERTIA] * stroke.pitch_acceleration[i]
    total = body_loads(motion, result.sections[i])
    total[:own] += out.body
    result.force[i], result.moment[i] = total[:, :3], total[:, 3:]


def prescribed_loads(
    model: AerodynamicModel, settings: Any, wing: Wing, motion: WingMotion, density: float = 1.225
) -> Floats:
    """Compute force and moment (N, 6) in N, N m of both wings on the fuselage, body axes, about its center of mass.

    Each instant is computed separately, without apparent mass and with a model's state at rest; `stroke_loads`
    includes both.
    """
    strips = strips_of(wing)
    parameters = model.build(settings, strips)
    state = model.initial(parameters, strips)
    total = np.zeros((len(motion.phase), 6))
    out = blank_loads(len(model.parts), strips, len(state))
    for i, instant in enumerate(protocol_motions(wing, motion)):
        model.loads(parameters, strips, instant, density, state, out)
        total[i] = out.body.sum(axis=0) + body_loads(instant, out.parts.sum(axis=0))
    return total


def body_loads(motion: Motion, sections: Floats) -> Floats:
    """Sum section loads (..., 4, n) to force and moment (..., 6) in N, N m about the body's origin, body axes."""
    return np.asarray(strip_loads(motion, sections).sum(axis=-2))


def lift_and_thrust(force: Floats, pitch: float = 0.0) -> LiftThrust:
    """Return vertical and forward components of forces (..., 3) in body axes, wings level at ``pitch`` rad."""
    c, s = math.cos(pitch), math.sin(pitch)
    return LiftThrust(-c * force[..., 2] + s * force[..., 0], c * force[..., 0] + s * force[..., 2])


def mean_lift_and_thrust(loads: StrokeLoads, pitch: float = 0.0) -> LiftThrust:
    """Return the means over the stroke, each (parts,)."""
    return lift_and_thrust(np.mean(loads.force, axis=0), pitch)
