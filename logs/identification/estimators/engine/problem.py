"""Maximum-likelihood problem: model, maneuvers, free parameters, priors, and weights of the outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple, Protocol

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.findings import Finding, of_severity
from logs.identification.results import Array, Estimate
from wingbeat.errors import InputError

Status = Literal["converged", "not converged", "diverged", "not identifiable"]
Weighting = Literal["diagonal", "full", "given"]


class Named(NamedTuple):
    """A quantity of a model: its unit, and its value where nobody says another."""

    unit: str
    """SI"""
    value: float = 0.0
    """as `unit`; of a parameter that a problem does not name, of an initial state that no output shows"""


class Intersample(NamedTuple):
    """Intersample behavior of the inputs."""

    foh: Array
    """-; (k,), 0 for a zero-order hold, 1 for a first-order hold"""
    shown: Array
    """(N, k); inputs in the outputs at the samples: before a change at that instant"""


class Model(Protocol):
    """A model that can be flown. `models.compiled.CompiledModel` makes one of two compiled functions."""

    @property
    def states(self) -> Mapping[str, Named]:
        """By name, in the order of ``start``."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """SI unit by the name of the experiment's signal, in the order of the columns of ``inputs``."""

    @property
    def outputs(self) -> Mapping[str, str]:
        """SI unit by the name of the experiment's signal, in the order of the columns that `simulate` returns."""

    @property
    def parameters(self) -> Mapping[str, Named]:
        """By name, in the order of ``parameters``."""

    def simulate(
        self,
        parameters: Array,
        start: Array,
        inputs: Array,
        step: float,
        intersample: Intersample | None = None,
        /,
    ) -> Array:
        """Outputs (N, m) from the state ``start`` (n,), driven by ``inputs`` (N, k) every ``step`` s.

        Inputs are linear between samples, except those under ``intersample``. A simulation that overflows gives
        values that are not finite from there on.
        """


class Feedback(NamedTuple):
    """Measured outputs that correct the states of a model while it is simulated."""

    gain: Array
    """(n, m); of the state by the innovations, at each sample"""
    measured: Array
    """(N, m); NaN where not measured: the innovation is zero there"""
    outputs: tuple[int, ...]
    """-; (m,), of the model, that are measured"""


class Predictor(Protocol):
    """A model that predicts each sample from the inputs and from the outputs measured before it.

    A `Model` without ``predict`` is simulated: output error. One with it is predicted: filter error.
    """

    def predict(self, parameters: Array, start: Array, inputs: Array, measured: Array, step: float) -> Array:
        """Outputs (N, m) of the fitted ones, whose measurements are ``measured`` (N, m), NaN where there are none."""


class Prior(NamedTuple):
    """Gaussian prior of one parameter."""

    mean: float
    """as the parameter"""
    deviation: float
    """as the parameter; standard deviation"""


class Parameter(NamedTuple):
    """One parameter of the model in a problem."""

    start: float
    """as the model's unit; where the search begins, or the value where it is not free"""
    free: bool = True
    """-; fitted, or fixed at `start`"""
    low: float = -math.inf
    """as the model's unit; least value allowed"""
    high: float = math.inf
    """as the model's unit; greatest value allowed"""
    local: bool = False
    """-; every maneuver has its value (a trim moment, say), which is then a nuisance like a bias"""
    prior: Prior | None = None
    """of a free parameter that all maneuvers share; None for none"""


class Nuisances(NamedTuple):
    """Nuisance parameters of every maneuver: fitted with the parameters, whose errors contain theirs."""

    initial_states: tuple[str, ...] | None = None
    """-; states whose initial values are free; None: all"""
    output_biases: tuple[str, ...] = ()
    """-; outputs with a constant bias (measured is model plus bias)"""
    input_biases: tuple[str, ...] = ()
    """-; inputs with a constant bias (measured plus bias is what acts)"""


class Problem(NamedTuple):
    """What is fitted to what."""

    model: Model
    experiments: tuple[Experiment, ...]
    """each cut to its window (`window`), at any rate; signals named as the model's inputs and outputs"""
    parameters: Mapping[str, Parameter]
    """by the model's names; those not named stay at the model's value"""
    outputs: tuple[str, ...]
    """-; outputs of the model that are fitted"""
    nuisances: Nuisances = Nuisances()
    initial: tuple[Mapping[str, float], ...] = ()
    """initial states of each experiment, by name; those not named begin at the first samples of the output of
    the same name, else at the model's value"""
    weighting: Weighting = "diagonal"
    """-; the outputs' noise: variances estimated, covariance matrix estimated, or `deviations` given"""
    deviations: Mapping[str, float] = {}
    """as the outputs' units; standard deviation of each output's noise where the weighting is given"""


class RecordParameters(NamedTuple):
    """What one experiment has of its own, as fitted."""

    name: str
    """-; of the experiment"""
    parameters: Mapping[str, float]
    """by name; the parameters that the model flew this experiment with"""
    initial: Mapping[str, float]
    """by the state's name"""
    output_biases: Mapping[str, float]
    """by the output's name; 0 where not free"""
    input_biases: Mapping[str, float]
    """by the input's name; 0 where not free"""


class History(NamedTuple):
    """One experiment as measured and as the fitted model flies it."""

    name: str
    """-; of the experiment"""
    time: Array
    """s; (N,)"""
    measured: Array
    """(N, m); NaN where not measured"""
    model: Array
    """(N, m); biases included"""


class Iteration(NamedTuple):
    """One step of the search."""

    cost: float
    """-; negative logarithm of the likelihood, without its constant"""
    step: float
    """-; the largest change of a parameter, in standard errors of white residuals"""


class Fit(NamedTuple):
    """Result of a search. If `failure` is not empty there is no number that may be used."""

    status: Status
    failure: str
    """-; one clause that says why nothing may be used, empty where it may"""
    estimates: tuple[Estimate, ...]
    """the free parameters that the data gives"""
    names: tuple[str, ...]
    """-; (p,) of the free parameters, in the order of `values`"""
    values: Array
    """(p,); NaN after a failure. Where a parameter is unidentified, the number that the search ended at"""
    covariance: Array
    """(p, p); corrected for colored residuals, zero in the rows of unidentified parameters"""
    degrees: float
    """-; effective degrees of freedom, the least of the identified parameters'"""
    noise: Array
    """(m, m); covariance of the outputs' residuals"""
    cost: float
    """-; negative logarithm of the likelihood, without its constant"""
    iterations: tuple[Iteration, ...]
    records: tuple[RecordParameters, ...]
    """per experiment; empty after a failure"""
    histories: tuple[History, ...]
    """per experiment; empty after a failure"""
    outputs: tuple[str, ...]
    """-; (m,)"""
    findings: tuple[Finding, ...] = ()
    """parameters without an estimate, and warnings; of a failure its reason"""

    @property
    def withheld(self) -> tuple[Finding, ...]:
        """Free parameters (subject) without an estimate."""
        return tuple(one for one in of_severity(self.findings, "withheld") if one.subject)


def window(experiment: Experiment, start: float, end: float) -> Experiment:
    """The part of ``experiment`` from ``start`` to ``end`` s, both included.

    Raises:
        InputError: fewer than two samples lie in it.
    """
    slack = 1e-6 * experiment.step
    inside = (experiment.time >= start - slack) & (experiment.time <= end + slack)
    if inside.sum() < 2:
        raise InputError(f"{experiment.name}: fewer than two samples between {start:g} and {end:g} s")
    signals = {name: np.asarray(values)[inside] for name, values in experiment.signals.items()}
    return experiment._replace(time=experiment.time[inside], signals=signals)
