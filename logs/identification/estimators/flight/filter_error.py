"""Filter error: maximum likelihood with the gusts among the states.

Output error takes every motion for the answer to the input. In turbulence the air moves the aircraft as well; a
Kalman filter that knows of gusts foretells each stroke from those before, and the derivatives are those whose
forecasts err least (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 5; Klein & Morelli, Aircraft System
Identification, 2006, ch. 6). The aircraft in its gusts is that of `gusts.py`. How strong and long the gusts are, what
their change does, what harder flapping does, how fast a slip stops and the errors of the averages are found with the
derivatives; what is known of those before is a wide prior (`gust_likelihood.py`, `gust_search.py`). What pitching
turns is the speed along and across: a first search takes one angle of attack for all strokes, a second the motion
that the first one follows.

Whether gusts turn the air where they change along the flight is not known before. Fitted by the wrong one of both a
flight has derivatives by the speed that are off by more than their errors; one more parameter between them is not
told well enough. Nor is it known whether what the tail does grows with the airspeed, which in light turbulence went
from 6 to 8 m/s between two inputs of Robo Raven. So both are left open, and what is found in each kind of air counts
as likely as the flight makes it (`mixture.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.flight_segments import Stretch
from logs.identification.estimators.flight.equation_error import DerivativeFit, failed
from logs.identification.estimators.flight.gust_ekf_data import PHASES, Task
from logs.identification.estimators.flight.gust_likelihood import Likelihood, Likelihoods, likelihoods_of
from logs.identification.estimators.flight.gust_search import End, climb, determined, likelihood_at, scored, scoring
from logs.identification.estimators.flight.gusts import BEGIN, LIFT_SLOPE, OUTPUTS, Air, heave, prior
from logs.identification.estimators.flight.model_averaging import likely, mixed
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread, with_scatter

USUAL = 10.0 / 11.0
"""-; how likely it is before the flight that gusts turn the air, as turbulence does (MIL-F-8785C 3.7.5), and that the
tail's work grows with the airspeed, as dynamic pressure does. At even odds for the first the damping of Robo Raven in
2 m/s was held in 8 flights of 11, at ten to one in 11 of 13 (with speeds over ground in place of those through the
air)"""
BEFORE = {
    Air(turning, growing): (USUAL if turning else 1.0 - USUAL) * (USUAL if growing else 1.0 - USUAL)
    for growing in (True, False)
    for turning in (True, False)
}
HOPELESS = 1e-2
"""-; probability after the flight below which a kind of air is left out"""
LEAST_DEGREES = 10.0
"""-; of freedom, for errors that mean something"""


class Filtered(NamedTuple):
    """What filter error found beside the derivatives."""

    stretches: tuple[Stretch, ...]
    foretold: Array
    """(K, 3); q rad/s, a_x and a_z m/s^2: each stroke's averages as the strokes before foretell them"""
    turning: float
    """-; how likely it is, after the flight, that gusts turned the air"""
    growing: float
    """-; and that what the tail does grew with the airspeed"""


class InAir(NamedTuple):
    """What was found in one kind of air."""

    air: Air
    values: Array
    """(p + 19,)"""
    fit: DerivativeFit
    evidence: float
    """-; logarithm of how likely the flight is of this air, up to a constant; minus infinity where ``fit`` failed"""
    errors: Array
    """rad/s, m/s^2, m/s^2; (K, m), of the forecasts"""
    followed: Array
    """m/s, m/s, rad/s, rad; (K, 4), motion in each stroke above the reference's"""


def filter_error(task: Task, start: Array) -> tuple[DerivativeFit, Filtered | None]:
    """Derivatives ``task.names``, searched by `gust_search.climb` from ``start`` (p,) and from `_stable`.

    Errors are those of the likelihood's information, or of the scatter between manoeuvres where that is larger, and
    what the kinds of air differ by.
    """
    if not task.stretches:
        return failed(
            task.names, "the strokes are too few or too uneven to follow the gusts from one to the next"
        ), None
    airs = _in_all(task, start)
    fitting = [each for each in airs if not each.fit.failure]
    if not fitting:
        return airs[0].fit, None
    shares = _shares(fitting)
    averages = np.vstack([stretch.averages[:, : len(OUTPUTS)] for stretch in task.stretches])
    errors = np.einsum("k,kij->ij", shares, [each.errors for each in fitting])
    turning, growing = (
        float(shares @ told) for told in ([a.air.turning for a in fitting], [a.air.growing for a in fitting])
    )
    fit = mixed(tuple(each.fit for each in fitting), shares)
    return fit, Filtered(task.stretches, averages - errors, turning, growing)


def _shares(airs: list[InAir]) -> Array:
    """How likely each is after the flight."""
    return likely(np.array([each.evidence for each in airs]), np.array([BEFORE[each.air] for each in airs]))


