"""Quasi-steady coefficients of angle of attack and advance ratio (Han et al. 2017), blade elements in 3-D.

Three mechanisms: translation (Polhamus' potential and vortex terms, Eq. 8-13), rotation (Kutta-Joukowski, Eq. 14)
and added mass (Eq. 15). The first two are parts of the loads; the third is proportional to accelerations and given as
apparent mass, which the mechanism solves for.

Where the paper is silent or misprinted:

* **Advance ratio.** In the paper's stroke plane, ``J + r_2 = (R r_2 phi' + U cos(phi)) / (R phi')``: the speed of the
  reference point over the speed that the tip has by the wing's rotation. That ratio of magnitudes is used for any
  motion, from the velocities of the wing's own strips, so that stroke plane, joints and body rates need not be
  known. With the flow in the stroke plane it is the paper's J as long as the reference point moves leading edge
  first; flow across the plane, which the paper does not treat, raises J. It is infinite without rotation and
  continuous through a reversal, where the paper's sign of phi' would make it jump from infinity to -0.25.
* **Flow from behind** (beyond the measured 95 degrees) is the plate turned round: Eq. 8 as printed would push the
  wing the way it goes. The moment about mid-chord passes zero between 85 and 95 degrees.
* **Signs.** C_M turns with the side that the air strikes (Eq. B.9 omits it). A nose-up rotation pushes the wing up
  (Kramer), whereby pronation gives thrust, as in the paper: Eq. B.8 as printed, in the axes of Eq. B.1, would push
  it down. Added mass resists acceleration; as printed it would aid it. The deviation's rate in Eq. B.3 is negative.
* **Other planforms.** The exponents' singular points are those of the wing that Table 1 was fitted to; only the
  reference point, where J is taken, is the vehicle's.
* **Moments.** C_M is about the quarter chord: with it, C_M / C_N at 90 degrees puts the centre of pressure within 4 %
  of mid-chord, as the paper finds it.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    INERTIA,
    MASS,
    NOSE_UP,
    UPWARD,
    AerodynamicModel,
    Motion,
    SectionLoads,
    Strips,
    ValidRange,
)
from sim_bridge.compiled import inlined, kernel
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.units import Quantity

PARTS = ("translational_lift", "translational_drag", "translational_moment", "rotational")
LIFT, DRAG, MOMENT, ROTATIONAL = range(len(PARTS))

FORCE_RADIUS, MOMENT_RADIUS = 0.567, 0.541
"""-; r_2 (printed) and r_M (by A.3) of the wing that Table 1 was fitted to"""
BORDER = -0.25
"""-; least advance ratio that was measured"""
MOMENT_AXIS = 0.25
"""-; share of the chord that C_M is about"""
ADDED_MASS = math.pi / 8.0
"""-; C_A, Eq. 15: half of an ideal plate's"""
TURN_ROUND = math.cos(math.radians(85.0))
"""-; cosine of the angle of attack below which the moment about mid-chord fades, to change sign at 90 degrees"""

# Table 1: a, b, d of K = a (J + r)^b + d
LIFT_POTENTIAL, LIFT_VORTEX = (-2.109, -0.606, 4.136), (2.659, -0.666, -0.344)
DRAG_POTENTIAL, DRAG_VORTEX = (-0.182, -2.414, 1.370), (0.765, -1.497, 2.078)
MOMENT_POTENTIAL, MOMENT_VORTEX = (0.803, -0.972, -0.363), (-0.242, -1.354, -0.554)


class QuasiSteady(NamedTuple):
    """Section ``[quasi_steady]`` of a vehicle file."""

    pitching_axis: Annotated[float, Quantity("-", 0.0, 0.75)]
    """behind the leading edge, in chords; x_0 of Eq. 14, where the section's velocity is taken (0.25 in the paper)"""


class QuasiSteadyParameters(NamedTuple):
    """Kernel arguments."""

    reach: float
    """m; R, from the hinge to the tip"""
    reference: float
    """-; r_2 of the wing, over R"""
    pitching_axis: float
    """-; in chords behind the leading edge"""
    rotational: float
    """-; C_R"""


class Factors(NamedTuple):
    """Correction factors K at one advance ratio, -."""

    lift_potential: float
    lift_vortex: float
    drag_potential: float
    drag_vortex: float
    moment_potential: float
    moment_vortex: float


class Coefficients(NamedTuple):
    """Coefficients of a section, -."""

    lift: float
    drag: float
    moment: float


