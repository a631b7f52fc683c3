"""The aircraft and the gusts that move it, as the linear system which filter error follows from stroke to stroke.

A gust along and one across, each of first order, move the air under the model of `longitudinal.py`. To the aircraft
air that comes up is not a body that goes down: what its wings' apparent mass, their twist and the lag of the downwash
owe to the change of the flow is among the derivatives of its own motion, of which the air's takes no part. So the
change of the gust across has effects of its own (the derivatives with w', Etkin, Dynamics of Atmospheric Flight,
1972, ch. 13):

    x' = A x + B delta - A_uw gust - G w_g' + F flapping + noise

On the multibody Robo Raven G is (0.05, -0.35, 0.7): left out, M_q came out at more than twice the truth, for the air
turning under the aircraft was the only other thing that a gust's change could do.

Who holds a height in gusts flaps harder and softer, and stops: between two manoeuvres of Robo Raven the amplitude
went from 0.1 to 0.65 rad. How hard the wings flap is measured, and what it does is one more input with effects to be
found, F: left out, it was taken for gusts and damping. A gust along changes what the tail does, too, as its dynamic
pressure: the tail's angle times the change of that, which is measured, is a third input.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.constants import STANDARD_GRAVITY
from logs.identification.data import Aircraft
from logs.identification.modes.gust_filter import Driven
from logs.identification.modes.longitudinal import matrices
from logs.identification.preparing.manoeuvre import Reference
from logs.identification.results import Array

OUTPUTS = ("q", "a_x", "a_z")
BEGIN = (3.0, 3.0, 1.0, 0.5)
"""m/s, m/s, rad/s, rad; standard deviation of the first state about the reference"""
BIASES = (0.3, 3.0, 3.0)
"""rad/s, m/s^2, m/s^2; of q, a_x and a_z, the trim's difference from the reference included"""
LIFT_SLOPE = 4.5
"""1/rad; of lift over weight: that of a wing of aspect ratio 5 at a lift coefficient of 1"""
NUISANCES = (
    "gust along", "gust across", "duration along", "duration across", "smoothing",
    "push along", "push across", "turn", "error of q", "error of a_x", "error of a_z",
    "change along", "change across", "change's turn", "flapping along", "flapping across", "flapping's turn",
    "pressure at the tail",
)  # fmt: skip
"""strengths (m/s) and durations (s) of the gusts; for how long (s) the span smooths how the one across turns the air;
what else moves the aircraft, as white noise on the rates of u and w (m/s/s^0.5) and of q (rad/s/s^0.5): strokes that
differ, say; standard deviations of the averages: all these as logarithms. What the change of the gust across does: to
u' and w' (-) and, in `heave` over the airspeed, to q'. What harder flapping does to all three, in `FLAPPING`.
By what share of the dynamic pressure's change (-) the tail's effect changes with it"""
LOGARITHMS = 11
GUST, PUSHES, AVERAGES = 0.5, (0.05, 0.05, 0.05), (2e-3, 0.05, 0.05)
"""where the priors of the strengths are centred"""
FLAPPING = (5.0, 5.0, 10.0)
"""m/s^2, m/s^2 and rad/s^2; what flapping of twice the mean square of the wings' rate may do to u', w' and q': half
of gravity along and across, and a moment that turns the aircraft by a radian in half a second"""
SCALES = (60.0, 15.0)
"""m; of gusts along and across (MIL-F-8785C 15 m high has 94 and 15 m, a field low over the ground less along it)"""
SPAN = 1.0
"""m; of an aircraft whose span is not known"""
DOUBT = np.array((1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 0.3, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0))
"""-; standard deviations under the priors"""


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


def flown(names: tuple[str, ...], reference: Reference, aircraft: Aircraft) -> Flown:
    """The aircraft of derivatives ``names``; its matrices are linear in them."""

    def matrix(values: Array) -> Array:
        model = matrices(names, values, reference, aircraft)
        rows = (model.a, model.b[:, None]), (model.c[: len(OUTPUTS)], model.d[: len(OUTPUTS), None])
        return np.block([list(row) for row in rows])

    still = matrix(np.zeros(len(names)))
    return Flown(names, reference, aircraft, still, np.array([matrix(one) - still for one in np.eye(len(names))]))


