"""Modified strip theory (DeLaurier 1993), optionally with Kim's dynamic stall (Kim 2011) as in Gerdes 2017.

Written in section velocities instead of angles over a constant flight speed, so that arbitrary motion works
and the loads stay finite as the airspeed goes to zero. The downwash of the unsteady wake is a first-order lag
a strip, which is the time-domain form of F'(k), G'(k):  C'(k) = 1 - C1 ik / (ik + C2).

When a section stalls is a choice of the vehicle (``dynamic_stall``):

* ``fixed``: DeLaurier's limit at the stall angle, whatever the motion;
* ``kim``: that angle times Kim's factor, at most twice. For a wing that only plunges the factor grows faster than the
  angle of attack, so that its sections stay attached to the bound of twice the stall angle.

Which of them holds is an argument of ours, not Kim's: the delay is the time in which a leading-edge vortex grows over
the section, and a vortex sheds after about `FORMATION` chords of travel. A half stroke shorter than that ends before
the delay does, that is k = omega c / 2U above pi / (2 `FORMATION`) = 0.39: Robo Raven and Slow Hawk at their root
chords. Over a longer one the vortex is gone and DeLaurier's limit holds: the wing of Yeo, Atkins and Shyy (2011),
k = 0.26 at the root, is measured separated over its outer third, where Kim's factor keeps it attached and gives twice
the force.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

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
    aspect_ratio,
)
from sim_bridge.compiled import inlined, kernel, noalias
from sim_bridge.elementary import arctangent
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.units import Quantity

STALL_BLEND = math.radians(3.0)
"""rad; half width over which attached and separated loads are blended: a hard switch makes the force jump"""
SLOWEST = 0.3
"""m/s; chordwise speed below which the reduced frequency is no longer resolved"""
FORMATION = 4.0
"""-; chords of travel until a leading-edge vortex sheds: the formation number of Gharib, Rambod and Shariff (1998)"""
STALL_FACTOR_BOUNDS = {"fixed": 1.0, "kim": 2.0}
"""by the choice of ``dynamic_stall``: what the stall angle may be raised by at most; 1 leaves DeLaurier's limit"""
KINEMATIC_VISCOSITY = 1.46e-5
"""m^2/s; of air at 15 degrees Celsius"""
PARTS = ("circulatory", "separated", "suction", "camber", "friction", "apparent_couple")
CIRCULATORY, SEPARATED, SUCTION, CAMBER, FRICTION, COUPLE = range(len(PARTS))


class StripTheory(NamedTuple):
    """Section ``[strip_theory]`` of a vehicle file."""

    zero_lift_angle: Annotated[float, Quantity("rad", -1.6, 1.6)]
    """of the section, negated: the angle that camber adds to the angle of attack"""
    suction_efficiency: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the leading-edge suction that is realised"""
    stall_angle: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """static; raised by Kim's factor with ``dynamic_stall``"""
    wake_lag: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the unsteady wake's effect: 1 is DeLaurier's C'(k) in the time domain, 0 quasi-steady"""
    dynamic_stall: str
    """``kim`` where a half stroke is shorter than `FORMATION` chords (see `half_stroke_travel`), else ``fixed``"""


class StripParameters(NamedTuple):
    """Kernel arguments; SI."""

    aspect_ratio: float
    zero_lift_angle: float
    suction_efficiency: float
    stall_angle: float
    c1: float
    c2: float
    lift_factor: float
    stall_factor_bound: float
    attached_slope: float
    """-; tangent of the angle below which no section stalls"""


class SectionMotion(NamedTuple):
    """Motion of one section through the air."""

    along: float
    """m/s; forward along the chord"""
    plunge: float
    """m/s; of the leading edge against the normal by flapping alone, h' cos(theta - theta_a)"""
    down: float
    """m/s; of mid-chord against the normal"""
    pitch_rate: float
    """rad/s; about the span, leading edge up"""
    chord: float
    """m"""


class Section(NamedTuple):
    """Loads per unit span of one section."""

    circulatory: float
    """N/m; normal, at a quarter chord"""
    separated: float
    """N/m; normal, at mid-chord"""
    suction: float
    """N/m; forward along the chord, as the next two"""
    camber: float
    """N/m"""
    friction: float
    """N/m"""
    lag_rate: float
    """m/s^2; of the wake's state"""
    apparent: float
    """kg/m; apparent mass at mid-chord"""
    stalled: float
    """-; share 0 to 1"""