def elliptic_strips(reach: float, mean_chord: float, root: float, count: int) -> Strips:
    """Both wings of a Zimmerman planform (two half ellipses joined: an elliptic chord), left wing first.

    Args:
        reach: m; R, from the hinge to the tip. mean_chord: m; area over the length from root to tip.
        root: -; gap between hinge and wing root over that length (0.2 in Han's model). count: strips a wing.
    """
    length = reach / (1.0 + root)
    edges = np.linspace(0.0, 1.0, count + 1)
    area = 0.5 * (edges * np.sqrt(1.0 - edges**2) + np.arcsin(edges))
    chord = mean_chord * 4.0 / math.pi * np.diff(area) * count
    span = (root + 0.5 * (edges[1:] + edges[:-1])) * length
    wing = np.repeat([0.0, 1.0], count)
    width = np.full(2 * count, length / count)
    return Strips(np.tile(span, 2), np.tile(span / reach, 2), np.tile(chord, 2), width, wing)


def reach_of(strips: Strips) -> float:
    """Wing length R in m from the hinge to the tip of the longer wing."""
    return float(np.max(strips.span + 0.5 * strips.width))


def force_radius(strips: Strips) -> float:
    """r_2, -: root of the second moment of area over R^2 S (Eq. A.2)."""
    area = strips.chord * strips.width
    second = strips.span**2 + strips.width**2 / 12.0
    return math.sqrt(float(np.sum(second * area) / np.sum(area))) / reach_of(strips)


@kernel
def correction_factor(advance_ratio: float, radius: float, row: tuple[float, float, float]) -> float:
    """K_P or K_V (Eq. 12-13) of a ``row`` of Table 1; its last number where the advance ratio is infinite."""
    factor: float = row[0] * (advance_ratio + radius) ** row[1] + row[2]
    return factor


@kernel
def correction_factors(advance_ratio: float) -> Factors:
    """All of Table 1 at one advance ratio, which must not be below `BORDER`."""
    j = advance_ratio
    return Factors(
        correction_factor(j, FORCE_RADIUS, LIFT_POTENTIAL),
        correction_factor(j, FORCE_RADIUS, LIFT_VORTEX),
        correction_factor(j, FORCE_RADIUS, DRAG_POTENTIAL),
        correction_factor(j, FORCE_RADIUS, DRAG_VORTEX),
        correction_factor(j, MOMENT_RADIUS, MOMENT_POTENTIAL),
        correction_factor(j, MOMENT_RADIUS, MOMENT_VORTEX),
    )


@kernel
def coefficients(sine: float, cosine: float, k: Factors) -> Coefficients:
    """Eq. 8-10 from sine and cosine of the angle of attack."""
    return Coefficients(
        (k.lift_potential * cosine + k.lift_vortex * sine) * sine * cosine,
        (k.drag_potential * cosine + k.drag_vortex * sine) * sine * sine,
        (k.moment_potential * cosine + k.moment_vortex) * sine * sine,
    )


def _of_angle(angle: Floats | float, advance_ratio: Floats | float) -> Coefficients:
    one = np.vectorize(_at_one_angle, otypes=[np.float64] * len(Coefficients._fields))
    return Coefficients._make(one(angle, np.maximum(advance_ratio, BORDER)))


def _at_one_angle(angle: float, advance_ratio: float) -> Coefficients:
    return coefficients(math.sin(angle), math.cos(angle), correction_factors(advance_ratio))


def lift_coefficient(angle: Floats | float, advance_ratio: Floats | float) -> Floats:
    """C_L (Eq. 8) of angles of attack in rad (-5 to 95 degrees) and advance ratios, broadcast; J at least -0.25."""
    return np.asarray(_of_angle(angle, advance_ratio).lift)


def drag_coefficient(angle: Floats | float, advance_ratio: Floats | float) -> Floats:
    """C_D (Eq. 9); arguments as for `lift_coefficient`."""
    return np.asarray(_of_angle(angle, advance_ratio).drag)


def moment_coefficient(angle: Floats | float, advance_ratio: Floats | float) -> Floats:
    """C_M (Eq. 10) about the quarter chord, nose up positive; arguments as for `lift_coefficient`."""
    return np.asarray(_of_angle(angle, advance_ratio).moment)


def build(settings: QuasiSteady, strips: Strips) -> QuasiSteadyParameters:
    """The model's parameters for the wings of a vehicle.

    Raises:
        InputError: a wing of a single strip, whose rotation and translation are the same, or a planform whose
            reference point lies where the border of the advance ratio has no meaning.
    """
    if np.min(np.unique(strips.wing, return_counts=True)[1]) < 2:
        raise InputError("quasi_steady needs at least two strips a wing")
    reference = force_radius(strips)
    if reference <= -BORDER:
        raise InputError(f"quasi_steady needs a wing with r_2 above {-BORDER}, this one has {reference:.3f}")
    axis = settings.pitching_axis
    return QuasiSteadyParameters(reach_of(strips), reference, axis, math.pi * (0.75 - axis))


def initial(parameters: QuasiSteadyParameters, strips: Strips) -> Floats:
    """Return an empty state, (0,)."""
    return np.zeros(0)


