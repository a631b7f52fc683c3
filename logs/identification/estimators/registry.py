"""The estimators by name, for the documentation, the contract test and programs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple, Protocol

from logs.identification.data.experiment import Experiment
from logs.identification.results import EstimationResult


class Request(NamedTuple):
    """What an estimator works on; it reads what it needs and ignores the rest."""

    experiments: tuple[Experiment, ...]
    """to be fitted"""
    held_out: tuple[Experiment, ...] = ()
    """to be predicted only"""
    inputs: tuple[str, ...] = ()
    """-; signals that drive the motion"""
    outputs: tuple[str, ...] = ()
    """-; signals to be explained; of a regression the response"""
    regressors: tuple[str, ...] = ()
    """-; terms of a regression, such as ``alpha`` or ``q*c/2V``"""
    model: Any = None
    """`models` protocol; None for a regression or a method without a model"""
    parameters: Mapping[str, Any] = {}
    """start, bounds, prior or fixed value by parameter of the model"""
    constants: Mapping[str, float] = {}
    """SI; of the vehicle, by name"""
    options: Mapping[str, Any] = {}
    """settings of the method by name; see its row"""


class Estimate(Protocol):
    """The function of a row."""

    def __call__(self, request: Request) -> EstimationResult:
        """Estimate.

        Raises:
            InputError: the request does not make sense for this method.
        """


class Estimator(NamedTuple):
    """One row of the registry."""

    name: str
    """-; key"""
    title: str
    """-; textbook name"""
    reference: str
    """-; textbook or paper, with chapter or equation"""
    estimate: Estimate
    selection: str = ""
    """-; subject of the command, or keys of a map, that select it; empty: programs only"""
    options: Mapping[str, str] = {}
    """-; meaning of each of `Request.options` by name"""


ESTIMATORS: dict[str, Estimator] = {}
"""by name, of the modules imported so far; `estimators` has all"""
MODULES = (
    "equation_error", "stepwise", "model_structure", "recursive", "output_error", "filter_error", "nonparametric",
    "flight_path", "gps_aided",
)  # fmt: skip
"""modules of this package with rows"""


def estimators() -> Mapping[str, Estimator]:
    """Import all modules with rows and return the registry."""
    for name in MODULES:
        import_module(f"logs.identification.estimators.{name}")
    return ESTIMATORS
