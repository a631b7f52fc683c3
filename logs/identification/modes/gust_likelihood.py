"""How likely a flight's strokes are of an aircraft and its gusts, at any set of their parameters.

Where derivatives swing with the wing, an average that always begins at one phase of the stroke sees them with the
motion's trend: the damping came out a tenth too high. Every stretch is therefore cut at two opposite phases, which
are wrong against each other, and both count half.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.data import Aircraft
from logs.identification.modes.gust_filter import Averaged, innovations
from logs.identification.modes.gusts import DOUBT, OUTPUTS, Air, flown, system
from logs.identification.modes.longitudinal import TAIL_LAG
from logs.identification.preparing.manoeuvre import Reference, tail_angle
from logs.identification.preparing.stretches import Stretch
from logs.identification.results import Array

PHASES = (0.0, 0.5)
"""-; of a stroke, at which the averages of the same flight begin"""
STEPS = 32
"""-; of the tail's angle through a stroke"""
LENGTH_STEP, AIRSPEED_STEP = 1e-2, 1.0 / 32.0
"""-; of a mean stroke and of the reference's airspeed: strokes that differ by less share a transition"""
WIDEST = 6.0
"""-; of a prior's standard deviations: nothing further out is tried"""


class Task(NamedTuple):
    """What is fitted to what."""

    stretches: tuple[Stretch, ...]
    """of every phase of `PHASES`, those of the first before the others"""
    reference: Reference
    aircraft: Aircraft
    names: tuple[str, ...]

    @property
    def known_lag(self) -> bool:
        """Whether the tail's time constant is none of the parameters."""
        return TAIL_LAG not in self.names


class Likelihood(NamedTuple):
    """At one set of parameters; where the cost is infinite the rest means nothing."""

    cost: float
    """-; minus the logarithm of likelihood and prior"""
    errors: Array
    """rad/s, m/s^2, m/s^2; (K, m), of the forecasts"""
    root: Array
    """(K, m, m); Cholesky's of their covariance"""
    white: Array
    """-; (K, m), the errors divided by the root"""


Likelihoods = Callable[[Array], list[Likelihood]]
"""at each of several sets of parameters (s, p + 18)"""


def likelihoods_of(task: Task, centre: Array, air: Air) -> Likelihoods:
    """The likelihood in ``air`` of sets of parameters (s, p + 18): derivatives and `gusts.NUISANCES`.

    The prior of these is about ``centre`` (18,).
    """
    count, names = len(task.names), tuple(name for name in task.names if name != TAIL_LAG)
    model = flown(names, task.reference, task.aircraft, air)
    fixed = _averaged(task, None, air.growing) if task.known_lag else None

    def together(sets: Array) -> list[Likelihood]:
        """Of sets that have the tail's lag in common."""
        averaged = fixed or _averaged(task, float(sets[0, task.names.index(TAIL_LAG)]), air.growing)
        with np.errstate(all="ignore"):
            found = innovations(system(model, sets.T[: len(names)], sets.T[count:]), averaged)
            logs = np.sum(np.log(np.diagonal(found.root, axis1=2, axis2=3)), axis=(1, 2))
            costs = (logs + np.sum(found.white**2, axis=(1, 2)) / 2.0) / len(PHASES)
        beyond = (sets[:, count:] - centre) / DOUBT
        costs += np.sum(beyond**2, axis=1) / 2.0
        costs[~np.isfinite(costs) | (np.max(np.abs(beyond), axis=1) > WIDEST)] = np.inf
        return [Likelihood(float(cost), *each) for cost, *each in zip(costs, *found, strict=True)]

    def at(sets: Array) -> list[Likelihood]:
        lags = np.zeros(len(sets)) if task.known_lag else sets[:, task.names.index(TAIL_LAG)]
        told: dict[int, Likelihood] = {}
        which = np.unique(lags, return_inverse=True)[1]
        for places in (np.flatnonzero(which == lag) for lag in range(int(which.max()) + 1)):
            told.update(zip(places.tolist(), together(sets[places]), strict=True))
        return [told[place] for place in range(len(sets))]

    return at


def _averaged(task: Task, lag: float | None, growing: bool) -> Averaged:
    """Every stroke of all stretches, with the tail's angle through it and how hard the wings flap in it.

    Where forces are ``growing`` with the airspeed, with that too.
    """
    aircraft = task.aircraft if lag is None else task.aircraft._replace(tail_time_constant=max(lag, 0.0))
    durations = np.concatenate([np.diff(stretch.edges) for stretch in task.stretches])
    unit = LENGTH_STEP * float(np.mean(durations))
    airspeeds = np.sqrt(1.0 + _pressure_above(task)) if growing else np.ones(len(durations))
    rounded = np.round(np.column_stack((durations / unit, airspeeds / AIRSPEED_STEP)))
    kinds, which = np.unique(rounded, axis=0, return_inverse=True)
    lengths, airspeeds = np.ascontiguousarray(kinds.T * [[unit], [AIRSPEED_STEP]])
    tails, first = [], []
    share = np.arange(STEPS + 1) / STEPS
    for stretch in task.stretches:
        angle = tail_angle(stretch.time, stretch.command, aircraft)
        at = stretch.edges[:-1, None] + np.diff(stretch.edges)[:, None] * share
        tails.append(np.interp(at, stretch.time, angle))
        first.append(np.arange(len(stretch.edges) - 1) == 0)
    outputs = np.vstack([stretch.averages[:, : len(OUTPUTS)] for stretch in task.stretches])
    harder = np.broadcast_to(_harder(task)[:, None], (len(outputs), STEPS + 1))
    tail = np.vstack(tails)
    inputs = np.dstack((tail, harder, tail * _pressure_above(task)[:, None]))
    return Averaged(lengths, airspeeds, which.ravel(), np.concatenate(first), inputs, outputs)


def _pressure_above(task: Task) -> Array:
    """By how much of the reference's the dynamic pressure is above it in each stroke (K,)."""
    airspeed = np.concatenate([stretch.airspeed for stretch in task.stretches])
    return (airspeed / task.reference.airspeed) ** 2 - 1.0


def _harder(task: Task) -> Array:
    """By how much of its mean the mean square of the wings' rate is above it, in each stroke (K,); 0 where
    it was not measured."""
    squared = np.concatenate([stretch.wing_rate_squared for stretch in task.stretches])
    mean = float(np.mean(squared))
    return squared / mean - 1.0 if mean > 0.0 else squared
