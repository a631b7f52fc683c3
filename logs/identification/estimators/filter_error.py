"""Filter error: maximum likelihood of the innovations of a steady-state Kalman filter, for linear models.

``x' = A x + B u + F w`` with white noise w of unit density; the strengths on the diagonal of F are parameters. The
gain is that of the discrete Riccati equation. Between searches the measurement noise is scaled until the innovations
have the variances that the filter expects (relaxation: Jategaonkar, Flight Vehicle System Identification, 2006,
ch. 5; Klein & Morelli, Aircraft System Identification, 2006, ch. 6). Output error is the case without process noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import (
    Feedback,
    Fit,
    Intersample,
    Model,
    Named,
    Parameter,
    Problem,
)
from logs.identification.estimators.output_error import (
    DEFAULT_SEARCH,
    Search,
    output_error,
    problem_of,
    result_of,
)
from logs.identification.estimators.registry import Request
from logs.identification.models.actuators import Actuated
from logs.identification.models.linear import LinearModel, exponential
from logs.identification.results import Array, EstimationResult
from wingbeat.errors import InputError

PREFIX = "process_noise_"
"""of the parameters of the strengths: ``process_noise_<state>``"""
RELAXATIONS = 4
"""-; searches, each with the measurement noise of the one before"""
SETTLED = 0.5
"""-; change of the logarithm of the likelihood that ends the relaxation"""
FILTER_STEPS = 50
"""-; at most, of Gauss-Newton in one search"""
START_SHARES = 0.3, 2.0
"""-; of the residuals of output error, or of the motion without it: standard deviation that the process noise adds to
an output at the start"""
MEMORY = 10.0
"""-; samples over which process noise is collected, at the start"""
WIDEST = 30.0
"""-; bounds of a strength over its start and under it"""
SECOND_DIFFERENCE = 6.0
"""-; variance of the second difference of white noise over that of the noise"""
LEAST_NOISE = 1e-4
"""-; of the residuals' variance that is measurement noise"""
DOUBLINGS = 40
EPSILON = 1e-12


NOT_LINEAR = "filter error needs a linear model"


def _linear(model: Model) -> LinearModel | Actuated:
    """Check the type of a model.

    Raises:
        InputError: neither linear nor behind actuators.
    """
    if not isinstance(model, LinearModel | Actuated):
        raise InputError(NOT_LINEAR)
    return model


