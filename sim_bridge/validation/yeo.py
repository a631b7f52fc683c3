"""Yeo, Atkins and Shyy 2011: lift of a rigid flapping wing from pressures over one stroke. Nothing is fitted.

The air travels 6.1 root chords in a half stroke, longer than a leading-edge vortex stays: DeLaurier's fixed limit
holds, at the 13 degrees of his own example. The RMS comes out 4.5 % high, the mean absolute error is 0.0226 N. Most
of that error is the measured mean lift of 0.023 N, which a flat wing at no angle of attack that flaps up as down
cannot have; without the means 0.008 N are left.
"""

from __future__ import annotations

import math
import statistics
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.models import find_model
from sim_bridge.aerodynamics.protocol import (
    MASS,
    UPWARD,
    Motion,
    SectionLoads,
    Strips,
    blank_loads,
    blank_motion,
)
from sim_bridge.aerodynamics.strip_theory import StripParameters, StripTheory, loads
from sim_bridge.compiled import kernel
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure
from sim_bridge.vectors import Floats

WHERE = "measured pressures"
MODEL = find_model("strip_theory")
DATA = Path(__file__).parent / "data" / "yeo2011"
PASCALS = 248.84
"""in one inch of water"""
ROWS = ("leading", "middle", "trailing")
PANELS = {
    "blue": ((0.072, 0.024), (0.072, 0.024), (0.072, 0.024)),
    "orange": ((0.07, 0.02112), (0.07, 0.02112), (0.07, 0.02112)),
    "green": ((0.071, 0.015), (0.06565, 0.015), (0.04165, 0.015)),
}
"""m; span and height of the panel that each pressure stands for, root to tip and from the leading edge back"""
OUTER_TAPS = (0.01569, 0.03069, 0.04569)
"""m; centers of the outermost panels behind the root's leading edge, digitized with the pressures"""
DIGITISED_RMS = 0.0715
"""N; RMS of the lift over the stroke, as printed with the digitized pressures"""
SEMISPAN, ROOT_CHORD, AIRSPEED, FREQUENCY, DENSITY = 0.213, 0.072, 2.9, 3.3, 1.225
OUTERMOST = 0.142
"""m; inner end of the outermost panels"""
OMEGA = 2.0 * math.pi * FREQUENCY
STRIPS, STEPS = 12, 100
STALL_ANGLE = math.radians(13.0)
"""static; DeLaurier (1993), of the section of his example"""
RMS_WITHIN, ERROR_AT_MOST, OUTER_WITHIN, STROKE_AT_MOST = 0.05, 0.025, 0.15, 1e-3
"""-, N, -, s; limits of the figures"""
BIAS = (
    "a flat wing at no angle of attack that flaps up as down can have none: a bias of pressures or incidence,"
    " 0.18 in lift coefficient"
)


class Rig(NamedTuple):
    """Work space of a stroke."""

    strips: Strips
    motion: Motion
    out: SectionLoads
    midway: Floats
    """(s,); state at the middle of a step"""
    unused: Floats
    """(n,)"""


def read(name: str) -> Floats:
    """Read a file of the digitized experiment, (rows, columns)."""
    return np.loadtxt(DATA / name, delimiter=",", encoding="utf-8-sig")


def flap(phase: Floats) -> Floats:
    """Compute flap angle in rad, rate and acceleration (n, 3) from three harmonics of the measured motion."""
    p = 2.0 * math.pi * phase
    angle = 0.0354 + 0.3793 * np.sin(p) - 0.0322 * np.cos(2 * p) - 0.0035 * np.sin(3 * p)
    rate = OMEGA * (0.3793 * np.cos(p) + 0.0644 * np.sin(2 * p) - 0.0105 * np.cos(3 * p))
    acceleration = OMEGA**2 * (-0.3793 * np.sin(p) + 0.1288 * np.cos(2 * p) + 0.0315 * np.sin(3 * p))
    return np.stack([angle, rate, acceleration], axis=1)


def measured_normal(station: str) -> Floats:
    """Return the normal force in N of one wing's panels at one station over the stroke."""
    rows = zip(ROWS, PANELS[station], strict=True)
    files = [(f"{station}_{row}_point_experimental_pressures.csv", width * height) for row, (width, height) in rows]
    return np.asarray(sum(read(name)[:, 1] * PASCALS * area for name, area in files))


def measured_lift() -> Floats:
    """Return the measured lift in N of both wings at `STEPS` equal steps of the stroke."""
    half = sum(measured_normal(station) for station in PANELS)
    return 2.0 * np.asarray(half) * np.cos(flap(np.arange(STEPS) / STEPS)[:, 0])


def edges(span: Floats) -> tuple[Floats, Floats]:
    """Return leading and trailing edge in m ahead of the root's trailing edge."""
    outline = read("extracted_planform_coordinates.csv") * 1e-3
    tip = int(np.argmax(outline[:, 0]))
    ahead = np.interp(span, *np.unique(outline[: tip + 1], axis=0).T)
    return ahead, np.interp(span, *np.unique(outline[tip:], axis=0).T)


