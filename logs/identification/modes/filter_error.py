"""Filter error: maximum likelihood with the gusts among the states.

Output error takes every motion for the answer to the input. In turbulence the air moves the aircraft as well; a
Kalman filter that knows of gusts foretells each stroke from those before, and the derivatives are those whose
forecasts err least (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 5; Klein & Morelli, Aircraft System
Identification, 2006, ch. 6). The aircraft in its gusts is that of `gusts.py`. How strong and long the gusts are, what
their change does, what harder flapping does and the errors of the averages are found with the derivatives; what is
known of those before is a wide prior.

Where derivatives swing with the wing, an average that always begins at one phase of the stroke sees them with the
motion's trend: the damping came out a tenth too high. Every stretch is therefore cut at two opposite phases, which
are wrong against each other, and both count half.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.data import Aircraft
from logs.identification.modes.equation_error import DerivativeFit, failed
from logs.identification.modes.errors import Spread, with_scatter
from logs.identification.modes.gust_filter import Averaged, innovations
from logs.identification.modes.gusts import BEGIN, DOUBT, LIFT_SLOPE, OUTPUTS, flown, heave, prior, system
from logs.identification.modes.longitudinal import TAIL_LAG
from logs.identification.modes.whitening import gradient_terms, information, whitened, whitened_change
from logs.identification.preparing.manoeuvre import Reference, tail_angle
from logs.identification.preparing.stretches import Stretch
from logs.identification.results import Array

PHASES = (0.0, 0.5)
"""-; of a stroke, at which the averages of the same flight begin"""
STEPS = 32
"""-; of the tail's angle through a stroke"""
LENGTH_STEP = 5e-3
"""-; of a mean stroke: lengths of strokes that differ by less share a transition"""
WIDEST = 6.0
"""-; of those deviations: nothing further out is tried"""
LONGEST = 1.0
"""-; step of those parameters: the first steps, far from the optimum, would leap out of sight"""
DIFFERENCE = 1e-5
ITERATIONS, LITTLE, CONVERGED = 50, 0.5, 1e-2
"""-; gain of the likelihood's logarithm by a step of scoring that others follow, and what one more promises"""
WORST_CONDITION, LEAST_DEGREES = 1e14, 10.0


class Filtered(NamedTuple):
    """What filter error found beside the derivatives."""

    stretches: tuple[Stretch, ...]
    foretold: Array
    """(K, 3); q rad/s, a_x and a_z m/s^2: each stroke's averages as the strokes before foretell them"""


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


def filter_error(task: Task, start: Array) -> tuple[DerivativeFit, Filtered | None]:
    """Derivatives ``task.names`` by scoring with Levenberg's damping, from ``start`` (p,) and from `_starts`'s other.

    Gusts hide in the speeds that equation error integrates: what it finds is a start that may lead to another optimum
    than the likeliest. The likelier end counts.
    Errors are those of the likelihood's information, or of the scatter between manoeuvres where that is larger.
    """
    if not task.stretches:
        return failed(
            task.names, "the strokes are too few or too uneven to follow the gusts from one to the next"
        ), None
    centre = prior(task.reference, task.aircraft)
    likelihoods = _likelihoods(task, centre)
    ends = [_climb(task, np.concatenate((each, centre)), likelihoods, centre) for each in _starts(task, start)]
    best = min(ends, key=lambda end: end.cost)
    here = _at(likelihoods, best.values)
    if _degrees(task, here, len(best.values)) < LEAST_DEGREES:
        return failed(task.names, "the flight holds too few strokes for the model's parameters"), None
    if not np.isfinite(best.cost):
        return failed(task.names, "filter error did not converge"), None
    scores, squared = _scores(task, best.values, likelihoods)
    if not _determined(squared):
        return failed(task.names, "the flight does not determine all derivatives"), None
    averages = np.vstack([stretch.averages[:, : len(OUTPUTS)] for stretch in task.stretches])
    found = Filtered(task.stretches, averages - here.errors)
    return _finish(task, best.values, here, scores, squared), found


def _at(likelihoods: Likelihoods, values: Array) -> Likelihood:
    return likelihoods(values[None])[0]