@kernel
def _down_at_axis(p: QuasiSteadyParameters, strips: Strips, motion: Motion, i: int) -> float:
    return float(motion.down[i] - (0.5 - p.pitching_axis) * strips.chord[i] * motion.pitch_rate[i])


@kernel
def speed_ratio(speed: float, tip: float, reference: float) -> float:
    """J of the reference point's ``speed`` and of what the tip's speed is by rotation, m/s; at least `BORDER`."""
    # Slower than this, the square of the speed underflows and there are no loads to get wrong.
    if tip <= 1e-100:
        return math.inf
    return max(speed / tip - reference, BORDER)


@kernel
def advance_ratio(p: QuasiSteadyParameters, strips: Strips, motion: Motion, first: int, last: int) -> float:
    """Instantaneous advance ratio of the wing of strips ``first`` to ``last - 1``; infinite without rotation.

    Velocity in the section plane is linear over a stiff wing's span: its slope is the rotation.
    """
    count = last - first
    middle, spread = 0.0, 0.0
    for i in range(first, last):
        middle += strips.span[i] / count
    for i in range(first, last):
        spread += (strips.span[i] - middle) ** 2
    speed, turning = 0.0, 0.0
    for k in range(3):
        mean, slope = 0.0, 0.0
        for i in range(first, last):
            down = _down_at_axis(p, strips, motion, i)
            v = motion.along[i] * motion.axes[1, k, i] - down * motion.axes[2, k, i]
            mean += v / count
            slope += v * (strips.span[i] - middle) / spread
        at_reference = mean + slope * (p.reference * p.reach - middle)
        speed += at_reference * at_reference
        turning += slope * slope
    return speed_ratio(math.sqrt(speed), p.reach * math.sqrt(turning), p.reference)


@kernel
def add_translation(along: float, down: float, k: Factors, scale: float, chord: float, load: Floats) -> None:
    """Lift, drag and moment about mid-chord of a strip in ``load`` (parts, 4), Eq. B.8-B.9.

    ``along`` and ``down`` in m/s at the pitching axis; ``scale`` is half the density times the strip's area, kg/m.
    """
    speed = math.sqrt(along * along + down * down)
    if speed <= 1e-100:
        return
    sine, cosine = abs(down) / speed, abs(along) / speed
    c = coefficients(sine, cosine, k)
    onto = math.copysign(1.0, down)
    ahead = math.copysign(1.0, along)
    pressure = scale * speed * speed
    load[LIFT, FORWARD] = pressure * c.lift * sine * ahead
    load[LIFT, UPWARD] = pressure * c.lift * cosine * onto
    load[DRAG, FORWARD] = -pressure * c.drag * cosine * ahead
    load[DRAG, UPWARD] = pressure * c.drag * sine * onto
    normal = c.lift * cosine + c.drag * sine
    about_middle = c.moment + (0.5 - MOMENT_AXIS) * normal
    turned = min(max(along / speed / TURN_ROUND, -1.0), 1.0)
    load[MOMENT, NOSE_UP] = pressure * chord * about_middle * onto * turned


@inlined
def loads(
    parameters: QuasiSteadyParameters,
    strips: Strips,
    motion: Motion,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    """Fill ``out``, see `sim_bridge.aerodynamics.protocol`."""
    p, count, last = parameters, strips.chord.shape[0], 0
    factors = correction_factors(math.inf)
    for i in range(count):
        if i == last:
            while last < count and strips.wing[last] == strips.wing[i]:
                last += 1
            factors = correction_factors(advance_ratio(p, strips, motion, i, last))
        chord, along, down = strips.chord[i], motion.along[i], _down_at_axis(p, strips, motion, i)
        mass = density * chord * strips.width[i]
        out.parts[:, :, i] = 0.0
        add_translation(along, down, factors, 0.5 * mass, chord, out.parts[:, :, i])
        speed = math.sqrt(along * along + down * down)
        out.parts[ROTATIONAL, UPWARD, i] = p.rotational * mass * chord * motion.pitch_rate[i] * speed
        out.apparent[MASS, i] = ADDED_MASS * mass * chord
        out.apparent[INERTIA, i] = 0.0


@kernel
def advance(
    parameters: QuasiSteadyParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Do nothing: the model has no memory."""


RANGES = (
    ValidRange("advance_ratio", 0.0, 1.0, "Han 2017, section 2: measured at 0 to 1, and without flapping"),
    ValidRange("reynolds", 1e3, 2e4, "Han 2017, section 2: measured at 10,000 to 20,000; critical value 1,000"),
    ValidRange("aspect_ratio", 4.0, 12.0, "chosen: 8.6 of Han's model wing from hinge to tip, by half and by 1.4"),
)
MODEL = AerodynamicModel(
    name="quasi_steady",
    title="Quasi-steady coefficients of angle of attack and advance ratio (Han et al. 2017)",
    settings=QuasiSteady,
    parameters=QuasiSteadyParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    needs_places=True,
    ranges=RANGES,
)