def wings() -> Strips:
    """Return both wings, divided along the digitized outline."""
    fine = (np.arange(STRIPS * 100) + 0.5) / (STRIPS * 100) * SEMISPAN
    leading, trailing = edges(fine)
    span = np.tile(fine.reshape(STRIPS, -1).mean(axis=1), 2)
    chord = np.tile((leading - trailing).reshape(STRIPS, -1).mean(axis=1), 2)
    width = np.full(2 * STRIPS, SEMISPAN / STRIPS)
    return Strips(span, span / SEMISPAN, chord, width, np.repeat([0.0, 1.0], STRIPS))


def rig(states: int) -> Rig:
    """Return the work space of a model with so many states, in the wind tunnel's flow."""
    strips = wings()
    motion = blank_motion(strips, 2)
    motion.along[:] = AIRSPEED
    return Rig(strips, motion, blank_loads(len(MODEL.parts), strips, states), np.zeros(states), 0.0 * strips.span)


@kernel
def normal_forces(parameters: StripParameters, r: Rig, state: Floats, flapping: Floats, normal: Floats) -> None:
    """Compute ``normal`` (n,) in N of every strip for a flap angle, rate and acceleration (3,)."""
    for j in range(normal.shape[0]):
        r.motion.down[j] = -flapping[1] * r.strips.span[j]
        r.motion.plunge[j] = r.motion.down[j]
    loads(parameters, r.strips, r.motion, DENSITY, state, r.out)
    for j in range(normal.shape[0]):
        normal[j] = -r.out.apparent[MASS, j] * flapping[2] * r.strips.span[j]
        for part in range(r.out.parts.shape[0]):
            normal[j] += r.out.parts[part, UPWARD, j]


@kernel
def stroke(parameters: StripParameters, r: Rig, state: Floats, flapping: Floats, normal: Floats) -> None:
    """Integrate a stroke by the midpoint rule; ``flapping`` (2 STEPS, 3) at half steps, ``normal`` (STEPS, n)."""
    n, dt = state.shape[0], 1.0 / FREQUENCY / normal.shape[0]
    for i in range(normal.shape[0]):
        normal_forces(parameters, r, state, flapping[2 * i], normal[i])
        for j in range(n):
            r.midway[j] = state[j] + 0.5 * dt * r.out.rates[j]
        normal_forces(parameters, r, r.midway, flapping[2 * i + 1], r.unused)
        for j in range(n):
            state[j] += dt * r.out.rates[j]


def section(dynamic_stall: str, wake_lag: float = 1.0) -> StripParameters:
    """Return a flat plate without camber, suction included: neither affects the lift at zero angle of attack."""
    built: StripParameters = MODEL.build(StripTheory(0.0, 1.0, STALL_ANGLE, wake_lag, dynamic_stall), wings())
    return built


@cache
def modelled_normal(parameters: StripParameters, steps: int = STEPS) -> Floats:
    """Compute the normal force in N of every strip of both wings (steps, n) over the third stroke."""
    state = MODEL.initial(parameters, wings())
    r, flapping = rig(state.shape[0]), flap(np.arange(2 * steps) / (2 * steps))
    normal = np.zeros((steps, 2 * STRIPS))
    for _ in range(3):
        stroke(parameters, r, state, flapping, normal)
    return normal


def modelled_lift(parameters: StripParameters, steps: int = STEPS) -> Floats:
    """Compute the lift in N of both wings (steps,) over the third stroke."""
    return np.asarray(modelled_normal(parameters, steps).sum(axis=1) * np.cos(flap(np.arange(steps) / steps)[:, 0]))


def rms(x: Floats) -> float:
    """Compute the root mean square."""
    return math.sqrt(float(np.mean(x**2)))


def mean_error(parameters: StripParameters) -> float:
    """Compute the mean absolute difference in N of modeled and measured lift."""
    return float(np.mean(np.abs(modelled_lift(parameters) - measured_lift())))


def outer_strength(normal: Floats) -> float:
    """Compute the standard deviation in N over the stroke of one wing's normal force outside of `OUTERMOST`."""
    span = wings().span[:STRIPS]
    return float(normal[:, :STRIPS][:, span > OUTERMOST].sum(axis=1).std())


def stroke_time(strokes: int = 200) -> float:
    """Measure the median time of a stroke in s."""
    p, state, flapping = section("fixed"), np.zeros(2 * STRIPS), flap(np.arange(2 * STEPS) / (2 * STEPS))
    r, normal, times = rig(state.shape[0]), np.zeros((STEPS, 2 * STRIPS)), []
    for _ in range(strokes + 1):
        begun = time.perf_counter()
        stroke(p, r, state, flapping, normal)
        times.append(time.perf_counter() - begun)
    return statistics.median(times[1:])


def lift_rows() -> list[Row]:
    """Compare the lift over a stroke by strip theory with DeLaurier's fixed stall limit."""
    p, measured = section("fixed"), measured_lift()
    lift, pressures = modelled_lift(p), float(measured_normal("green").std())
    outer = figure(WHERE, "outer wing's normal force, standard deviation", "N", pressures)
    return [
        compare_share(figure(WHERE, "RMS lift over a stroke", "N", rms(measured)), rms(lift), RMS_WITHIN),
        compare(figure(WHERE, "mean absolute error of the lift", "N", 0.0), mean_error(p), ERROR_AT_MOST),
        compare_share(outer, outer_strength(modelled_normal(p)), OUTER_WITHIN),
        compare(figure(WHERE, "mean lift", "N", float(measured.mean())), float(lift.mean()), 0.005, BIAS),
    ]


CHECKS = (Check("lift over a stroke", lift_rows),)