class End(NamedTuple):
    """Where a search ended."""

    values: Array
    """(p + 18,)"""
    cost: float
    """-; infinite where it did not converge"""


def _starts(task: Task, start: Array) -> list[Array]:
    """``start`` (p,), and another (p,) that no gust has spoilt: a stable aircraft of this weight at this airspeed.

    Its wing lifts as a wing does, and a short period as fast as its heave is damped by half and more; what the tail
    does is that of ``start``, which tells it best.
    """
    damped = heave(task.reference)
    stable = {
        "X_u": -0.3, "X_w": 0.15 * damped, "X_q": 0.0, "Z_u": -damped / LIFT_SLOPE, "Z_w": -damped, "Z_q": 0.0,
        "M_u": 0.0, "M_w": -(damped**2) / task.reference.airspeed, "M_q": -damped,
    }  # fmt: skip
    pairs = zip(task.names, start, strict=True)
    return [start, np.array([stable.get(name, value) for name, value in pairs])]


def _climb(task: Task, values: Array, likelihoods: Likelihoods, centre: Array) -> End:
    """Scoring as long as it gains much, then `_settled`."""
    here, damping = _at(likelihoods, values), 1e-3
    for _ in range(ITERATIONS):
        if not np.isfinite(here.cost):
            break
        scores, squared = _scores(task, values, likelihoods)
        if not _determined(squared):
            break
        gradient, before = _gradient(scores, values, centre), here.cost
        values, here, damping = _advanced(likelihoods, values, here, (gradient, squared), damping)
        if before - here.cost < LITTLE:
            return _settled(task, values, likelihoods, centre)
    return End(values, np.inf)


def _settled(task: Task, values: Array, likelihoods: Likelihoods, centre: Array) -> End:
    """The last part of the way by quasi-Newton steps (Broyden, Fletcher, Goldfarb, Shanno) that begin with scoring.

    In calm air the information of the gusts' parameters is not the likelihood's curvature: scoring goes to and fro.
    """
    here = _at(likelihoods, values)
    scores, squared = _scores(task, values, likelihoods)
    inverse = np.asarray(np.linalg.inv(squared), dtype=np.float64)
    gradient = _gradient(scores, values, centre)
    for _ in range(ITERATIONS):
        if float(gradient @ inverse @ gradient) < CONVERGED:
            return End(values, here.cost)
        step = -inverse @ gradient
        there = _at(likelihoods, values + step)
        moved, there = _along(likelihoods, values, here, (step, there, float(gradient @ step)))
        if not there.cost < here.cost:
            break
        after = _gradient(_scores(task, moved, likelihoods)[0], moved, centre)
        inverse = _updated(inverse, moved - values, after - gradient)
        values, here, gradient = moved, there, after
    return End(values, np.inf)


def _updated(inverse: Array, step: Array, change: Array) -> Array:
    """The inverse curvature (n, n) that also tells the ``change`` (n,) of the gradient over a ``step`` (n,)."""
    along = float(step @ change)
    if along <= 0.0:
        return inverse
    turn = np.eye(len(step)) - np.outer(step, change) / along
    new: Array = turn @ inverse @ turn.T + np.outer(step, step) / along
    return new


def _averaged(task: Task, lag: float | None) -> Averaged:
    """Every stroke of all stretches, with the tail's angle through it and how hard the wings flap in it."""
    aircraft = task.aircraft if lag is None else task.aircraft._replace(tail_time_constant=max(lag, 0.0))
    durations = np.concatenate([np.diff(stretch.edges) for stretch in task.stretches])
    unit = LENGTH_STEP * float(np.mean(durations))
    lengths, which = np.unique(np.round(durations / unit), return_inverse=True)
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
    inputs = np.dstack((tail, harder, tail * _faster(task)[:, None]))
    return Averaged(lengths * unit, which, np.concatenate(first), inputs, outputs)


def _faster(task: Task) -> Array:
    """By how much of the reference's the dynamic pressure is above it in each stroke (K,)."""
    airspeed = np.concatenate([stretch.airspeed for stretch in task.stretches])
    return (airspeed / task.reference.airspeed) ** 2 - 1.0


