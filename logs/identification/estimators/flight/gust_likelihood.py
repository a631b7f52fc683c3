"""How likely a flight's strokes are of an aircraft and its gusts, at any set of their parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.flight.gust_ekf_data import PHASES, Task, averaged_strokes
from logs.identification.estimators.flight.gust_filter import innovations
from logs.identification.estimators.flight.gusts import DOUBT, Air, flown, system
from logs.identification.models.stroke_averaged import TAIL_LAG
from logs.identification.results import Array

WIDEST = 6.0
"""-; of a prior's standard deviations: nothing further out is tried"""


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
    followed: Array
    """m/s, m/s, rad/s, rad; (K, 4), motion in each stroke above the reference's, as the filter has it"""


Likelihoods = Callable[[Array], list[Likelihood]]
"""at each of several sets of parameters (s, p + 19)"""


def likelihoods_of(task: Task, centre: Array, air: Air) -> Likelihoods:
    """The likelihood in ``air`` of sets of parameters (s, p + 19): derivatives and `gusts.NUISANCES`.

    The prior of these is about ``centre`` (19,).
    """
    count, names = len(task.names), tuple(name for name in task.names if name != TAIL_LAG)
    model = flown(names, task.reference, task.aircraft, air)
    fixed = averaged_strokes(task, None) if task.known_lag else None

    def together(sets: Array) -> list[Likelihood]:
        """Of sets that have the tail's lag in common."""
        averaged = fixed or averaged_strokes(task, float(sets[0, task.names.index(TAIL_LAG)]))
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
