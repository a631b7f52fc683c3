"""The aircraft and the gusts that move it, as the linear system which filter error follows from stroke to stroke.

A gust along and one across, each of first order, move the air under the model of `longitudinal.py`. The speeds are
those through the air: that is what forces come of, and in axes that turn with the aircraft what pitching turns is the
airspeed, which is measured. Over ground it would be the airspeed and a gust that nobody knows. To the aircraft air
that comes up is not a body that goes down: what its wings' apparent mass, their twist and the lag of the downwash
owe to the change of the flow is among the derivatives of its own motion, of which the air's takes no part. So the
change of the gust across has effects of its own (the derivatives with w', Etkin, Dynamics of Atmospheric Flight,
1972, ch. 13):

    x' = A x + B delta - gust' - G w_g' + F flapping + bank and slip + noise

On the multibody Robo Raven G is (0.05, -0.35, 0.7): left out, M_q came out at more than twice the truth, for the air
turning under the aircraft was the only other thing that a gust's change could do. Wings twist and wakes grow over a
time, so w_g' is the change over a third of a span of flight: the gust less what a first-order lag makes of it. As the
slope of the very moment it was white noise; the damping of Robo Raven was held in 8 flights of 12 in light turbulence
then, and with the lag in 11.

Who holds a height in gusts flaps harder and softer, and stops: between two manoeuvres of Robo Raven the amplitude
went from 0.1 to 0.65 rad. How hard the wings flap is measured, and what it does is one more input with effects to be
found, F: left out, it was taken for gusts and damping. A gust along changes what the tail does, too, as its dynamic
pressure: the tail's angle times the change of that, which is measured, is an input too.

The derivatives that are mostly the tail's change with the airspeed too. Linearised at 6 and at 9.2 m/s the same
aircraft has M_q of -4.6 and -7.5, M_w of -10 and -15, Z_q of -1.9 and -3.9, but Z_w of -8.8 and -9.4, Z_u of -0.6 and
-0.5: wings owe much of their speed to flapping. Where `Air.growing`, the former are proportional to the measured
airspeed, stroke by stroke. In any air a gust passes as soon as the airspeed has it, and pitching turns the speed
that the stroke has.

Gusts come from the sides as well. Who rolls while he slips has his slip before him and below him:

    u' = ... + r v,    w' = ... - p v + g cos theta (cos phi - 1),    theta' = q cos phi - r sin phi

(Etkin ch. 5), as fast as a short period. Rates and bank are measured; the slip is known by the side force that it
makes at the IMU, v = -a_y T, T being the time in which that force would stop it: found with the rest, it takes up
where the IMU is. On Robo Raven in 2 m/s v and -0.8 s a_y had a correlation of 0.95. Left out, all this was taken for
gusts and damping. The moment (I_zz - I_xx) p r is left out: of an aircraft as flat as a bird that is p r at the most,
0.07 rad/s^2 there beside 1.4 of all q'.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.estimators.flight.gust_filter import Driven
from logs.identification.models.stroke_averaged import matrices
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

OUTPUTS = ("q", "a_x", "a_z")
BEGIN = (3.0, 3.0, 1.0, 0.5)
"""m/s, m/s, rad/s, rad; standard deviation of the first state about the reference"""
BIASES = (0.3, 3.0, 3.0)
"""rad/s, m/s^2, m/s^2; of q, a_x and a_z, the trim's difference from the reference included"""
LIFT_SLOPE = 4.5
"""1/rad; of lift over weight: that of a wing of aspect ratio 5 at a lift coefficient of 1"""
NUISANCES = (
    "gust along", "gust across", "duration along", "duration across", "smoothing",
    "push along", "push across", "turn", "error of q", "error of a_x", "error of a_z", "slip",
    "change along", "change across", "change's turn", "flapping along", "flapping across", "flapping's turn",
    "pressure at the tail",
)  # fmt: skip
"""strengths (m/s) and durations (s) of the gusts; for how long (s) the span smooths how the one across turns the air;
what else moves the aircraft, as white noise on the rates of u and w (m/s/s^0.5) and of q (rad/s/s^0.5): strokes that
differ, say; standard deviations of the averages; the time (s) in which the side force stops a slip: all these as
logarithms. What the change of the gust across does: to u' and w' (-) and, in `heave` over the airspeed, to q'. What
harder flapping does to all three, in `FLAPPING`. By what share of the dynamic pressure's change (-) the tail's effect
changes with it"""
LOGARITHMS = 12
GUST, PUSHES, AVERAGES = 0.5, (0.05, 0.05, 0.05), (2e-3, 0.05, 0.05)
"""where the priors of the strengths are centred"""
FLAPPING = (5.0, 5.0, 10.0)
"""m/s^2, m/s^2 and rad/s^2; what flapping of twice the mean square of the wings' rate may do to u', w' and q': half
of gravity along and across, and a moment that turns the aircraft by a radian in half a second"""
SCALES = (60.0, 15.0)
"""m; of gusts along and across (MIL-F-8785C 15 m high has 94 and 15 m, a field low over the ground less along it)"""
SIDE = 0.25
"""-; of what a wing feels when it heaves, what fuselage, wing and tail feel of a slip"""
SPAN = 1.0
"""m; of an aircraft whose span is not known"""
LAG = 0.33
"""-; of a span: the flight that wings and wake take to follow a gust. Robo Raven's twist follows at 15 rad/s,
which is this; from 0.2 to 0.6 its flights in light turbulence gave much the same"""
STATES = 8
"""-; u, w through the air, q, theta, gust along, gust across, the latter smoothed by the span, and lagged"""
DOUBT = np.array((1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 1.0, 0.3, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0))
"""-; standard deviations under the priors"""


