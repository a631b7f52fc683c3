"""The estimators by key, for maps, the command, the documentation, the contract test and programs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from operator import attrgetter
from typing import Any, NamedTuple

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


class Estimator(NamedTuple):
    """One row of the registry."""

    title: str
    """-; textbook name"""
    reference: str
    """-; textbook or paper, with chapter or equation"""
    function: str
    """-; ``module:function`` of this package (or ``package.module:function``), from a `Request` to the result"""
    sections: tuple[str, ...] = ()
    """-; sections of a map whose ``method`` is the key: modes (also ``--method`` of the command), aero.regressions,
    aero.output_error"""
    selection: str = ""
    """-; other subjects of the command, or keys of a map, that select it; empty: none"""
    options: Mapping[str, str] = {}
    """-; meaning of each of `Request.options` by name"""

    def estimate(self, request: Request) -> EstimationResult:
        """Estimate.

        Raises:
            InputError: the request does not make sense for this method.
        """
        module, _, name = self.function.partition(":")
        result: EstimationResult = attrgetter(name)(import_module(module if "." in module else f"{HERE}.{module}"))(
            request
        )
        return result


HERE = __name__.rpartition(".")[0]
REGRESSION = {
    "intercept": "common, each (maneuver) or none", "trend": "order of each maneuver's polynomial in time",
    "frequencies": "Hz, of the transform", "covariance": "of the residuals: autocorrelated or white",
    "units": "SI unit by the constant's name",
}  # fmt: skip
LIKELIHOOD = {
    "nuisances": "initial states and biases of each maneuver: `Nuisances`", "initial": "initial states by maneuver",
    "weighting": "of the outputs: diagonal, full or given", "deviations": "of the outputs' noise if given",
}  # fmt: skip
KINDS = {"kinds": "short_period, phugoid"}
MODES, REGRESSIONS, OUTPUT_ERROR = "modes", "aero.regressions", "aero.output_error"
ESTIMATORS: dict[str, Estimator] = {
    "equation_error_time": Estimator(
        "Equation error, time domain", "Klein & Morelli 2006, ch. 5; Grauer Eq. 17 to 19",
        "equation_error:in_time_domain", (REGRESSIONS,), "", REGRESSION,
    ),
    "equation_error_frequency": Estimator(
        "Equation error, frequency domain", "Klein & Morelli 2006, ch. 7; Grauer Eq. 20, 21",
        "equation_error:in_frequency_domain", (REGRESSIONS,), "modes", REGRESSION,
    ),
    "stepwise": Estimator(
        "Stepwise regression", "Klein & Morelli 2006, ch. 5.4; Grauer V.C", "stepwise:estimate_stepwise",
        (REGRESSIONS,), "aero of a flight",
        {
            "stop": "rule: F, PSE or PRESS", "significance": "largest p-value of a term",
            "least_gain": "of R^2 by a term", "most_terms": "in the model",
            "always": "terms that are forced into the model",
        },
    ),
    "orthogonal": Estimator(
        "Multivariate orthogonal functions", "Morelli, J. Aircraft 32(2), 1995",
        "model_structure:estimate_orthogonal", (REGRESSIONS,), "", {"most_terms": "orthogonal functions at most"},
    ),
    "recursive_least_squares": Estimator(
        "Recursive least squares", "Klein & Morelli 2006, ch. 8", "recursive:estimate_recursively", (REGRESSIONS,),
        "", {"forgetting": "factor of a sample's weight per later sample, above 0 and at most 1"},
    ),
    "output_error": Estimator(
        "Output error (maximum likelihood)",
        "Klein & Morelli, Aircraft System Identification, 2006, ch. 6; Jategaonkar, 2006, ch. 4",
        "output_error:estimate_by_output_error", (MODES, OUTPUT_ERROR), "",
        LIKELIHOOD | {"search": "start values, simplex, number of starts: `Search`"},
    ),
    "filter_error": Estimator(
        "Filter error (maximum likelihood with process noise)",
        "Jategaonkar, Flight Vehicle System Identification, 2006, ch. 5; Klein & Morelli, 2006, ch. 6",
        "filter_error:estimate_by_filter_error", (MODES, OUTPUT_ERROR), "",
        LIKELIHOOD | {"noisy": "states with process noise"},
    ),
    "equivalent_system": Estimator(
        "Equivalent system", "Morelli, NASA/TM-2000-210117", "equivalent_system:EQUIVALENT_SYSTEM.result", (MODES,),
        "", KINDS,
    ),
    "era": Estimator(
        "Eigensystem realization", "Juang & Pappa, J. Guidance 8(5), 1985", "era:ERA.result", (MODES,), "", KINDS
    ),
    "free_response": Estimator(
        "Free response", "Jategaonkar 2006, ch. 3", "free_response:FREE_RESPONSE.result", (MODES,), "", KINDS
    ),
    "spectrum": Estimator(
        "Spectrum", "Bendat & Piersol 2010, ch. 6 and 9", "spectrum:SPECTRUM.result", (MODES,), "", KINDS
    ),
    "flight_path": Estimator(
        "Flight-path reconstruction (data compatibility check)", "Klein & Morelli 2006, ch. 10",
        "flight_path:estimate_flight_path", (), "[path]; path of a flight without velocities of the GPS",
        {
            "longitudinal": "u, w, theta and altitude alone", "also": "further errors: scale_q, bias_theta, ...",
            "known": "errors that are zero", "positions": "of the sensors, FRD, m: `SensorPositions`",
            "input_noise": "standard deviation by input",
        },
    ),
    "gps_aided": Estimator(
        "IMU errors by GPS velocities (iterated Kalman smoother)", "Groves 2013, ch. 14; Bell 1994",
        "gps_aided:estimate_gps_aided", (), "path of a flight", {"arm": "from the antenna to the IMU, FRD, m"},
    ),
}  # fmt: skip
"""by key; a method is one file and one row"""


def methods(section: str) -> tuple[str, ...]:
    """Keys that the ``method`` of a map's section accepts."""
    return tuple(name for name, row in ESTIMATORS.items() if section in row.sections)