def heave(reference: Reference) -> float:
    """1/s; how fast a wing of `LIFT_SLOPE` damps the heaving at this airspeed."""
    return LIFT_SLOPE * STANDARD_GRAVITY / reference.airspeed


def prior(reference: Reference, aircraft: Aircraft) -> Array:
    """What the priors of `NUISANCES` (18,) are centred on.

    The span b smooths over 4 b / pi (MIL-F-8785C 3.7.5).
    """
    smoothed = 4.0 * (aircraft.span or SPAN) / np.pi
    durations = (scale / reference.airspeed for scale in (*SCALES, smoothed))
    return np.concatenate((np.log([GUST, GUST, *durations, *PUSHES, *AVERAGES]), np.zeros(6), [1.0]))


def system(flown: Flown, derivatives: Array, nuisances: Array) -> Driven:
    """The aircraft and its gusts: states u, w, q, theta over ground, gust along, gust across, the latter smoothed.

    Where the gust across changes along the flight the air turns, ``q_g = -dw_g/dx``, as far as the span does not
    smooth it (MIL-F-8785C 3.7.5), and moves the aircraft as its own pitch rate does, less it. Of ``derivatives``
    (p, s) and ``nuisances`` (18, s) there may be several sets.
    """
    logarithms, change, flapping, (pressed,) = np.split(nuisances, (LOGARITHMS, LOGARITHMS + 3, LOGARITHMS + 6))
    strengths, durations, (smoothing,), pushes, noise = np.split(np.exp(logarithms), (2, 4, 5, 8))
    count, airspeed, sets = len(OUTPUTS), flown.reference.airspeed, nuisances.shape[1]
    model = flown.still[:, :, None] + np.einsum("pij,ps->ijs", flown.slopes, derivatives)
    a, c = np.zeros((7, 7, sets)), np.zeros((count, 7, sets))
    a[:4, :4], a[:4, 4:6], c[:, :4], c[:, 4:6] = model[:4, :4], -model[:4, :2], model[4:, :4], -model[4:, :2]
    a[4, 4], a[5, 5] = -1.0 / durations
    a[6, 5], a[6, 6] = 1.0 / smoothing, -1.0 / smoothing
    turned = np.array([1.0, -1.0])[:, None] / (smoothing * airspeed)
    a[:3, 5:] += _by_pitch_rate(flown.names, derivatives)[:, None] * turned
    c[1:, 5:] += model[5:, None, 2] * turned
    felt = _felt(flown.aircraft)
    changed = np.einsum("ij,js->is", felt, change * np.array([[1.0], [1.0], [heave(flown.reference) / airspeed]]))
    a[:3, 5] += changed[:3] / durations[1]
    c[:, 5] += changed[7:] / durations[1]
    flapped, tail = np.einsum("ij,js->is", felt * FLAPPING, flapping), model[:, 4]
    effects = np.stack((tail, np.concatenate((flapped[:4], flapped[7:])), pressed * tail), axis=1)
    b, d = effects[:4], effects[4:]
    density = np.einsum("ijk,ks->ijs", felt[:, None] * felt, pushes**2)
    changed[5] = -1.0
    density[4, 4] = 2.0 * strengths[0] ** 2 / durations[0]
    density += changed[:, None] * changed * (2.0 * strengths[1] ** 2 / durations[1])
    begin, biases = (np.broadcast_to(np.array(each)[:, None], (len(each), sets)) for each in (BEGIN, BIASES))
    return Driven(a, b, c, d, density, np.concatenate((begin, strengths, strengths[1:])), biases, noise)


def _felt(aircraft: Aircraft) -> Array:
    """States and, behind them, outputs (7 + 3, 3) as forces along and across and a moment change them.

    The accelerometers feel them where they are.
    """
    felt = np.zeros((7 + len(OUTPUTS), 3))
    felt[:3], felt[7 + 1, 0], felt[7 + 2, 1] = np.eye(3), 1.0, 1.0
    felt[7 + 1 :, 2] = aircraft.imu_z, -aircraft.imu_x
    return felt


def _by_pitch_rate(names: tuple[str, ...], values: Array) -> Array:
    """X_q, Z_q and M_q (3, s); 0 for what is not named."""
    given = dict(zip(names, values, strict=True))
    return np.array([given.get(f"{axis}_q", np.zeros(values.shape[1])) for axis in "XZM"])