def _in_all(task: Task, start: Array) -> list[InAir]:
    """What is found in each kind of air.

    Gusts hide in the speeds that equation error integrates: what it finds is a ``start`` that may lead to another
    optimum than the likeliest. So a start that no gust has spoilt is tried too, and where searches in other air
    ended. The long way from a start is searched with the strokes of one phase, and all of it at one angle of attack;
    what is hopeless then is left out.
    """
    phase = task.stretches[0].phase
    half = task._replace(stretches=tuple(stretch for stretch in task.stretches if stretch.phase == phase))
    centres = {air: prior(task.reference, task.aircraft, air) for air in BEFORE}
    likelihoods = {air: likelihoods_of(task, centre, air) for air, centre in centres.items()}

    def nearer(air: Air, derivatives: Array) -> Array:
        centre = centres[air]
        return scoring(half, np.concatenate((derivatives, centre)), likelihoods_of(half, centre, air), centre)[1]

    def best(air: Air, *starts: Array) -> InAir:
        ends = [climb(task, values, likelihoods[air], centres[air]) for values in starts]
        return _in_air(task, air, min(ends, key=lambda end: end.cost), likelihoods[air])

    def likelier(found: InAir, other: InAir) -> InAir:
        """What was ``found``, or what comes in the same air from the ``other`` where that is likelier."""
        if found.evidence >= other.evidence:
            return found
        return max(found, best(found.air, other.values), key=lambda each: each.evidence)

    stable, with_growth, without = _stable(task, start), Air(True, True), Air(True, False)
    growing = best(with_growth, nearer(with_growth, start), nearer(with_growth, stable))
    near = min(growing.values, nearer(without, stable), key=lambda at: likelihood_at(likelihoods[without], at).cost)
    steady = best(without, near)
    pair = [likelier(growing, steady) if growing.fit.failure else growing, steady]
    if all(each.fit.failure for each in pair):
        return pair
    found = []
    for turned, share in zip(pair, _shares(pair), strict=True):
        if share >= HOPELESS or turned.fit.failure:
            still = best(Air(False, turned.air.growing), turned.values)
            found += [likelier(turned, still), still]
    return _by_the_motion(task, _hopeful(found), centres)


def _hopeful(airs: list[InAir]) -> list[InAir]:
    """Those of `HOPELESS` and more; all where no fit succeeded."""
    fitting = [each for each in airs if not each.fit.failure]
    if not fitting:
        return airs
    return [each for each, share in zip(fitting, _shares(fitting), strict=True) if share >= HOPELESS]


def _by_the_motion(task: Task, found: list[InAir], centres: dict[Air, Array]) -> list[InAir]:
    """What is ``found`` once more, with the kinematics of the motion that it follows, the same in all kinds of air.

    What pitching turns is the speed along and across. Only the airspeed is measured: at one angle of attack for all
    strokes the products of the pitch rate with what gusts do to it are left to Z_w and M_w. Where a search fails all
    stays as it was: how likely kinds of air are is told by one model of the kinematics.
    """
    if any(each.fit.failure for each in found):
        return found
    moving = task._replace(across=task.reference.w + _shares(found) @ [each.followed[:, 1] for each in found])
    again = []
    for each in found:
        centre = centres[each.air]
        likelihoods = likelihoods_of(moving, centre, each.air)
        again.append(_in_air(moving, each.air, climb(moving, each.values, likelihoods, centre), likelihoods))
    return found if any(each.fit.failure for each in again) else again


def _stable(task: Task, start: Array) -> Array:
    """Derivatives (p,) of a stable aircraft of this weight at this airspeed.

    Its wing lifts as a wing does, and a short period as fast as its heave is damped by half and more; what the tail
    does is that of ``start`` (p,), which tells it best.
    """
    damped = heave(task.reference)
    stable = {
        "X_u": -0.3, "X_w": 0.15 * damped, "X_q": 0.0, "Z_u": -damped / LIFT_SLOPE, "Z_w": -damped, "Z_q": 0.0,
        "M_u": 0.0, "M_w": -(damped**2) / task.reference.airspeed, "M_q": -damped,
    }  # fmt: skip
    return np.array([stable.get(name, value) for name, value in zip(task.names, start, strict=True)])


def _in_air(task: Task, air: Air, end: End, likelihoods: Likelihoods) -> InAir:
    """The fit that a search ended with, and how likely it makes the flight.

    Likelihood times prior is integrated over the parameters as a normal distribution about its greatest, the
    information taken for its curvature (Laplace's method: MacKay, Information Theory, Inference, and Learning
    Algorithms, 2003, Eq. 28.10).
    """
    here = likelihood_at(likelihoods, end.values)

    def nothing(why: str) -> InAir:
        return InAir(air, end.values, failed(task.names, why), -np.inf, here.errors, here.followed)

    if _degrees(task, here, len(end.values)) < LEAST_DEGREES:
        return nothing("the flight holds too few strokes for the model's parameters")
    if not np.isfinite(end.cost):
        return nothing("filter error did not converge")
    scores, squared = scored(task, end.values, likelihoods)
    if not determined(squared):
        return nothing("the flight does not determine all derivatives")
    fit = _finish(task, end.values, here, scores, squared)
    evidence = -end.cost - float(np.linalg.slogdet(squared)[1]) / 2.0
    return InAir(air, end.values, fit, evidence, here.errors, here.followed)


def _finish(task: Task, values: Array, here: Likelihood, scores: Array, squared: Array) -> DerivativeFit:
    count = len(task.names)
    inverse = np.asarray(np.linalg.inv(squared), dtype=np.float64)
    degrees = _degrees(task, here, len(values))
    # Strengths at their optimum are too small by what the parameters took, as a variance over all residuals is.
    within = Spread(inverse * (here.errors.size / len(PHASES) / degrees), degrees)
    spread = with_scatter(within, inverse, _by_manoeuvre(task, scores))
    scatter: Array = np.std(here.errors, axis=0)
    return DerivativeFit(task.names, values[:count], spread.part(slice(count)), scatter)


def _degrees(task: Task, here: Likelihood, parameters: int) -> float:
    """Of freedom: averages of one phase less the parameters and, of each stretch, first state and biases."""
    nuisances = len(task.stretches) * (len(BEGIN) + len(OUTPUTS))
    return (here.errors.size - nuisances) / len(PHASES) - parameters


def _by_manoeuvre(task: Task, scores: Array) -> list[Array]:
    """The scores (K, n) summed over each manoeuvre and the calm behind it, all phases of it together."""
    places = np.concatenate([stretch.manoeuvre for stretch in task.stretches])
    return [np.sum(scores[places == place], axis=0) for place in np.unique(places)]