def strip_parameters(
    aspect_ratio: float,
    zero_lift_angle: float,
    suction_efficiency: float,
    stall_angle: float,
    stall_factor_bound: float = STALL_FACTOR_BOUNDS["kim"],
) -> StripParameters:
    """Constants of the modified Theodorsen function for a wing's aspect ratio (both wings together)."""
    return StripParameters(
        aspect_ratio,
        zero_lift_angle,
        suction_efficiency,
        stall_angle,
        0.5 * aspect_ratio / (2.32 + aspect_ratio),
        0.181 + 0.772 / aspect_ratio,
        aspect_ratio / (2.0 + aspect_ratio),
        stall_factor_bound,
        math.tan(max(stall_angle - STALL_BLEND, 0.0)),
    )


def build(settings: StripTheory, strips: Strips) -> StripParameters:
    """The model's parameters for the wings of a vehicle.

    Raises:
        InputError: ``dynamic_stall`` is none of `STALL_FACTOR_BOUNDS`.
    """
    bound = STALL_FACTOR_BOUNDS.get(settings.dynamic_stall)
    if bound is None:
        known = " or ".join(STALL_FACTOR_BOUNDS)
        raise InputError(f'strip_theory.dynamic_stall = "{settings.dynamic_stall}" is unknown; it is {known}')
    wing = aspect_ratio(strips)
    p = strip_parameters(wing, settings.zero_lift_angle, settings.suction_efficiency, settings.stall_angle, bound)
    return p._replace(c1=p.c1 * settings.wake_lag)


def half_stroke_travel(airspeed: float, frequency: float, chord: float) -> float:
    """Travel of the air over a section in half a stroke, in chords: pi / 2k for the reduced frequency k."""
    return airspeed / (2.0 * frequency * chord)


def initial(parameters: StripParameters, strips: Strips) -> Floats:
    """Return the wake states (n,) in m/s at rest, one a strip; empty without wake."""
    return np.zeros(strips.chord.shape[0] if parameters.c1 != 0.0 else 0)


@inlined
def stall_factor(
    plunge_angle: float, towards: float, chord: float, speed: float, stall_angle: float, bound: float = 2.0
) -> float:
    """Kim's dynamic stall factor xi (Gerdes Eq. 8 as corrected): 1 to ``bound``.

    ``plunge_angle`` is |atan(h' cos(theta - theta_a) / V_x)|, ``towards`` the pitch rate in rad/s counted
    positive when it increases the magnitude of the angle of attack.
    """
    pitching = math.copysign(0.51 * math.sqrt(chord * abs(towards) / (2.0 * speed)), towards)
    return max(1.0, min(1.0 + (plunge_angle + pitching) / stall_angle, bound))


def _friction_polynomial() -> tuple[float, ...]:
    """Coefficients, highest power first, of 0.89 / (log10 Re)^2.58 as a polynomial in Re^(-1/8)."""
    powers = np.linspace(3.0, 7.0, 400)
    target = 0.89 / powers**2.58
    fit = Polynomial.fit(10.0 ** (-powers / 8.0), target, 7, w=1.0 / target).convert()
    return tuple(float(c) for c in fit.coef[::-1])


FRICTION_POLYNOMIAL = _friction_polynomial()


@inlined
def friction_coefficient(reynolds: float) -> float:
    """Skin friction of both faces of a plate, 0.89 / (log10 Re)^2.58, to 1e-5 from Re 1e3 to 1e7.

    A polynomial in Re^(-1/8): the logarithm and the power cost as much as all the rest of a section.
    """
    x = math.sqrt(math.sqrt(math.sqrt(1.0 / min(max(reynolds, 1.0e3), 1.0e7))))
    a7, a6, a5, a4, a3, a2, a1, a0 = FRICTION_POLYNOMIAL
    return a0 + x * (a1 + x * (a2 + x * (a3 + x * (a4 + x * (a5 + x * (a6 + x * a7))))))


@kernel
def stalled_share(across: float, m: SectionMotion, speed: float, p: StripParameters) -> float:
    """Stalled fraction of a section, 0 to 1; DeLaurier's stall angle is atan(across / speed)."""
    return _share_beyond(across, m, speed, p) if may_stall(across, speed, p) else 0.0


@inlined
def may_stall(across: float, speed: float, p: StripParameters) -> bool:
    """Whether a section's angle is beyond that below which none stalls: Kim's factor is at least 1."""
    return abs(across) > p.attached_slope * speed


