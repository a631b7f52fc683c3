"""Filter error: maximum likelihood with the gusts among the states.

Output error takes every motion for the answer to the input. In turbulence the air moves the aircraft as well; a
Kalman filter that knows of gusts foretells each stroke from those before, and the derivatives are those whose
forecasts err least (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 5; Klein & Morelli, Aircraft System
Identification, 2006, ch. 6). A gust along and one across, each of first order, move the air under the linear model
of `longitudinal.py`: ``x' = A x + B delta - A_uw gust``. Their strengths and durations and the errors of the averages
are found with the derivatives; what is known of those before is a wide log-normal prior.

Where derivatives swing with the wing, an average that always begins at one phase of the stroke sees them with the
motion's trend: the damping came out a tenth too high. Every stretch is therefore cut at two opposite phases, which
are wrong against each other, and both count half.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from avionics.constants import STANDARD_GRAVITY
from logs.identification.data import Aircraft
from logs.identification.modes.equation_error import DerivativeFit, failed
from logs.identification.modes.errors import Spread, with_scatter
from logs.identification.modes.gust_filter import Averaged, Driven, innovations
from logs.identification.modes.longitudinal import TAIL_LAG, matrices
from logs.identification.preparing.manoeuvre import Reference, tail_angle
from logs.identification.preparing.stretches import Stretch
from logs.identification.results import Array

OUTPUTS = ("q", "a_x", "a_z")
PHASES = (0.0, 0.5)
"""-; of a stroke, at which the averages of the same flight begin"""
STEPS = 32
"""-; of the tail's angle through a stroke"""
LENGTH_STEP = 5e-3
"""-; of a mean stroke: lengths of strokes that differ by less share a transition"""
BEGIN = (3.0, 3.0, 1.0, 0.5)
"""m/s, m/s, rad/s, rad; standard deviation of the first state about the reference"""
BIASES = (0.3, 3.0, 3.0)
"""rad/s, m/s^2, m/s^2; of q, a_x and a_z, the trim's difference from the reference included"""
LIFT_SLOPE = 4.5
"""1/rad; of lift over weight: that of a wing of aspect ratio 5 at a lift coefficient of 1"""
NUISANCES = (
    "gust along", "gust across", "duration along", "duration across", "smoothing",
    "push along", "push across", "turn", "error of q", "error of a_x", "error of a_z",
)  # fmt: skip
"""strengths (m/s) and durations (s) of the gusts; for how long (s) the span smooths how the one across turns the air;
what else moves the aircraft, as white noise on the rates of u and w (m/s/s^0.5) and of q (rad/s/s^0.5): strokes that
differ, say; standard deviations of the averages"""
GUST, PUSHES, AVERAGES = 0.5, (0.05, 0.05, 0.05), (2e-3, 0.05, 0.05)
"""where the priors of the strengths are centred"""
SCALES = (60.0, 15.0, 1.3)
"""m; of gusts along and across and of the span's smoothing, likewise (MIL-F-8785C 15 m high has 94 and 15 m, a field
low over the ground less along it; 4 b / pi for a span b of 1 m)"""
DOUBT = np.array((1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0))
"""-; standard deviation of the logarithms under the priors"""
WIDEST = 6.0
"""-; of those deviations: nothing further out is tried"""
LONGEST = 1.0
"""-; step of those logarithms: the first steps, far from the optimum, would leap out of sight"""
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
    """At one set of parameters; where the cost is infinite there is nothing else."""

    cost: float
    """-; minus the logarithm of likelihood and prior"""
    errors: Array
    """rad/s, m/s^2, m/s^2; (K, m), of the forecasts"""
    root: Array
    """(K, m, m); Cholesky's of their covariance"""


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
    prior = _prior(task.reference)
    likelihood = _likelihood(task, prior)
    ends = [_climb(task, np.concatenate((each, prior)), likelihood, prior) for each in _starts(task, start)]
    best = min(ends, key=lambda end: end.cost)
    if _degrees(task, likelihood(best.values), len(best.values)) < LEAST_DEGREES:
        return failed(task.names, "the flight holds too few strokes for the model's parameters"), None
    if not np.isfinite(best.cost):
        return failed(task.names, "filter error did not converge"), None
    scores, squared = _scores(task, best.values, likelihood)
    if not _determined(squared):
        return failed(task.names, "the flight does not determine all derivatives"), None
    here = likelihood(best.values)
    averages = np.vstack([stretch.averages[:, : len(OUTPUTS)] for stretch in task.stretches])
    found = Filtered(task.stretches, averages - here.errors)
    return _finish(task, best.values, here, scores, squared), found