def _harder(task: Task) -> Array:
    """By how much of its mean the mean square of the wings' rate is above it, in each stroke (K,); 0 where
    it was not measured."""
    squared = np.concatenate([stretch.wing_rate_squared for stretch in task.stretches])
    mean = float(np.mean(squared))
    return squared / mean - 1.0 if mean > 0.0 else squared


def _likelihoods(task: Task, centre: Array) -> Likelihoods:
    """The likelihood of sets of parameters (s, p + 18): derivatives and `gusts.NUISANCES`."""
    count, names = len(task.names), tuple(name for name in task.names if name != TAIL_LAG)
    model = flown(names, task.reference, task.aircraft)
    fixed = _averaged(task, None) if task.known_lag else None

    def together(sets: Array) -> list[Likelihood]:
        """Of sets that have the tail's lag in common."""
        averaged = fixed or _averaged(task, float(sets[0, task.names.index(TAIL_LAG)]))
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


def _scores(task: Task, values: Array, likelihoods: Likelihoods) -> tuple[Array, Array]:
    """Each stroke's gradient (K, n) of the cost without the prior, and the information (n, n) with it."""
    widths = DIFFERENCE * np.maximum(np.abs(values), 0.1)
    here, *ahead = likelihoods(np.vstack((values, values + np.diag(widths))))
    strokes, m = here.errors.shape
    shift, growth = np.empty((len(values), strokes, m)), np.empty((len(values), strokes, m, m))
    scores, squared = np.empty((len(values), strokes)), np.empty((len(values), len(values)))
    for index, (width, there) in enumerate(zip(widths, ahead, strict=True)):
        known = there if np.isfinite(there.cost) else here
        whitened(here.root, (known.errors - here.errors) / width, shift[index])
        whitened_change(here.root, known.root, width, growth[index])
        gradient_terms(shift[index], growth[index], here.white, scores[index])
    information(shift, growth, squared)
    count = len(task.names)
    squared /= len(PHASES)
    squared[count:, count:] += np.diag(1.0 / DOUBT**2)
    return scores.T / len(PHASES), squared


def _gradient(scores: Array, values: Array, centre: Array) -> Array:
    gradient: Array = np.sum(scores, axis=0)
    gradient[-len(centre) :] += (values[-len(centre) :] - centre) / DOUBT**2
    return gradient


def _determined(squared: Array) -> bool:
    scale = np.sqrt(np.diag(squared))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(squared / np.outer(scale, scale)) < WORST_CONDITION)


def _advanced(
    likelihoods: Likelihoods,
    values: Array,
    here: Likelihood,
    slope: tuple[Array, Array],
    damping: float,
) -> tuple[Array, Likelihood, float]:
    """A damped step that lowers the cost, and the damping for the next; an infinite cost where none does."""
    gradient, squared = slope
    scale = np.sqrt(np.diag(squared))
    even = squared / np.outer(scale, scale)
    while damping < 1e8:
        step = -np.linalg.solve(even + damping * np.eye(len(scale)), gradient / scale) / scale
        step = step * min(1.0, LONGEST / float(np.max(np.abs(step[-len(DOUBT) :]))))
        there = _at(likelihoods, values + step)
        if there.cost < here.cost:
            return *_along(likelihoods, values, here, (step, there, float(gradient @ step))), max(damping / 8.0, 1e-9)
        damping = max(damping * 4.0, 1e-3)
    return values, here._replace(cost=np.inf), damping


def _along(
    likelihoods: Likelihoods,
    values: Array,
    here: Likelihood,
    tried: tuple[Array, Likelihood, float],
) -> tuple[Array, Likelihood]:
    """The step as it was ``tried``, or to the least of a parabola through both ends where that is lower.

    The information is not the curvature: where it is half of it, every step ends as far behind the optimum as it
    began before it.
    """
    step, there, slope = tried
    bend = there.cost - here.cost - slope if np.isfinite(there.cost) else np.inf
    share = float(np.clip(-slope / (2.0 * bend), 0.1, 3.0)) if bend > 0 else 3.0
    another = _at(likelihoods, values + share * step)
    return (values + share * step, another) if another.cost < there.cost else (values + step, there)


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
