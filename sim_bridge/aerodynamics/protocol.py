"""Interface of an aerodynamic model: its inputs from the mechanism and its outputs.

A model is a NamedTuple of constants (its *parameters*) and three functions of them:

* ``initial(parameters, strips)``: its state at rest, (s,);
* ``loads(parameters, strips, motion, density, state, out)``: the loads of this instant, strip by strip and part by
  part, and the rates of that share of the state that moves smoothly; compiled, called by every stage of the
  integrator;
* ``advance(parameters, strips, motion, density, state, dt)``: what happens between two steps of the integrator, for
  memory with a rate of its own (a wake shed row by row); compiled. ``motion`` is that of the end of the step, and so
  is ``state``, whose smooth share is left to the integrator. Models without `advances` are not called.

All of a model's work is in section axes, so that it knows neither frames nor joints: ``chord`` forward, ``normal``
upward, ``span`` to the tip. The mechanism turns them into body axes and generalised forces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.vectors import Floats

FORWARD, UPWARD, OUTWARD, NOSE_UP = 0, 1, 2, 3
"""components of a part's load: force along chord, normal and span in N, moment about the span at mid-chord in N m"""
MASS, INERTIA = 0, 1
"""what the air's apparent mass consists of: kg along the normal at mid-chord, kg m^2 about the span there"""


class Strips(NamedTuple):
    """Strips of all wings, left wing first, from root to tip; arrays (n,)."""

    span: Floats
    """m; from the hinge to the middle of the strip"""
    eta: Floats
    """-; the same over the semispan"""
    chord: Floats
    """m"""
    width: Floats
    """m"""
    wing: Floats
    """-; index of the wing that the strip belongs to"""


class Motion(NamedTuple):
    """Motion of strips and body at one instant; arrays (n,) unless noted."""

    along: Floats
    """m/s; of the section through the air, forward along its chord"""
    down: Floats
    """m/s; of mid-chord through the air, against the normal: down counts positive"""
    outward: Floats
    """m/s; of mid-chord through the air, towards the tip"""
    pitch_rate: Floats
    """rad/s; of the section about its span, leading edge up, body's rotation included"""
    plunge: Floats
    """m/s; of the leading edge against the normal by the wing's joints alone (h' cos(theta - theta_a))"""
    place: Floats
    """(3, n) m; of mid-chord in body axes, from the origin of the fuselage; for models that need it"""
    axes: Floats
    """(3, 3, n) -; span, chord and normal, each in body axes; likewise"""
    wings: Floats
    """(wings, 2) rad, rad/s; flap angle and rate, wing up positive"""
    body: Floats
    """(6,) m/s, rad/s; velocity of the fuselage through the air and its angular velocity, body axes"""
    tail: Floats
    """(2,) rad; achieved elevator (nose up positive) and rudder (nose right positive), 0 where a vehicle has none"""
    tail_rate: Floats
    """(2,) rad/s; of these"""
    ground: Floats
    """(4,) m, -; height of the fuselage's origin above the ground, and the way down in body axes; for ``advance``"""


class SectionLoads(NamedTuple):
    """Loads that a model fills in."""

    parts: Floats
    """(parts, 4, n) N, N, N, N m; two parts or more: FORWARD, UPWARD, OUTWARD, NOSE_UP of each strip"""
    apparent: Floats
    """(2, n) kg, kg m^2; MASS and INERTIA of the air that the strip's acceleration moves"""
    rates: Floats
    """(s,); of the state, 0 where `advance` moves it"""
    body: Floats
    """(parts, 6) N, N m; on the fuselage about its origin, body axes: loads not given strip by strip"""


def blank_motion(strips: Strips, wings: int) -> Motion:
    """Allocate a motion at rest, far from the ground."""
    n = strips.chord.shape[0]
    columns = [np.zeros(n) for _ in range(5)]
    return Motion._make(
        [
            *columns,
            np.zeros((3, n)),
            np.zeros((3, 3, n)),
            np.zeros((wings, 2)),
            np.zeros(6),
            np.zeros(2),
            np.zeros(2),
            np.array([np.inf, 0.0, 0.0, 1.0]),
        ]
    )


def blank_loads(parts: int, strips: Strips, states: int) -> SectionLoads:
    """Allocate loads of ``parts`` parts."""
    n = strips.chord.shape[0]
    return SectionLoads(np.zeros((parts, 4, n)), np.zeros((2, n)), np.zeros(states), np.zeros((parts, 6)))


def strip_loads(motion: Motion, sections: Floats) -> Floats:
    """Force and moment (..., n, 6) in N, N m of section loads (..., 4, n), about the body's origin, body axes.

    ``motion`` with places and axes.
    """
    span, chord, normal = motion.axes
    forward, upward, outward, nose_up = (sections[..., i, None, :] for i in range(4))
    force = forward * chord + upward * normal + outward * span
    # Nose up turns about the axis to the right on either side: chord times normal.
    moment = _cross(motion.place, force) + nose_up * _cross(chord, normal)
    return np.swapaxes(np.concatenate((force, moment), axis=-2), -1, -2)


def _cross(one: Floats, other: Floats) -> Floats:
    """Cross product over the last axis but one; `numpy.cross` takes three times as long for so few strips."""
    return one[..., _NEXT, :] * other[..., _LAST, :] - one[..., _LAST, :] * other[..., _NEXT, :]


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def aspect_ratio(strips: Strips) -> float:
    """Aspect ratio of both wings: (2 x maximum semispan)^2 over the area of all strips."""
    semispan = float(np.max(strips.span + 0.5 * strips.width))
    return (2.0 * semispan) ** 2 / float(np.sum(strips.chord * strips.width))


class ValidRange(NamedTuple):
    """Range of a similarity number in which a model was compared with measurements, or its assumptions hold."""

    quantity: str
    """field of `sim_bridge.flight_mechanics.similarity.SimilarityNumbers`"""
    low: float
    """-; lower limit"""
    high: float
    """-; upper limit; infinite for none"""
    source: str
    """publication or reason of the limits"""


class AerodynamicModel(NamedTuple):
    """One row of the table of models."""

    name: str
    title: str
    """what it is, and after whom"""
    settings: type[Any]
    """section of the vehicle file that carries the model's name"""
    parameters: type[Any]
    """NamedTuple of numbers, or of such NamedTuples, that ``build`` makes"""
    parts: tuple[str, ...]
    """names of the parts of the loads, in order"""
    build: Callable[[Any, Strips], Any]
    """settings and strips to parameters; raises InputError where the model does not hold"""
    initial: Callable[[Any, Strips], Floats]
    loads: Callable[..., None]
    advance: Callable[..., None]
    needs_places: bool = False
    """``loads`` requires `Motion.place` and `Motion.axes`, which are not filled otherwise"""
    advances: bool = False
    """there is something for ``advance`` to move: the plant evaluates the motion once more a step, places too"""
    with_fuselage: bool = False
    """the loads have the fuselage's drag in them: the plant adds none"""
    with_tail: bool = False
    """the loads have those of tail and fins in them: the plant adds none"""
    keeps_wake: bool = False
    """its state is a whole wake, thousands of numbers: too many for orbits and linear models"""
    ranges: tuple[ValidRange, ...] = ()
    """ranges of validity; none for a quantity without a known limit"""


MODELS: dict[str, AerodynamicModel] = {}
"""the table, by name; filled by `sim_bridge.aerodynamics.models`"""