class End(NamedTuple):
    """Where a search ended."""

    values: Array
    """(p + 11,)"""
    cost: float
    """-; infinite where it did not converge"""


def _starts(task: Task, start: Array) -> list[Array]:
    """``start`` (p,), and another (p,) that no gust has spoilt: a stable aircraft of this weight at this airspeed.

    Its wing lifts as a wing does, and a short period as fast as its heave is damped by half and more; what the tail
    does is that of ``start``, which tells it best.
    """
    fall = STANDARD_GRAVITY / task.reference.airspeed
    heave = -LIFT_SLOPE * fall
    stable = {
        "X_u": -0.3, "X_w": -0.15 * heave, "X_q": 0.0, "Z_u": -fall, "Z_w": heave, "Z_q": 0.0,
        "M_u": 0.0, "M_w": -(heave**2) / task.reference.airspeed, "M_q": heave,
    }  # fmt: skip
    pairs = zip(task.names, start, strict=True)
    return [start, np.array([stable.get(name, value) for name, value in pairs])]


def _climb(task: Task, values: Array, likelihood: Callable[[Array], Likelihood], prior: Array) -> End:
    """Scoring as long as it gains much, then `_settled`."""
    here, damping = likelihood(values), 1e-3
    for _ in range(ITERATIONS):
        if not np.isfinite(here.cost):
            break
        scores, squared = _scores(task, values, likelihood)
        if not _determined(squared):
            break
        gradient, before = _gradient(scores, values, prior), here.cost
        values, here, damping = _advanced(likelihood, values, here, (gradient, squared), damping)
        if before - here.cost < LITTLE:
            return _settled(task, values, likelihood, prior)
    return End(values, np.inf)


def _settled(task: Task, values: Array, likelihood: Callable[[Array], Likelihood], prior: Array) -> End:
    """The last part of the way by quasi-Newton steps (Broyden, Fletcher, Goldfarb, Shanno) that begin with scoring.

    In calm air the information of the gusts' parameters is not the likelihood's curvature: scoring goes to and fro.
    """
    here = likelihood(values)
    scores, squared = _scores(task, values, likelihood)
    inverse = np.asarray(np.linalg.inv(squared), dtype=np.float64)
    gradient = _gradient(scores, values, prior)
    for _ in range(ITERATIONS):
        if float(gradient @ inverse @ gradient) < CONVERGED:
            return End(values, here.cost)
        step = -inverse @ gradient
        there = likelihood(values + step)
        moved, there = _along(likelihood, values, here, (step, there, float(gradient @ step)))
        if not there.cost < here.cost:
            break
        after = _gradient(_scores(task, moved, likelihood)[0], moved, prior)
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


def _prior(reference: Reference) -> Array:
    """Logarithms (11,) on which the priors of `NUISANCES` are centred."""
    durations = (scale / reference.airspeed for scale in SCALES)
    return np.log([GUST, GUST, *durations, *PUSHES, *AVERAGES])


def _averaged(task: Task, lag: float | None) -> Averaged:
    """Every stroke of all stretches, with the tail's angle through it."""
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
    return Averaged(lengths * unit, which, np.concatenate(first), np.vstack(tails), outputs)


def _system(task: Task, values: Array) -> Driven:
    """The aircraft and its gusts: states u, w, q, theta over ground, gust along, gust across, the latter smoothed.

    Where the gust across changes along the flight the air turns, ``q_g = -dw_g/dx``, as far as the span does not
    smooth it (MIL-F-8785C 3.7.5), and moves the aircraft as its own pitch rate does, less it.
    """
    names, count = tuple(name for name in task.names if name != TAIL_LAG), len(OUTPUTS)
    model = matrices(names, values[: len(names)], task.reference, task.aircraft)
    strengths, durations, (smoothing,), pushes, noise = np.split(np.exp(values[len(task.names) :]), (2, 4, 5, 8))
    a, c = np.zeros((7, 7)), np.hstack((model.c[:count], -model.c[:count, :2], np.zeros((count, 1))))
    a[:4, :4], a[:4, 4:6] = model.a, -model.a[:, :2]
    a[4:6, 4:6] = np.diag(-1.0 / durations)
    a[6, 5:] = 1.0 / smoothing, -1.0 / smoothing
    turned = np.array([1.0, -1.0]) / (smoothing * task.reference.airspeed)
    a[:3, 5:] += np.outer(_by_pitch_rate(names, values), turned)
    c[1:, 5:] += np.outer(model.c[1:count, 2], turned)
    # A push is a force or a moment: the accelerometers feel it where they are.
    felt = np.zeros((7 + count, 3))
    felt[:3], felt[7 + 1, 0], felt[7 + 2, 1] = np.eye(3), 1.0, 1.0
    felt[7 + 1 :, 2] = task.aircraft.imu_z, -task.aircraft.imu_x
    density = (felt * pushes**2) @ felt.T
    density[[4, 5], [4, 5]] = 2.0 * strengths**2 / durations
    start = np.concatenate((BEGIN, strengths, strengths[1:]))
    return Driven(a, model.b, c, model.d[:count], density, start, np.array(BIASES), noise)