GROWING = ("X_q", "Z_q", "M_u", "M_w", "M_q")
"""-; derivatives that are mostly the tail's"""


class Air(NamedTuple):
    """What is taken for granted of the air and of what it does to the aircraft."""

    turning: bool
    """-; the gust across turns the air where it changes along the flight"""
    growing: bool
    """-; what the tail does (`GROWING`) grows with the airspeed"""


class Flown(NamedTuple):
    """Which aircraft meets the gusts, and how it flies."""

    names: tuple[str, ...]
    """-; of the derivatives"""
    reference: Reference
    aircraft: Aircraft
    still: Array
    """(7, 5); A and B and, below them, C and D of `OUTPUTS`, in still air and without derivatives"""
    slopes: Array
    """(p, 7, 5); what one of each derivative adds to that"""
    growing: Array
    """(p, 7, 5); what of ``slopes`` is proportional to the airspeed"""
    air: Air


def flown(names: tuple[str, ...], reference: Reference, aircraft: Aircraft, air: Air) -> Flown:
    """The aircraft of derivatives ``names``, in which its matrices are linear, in ``air``."""

    def matrix(values: Array) -> Array:
        model = matrices(names, values, reference, aircraft)
        rows = (model.a, model.b[:, None]), (model.c[: len(OUTPUTS)], model.d[: len(OUTPUTS), None])
        return np.block([list(row) for row in rows])

    still = matrix(np.zeros(len(names)))
    slopes = np.array([matrix(one) - still for one in np.eye(len(names))])
    tail = slopes * np.array([name in GROWING for name in names])[:, None, None]
    return Flown(names, reference, aircraft, still, slopes, tail * air.growing, air)


def kinematics(reference: Reference, airspeeds: Array, angles: Array) -> Array:
    """What to add to A (l, 4, 4), which turns the reference's speed with the pitch, to turn another.

    ``airspeeds`` (l,) are in m/s, ``angles`` of attack (l,) in rad.
    """
    more = np.zeros((len(airspeeds), 4, 4))
    more[:, 0, 2] = reference.w - airspeeds * np.sin(angles)
    more[:, 1, 2] = airspeeds * np.cos(angles) - reference.u
    return more


def heave(reference: Reference) -> float:
    """1/s; how fast a wing of `LIFT_SLOPE` damps the heaving at this airspeed."""
    return LIFT_SLOPE * STANDARD_GRAVITY / reference.airspeed


def prior(reference: Reference, aircraft: Aircraft, air: Air) -> Array:
    """What the priors of `NUISANCES` (19,) are centred on in ``air``.

    The span b smooths over 4 b / pi (MIL-F-8785C 3.7.5). The tail feels all of the dynamic pressure, or none of it.
    A slip is damped as a heave is, `SIDE` times as fast.
    """
    smoothed = 4.0 * (aircraft.span or SPAN) / np.pi
    durations = (scale / reference.airspeed for scale in (*SCALES, smoothed))
    slip = 1.0 / (SIDE * heave(reference))
    known = np.log([GUST, GUST, *durations, *PUSHES, *AVERAGES, slip])
    return np.concatenate((known, np.zeros(6), [float(air.growing)]))


def system(flown: Flown, derivatives: Array, nuisances: Array) -> Driven:
    """The aircraft and its gusts, of `STATES`.

    Where gusts are ``turning`` the air, ``q_g = -dw_g/dx`` as far as the span does not smooth it (MIL-F-8785C
    3.7.5), that moves the aircraft as its own pitch rate does, less it. Of ``derivatives`` (p, s) and ``nuisances``
    (19, s) there may be several sets.
    """
    logarithms, change, flapping, (pressed,) = np.split(nuisances, (LOGARITHMS, LOGARITHMS + 3, LOGARITHMS + 6))
    strengths, durations, (smoothing,), pushes, noise, (slip,) = np.split(np.exp(logarithms), (2, 4, 5, 8, 11))
    airspeed, sets = flown.reference.airspeed, nuisances.shape[1]
    model, grown = (np.einsum("pij,ps->ijs", slopes, derivatives) for slopes in (flown.slopes, flown.growing))
    model += flown.still[:, :, None]
    lags, felt = (smoothing, np.full(sets, LAG * (flown.aircraft.span or SPAN) / airspeed)), _felt(flown.aircraft)
    blown = _blown(felt, durations, lags, change * [[1.0], [1.0], [heave(flown.reference) / airspeed]])
    turned = np.zeros_like(blown)
    by_turning = flown.air.turning * np.array([1.0, -1.0])[:, None] / (smoothing * airspeed)
    turned[:, 5:7] += np.einsum("ij,js->is", felt, _by_pitch_rate(flown.names, derivatives))[:, None] * by_turning
    rates, faster = _beside(model, blown + turned), _beside(grown, blown + turned * flown.air.growing)
    flapped, tail = np.einsum("ij,js->is", felt * FLAPPING, flapping), model[:, 4]
    pushed = np.stack((tail, pressed * tail, np.concatenate((flapped[:4], flapped[STATES:]))), axis=1)
    effects = np.concatenate((pushed, _turned_aside(slip)), axis=1)
    b, d = effects[:4], effects[4:]
    density, gusts = _densities(felt, pushes, strengths, durations)
    biases = np.broadcast_to(np.array(BIASES)[:, None], (len(BIASES), sets))
    return Driven(
        rates[:STATES], b, rates[STATES:], d, density + gusts,
        _begin(strengths, durations[1], lags), biases, noise, faster, gusts,
    )  # fmt: skip