class FilterModel(NamedTuple):
    """A linear model with process noise, as a `problem.Predictor`."""

    model: LinearModel | Actuated
    noisy: tuple[str, ...]
    """-; states with process noise"""
    fitted: tuple[str, ...]
    """-; (m,), outputs that are measured"""
    noise: Array
    """(m, m); covariance of the measurement noise that the gain is computed with"""
    every: int = 1
    """-; samples from one measurement to the next"""
    averaged: bool = False
    """-; each measurement is the mean over the time from one to the next"""

    @property
    def linear(self) -> LinearModel:
        """The model without its actuators."""
        inner = self.model.model if isinstance(self.model, Actuated) else self.model
        if not isinstance(inner, LinearModel):
            raise InputError(NOT_LINEAR)
        return inner

    @property
    def states(self) -> Mapping[str, Named]:
        """Those of the model."""
        return self.model.states

    @property
    def inputs(self) -> Mapping[str, str]:
        """Those of the model."""
        return self.model.inputs

    @property
    def outputs(self) -> Mapping[str, str]:
        """Those of the model."""
        return self.model.outputs

    @property
    def parameters(self) -> Mapping[str, Named]:
        """Those of the model, then the strength of the process noise of each noisy state."""
        strengths = {PREFIX + name: Named(f"({self.states[name].unit})/s^0.5") for name in self.noisy}
        return dict(self.model.parameters) | strengths

    def simulate(
        self, parameters: Array, start: Array, inputs: Array, step: float, intersample: Intersample | None = None
    ) -> Array:
        """Outputs (N, m) without the filter."""
        return self.model.simulate(parameters[: len(self.model.parameters)], start, inputs, step, intersample)

    def predict(self, parameters: Array, start: Array, inputs: Array, measured: Array, step: float) -> Array:
        """Outputs (N, m) of ``fitted``, each predicted from the samples before."""
        count = len(self.model.parameters)
        chosen = tuple(list(self.outputs).index(name) for name in self.fitted)
        gain = self.gain(parameters, step)
        if not np.all(np.isfinite(gain)):
            return np.full(measured.shape, np.nan)
        feedback = Feedback(gain, measured, chosen)
        outputs: Array = self.model.simulate(parameters[:count], start, inputs, step, None, feedback)[:, chosen]
        return outputs

    def excess(self, parameters: Array, innovations: Array, step: float) -> Array:
        """Variances of ``innovations`` (m, m) over those that the filter expects, (m,)."""
        expected = self._filter(parameters, step)[1]
        return np.asarray(np.diag(innovations) / np.diag(expected))

    def gain(self, parameters: Array, step: float) -> Array:
        """Steady-state gain (n, m) of the innovations at samples ``step`` s apart; NaN where there is none."""
        return self._filter(parameters, step)[0]

    def _filter(self, parameters: Array, step: float) -> tuple[Array, Array]:
        """Gain (n, m), and covariance (m, m) of the innovations."""
        a, c, density = self._system(parameters)
        if not np.all(np.isfinite(a)) or not np.all(np.isfinite(density)):
            return np.full(c.T.shape, np.nan), np.full((len(c), len(c)), np.nan)
        arrays = (one.tobytes() for one in (a, c, density, self.noise))
        with np.errstate(over="ignore", invalid="ignore"):  # of a search far from the data: the gain is not finite
            return _cached(*arrays, step * self.every, self.averaged, c.shape)

    def _system(self, parameters: Array) -> tuple[Array, Array, Array]:
        """A (n, n), C (m, n) of the fitted outputs, and the density (n, n) of the process noise."""
        count, linear = len(self.model.parameters), self.linear
        matrices = linear.matrices(parameters[: len(linear.parameters)])
        density = np.zeros(len(linear.states))
        density[[list(linear.states).index(name) for name in self.noisy]] = parameters[count:] ** 2
        c = matrices.c[[list(self.outputs).index(name) for name in self.fitted]]
        return np.ascontiguousarray(matrices.a), c, np.diag(density)


@lru_cache(maxsize=256)
def _cached(
    a: bytes, c: bytes, density: bytes, noise: bytes, step: float, averaged: bool, size: tuple[int, int]
) -> tuple[Array, Array]:
    """`steady_gain` of arrays as bytes; one set of parameters serves all records."""
    m, n = size
    shaped = (np.frombuffer(a).reshape(n, n), np.frombuffer(c).reshape(m, n), np.frombuffer(density).reshape(n, n))
    return steady_gain(*shaped, np.frombuffer(noise).reshape(m, m), step, averaged)


def steady_gain(
    a: Array, c: Array, density: Array, noise: Array, step: float, averaged: bool = False
) -> tuple[Array, Array]:
    """Gain (n, m) of the measurement update of a steady-state Kalman filter, and the innovations' covariance (m, m).

    Args:
        a: (n, n); 1/s, of ``x' = A x``.
        c: (m, n); of the outputs.
        density: (n, n); spectral density of the process noise.
        noise: (m, m); covariance of the measurement noise.
        step: s; between samples.
        averaged: the outputs, and so the states, are means over the step. Their mean depends on the process noise
            within it: prediction with correlated noises (Jazwinski, Stochastic Processes and Filtering Theory, 1970,
            example 7.5).
    """
    n = len(a)
    if not averaged:
        transition, covariance = discrete_noise(a, density, step)
        p = riccati(transition, c, covariance, noise)
        innovations: Array = c @ p @ c.T + noise
        return _solved(innovations, c @ p), innovations
    wide, driven = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    wide[:n, :n], wide[n:, :n], driven[:n, :n] = a, np.eye(n) / step, density
    both, covariance = discrete_noise(wide, driven, step)
    transition, mean = both[:n, :n], both[n:, :n]
    mean_c, cross = c @ mean, covariance[:n, n:] @ c.T
    total = noise + c @ covariance[n:, n:] @ c.T
    weights = _solved(total, cross.T)
    p = riccati(transition - weights @ mean_c, mean_c, covariance[:n, :n] - weights @ cross.T, total)
    innovations = mean_c @ p @ mean_c.T + total
    gain = _solved(innovations, mean_c @ p @ transition.T + cross.T)
    return _solved(transition, mean @ gain).T if np.all(np.isfinite(gain)) else gain, innovations