@inlined
def _share_beyond(across: float, m: SectionMotion, speed: float, p: StripParameters) -> float:
    """`stalled_share` without a branch."""
    size = abs(arctangent(across, speed))
    plunge_angle = abs(arctangent(m.plunge, speed))
    towards = m.pitch_rate if across >= 0.0 else -m.pitch_rate
    factor = stall_factor(plunge_angle, towards, m.chord, speed, p.stall_angle, p.stall_factor_bound)
    limit = p.stall_angle * factor
    share = min(max((size - limit) / (2.0 * STALL_BLEND) + 0.5, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


class Incidence(NamedTuple):
    """Incidence of a section, m/s."""

    three_quarter: float
    """air against the normal at three quarters of the chord"""
    wash: float
    """what of it makes lift, by the wing's span and the wake"""
    across: float
    """against the normal, of the angle of attack that stalls"""
    speed: float
    """along the chord, at least `SLOWEST`"""


@inlined
def incidence(m: SectionMotion, lag: float, p: StripParameters) -> Incidence:
    """Compute the incidence of a section; ``lag`` in m/s is the wake state."""
    three_quarter = m.down + 0.25 * m.chord * m.pitch_rate
    wash = p.lift_factor * (three_quarter - p.c1 * (three_quarter - lag))
    return Incidence(three_quarter, wash, wash - 0.75 * m.chord * m.pitch_rate, max(abs(m.along), SLOWEST))


@kernel
def section_loads(m: SectionMotion, density: float, lag: float, p: StripParameters) -> Section:
    """Loads per unit span of one section; ``lag`` in m/s is the wake state, ``density`` in kg/m^3."""
    at = incidence(m, lag, p)
    return _loads_at(m, at, stalled_share(at.across, m, at.speed, p), density, lag, p)


@inlined
def _lag_rate(at: Incidence, chord: float, lag: float, p: StripParameters) -> float:
    """m/s^2; of the wake's state."""
    return 2.0 * at.speed / chord * p.c2 * (at.three_quarter - lag)


@inlined
def _loads_at(
    m: SectionMotion, at: Incidence, stalled: float, density: float, lag: float, p: StripParameters
) -> Section:
    along, pitch_rate, chord = m.along, m.pitch_rate, m.chord
    wash, speed = at.wash, at.speed
    resultant = math.sqrt(along * along + (wash - 0.5 * chord * pitch_rate) ** 2)
    pressure = 0.5 * density * chord
    attached = (1.0 - stalled) * pressure
    suction = wash - 0.25 * chord * pitch_rate
    skin = friction_coefficient(speed * chord / KINEMATIC_VISCOSITY)
    return Section(
        attached * 2.0 * math.pi * resultant * (wash + p.zero_lift_angle * along * p.lift_factor),
        stalled * 1.98 * pressure * math.sqrt(along * along + m.down * m.down) * m.down,
        attached * p.suction_efficiency * 2.0 * math.pi * suction * suction * resultant / speed,
        attached * 2.0 * math.pi * p.zero_lift_angle * wash * resultant,
        -attached * skin * along * abs(along),
        _lag_rate(at, chord, lag, p),
        (1.0 - 0.5 * stalled) * density * math.pi * chord * chord / 4.0,
        stalled,
    )


@inlined
def loads(
    parameters: StripParameters, strips: Strips, motion: Motion, density: float, state: Floats, out: SectionLoads
) -> None:
    """Fill ``out``, see `sim_bridge.aerodynamics.protocol`."""
    p, m, parts, has_wake = parameters, motion, out.parts, state.shape[0] > 0
    # Without a wake c1 is 0: whatever stands in the place of the lags has no effect.
    lags = state if has_wake else m.down
    # The shares that are stalled wait where the separated loads will be.
    stalled = parts[SEPARATED, UPWARD]
    fill_stalled(p, strips.chord, m.along, m.plunge, m.down, m.pitch_rate, lags, stalled)
    fill_loads(
        p, density, strips.chord, strips.width, m.along, m.down, m.pitch_rate, lags, parts[CIRCULATORY, UPWARD],
        parts[CIRCULATORY, NOSE_UP], stalled, parts[SUCTION, FORWARD], parts[CAMBER, FORWARD],
        parts[FRICTION, FORWARD], parts[COUPLE, NOSE_UP], out.apparent[MASS], out.apparent[INERTIA],
    )  # fmt: skip
    if has_wake:
        fill_lag_rates(p, strips.chord, m.along, m.down, m.pitch_rate, lags, out.rates)


@noalias
def fill_stalled(
    p: StripParameters,
    chord: Floats,
    along: Floats,
    plunge: Floats,
    down: Floats,
    pitch_rate: Floats,
    lag: Floats,
    stalled: Floats,
) -> None:
    """Fill ``stalled`` (n,) with the share of every section; mostly none is, which is seen without arctangents."""
    beyond = 0
    for i in range(stalled.shape[0]):
        at = incidence(SectionMotion(along[i], plunge[i], down[i], pitch_rate[i], chord[i]), lag[i], p)
        beyond += 1 if may_stall(at.across, at.speed, p) else 0
        stalled[i] = 0.0
    if beyond > 0:
        for i in range(stalled.shape[0]):
            m = SectionMotion(along[i], plunge[i], down[i], pitch_rate[i], chord[i])
            at = incidence(m, lag[i], p)
            stalled[i] = _share_beyond(at.across, m, at.speed, p)


@noalias
def fill_loads(
    p: StripParameters,
    density: float,
    chord: Floats,
    width: Floats,
    along: Floats,
    down: Floats,
    pitch_rate: Floats,
    lag: Floats,
    circulatory: Floats,
    circulatory_moment: Floats,
    separated: Floats,
    suction: Floats,
    camber: Floats,
    friction: Floats,
    couple: Floats,
    mass: Floats,
    inertia: Floats,
) -> None:
    """Fill the parts, N and N m, and the apparent ``mass`` and ``inertia``, kg and kg m^2, of every section, (n,).

    ``separated`` is given with the share that is stalled in it.
    """
    for i in range(chord.shape[0]):
        m = SectionMotion(along[i], 0.0, down[i], pitch_rate[i], chord[i])
        section = _loads_at(m, incidence(m, lag[i], p), separated[i], density, lag[i], p)
        apparent = section.apparent * width[i]
        circulatory[i] = section.circulatory * width[i]
        circulatory_moment[i] = 0.25 * chord[i] * section.circulatory * width[i]
        separated[i] = section.separated * width[i]
        suction[i] = section.suction * width[i]
        camber[i] = section.camber * width[i]
        friction[i] = section.friction * width[i]
        couple[i] = -0.25 * apparent * chord[i] * abs(along[i]) * pitch_rate[i]
        mass[i] = apparent
        inertia[i] = apparent * chord[i] * chord[i] / 32.0


@noalias
def fill_lag_rates(
    p: StripParameters, chord: Floats, along: Floats, down: Floats, pitch_rate: Floats, lag: Floats, rates: Floats
) -> None:
    """Fill the rate in m/s^2 of each wake state; arrays (n,), m/s and rad/s as in `Motion`."""
    for i in range(chord.shape[0]):
        at = incidence(SectionMotion(along[i], 0.0, down[i], pitch_rate[i], chord[i]), lag[i], p)
        rates[i] = _lag_rate(at, chord[i], lag[i], p)


@kernel
def advance(
    parameters: StripParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Do nothing: the wake states are part of the integrated state."""


def frequency_domain_incidence(alpha: complex, k: float, parameters: StripParameters) -> complex:
    """The printed form alpha' = AR/(2+AR) (F'(k) + i G'(k)) alpha for harmonic motion, for checks."""
    lag = 1j * k / (1j * k + parameters.c2)
    return parameters.lift_factor * (1.0 - parameters.c1 * lag) * alpha


RANGES = (
    ValidRange("advance_ratio", 0.9, math.inf, "Gerdes 2017, Table 4: 0.91 of wing B, the lowest; a flow from ahead"),
    ValidRange("reynolds", 1e4, math.inf, "Yeo 2011: 18,000, the lowest that was compared"),
    ValidRange("reduced_frequency", 0.0, 0.8, "Gerdes 2017, Table 4: 0.78 of wing B, the highest"),
    ValidRange("aspect_ratio", 3.0, math.inf, "Jones 1940: C'(k) of wings of aspect ratio 3 and more"),
)
MODEL = AerodynamicModel(
    name="strip_theory",
    title="Modified strip theory (DeLaurier 1993) with Kim's dynamic stall, as Gerdes 2017 uses it",
    settings=StripTheory,
    parameters=StripParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    ranges=RANGES,
)