def _turned_aside(slip: Array) -> Array:
    """What bank and slip do (4 + 3, 4, s), by the kinematics alone: no specific force comes of it."""
    aside = np.zeros((4 + len(OUTPUTS), 4, len(slip)))
    aside[3, 0] = aside[1, 1] = 1.0
    aside[0, 2] = aside[1, 3] = slip
    return aside


def _blown(felt: Array, durations: Array, lags: tuple[Array, Array], change: Array) -> Array:
    """What gusts do (8 + 3, 8, s) as they pass: to the speeds through the air, to forces by a ``change`` (3, s)."""
    blown = np.zeros((len(felt), STATES, durations.shape[1]))
    blown[[4, 5], [4, 5]], blown[[0, 1], [4, 5]] = -1.0 / durations, 1.0 / durations
    blown[[6, 7], 5], blown[[6, 7], [6, 7]] = 1.0 / np.array(lags), -1.0 / np.array(lags)
    changed = np.einsum("ij,js->is", felt, change) / lags[1]
    blown[:, [5, 7]] += changed[:, None] * np.array([-1.0, 1.0])[:, None]
    return blown


def _densities(felt: Array, pushes: Array, strengths: Array, durations: Array) -> tuple[Array, Array]:
    """Spectral densities (8 + 3, 8 + 3, s) of what pushes the aircraft, and of the gusts.

    What the noise of a gust adds to the air's speed it takes off that through the air.
    """
    white = 2.0 * strengths**2 / durations
    pushed = np.einsum("ijk,ks->ijs", felt[:, None] * felt, pushes**2)
    gusts = np.zeros_like(pushed)
    gusts[[4, 5], [4, 5]], gusts[[0, 1], [0, 1]] = white, white
    gusts[[0, 1], [4, 5]], gusts[[4, 5], [0, 1]] = -white, -white
    return pushed, gusts


def _beside(model: Array, blown: Array) -> Array:
    """A ``model`` (7, 5, s) of motion and outputs, without its input, and what is ``blown`` (8 + 3, 8, s)."""
    rates = blown.copy()
    for here, there in ((slice(4), slice(4)), (slice(STATES, None), slice(4, None))):
        rates[here, :4] += model[there, :4]
    return rates


def _begin(strengths: Array, duration: Array, lags: tuple[Array, Array]) -> Array:
    """Covariance (8, 8, s) of the first state of a stretch.

    Of gusts of ``strengths`` (2, s) that have always blown: what ``lags`` make of noise of first order, whose
    ``duration`` (s,) it has, has with it the covariance that no longer changes. The motion through the air may be
    any, whatever the gust is just then.
    """
    begin = np.zeros((STATES, STATES, len(duration)))
    begin[range(4), range(4)] = np.square(BEGIN)[:, None]
    begin[4, 4], across = strengths**2
    one, other = (across * duration / (duration + lag) for lag in lags)
    both = (other * lags[1] + one * lags[0]) / (lags[0] + lags[1])
    begin[5:, 5:] = np.array([[across, one, other], [one, one, both], [other, both, other]])
    return begin


def _felt(aircraft: Aircraft) -> Array:
    """States and, behind them, outputs (8 + 3, 3) as forces along and across and a moment change them.

    The accelerometers feel them where they are.
    """
    felt = np.zeros((STATES + len(OUTPUTS), 3))
    felt[:3], felt[STATES + 1, 0], felt[STATES + 2, 1] = np.eye(3), 1.0, 1.0
    felt[STATES + 1 :, 2] = aircraft.imu_z, -aircraft.imu_x
    return felt


def _by_pitch_rate(names: tuple[str, ...], values: Array) -> Array:
    """X_q, Z_q and M_q (3, s); 0 for what is not named."""
    given = dict(zip(names, values, strict=True))
    return np.array([given.get(f"{axis}_q", np.zeros(values.shape[1])) for axis in "XZM"])