def _solved(matrix: Array, right: Array) -> Array:
    """``right``^T ``matrix``^-T; NaN if it is not finite or singular."""
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
        return np.full(right.T.shape, np.nan)
    try:
        return np.asarray(np.linalg.solve(matrix, right).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(right.T.shape, np.nan)


def discrete_noise(a: Array, density: Array, step: float) -> tuple[Array, Array]:
    """Transition (n, n) over one ``step`` and covariance (n, n) of what the process noise adds in it.

    Van Loan, Computing Integrals Involving the Matrix Exponential, IEEE Trans. Automatic Control 23(3), 1978.
    """
    n = len(a)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -a * step, density * step, a.T * step
    exact = exponential(block)
    transition = exact[n:, n:].T
    covariance: Array = transition @ exact[:n, n:]
    return transition, (covariance + covariance.T) / 2


def riccati(transition: Array, c: Array, covariance: Array, noise: Array) -> Array:
    """Covariance (n, n) of the predicted state: the discrete algebraic Riccati equation by doubling.

    Anderson, Second-order convergent algorithms for the steady-state Riccati equation, Int. J. Control 28(2), 1978.
    NaN where it has no stabilizing solution.
    """
    a: Array = transition.T
    g: Array = _solved(noise, c) @ c
    h: Array = covariance
    eye = np.eye(len(a))
    for _ in range(DOUBLINGS):
        try:
            inverse = np.linalg.inv(eye + g @ h)
        except np.linalg.LinAlgError:
            return np.full_like(h, np.nan)
        more = a.T @ h @ inverse @ a
        a, g, h = a @ inverse @ a, g + a @ inverse @ g @ a.T, h + more
        if not np.all(np.isfinite(h)):
            return np.full_like(h, np.nan)
        if np.max(np.abs(more)) <= EPSILON * max(float(np.max(np.abs(h))), 1e-300):
            break
    return h


class Filtered(NamedTuple):
    """A filter-error fit and the problem whose model predicts with the filter that it ended with."""

    problem: Problem
    fit: Fit
    every: int
    """-; samples from one measurement to the next"""


def filter_error(problem: Problem, noisy: tuple[str, ...] | None = None, search: Search = DEFAULT_SEARCH) -> Fit:
    """The fit of `filter_error_search`."""
    return filter_error_search(problem, noisy, search).fit


def filter_error_search(
    problem: Problem,
    noisy: tuple[str, ...] | None = None,
    search: Search = DEFAULT_SEARCH,
    every: int = 1,
    averaged: bool = False,
    before: Fit | None = None,
    start_here: bool = False,
) -> Filtered:
    """The free parameters of ``problem``, whose model is linear, by filter error.

    Of outputs with correlated noise, such as moving averages, the filter uses one sample of ``every`` so many; they
    are ``averaged`` if the moving average is as long as that. ``before`` is output error's fit if there is one: the
    filter starts from it and its residuals, or from the problem's values with ``start_here``. ``noisy`` are the
    states with process noise; None for all but angles that are integrals of rates (theta, phi).

    Raises:
        InputError: as `output_error`, or the model is not linear.
    """
    noisy = default_noisy(problem) if noisy is None else noisy
    unknown = [name for name in noisy if name not in problem.model.states]
    if unknown:
        raise InputError(f"the model has no state {unknown[0]} (it has {', '.join(problem.model.states)})")
    if before is None and not start_here:
        before = output_error(problem, search)
    start, noise = _start(problem, before, noisy, every)
    thin = problem._replace(experiments=tuple(_thinned(one, problem.outputs, every) for one in problem.experiments))
    search, best = search._replace(starts=1, steps=FILTER_STEPS, fallback=False), None
    step = min(one.step for one in problem.experiments)
    for _ in range(RELAXATIONS):
        model = FilterModel(_linear(problem.model), noisy, problem.outputs, noise, every, averaged)
        filtered = thin._replace(model=model, parameters=start)
        fit = output_error(filtered, search)
        if best is not None and (fit.failure or fit.cost >= best.fit.cost):
            break
        improved = best is None or best.fit.cost - fit.cost > SETTLED
        best = Filtered(filtered, fit, every)
        if fit.failure or not improved:
            break
        excess = model.excess(vector_of(model, fit), fit.noise, step)
        if not np.all(np.isfinite(excess)):
            break
        noise = noise * excess[:, None]
        values = dict(zip(fit.names, fit.values.tolist(), strict=True))
        scale = float(np.exp(np.mean(np.log(excess)) / 2))
        values |= {PREFIX + name: values[PREFIX + name] * scale for name in noisy}
        start = {name: _at(one, values.get(name, one.start)) for name, one in start.items()}
    assert best is not None
    return best


def _thinned(experiment: Experiment, outputs: tuple[str, ...], every: int) -> Experiment:
    """The experiment with its ``outputs`` at one sample of ``every`` so many."""
    if every == 1:
        return experiment
    left_out = np.arange(len(experiment.time)) % every != 0
    thin = {name: np.where(left_out, np.nan, experiment.signals[name]) for name in outputs}
    return experiment._replace(signals={**experiment.signals, **thin})


def _at(parameter: Parameter, start: float) -> Parameter:
    return parameter._replace(start=min(max(start, parameter.low), parameter.high))


def default_noisy(problem: Problem) -> tuple[str, ...]:
    """States that forces and moments drive."""
    return tuple(name for name in problem.model.states if name not in ("theta", "phi"))


def vector_of(model: FilterModel, fit: Fit) -> Array:
    """All parameters of the ``model`` as a fit without local parameters has them."""
    shared = fit.records[0].parameters
    return np.array([shared[name] for name in model.parameters])


def _start(
    problem: Problem, before: Fit | None, noisy: tuple[str, ...], every: int
) -> tuple[dict[str, Parameter], Array]:
    """Parameters with the strengths of the process noise, and the first covariance (m, m) of the measurement noise.

    The measurement noise is that of the second differences of output error's residuals, which contain little of the
    motion. The strengths start where they account for `START_SHARES` of the residuals.
    """
    usable = before if before is not None and not before.failure else None
    values = dict(zip(usable.names, usable.values.tolist(), strict=True)) if usable else {}
    parameters = {name: _at(one, values.get(name, one.start)) for name, one in problem.parameters.items()}
    residuals = [one.measured - one.model for one in usable.histories] if usable else _about_mean(problem)
    differences = np.vstack([np.diff(one[::every], 2, axis=0) for one in residuals])
    variances = np.nanmean(np.vstack(residuals) ** 2, axis=0)
    noise = np.clip(np.nanmean(differences**2, axis=0) / SECOND_DIFFERENCE, LEAST_NOISE * variances, variances)
    first = FilterModel(_linear(problem.model), noisy, problem.outputs, np.diag(noise))
    table = [parameters[n].start if n in parameters else p.value for n, p in problem.model.parameters.items()]
    matrices = first.linear.matrices(np.array(table)[: len(first.linear.parameters)])
    rows = np.abs(matrices.c[[list(first.outputs).index(name) for name in problem.outputs]])
    memory = MEMORY * every * min(one.step for one in problem.experiments)
    for name in noisy:
        column = rows[:, list(first.linear.states).index(name)]
        reach = np.min(np.where(column > 0, np.sqrt(variances) / np.maximum(column, 1e-300), np.inf))
        strength = START_SHARES[usable is None] * (float(reach) if np.isfinite(reach) else 1.0) / np.sqrt(memory)
        parameters[PREFIX + name] = Parameter(strength, low=strength / WIDEST, high=strength * WIDEST)
    return parameters, np.diag(noise)


def _about_mean(problem: Problem) -> list[Array]:
    columns = [np.column_stack([one.signals[name] for name in problem.outputs]) for one in problem.experiments]
    return [one - np.nanmean(one, axis=0) for one in columns]


def estimate_by_filter_error(request: Request) -> EstimationResult:
    """Filter error of a request; option ``noisy``: states with process noise. Their strengths are `derived`."""
    end = filter_error_search(problem_of(request), request.options.get("noisy"))
    result = result_of("filter_error", request, end.problem, end.fit)
    kept = [place for place, one in enumerate(result.estimates) if not one.name.startswith(PREFIX)]
    return result._replace(
        estimates=tuple(result.estimates[place] for place in kept),
        covariance=None if result.covariance is None else result.covariance[np.ix_(kept, kept)],
        derived=tuple(one for one in result.estimates if one.name.startswith(PREFIX)),
        findings=tuple(one for one in result.findings if not one.subject.startswith(PREFIX)),
    )