def _by_pitch_rate(names: tuple[str, ...], values: Array) -> Array:
    """X_q, Z_q and M_q (3,); 0 for what is not named."""
    given = dict(zip(names, values, strict=False))
    return np.array([given.get(f"{axis}_q", 0.0) for axis in "XZM"])


def _likelihood(task: Task, prior: Array) -> Callable[[Array], Likelihood]:
    """The likelihood of parameters (p + 11,): derivatives, and the logarithms of the nuisances."""
    count = len(task.names)
    fixed = _averaged(task, None) if task.known_lag else None

    def at(values: Array) -> Likelihood:
        beyond = (values[count:] - prior) / DOUBT
        if np.max(np.abs(beyond)) > WIDEST:
            return Likelihood(np.inf, np.empty(0), np.empty(0))
        averaged = fixed or _averaged(task, float(values[task.names.index(TAIL_LAG)]))
        with np.errstate(all="ignore"):
            errors, covariance = innovations(_system(task, values), averaged)
        try:
            root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        except np.linalg.LinAlgError:
            return Likelihood(np.inf, np.empty(0), np.empty(0))
        white = np.linalg.solve(root, errors[:, :, None])[:, :, 0]
        logs = float(np.sum(np.log(np.diagonal(root, axis1=1, axis2=2))))
        cost = (logs + float(np.sum(white**2)) / 2.0) / len(PHASES) + float(np.sum(beyond**2)) / 2.0
        return Likelihood(cost if np.isfinite(cost) else np.inf, errors, root)

    return at


def _scores(task: Task, values: Array, likelihood: Callable[[Array], Likelihood]) -> tuple[Array, Array]:
    """Each stroke's gradient (K, n) of the cost without the prior, and the information (n, n) with it."""
    here = likelihood(values)
    factor = np.linalg.inv(here.root)
    white = np.einsum("kij,kj->ki", factor, here.errors)
    moved, widened = [], []
    for index, value in enumerate(values):
        width = DIFFERENCE * max(abs(value), 0.1)
        ahead = values.copy()
        ahead[index] += width
        there = likelihood(ahead)
        if not np.isfinite(there.cost):
            there = here
        moved.append(np.einsum("kij,kj->ki", factor, (there.errors - here.errors) / width))
        spread = there.root @ there.root.transpose(0, 2, 1) - here.root @ here.root.transpose(0, 2, 1)
        widened.append(factor @ (spread / width) @ factor.transpose(0, 2, 1))
    shift, growth = np.array(moved), np.array(widened)
    trace = np.trace(growth, axis1=2, axis2=3)
    scores = np.einsum("pki,ki->kp", shift, white)
    scores += (trace - np.einsum("ki,pkij,kj->pk", white, growth, white)).T / 2.0
    scores /= len(PHASES)
    flat, grown = shift.reshape(len(values), -1), growth.reshape(len(values), -1)
    squared = (flat @ flat.T + grown @ grown.T / 2.0) / len(PHASES)
    count = len(task.names)
    squared[count:, count:] += np.diag(1.0 / DOUBT**2)
    return scores, squared


def _gradient(scores: Array, values: Array, prior: Array) -> Array:
    gradient: Array = np.sum(scores, axis=0)
    gradient[-len(prior) :] += (values[-len(prior) :] - prior) / DOUBT**2
    return gradient


def _determined(squared: Array) -> bool:
    scale = np.sqrt(np.diag(squared))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(squared / np.outer(scale, scale)) < WORST_CONDITION)


def _advanced(
    likelihood: Callable[[Array], Likelihood],
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
        there = likelihood(values + step)
        if there.cost < here.cost:
            return *_along(likelihood, values, here, (step, there, float(gradient @ step))), max(damping / 8.0, 1e-9)
        damping = max(damping * 4.0, 1e-3)
    return values, here._replace(cost=np.inf), damping


def _along(
    likelihood: Callable[[Array], Likelihood],
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
    another = likelihood(values + share * step)
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
